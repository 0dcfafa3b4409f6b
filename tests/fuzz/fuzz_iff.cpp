// A file of form factors of any bytes: an Error, or one whose every panel can be asked for. The first byte says which
// checksums are made right, so that what lies behind them is reached as well.
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstring>
#include <span>

#include "fuzz_scene.h"
#include "interflect/formfactor/iff_closing.h"
#include "interflect/formfactor/iff_file.h"

namespace {

using namespace interflect;

std::uint64_t checksum_of(const std::string& bytes, std::size_t first, std::size_t count, std::uint64_t seed = 0) {
  return iff::checksum(std::as_bytes(std::span(bytes.data() + first, count)), seed);
}

template <typename T>
void put(std::string& bytes, std::size_t at, const T& value) {
  std::memcpy(bytes.data() + at, &value, sizeof value);
}

/// Sizes from n and the rows per panel, then header, entries, panels and closing section sealed as far as `which` says.
void seal(std::string& bytes, unsigned which) {
  if (bytes.size() < sizeof(iff::HeaderBytes)) return;
  iff::HeaderBytes header{};
  std::memcpy(&header, bytes.data(), sizeof header);
  iff::Shape shape{header.n % 200 + 1, (header.rows_per_panel % 4 + 1) * 32, 1, false, {}};
  if ((which & 1U) != 0) put(bytes, 0, iff::header_of(shape));
  if ((which & 2U) != 0) {
    std::memcpy(&header, bytes.data(), sizeof header);
    header.magic = iff::magic;
    header.version = iff::version;
    header.byte_order = iff::byte_order;
    put(bytes, 0, header);
    put(bytes, offsetof(iff::HeaderBytes, checksum), checksum_of(bytes, 0, offsetof(iff::HeaderBytes, checksum)));
    return;
  }
  if ((which & 4U) == 0) return;
  const std::uint64_t seed = iff::seed_of(shape), end = shape.closing_offset();
  if (bytes.size() < end + sizeof(iff::ClosingBytes)) {
    // The mutated bytes are the closing section's.
    const std::string body = bytes.substr(sizeof header);
    bytes.resize(end + sizeof(iff::ClosingBytes));
    bytes += body;
  }
  for (std::uint32_t panel = 0; panel < shape.panels(); ++panel) {
    iff::EntryBytes entry{};
    entry.state = iff::state_finished;
    entry.panel = panel;
    entry.rows_checksum = checksum_of(bytes, shape.panel_offset(panel), shape.panel_bytes(panel));
    entry.variance_checksum = checksum_of(bytes, shape.variance_offset(panel), shape.variances(panel) * sizeof(float));
    put(bytes, iff::Shape::table_offset() + panel * sizeof entry, iff::sealed(entry, seed));
  }
  const std::size_t body = end + sizeof(iff::ClosingBytes);
  put(bytes, end, iff::ClosingBytes{bytes.size() - body, checksum_of(bytes, body, bytes.size() - body, seed)});
}

void use(const IffFile& file) {
  const std::vector<std::uint32_t> damaged = file.damaged();
  if (file.area().size() != file.n() || file.scaling().size() != file.n()) fuzzing::found("areas miscounted");
  const Grouping grouping = group_surfaces(file, GroupBy::automatic);
  if (!damaged.empty()) {
    try {
      (void)read_form_factors(file);
    } catch (const Error&) {
      return;
    }
    fuzzing::found("a damaged panel was read");
  }
  if (read_form_factors(file).matrix.size() != file.n()) fuzzing::found("patches miscounted");
  (void)between(file, grouping);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  return fuzzing::run(data + 1, size - 1, [&](const std::string& input) {
    std::string bytes = input;
    seal(bytes, data[0]);
    static const int memory = ::memfd_create("fuzz.iff", 0);
    if (::ftruncate(memory, 0) != 0 || ::pwrite(memory, bytes.data(), bytes.size(), 0) < 0)
      fuzzing::found("no memory file");
    // The closing section once more by itself: nothing stands before its numbers.
    try {
      (void)iff::decode(std::as_bytes(std::span(input.data(), input.size())), data[0] % 8U + 1, "fuzz.iff");
    } catch (const Error&) {
    }
    const std::string name = "/proc/self/fd/" + std::to_string(memory);
    // What opens without its closing section gives its panels all the same.
    const IffFile panels = IffFile::open_panels(name);
    const bool closed = panels.closing_damage().empty();
    if (!closed && !panels.area().empty()) fuzzing::found("areas of a damaged closing section");
    if (!closed) static_cast<void>(panels.damaged());
    use(IffFile::open(name));
    if (!closed) fuzzing::found("a damaged closing section was read");
  });
}
