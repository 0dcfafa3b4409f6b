#include "interflect/formfactor/iff_store.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "interflect/formfactor/iff_closing.h"

namespace interflect {

namespace {

constexpr std::uint32_t none = ~std::uint32_t{0};

template <typename T>
std::span<const std::byte> bytes_of(const T& value) {
  return std::as_bytes(std::span(&value, 1));
}

/// The file that a name stands for, however many links lead there: a rename would replace a link.
std::filesystem::path target_of(std::filesystem::path path) {
  std::error_code none_there;
  constexpr int most = 40;  // as the system itself
  for (int links = 0; std::filesystem::is_symlink(path, none_there); ++links) {
    if (links == most) throw input_error(path.string(), 0, "cannot create: too many symbolic links");
    path = path.parent_path() / std::filesystem::read_symlink(path, none_there);
  }
  return path;
}

/// Whether a FILE.partial with such a header may be our own, of which the machine's fall left the beginning: not when
/// it is of something else or of another version.
bool may_be_torn(const iff::HeaderBytes& header) {
  if (header.magic == std::array<char, 8>{}) return true;
  return header.magic == iff::magic && header.version == iff::version && header.byte_order == iff::byte_order;
}

void check_replaceable(const std::filesystem::path& path) {
  std::error_code missing;
  if (!std::filesystem::exists(path, missing)) return;
  if (std::filesystem::is_directory(path, missing)) throw input_error(path.string(), 0, "is a folder, not a file");
  if (!std::filesystem::is_regular_file(path, missing)) {
    throw input_error(path.string(), 0, "is a pipe or a device, not a regular file");
  }
  if (::access(path.c_str(), W_OK) != 0) throw file_error(path.string(), "replace", errno);
}

}  // namespace

std::uint64_t iff_panel_target() {
  constexpr std::uint64_t target = std::uint64_t{32} << 20;
  return std::min(target, FormFactorMatrix::default_panel_bytes());
}

iff::Shape iff_shape(const PatchMesh& mesh, double divide, bool two_sided, double eps, std::uint64_t seed) {
  const auto n = static_cast<std::uint32_t>(mesh.size());
  // Some 16 panels of a small matrix, so that a part of it is something that can be in memory.
  const std::uint64_t part = std::max<std::uint64_t>(FormFactorMatrix::predicted_bytes(n) / 16, std::uint64_t{1} << 20);
  iff::Shape shape{n, iff::rows_of_panel(n, std::min(iff_panel_target(), part)), divide, two_sided, {}};
  shape.key.geometry = iff::geometry_hash(mesh);
  shape.key.eps = eps;
  shape.key.seed = seed;
  return shape;
}

namespace {

std::string made_by(std::uint32_t maker) {
  switch (maker) {
    case iff::maker_embree: return "the CPU path made it (--assembly host)";
    case iff::maker_opencl: return "OpenCL kernels made it (--assembly device --device opencl:0, or whichever it was)";
    case iff::maker_vulkan: return "Vulkan kernels made it (--assembly device --device vulkan:0, or whichever it was)";
    case iff::maker_cuda: return "CUDA kernels made it (--assembly device --device cuda:0, or whichever it was)";
    default: return "another version of the program began it";
  }
}

std::string difference(const iff::Key& has, const iff::Key& wanted) {
  if (has.eps != wanted.eps) return fmt::format("its accuracy is {}, {} is asked", has.eps, wanted.eps);
  if (has.seed != wanted.seed) return fmt::format("its seed is {}, {} is asked", has.seed, wanted.seed);
  if (has.algorithm != wanted.algorithm) return "another version of the program began it";
  return has.maker == wanted.maker ? "" : made_by(has.maker);
}

}  // namespace

std::string difference(const iff::Shape& has, const iff::Shape& wanted) {
  if (has.n != wanted.n) return fmt::format("its geometry is another: {} patches, not {}", has.n, wanted.n);
  if (has.key.geometry != wanted.key.geometry) return "its geometry is another";
  return difference(has.key, wanted.key);
}

IffClosing iff_closing(const PatchMesh& mesh, const std::vector<Material>& materials, Closure closure,
                       AssemblyReport report) {
  IffClosing out{closure, std::move(report), mesh.area, mesh.surface, {}};
  out.surfaces.reserve(mesh.surfaces.size());
  for (const Surface& surface : mesh.surfaces) {
    out.surfaces.push_back({surface.object, surface.group, materials.at(surface.material).name});
  }
  return out;
}

IffStore::IffStore(const std::filesystem::path& file, const iff::Shape& wanted, Options options)
    : path_(target_of(file)), options_(std::move(options)), held_(none) {
  if (options_.mode == Mode::make) {
    open_partial(wanted);
  } else {
    open_complete(wanted);
  }
  rows_.resize(shape_.panel_bytes(0) / sizeof(float));
}

IffStore::~IffStore() = default;

/// Keeps other processes out until this one ends or closes the file.
void IffStore::lock() {
  if (::flock(file_.get(), LOCK_EX | LOCK_NB) == 0) return;
  if (errno == EWOULDBLOCK) throw input_error(name_, 0, "another process is writing it");
  if (errno != ENOLCK && errno != ENOTSUP && errno != EINVAL) throw file_error(name_, "lock", errno);
}

void IffStore::open_partial(const iff::Shape& wanted) {
  check_replaceable(path_);
  name_ = path_.string() + ".partial";
  for (;;) {
    file_ = Descriptor(::open(name_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NONBLOCK, 0666));
    if (!file_) throw file_error(name_, "create", errno);
    (void)size_of(file_, name_);
    lock();
    // The process that had the lock may have renamed the file in between.
    struct stat opened {
    }, named{};
    if (::fstat(file_.get(), &opened) == 0 && ::stat(name_.c_str(), &named) == 0 && opened.st_ino == named.st_ino &&
        opened.st_dev == named.st_dev) {
      break;
    }
  }
  if (size_of(file_, name_) == 0) {
    start(wanted);
  } else {
    go_on(wanted);
  }
  if (options_.say && kept() > 0) {
    options_.say(fmt::format("{}: going on after {} of {} panels", name_, kept(), shape_.panels()));
  }
}

/// With what FILE.partial has. Finished panels and what is not our own are not thrown away.
void IffStore::go_on(const iff::Shape& wanted) {
  const auto start_anew = [&](std::string_view why) {
    if (options_.say) options_.say(fmt::format("{}: started anew", why));
    start(wanted);
  };
  iff::HeaderBytes header{};
  try {
    if (!read_at(file_, name_, 0, std::as_writable_bytes(std::span(&header, 1)))) {
      throw input_error(name_, 0, "ends within its header");
    }
    shape_ = iff::shape_of(header, name_);
    seed_ = iff::seed_of(shape_);
    table_ = iff::read_table(file_, name_, shape_);
  } catch (const Error& error) {
    if (!may_be_torn(header))
      throw Error(error.kind(), fmt::format("{}; remove it, or give another name", error.what()));
    if (!restore_header(wanted)) start_anew(error.what());
    return;
  }
  const std::string why = difference(shape_, wanted);
  if (why.empty()) return;
  if (kept() == 0) return start_anew(fmt::format("{}: {}", name_, why));
  throw input_error(name_, 0,
                    fmt::format("{}; {} of its {} panels are finished: give the options that it was begun with, or "
                                "remove it",
                                why, kept(), shape_.panels()));
}

/// An empty file with its header and a table in which nothing is finished.
void IffStore::start(const iff::Shape& wanted) {
  shape_ = wanted;
  if (::ftruncate(file_.get(), 0) != 0) throw file_error(name_, "write", errno);
  seed_ = iff::seed_of(shape_);
  table_.assign(shape_.panels(), {});
  std::vector<std::byte> front(shape_.data_offset());
  const iff::HeaderBytes header = iff::header_of(shape_);
  std::copy(bytes_of(header).begin(), bytes_of(header).end(), front.begin());
  write_at(file_, name_, 0, front);
  sync();
}

/// Where an entry proves that the file had the header of `wanted`, writes that header again.
bool IffStore::restore_header(const iff::Shape& wanted) {
  if (size_of(file_, name_) < wanted.data_offset()) return false;
  shape_ = wanted;
  seed_ = iff::seed_of(wanted);
  table_ = iff::read_table(file_, name_, wanted);
  if (kept() == 0) return false;
  const iff::HeaderBytes header = iff::header_of(wanted);
  write_at(file_, name_, 0, bytes_of(header));
  return true;
}

void IffStore::open_complete(const iff::Shape& wanted) {
  name_ = path_.string();
  const int how = options_.mode == Mode::read ? O_RDONLY : O_RDWR;
  file_ = Descriptor(::open(name_.c_str(), how | O_CLOEXEC | O_NONBLOCK));
  if (!file_) throw file_error(name_, "open", errno);
  const std::uint64_t bytes = size_of(file_, name_);
  if (options_.mode != Mode::read) lock();
  iff::HeaderBytes header{};
  try {
    if (bytes < sizeof header || !read_at(file_, name_, 0, std::as_writable_bytes(std::span(&header, 1)))) {
      throw input_error(name_, 0, "ends within its header");
    }
    shape_ = iff::shape_of(header, name_);
  } catch (const Error& error) {
    if (options_.mode != Mode::repair) throw;
    if (!restore_header(wanted)) {
      throw Error(ErrorKind::input, fmt::format("{}; no panel in it is of this scene with these options (--accuracy, "
                                                "--seed, --divide, --assembly): it is left as it is",
                                                error.what()));
    }
    if (options_.say) options_.say(fmt::format("{}: its header is written again", error.what()));
    return;
  }
  const std::string why = difference(shape_, wanted);
  if (!why.empty()) throw input_error(name_, 0, fmt::format("does not fit: {}", why));
  seed_ = iff::seed_of(shape_);
  if (options_.mode == Mode::repair && bytes < shape_.data_offset() &&
      ::ftruncate(file_.get(), static_cast<off_t>(shape_.data_offset())) != 0) {
    throw file_error(name_, "write", errno);
  }
  table_ = iff::read_table(file_, name_, shape_);
}

std::uint32_t IffStore::kept() const {
  std::uint32_t count = 0;
  for (std::uint32_t panel = 0; panel < table_.size(); ++panel)
    count += iff::valid(table_[panel], panel, seed_) ? 1 : 0;
  return count;
}

bool IffStore::bound_to_maker() const {
  wait();
  return options_.mode == Mode::repair || (options_.mode == Mode::make && kept() > 0);
}

std::string IffStore::how_to_go_on() const {
  wait();
  return fmt::format("{} of {} panels are kept in {}, and the same command goes on from there", kept(), shape_.panels(),
                     name_);
}

/// Reads a panel and says whether it is what it was when it was written.
bool IffStore::read(std::uint32_t panel) const {
  const iff::EntryBytes& entry = table_[panel];
  if (!iff::valid(entry, panel, seed_)) return false;
  wait();  // for the buffer
  held_ = none;
  const auto rows = std::span(rows_).first(shape_.panel_bytes(panel) / sizeof(float));
  variance_.resize(shape_.variances(panel));
  const auto matches = [&](std::span<float> values, std::uint64_t offset, std::uint64_t checksum) {
    return read_at(file_, name_, offset, std::as_writable_bytes(values)) &&
           iff::checksum(std::as_bytes(values)) == checksum;
  };
  if (!matches(rows, shape_.panel_offset(panel), entry.rows_checksum) ||
      !matches(variance_, shape_.variance_offset(panel), entry.variance_checksum)) {
    return false;
  }
  held_ = panel;
  return true;
}

bool IffStore::has(std::uint32_t panel) const {
  const bool there = read(panel);
  if (there) return true;
  if (options_.mode == Mode::read || options_.mode == Mode::close) {
    throw input_error(
        name_, 0, fmt::format("{}: checksum differs; `--repair` computes it again", iff::panel_name(shape_, panel)));
  }
  if (options_.say && (options_.mode == Mode::repair || iff::valid(table_[panel], panel, seed_))) {
    options_.say(fmt::format("{}: {}: checksum differs: computed again", name_, iff::panel_name(shape_, panel)));
  }
  return false;
}

void IffStore::read_columns(std::uint32_t panel, std::uint32_t first, std::uint32_t columns,
                            std::span<float> to) const {
  wait();  // it may be the panel that is being written
  // Whole rows lie one behind the other; of narrower ones each is read by itself.
  const bool whole = columns == shape_.stride();
  const std::uint32_t reads = whole ? 1 : shape_.rows(panel);
  const std::size_t length = whole ? std::size_t{columns} * shape_.rows(panel) : columns;
  for (std::uint32_t k = 0; k < reads; ++k) {
    const std::uint64_t offset = shape_.panel_offset(panel) + k * shape_.row_bytes() + first * sizeof(float);
    if (!read_at(file_, name_, offset, std::as_writable_bytes(to.subspan(k * length, length)))) {
      throw input_error(name_, 0, fmt::format("ends within {}", iff::panel_name(shape_, panel)));
    }
  }
}

TileFacts IffStore::load(std::uint32_t panel, FormFactorMatrix& s) {
  if (held_ != panel && !read(panel)) {
    throw Error(ErrorKind::internal, fmt::format("{}: panel {} was asked for and is not there", name_, panel));
  }
  if (s.size() != shape_.n) throw Error(ErrorKind::internal, "a matrix of another size");
  check_symmetry(panel, s);
  for (std::uint32_t k = 0; k < shape_.rows(panel); ++k) {
    const auto row = std::span(rows_).subspan(std::size_t{k} * shape_.stride(), shape_.n);
    std::copy(row.begin(), row.end(), s.row(shape_.first(panel) + k).begin());
  }
  const iff::EntryBytes& entry = table_[panel];
  return {entry.pairs, entry.analytic, entry.rays, 0, variance_};
}

Error IffStore::comes_out_otherwise(std::uint32_t panel) const {
  return input_error(name_, 0,
                     fmt::format("{} comes out otherwise than when the file was made (by another machine, device or "
                                 "driver?): remove the file, and compute it anew",
                                 iff::panel_name(shape_, panel)));
}

/// A panel that was computed again must agree with the mirror image that a later one has of it: S stays symmetric.
void IffStore::check_symmetry(std::uint32_t panel, const FormFactorMatrix& s) const {
  if (options_.mode != Mode::repair) return;
  for (const std::uint32_t again : saved_) {
    for (std::uint32_t k = 0; k < shape_.rows(panel); ++k) {
      const float* row = rows_.data() + std::size_t{k} * shape_.stride();
      const std::uint32_t j = shape_.first(panel) + k;
      for (std::uint32_t i = shape_.first(again); i < shape_.first(again) + shape_.rows(again); ++i) {
        if (row[i] == s.row(j)[i]) continue;  // the mirror image is there: `again` comes before `panel`
        throw comes_out_otherwise(again);
      }
    }
  }
}

void IffStore::sync() {
  if (::fdatasync(file_.get()) != 0 && errno != EINVAL) throw file_error(name_, "write", errno);
}

Error IffStore::no_room(const Error& cause, std::uint32_t panel) const {
  return {cause.kind(), fmt::format("{} ({}); {}", cause.what(), iff::panel_name(shape_, panel), how_to_go_on())};
}

void IffStore::prepare(std::uint32_t panel) {
  const std::uint64_t first = shape_.panel_offset(panel), bytes = shape_.panel_end(panel) - first;
  int error = 0;
  do {
    error = ::posix_fallocate(file_.get(), static_cast<off_t>(first), static_cast<off_t>(bytes));
  } while (error == EINTR);
  if (error == 0 || error == EOPNOTSUPP || error == EINVAL) return;  // a file system that cannot tell in advance
  wait();
  throw no_room(file_error(name_, "write", error), panel);
}

void IffStore::save(std::uint32_t panel, const FormFactorMatrix& s, const TileFacts& facts) {
  if (facts.variance.size() != shape_.variances(panel) || s.size() != shape_.n) {
    throw Error(ErrorKind::internal, fmt::format("{}: panel {} has facts of another shape", name_, panel));
  }
  wait();
  held_ = none;
  for (std::uint32_t k = 0; k < shape_.rows(panel); ++k) {
    const auto row = s.row(shape_.first(panel) + k);
    const auto to = std::span(rows_).subspan(std::size_t{k} * shape_.stride(), shape_.stride());
    std::fill(std::copy(row.begin(), row.end(), to.begin()), to.end(), 0.0F);
  }
  const iff::EntryBytes entry = entry_of(panel, facts);
  if (options_.mode == Mode::repair) check_same(entry);
  writing_ = panel;
  saved_.push_back(panel);
  pending_ = std::async(std::launch::async, [this, entry, variance = facts.variance] { write(entry, variance); });
  if (!options_.stop || !options_.stop()) return;
  wait();
  throw Error(ErrorKind::interrupted, how_to_go_on());
}

/// Where the entry of a damaged panel is sound, it says what the panel must be again.
void IffStore::check_same(const iff::EntryBytes& entry) const {
  const iff::EntryBytes& before = table_[entry.panel];
  if (!iff::valid(before, entry.panel, seed_)) return;
  if (before.rows_checksum != entry.rows_checksum || before.variance_checksum != entry.variance_checksum) {
    throw comes_out_otherwise(entry.panel);
  }
}

/// Whether no panel behind this one counts.
bool IffStore::last_valid(std::uint32_t panel) const {
  for (std::uint32_t later = panel + 1; later < shape_.panels(); ++later) {
    if (iff::valid(table_[later], later, seed_)) return false;
  }
  return true;
}

/// Data, then the entry that makes it count: at once, unless panels behind that count have yet to agree with it
/// (check_symmetry). Runs beside the next panel's computation.
void IffStore::write(const iff::EntryBytes& entry, const std::vector<float>& variance) {
  const auto rows = std::span(rows_).first(shape_.panel_bytes(entry.panel) / sizeof(float));
  write_at(file_, name_, shape_.panel_offset(entry.panel), std::as_bytes(rows));
  write_at(file_, name_, shape_.variance_offset(entry.panel), std::as_bytes(std::span(variance)));
  sync();
  if (options_.mode == Mode::repair && !last_valid(entry.panel)) {
    unproven_.push_back(entry);
  } else {
    write(entry);
  }
}

void IffStore::write(const iff::EntryBytes& entry) {
  write_at(file_, name_, iff::Shape::table_offset() + entry.panel * sizeof entry, bytes_of(entry));
  table_[entry.panel] = entry;
}

/// Until the panel that is being written has reached the file.
void IffStore::wait() const {
  if (!pending_.valid()) return;
  try {
    pending_.get();
  } catch (const Error& error) {
    throw no_room(error, writing_);
  }
}

/// Whether the file ends with this closing section already.
bool IffStore::closes_with(const iff::ClosingBytes& front, std::span<const std::byte> body) const {
  const std::uint64_t begin = shape_.closing_offset();
  if (size_of(file_, name_) != begin + sizeof front + body.size()) return false;
  std::vector<std::byte> there(sizeof front + body.size());
  return read_at(file_, name_, begin, there) &&
         std::equal(bytes_of(front).begin(), bytes_of(front).end(), there.begin()) &&
         std::equal(body.begin(), body.end(), there.begin() + sizeof front);
}

void IffStore::finish(const IffClosing& closing) {
  wait();
  if (options_.mode == Mode::read) throw Error(ErrorKind::internal, fmt::format("{} was opened to be read", name_));
  for (const iff::EntryBytes& entry : unproven_) write(entry);  // all panels have been seen
  unproven_.clear();
  if (kept() != shape_.panels()) {
    throw Error(ErrorKind::internal, fmt::format("{}: {} panels are missing", name_, shape_.panels() - kept()));
  }
  const std::string body = iff::encode(closing);
  const auto bytes = std::as_bytes(std::span(body.data(), body.size()));
  const iff::ClosingBytes front{bytes.size(), iff::checksum(bytes, seed_)};
  const std::uint64_t begin = shape_.closing_offset();
  if (options_.mode != Mode::make && closes_with(front, bytes)) return;
  try {
    write_at(file_, name_, begin, bytes_of(front));
    write_at(file_, name_, begin + sizeof front, bytes);
    if (::ftruncate(file_.get(), static_cast<off_t>(begin + sizeof front + bytes.size())) != 0 ||
        (::fsync(file_.get()) != 0 && errno != EINVAL)) {
      throw file_error(name_, "write", errno);
    }
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("{}; {}", error.what(), how_to_go_on()));
  }
  if (options_.mode != Mode::make) return;
  if (::rename(name_.c_str(), path_.c_str()) != 0) throw file_error(path_.string(), "rename the finished file", errno);
  const std::filesystem::path folder = path_.has_parent_path() ? path_.parent_path() : ".";
  const Descriptor entry(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (entry) ::fsync(entry.get());  // some file systems cannot; the file is there all the same
}

}  // namespace interflect
