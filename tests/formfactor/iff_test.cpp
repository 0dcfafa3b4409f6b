// The file of form factors: what comes back, what damage is found, what a store continues and repairs.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "formfactor/broken.h"
#include "interflect/base/error.h"
#include "interflect/formfactor/iff_closing.h"
#include "interflect/formfactor/iff_file.h"
#include "interflect/formfactor/iff_store.h"
#include "sanitized.h"

namespace interflect {
namespace {

using test::Builder;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// A closed room with a box in it: 240 patches, 8 rows of tiles.
Builder room() {
  Builder b;
  b.part("walls").box({0, 0, 0}, {4, 3, 2.5}, true, 4);
  b.part("box").box({1, 1, 0.2}, {2, 1.7, 1}, false, 2);
  return b;
}

std::string content_of(const std::string& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

void write(const std::string& path, const std::string& content) {
  std::ofstream(path, std::ios::binary) << content;
}

/// What an action throws; empty when it does not.
template <typename Action>
std::string error_of(const Action& action, ErrorKind kind = ErrorKind::input) {
  try {
    action();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind) << error.what();
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    return error.what();
  }
  return "";
}

class Iff : public ::testing::Test {
 protected:
  static constexpr std::uint32_t rows = 64;

  Iff()
      : folder_(::testing::TempDir() + "/iff-" + ::testing::UnitTest::GetInstance()->current_test_info()->name() + "-" +
                std::to_string(::getpid())) {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
  }
  ~Iff() override { std::filesystem::remove_all(folder_); }
  Iff(const Iff&) = delete;
  Iff& operator=(const Iff&) = delete;

  [[nodiscard]] std::string file(const std::string& name = "room.iff") const { return folder_ + "/" + name; }
  [[nodiscard]] iff::Shape shape(std::uint64_t seed = 1) const {
    iff::Shape out = iff_shape(mesh_, 0.25, false, 5e-3, seed);
    out.rows_per_panel = rows;
    return out;
  }
  /// As the command line does it; throws what it throws.
  FormFactors make(const std::string& name, IffStore::Options options = {}, std::uint64_t seed = 1) {
    IffStore store(name, shape(seed), std::move(options));
    AssemblyOptions assembly;
    assembly.panels = &store;
    assembly.seed = seed;
    FormFactors out = assemble(mesh_, assembly);
    store.finish(iff_closing(mesh_, materials_, assembly.closure, out.report));
    saved_ = store.saved();
    return out;
  }
  IffStore::Options saying(IffStore::Mode mode = IffStore::Mode::make) {
    return {mode, {}, [this](const std::string& line) { said_.push_back(line); }};
  }

  Builder builder_ = room();
  PatchMesh mesh_ = builder_.mesh();
  std::vector<Material> materials_{Material{"white"}};
  std::string folder_;
  std::vector<std::uint32_t> saved_;
  std::vector<std::string> said_;
};

bool equal(const FormFactorMatrix& a, const FormFactorMatrix& b) {
  for (std::uint32_t i = 0; i < a.size(); ++i) {
    if (std::memcmp(a.row(i).data(), b.row(i).data(), a.row(i).size_bytes()) != 0) return false;
  }
  return a.size() == b.size();
}

TEST_F(Iff, WhatComesBackIsTheSameToTheBit) {
  const FormFactors without = assemble(mesh_);
  const FormFactors made = make(file());
  EXPECT_TRUE(equal(without.matrix, made.matrix)) << "keeping panels changes nothing";
  EXPECT_FALSE(std::filesystem::exists(file() + ".partial"));
  const IffFile there = IffFile::open(file());
  EXPECT_EQ(there.n(), 240U);
  EXPECT_EQ(there.panels(), 4U);
  EXPECT_THAT(there.damaged(), IsEmpty());
  const FormFactors read = read_form_factors(there);
  EXPECT_TRUE(equal(without.matrix, read.matrix));
  EXPECT_EQ(read.report.row_sum, made.report.row_sum);
  EXPECT_EQ(read.report.row_sum_before, made.report.row_sum_before);
  EXPECT_EQ(read.report.scaling, made.report.scaling);
  EXPECT_EQ(read.report.tile_variance, made.report.tile_variance);
  EXPECT_EQ(read.report.rays, made.report.rays);
  EXPECT_EQ(read.report.pairs_considered, made.report.pairs_considered);
  EXPECT_EQ(read.report.pairs_analytic, made.report.pairs_analytic);
  EXPECT_EQ(read.report.warnings, made.report.warnings);
  EXPECT_EQ(read.report.closure_max_change, made.report.closure_max_change);
  EXPECT_EQ(read.report.after.mean, made.report.after.mean);
  EXPECT_GT(read.report.rays, 0U);
  std::uint32_t visited = 0;
  rows_of(there)([&](std::uint32_t i, std::span<const float> row) {
    EXPECT_EQ(i, visited++);
    EXPECT_EQ(std::memcmp(row.data(), read.matrix.row(i).data(), row.size_bytes()), 0) << i;
  });
  EXPECT_EQ(visited, 240U);
  // The twin: another seed gives other bits, which the comparison sees.
  EXPECT_FALSE(equal(make(file("other.iff"), {}, 2).matrix, read.matrix));
}

TEST_F(Iff, GroupsComeFromTheFileAlone) {
  const FormFactors made = make(file());
  const IffFile there = IffFile::open(file());
  const Grouping grouping = group_surfaces(there, GroupBy::group);
  EXPECT_THAT(grouping.names, ElementsAre("walls", "box"));
  const GroupFactors a = between(made.matrix, mesh_, builder_.grouping()), b = between(there, grouping);
  EXPECT_EQ(a.areas, b.areas);
  EXPECT_EQ(a.factors, b.factors);
  EXPECT_THAT(group_surfaces(there, GroupBy::material).names, ElementsAre("white"));
}

TEST_F(Iff, PanelsLieAtPagesAndReadAlone) {
  (void)make(file());
  const IffFile there = IffFile::open(file());
  const std::string content = content_of(file());
  std::vector<float> rows_read;
  for (std::uint32_t panel = 0; panel < there.panels(); ++panel) {
    EXPECT_EQ(there.shape().panel_offset(panel) % 4096, 0U);
    rows_read.resize(std::size_t{there.rows(panel)} * there.stride());
    there.read_panel(panel, rows_read);
    EXPECT_EQ(std::memcmp(rows_read.data(), content.data() + there.shape().panel_offset(panel),
                          rows_read.size() * sizeof(float)),
              0);
  }
  EXPECT_EQ(error_of([&] { there.read_panel(0, std::span(rows_read).first(3)); }, ErrorKind::internal).empty(), false);
}

TEST_F(Iff, EveryDamagedByteIsFound) {
  const FormFactors made = make(file());
  const std::string whole = content_of(file());
  const iff::Shape shape = IffFile::open(file()).shape();
  const auto damaged_at = [&](std::uint64_t at) {
    std::string bytes = whole;
    bytes.at(at) = static_cast<char>(bytes[at] ^ 0x10);
    write(file("damaged.iff"), bytes);
    return error_of([&] { (void)read_form_factors(IffFile::open(file("damaged.iff"))); });
  };
  for (std::uint64_t at = 0; at < sizeof(iff::HeaderBytes); ++at) EXPECT_NE(damaged_at(at), "") << "header " << at;
  for (std::uint64_t at = 0; at < 4 * sizeof(iff::EntryBytes); at += 7) {
    const std::string panel = "panel " + std::to_string(at / sizeof(iff::EntryBytes)) + " (rows ";
    EXPECT_THAT(damaged_at(iff::Shape::table_offset() + at), HasSubstr(panel)) << "table " << at;
  }
  for (std::uint32_t panel = 0; panel < shape.panels(); ++panel) {
    const std::string name =
        file("damaged.iff") + ": " + iff::panel_name(shape, panel) + ": checksum differs; `--repair` computes it again";
    const std::uint64_t first = shape.panel_offset(panel);
    const std::uint64_t end = shape.variance_offset(panel) + shape.variances(panel) * sizeof(float);
    for (std::uint64_t at = first; at < end; at += 20011) EXPECT_EQ(damaged_at(at), name) << at;
    EXPECT_EQ(damaged_at(end - 1), name) << "the variances' last byte";
  }
  for (std::uint64_t at = shape.closing_offset(); at < whole.size();
       at += at < shape.closing_offset() + 100 ? 7 : 307) {
    EXPECT_THAT(damaged_at(at), HasSubstr("closing section: ")) << at;
  }
  EXPECT_EQ(damaged_at(sizeof(iff::HeaderBytes) + 1), "") << "nothing is kept there";
}

TEST_F(Iff, ATruncatedFileIsFoundAtEveryLength) {
  (void)make(file());
  const std::string whole = content_of(file());
  for (std::size_t bytes = 0; bytes < whole.size(); bytes += bytes < 8192 ? 61 : 9001) {
    write(file("cut.iff"), whole.substr(0, bytes));
    EXPECT_NE(error_of([&] { (void)IffFile::open(file("cut.iff")); }), "") << bytes;
  }
  write(file("long.iff"), whole + "x");
  EXPECT_THAT(error_of([&] { (void)IffFile::open(file("long.iff")); }), HasSubstr("closing section"));
  EXPECT_THAT(error_of([&] { (void)IffFile::open(folder_); }), HasSubstr("folder"));
  EXPECT_THAT(error_of([&] { (void)IffFile::open("/dev/null"); }), HasSubstr("not a regular file"));
  EXPECT_THAT(error_of([&] { (void)IffFile::open(file("none.iff")); }), HasSubstr("No such file"));
}

/// While it lives, this process may have no more than 64 MiB of address space beyond what it has. Not under a
/// sanitizer, which needs more of it than there is memory.
class LittleMemory {
 public:
  LittleMemory() {
    ::getrlimit(RLIMIT_AS, &before_);
    std::uint64_t pages = 0;
    std::ifstream("/proc/self/statm") >> pages;
    struct rlimit tight = before_;
    tight.rlim_cur = pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE)) + (std::uint64_t{64} << 20);
    if (!test::sanitized) ::setrlimit(RLIMIT_AS, &tight);
  }
  LittleMemory(const LittleMemory&) = delete;
  LittleMemory& operator=(const LittleMemory&) = delete;
  ~LittleMemory() { ::setrlimit(RLIMIT_AS, &before_); }

 private:
  struct rlimit before_ {};
};

/// Headers whose checksum is right and whose numbers are not.
TEST_F(Iff, LyingHeadersAreRefusedWithoutAllocating) {
  (void)make(file());
  const std::string whole = content_of(file());
  iff::HeaderBytes header{};
  std::memcpy(&header, whole.data(), sizeof header);
  const auto refused = [&](const std::function<void(iff::HeaderBytes&)>& lie) {
    iff::HeaderBytes lying = header;
    lie(lying);
    lying.checksum = iff::checksum(std::as_bytes(std::span(&lying, 1)).first(offsetof(iff::HeaderBytes, checksum)));
    std::string bytes = whole;
    std::memcpy(bytes.data(), &lying, sizeof lying);
    write(file("lie.iff"), bytes);
    const LittleMemory limit;
    return error_of([&] { (void)IffFile::open(file("lie.iff")); });
  };
  if (!test::sanitized) {  // the twin: as much as the table of a huge matrix would need is refused
    const LittleMemory limit;
    EXPECT_THROW((void)std::make_unique<char[]>(std::size_t{1} << 30), std::bad_alloc);
  }
  EXPECT_EQ(refused([](iff::HeaderBytes&) {}), "");
  EXPECT_THAT(refused([](iff::HeaderBytes& h) { h.n = 0; }), HasSubstr("0 patches"));
  EXPECT_THAT(refused([](iff::HeaderBytes& h) { h.n = ~0U; }), HasSubstr("patches"));
  EXPECT_THAT(refused([](iff::HeaderBytes& h) { h.rows_per_panel = 33; }), HasSubstr("rows per panel"));
  EXPECT_THAT(refused([](iff::HeaderBytes& h) { h.rows_per_panel = 0; }), HasSubstr("rows per panel"));
  EXPECT_THAT(refused([](iff::HeaderBytes& h) { h.storage = 7; }), HasSubstr("storage format 7"));
  EXPECT_THAT(refused([](iff::HeaderBytes& h) { h.version = 2; }), HasSubstr("version 2"));
  EXPECT_THAT(refused([](iff::HeaderBytes& h) { h.byte_order = 0x04030201; }), HasSubstr("byte order"));
  EXPECT_THAT(refused([](iff::HeaderBytes& h) { h.eps = std::nan(""); }), HasSubstr("make no sense"));
  for (const auto field : {&iff::HeaderBytes::stride, &iff::HeaderBytes::panels}) {
    EXPECT_THAT(refused([&](iff::HeaderBytes& h) { h.*field += 16; }), HasSubstr("do not go together"));
  }
  for (const auto field : {&iff::HeaderBytes::pitch, &iff::HeaderBytes::closing_offset, &iff::HeaderBytes::data_offset,
                           &iff::HeaderBytes::table_offset}) {
    EXPECT_THAT(refused([&](iff::HeaderBytes& h) { h.*field = ~std::uint64_t{4095}; }),
                HasSubstr("do not go together"));
  }
  // A consistent header of a huge matrix: the file is too short for it.
  iff::Shape huge = shape();
  huge.n = 1U << 30;
  EXPECT_THAT(refused([&](iff::HeaderBytes& h) { h = iff::header_of(huge); }), HasSubstr("cut short"));
}

TEST_F(Iff, ALyingClosingSectionIsRefused) {
  (void)make(file());
  const IffFile there = IffFile::open(file());
  const std::string body = iff::encode(there.closing());
  const auto bytes = [](const std::string& text) { return std::as_bytes(std::span(text.data(), text.size())); };
  EXPECT_EQ(iff::encode(iff::decode(bytes(body), 240, "f")), body);
  for (std::size_t length = 0; length < body.size(); length += length < 200 ? 1 : 37) {
    EXPECT_THAT(error_of([&] { (void)iff::decode(bytes(body).first(length), 240, "f"); }), HasSubstr("makes no sense"));
  }
  std::string longer = body + '\0';
  EXPECT_NE(error_of([&] { (void)iff::decode(bytes(longer), 240, "f"); }), "");
  const auto changed = [&](const std::function<void(IffClosing&)>& change) {
    IffClosing closing = there.closing();
    change(closing);
    const std::string text = iff::encode(closing);
    return error_of([&] { (void)iff::decode(bytes(text), 240, "f"); });
  };
  EXPECT_NE(changed([](IffClosing& c) { c.surface[3] = 2; }), "");
  EXPECT_NE(changed([](IffClosing& c) { c.report.set_aside = {240}; }), "");
  EXPECT_NE(changed([](IffClosing& c) { c.area[0] = -1; }), "");
  EXPECT_NE(changed([](IffClosing& c) { c.report.scaling[0] = 0; }), "");
  EXPECT_NE(changed([](IffClosing& c) { c.report.scaling[0] = std::nan(""); }), "");
  EXPECT_EQ(changed([](IffClosing& c) { c.report.warnings = {"a", ""}; }), "");
}

TEST_F(Iff, AnInterruptedRunGoesOnAndGivesTheSameFile) {
  (void)make(file("undisturbed.iff"));
  for (const int after : {1, 2, 3}) {
    const std::string name = file("stopped" + std::to_string(after) + ".iff");
    int panels = 0;
    IffStore::Options options = saying();
    options.stop = [&] { return ++panels == after; };
    const std::string line = error_of([&] { (void)make(name, options); }, ErrorKind::interrupted);
    EXPECT_THAT(line, HasSubstr(std::to_string(after) + " of 4 panels are kept in " + name + ".partial"));
    EXPECT_FALSE(std::filesystem::exists(name));
    const FormFactors again = make(name, saying());
    EXPECT_EQ(again.report.panels_reused, static_cast<std::uint32_t>(after));
    EXPECT_THAT(said_.back(), HasSubstr("going on after " + std::to_string(after) + " of 4 panels"));
    EXPECT_EQ(content_of(name), content_of(file("undisturbed.iff")));
  }
}

/// Whatever a killed process leaves of a panel in hand: bytes without an entry, or an entry that is torn.
TEST_F(Iff, HalfWrittenPanelsDoNotCount) {
  (void)make(file("undisturbed.iff"));
  const std::string whole = content_of(file("undisturbed.iff"));
  const iff::Shape shape = IffFile::open(file("undisturbed.iff")).shape();
  for (const std::uint64_t end : {std::uint64_t{0}, std::uint64_t{100}, std::uint64_t{4096 + 64},
                                  shape.panel_offset(1) + 5, shape.closing_offset() + 8}) {
    std::string bytes = whole.substr(0, end);
    write(file("a.iff.partial"), bytes);
    (void)make(file("a.iff"));
    EXPECT_EQ(content_of(file("a.iff")), whole) << end;
    // The same end with a table that knows nothing yet of panel 2, torn in its entry.
    if (end < shape.data_offset()) continue;
    std::memset(bytes.data() + 4096 + 2 * 64 + 24, 0, 40);
    write(file("b.iff.partial"), bytes);
    (void)make(file("b.iff"));
    EXPECT_EQ(content_of(file("b.iff")), whole) << end;
  }
}

TEST_F(Iff, FinishedPanelsOfAnotherKeyAreNotThrownAway) {
  (void)make(file("undisturbed.iff"));
  const std::string partial = file() + ".partial";
  IffStore::Options options;
  options.stop = [] { return true; };
  EXPECT_NE(error_of([&] { (void)make(file(), options, 2); }, ErrorKind::interrupted), "");
  const std::string begun = content_of(partial);
  EXPECT_THAT(error_of([&] { (void)make(file()); }),
              HasSubstr("its seed is 2, 1 is asked; 1 of its 4 panels are finished: give the options that it was begun "
                        "with, or remove it"));
  EXPECT_EQ(content_of(partial), begun);
  // With nothing finished there is nothing to lose.
  std::string nothing = begun;
  std::memset(nothing.data() + iff::Shape::table_offset(), 0, 4 * sizeof(iff::EntryBytes));
  write(partial, nothing);
  (void)make(file(), saying());
  EXPECT_THAT(said_, ElementsAre(HasSubstr("its seed is 2, 1 is asked: started anew")));
  EXPECT_EQ(content_of(file()), content_of(file("undisturbed.iff")));
  // A byte of the header is not worth the panels.
  write(partial, content_of(file()));
  std::string scratched = content_of(partial);
  scratched[70] ^= 1;
  write(partial, scratched);
  EXPECT_EQ(make(file()).report.panels_reused, 4U);
  EXPECT_EQ(content_of(file()), content_of(file("undisturbed.iff")));
}

TEST_F(Iff, APartialFileThatIsSomethingElseIsLeftAlone) {
  (void)make(file("undisturbed.iff"));
  std::string newer = content_of(file("undisturbed.iff"));
  newer[8] = 2;
  for (const std::string& content : {newer, std::string("the only copy of something"), std::string(9000, 'x')}) {
    write(file() + ".partial", content);
    EXPECT_THAT(error_of([&] { (void)make(file()); }), HasSubstr("; remove it, or give another name"));
    EXPECT_EQ(content_of(file() + ".partial"), content);
  }
  write(file() + ".partial", std::string(9000, '\0'));  // the beginning of one that never reached the disk
  (void)make(file());
  EXPECT_EQ(content_of(file()), content_of(file("undisturbed.iff")));
}

TEST_F(Iff, TheBackendsAreNotMixed) {
  IffStore::Options options;
  options.stop = [] { return true; };
  EXPECT_NE(error_of([&] { (void)make(file(), options); }, ErrorKind::interrupted), "");
  const auto with_maker = [&](std::uint32_t maker) {
    iff::Shape other = shape();
    other.key.maker = maker;
    return other;
  };
  EXPECT_THAT(error_of([&] { const IffStore store(file(), with_maker(iff::maker_opencl), {}); }),
              HasSubstr("the CPU path made it (--assembly host); 1 of its 4 panels are finished"));
  for (const char* backend : {"opencl", "vulkan", "cuda"}) {
    const iff::Shape its = with_maker(iff::maker_of(backend));
    for (const auto& other : {shape(), with_maker(its.key.maker % 3 + 1)}) {
      EXPECT_THAT(difference(its, other), HasSubstr(std::string("--assembly device --device ") + backend + ":0"));
    }
    EXPECT_EQ(difference(its, its), "");
  }
  EXPECT_NE(error_of([] { (void)iff::maker_of("openmp"); }, ErrorKind::internal), "");
}

/// A header with this scene's hash and another n must not reach a matrix of the scene's size.
TEST_F(Iff, AHeaderOfAnotherSizeWithThisGeometryIsRefused) {
  (void)make(file("undisturbed.iff"));
  for (const std::uint32_t n : {200U, 256U, 320U}) {
    iff::Shape crafted = shape();
    crafted.n = n;
    const iff::HeaderBytes header = iff::header_of(crafted);
    iff::EntryBytes entry{};
    entry.state = iff::state_finished;
    std::string bytes = content_of(file("undisturbed.iff"));
    bytes.resize(crafted.closing_offset() + 100);
    const auto of = [&](std::uint64_t at, std::uint64_t count) {
      return iff::checksum(std::as_bytes(std::span(bytes.data() + at, count)));
    };
    entry.rows_checksum = of(crafted.panel_offset(0), crafted.panel_bytes(0));
    entry.variance_checksum = of(crafted.variance_offset(0), crafted.variances(0) * sizeof(float));
    entry = iff::sealed(entry, header.checksum);
    std::memcpy(bytes.data(), &header, sizeof header);
    std::memcpy(bytes.data() + iff::Shape::table_offset(), &entry, sizeof entry);
    write(file(), bytes);
    write(file() + ".partial", bytes);
    const std::string says = "its geometry is another: " + std::to_string(n) + " patches, not 240";
    for (const auto mode :
         {IffStore::Mode::make, IffStore::Mode::repair, IffStore::Mode::close, IffStore::Mode::read}) {
      EXPECT_THAT(error_of([&] { (void)make(file(), {mode, {}, {}}); }), HasSubstr(says));
    }
    EXPECT_EQ(content_of(file()), bytes);
    EXPECT_EQ(content_of(file() + ".partial"), bytes);
  }
}

TEST_F(Iff, BuffersOfManyThreadsCountAsMemory) {
  (void)make(file());
  const IffFile there = IffFile::open(file());
  const std::uint64_t matrix = FormFactorMatrix::predicted_bytes(240), buffer = there.shape().panel_bytes(0);
  EXPECT_EQ(panels_at_a_time(there, matrix + buffer, 8), 1U);
  EXPECT_EQ(panels_at_a_time(there, matrix + 4 * buffer - 1, 8), 3U);
  EXPECT_EQ(panels_at_a_time(there, 10 * matrix, 8), 4U) << "panels";
  EXPECT_EQ(panels_at_a_time(there, 10 * matrix, 2), 2U) << "threads";
  EXPECT_THAT(error_of([&] { (void)read_form_factors(there, matrix + buffer - 1); }, ErrorKind::limit),
              HasSubstr("240 patches need"));
  EXPECT_TRUE(equal(read_form_factors(there, matrix + buffer).matrix, read_form_factors(there).matrix));
}

TEST_F(Iff, DamagedPanelsAreComputedAgainAlone) {
  (void)make(file("undisturbed.iff"));
  const std::string whole = content_of(file("undisturbed.iff"));
  const iff::Shape shape = IffFile::open(file("undisturbed.iff")).shape();
  const auto repaired = [&](const std::vector<std::uint64_t>& places) {
    std::string bytes = whole;
    for (const std::uint64_t at : places) bytes.at(at) = static_cast<char>(~bytes[at]);
    write(file(), bytes);
    (void)make(file(), saying(IffStore::Mode::repair));
    EXPECT_EQ(content_of(file()), whole);
    return saved_;
  };
  EXPECT_THAT(repaired({}), IsEmpty());
  EXPECT_THAT(repaired({shape.panel_offset(2) + 4321}), ElementsAre(2));
  EXPECT_THAT(said_.back(), HasSubstr("panel 2 (rows 128 to 191): checksum differs: computed again"));
  EXPECT_THAT(repaired({shape.variance_offset(1)}), ElementsAre(1));
  EXPECT_THAT(repaired({4096 + 3 * 64 + 40, shape.panel_offset(0)}), ElementsAre(0, 3));
  EXPECT_THAT(repaired({shape.closing_offset() + 500}), IsEmpty());
  EXPECT_THAT(repaired({30}), IsEmpty()) << "the header; the entries prove that they belong to it";
  write(file(), whole.substr(0, shape.panel_offset(2) + 77));
  (void)make(file(), saying(IffStore::Mode::repair));
  EXPECT_EQ(content_of(file()), whole);
  EXPECT_THAT(saved_, ElementsAre(2, 3));
}

/// The twin: panels that come out otherwise are not mixed with the others, and the file does not serve afterwards.
TEST_F(Iff, ARepairByOtherArithmeticIsRefused) {
  (void)make(file());
  const std::string whole = content_of(file());
  const iff::Shape shape = this->shape();
  const auto other_arithmetic = [&] {
    IffStore store(file(), shape, {IffStore::Mode::repair, {}, {}});
    AssemblyOptions assembly;
    assembly.panels = &store;
    assembly.seed = 7;  // as another machine's arithmetic would, it gives other values
    (void)assemble(mesh_, assembly);
  };
  const std::uint64_t rows_of_1 = shape.panel_offset(1) + 400, rows_of_2 = shape.panel_offset(2) + 400;
  const std::uint64_t entry_of_1 = iff::Shape::table_offset() + sizeof(iff::EntryBytes) + 24;
  for (const auto& [at, panel] :
       {std::pair(rows_of_1, "panel 1 (rows 64 to 127)"), std::pair(rows_of_2, "panel 2 (rows 128 to 191)"),
        std::pair(entry_of_1, "panel 1 (rows 64 to 127)")}) {
    std::string bytes = whole;
    bytes[at] ^= 1;
    write(file(), bytes);
    for (int again = 0; again < 2; ++again) {  // the first try must not make the file look sound
      EXPECT_THAT(error_of(other_arithmetic), HasSubstr(std::string(panel) + " comes out otherwise")) << at;
      EXPECT_THAT(error_of([&] { (void)read_form_factors(IffFile::open(file())); }),
                  HasSubstr(std::string(panel) + ": checksum differs"));
    }
    (void)make(file(), saying(IffStore::Mode::repair));
    EXPECT_EQ(content_of(file()), whole) << "what made it can still repair it";
  }
  EXPECT_THAT(error_of([&] {
                (void)make(file(), {IffStore::Mode::repair, {}, {}}, 2);
              }),
              HasSubstr("does not fit: its seed is 1, 2 is asked"));
}

TEST_F(Iff, AnInterruptedRepairGoesOn) {
  (void)make(file());
  const std::string whole = content_of(file());
  for (const std::vector<std::uint32_t>& panels : {std::vector<std::uint32_t>{1}, {0, 2}, {2, 3}}) {
    std::string bytes = whole;
    for (const std::uint32_t panel : panels) {  // the entry and the rows
      bytes[iff::Shape::table_offset() + panel * sizeof(iff::EntryBytes) + 24] ^= 1;
      bytes[shape().panel_offset(panel) + 40] ^= 1;
    }
    write(file(), bytes);
    const IffStore::Options stopped{IffStore::Mode::repair, [] { return true; }, {}};
    EXPECT_THAT(error_of([&] { (void)make(file(), stopped); }, ErrorKind::interrupted), HasSubstr("panels are kept"));
    (void)make(file(), saying(IffStore::Mode::repair));
    EXPECT_EQ(content_of(file()), whole);
  }
}

/// Only a file that was made from this scene with these options gets its header back.
TEST_F(Iff, ARepairLeavesWhatIsSomethingElseAsItIs) {
  (void)make(file("undisturbed.iff"));
  (void)make(file("seed2.iff"), {}, 2);
  std::string of_seed_2 = content_of(file("seed2.iff")), newer = of_seed_2;
  of_seed_2[70] ^= 1;
  newer[8] = 2;
  for (const std::string& content :
       {std::string("not form factors"), std::string(100'000, 'x'), std::string(), of_seed_2, newer}) {
    write(file(), content);
    EXPECT_THAT(error_of([&] { (void)make(file(), saying(IffStore::Mode::repair)); }),
                HasSubstr("no panel in it is of this scene with these options"));
    EXPECT_EQ(content_of(file()), content);
  }
  // The twin: with the seed that it was made with.
  write(file(), of_seed_2);
  (void)make(file(), saying(IffStore::Mode::repair), 2);
  EXPECT_EQ(content_of(file()), content_of(file("seed2.iff")));
  EXPECT_THAT(said_, ElementsAre(HasSubstr("header: checksum differs: its header is written again")));
}

/// Whatever a kill, or a full disk, leaves of a closing section that is written anew: the panels serve on.
TEST_F(Iff, ABrokenClosingSectionIsWrittenAnew) {
  (void)make(file("undisturbed.iff"));
  const std::string whole = content_of(file("undisturbed.iff"));
  const std::uint64_t end = shape().closing_offset();
  // The store keeps the panels; the closing section is another one.
  const auto close = [&](Closure closure) {
    IffStore store(file(), shape(), {IffStore::Mode::close, {}, {}});
    AssemblyOptions assembly;
    assembly.panels = &store;
    assembly.closure = closure;
    const FormFactors out = assemble(mesh_, assembly);
    EXPECT_EQ(out.report.panels_reused, 4U);
    store.finish(iff_closing(mesh_, materials_, closure, out.report));
  };
  write(file(), whole);
  close(Closure::off);
  const std::string open_one = content_of(file());
  EXPECT_TRUE(IffFile::open_panels(file()).closed_as(Closure::off));
  ASSERT_NE(open_one, whole);
  for (const std::uint64_t reached : {end, end + 3, end + 16, end + 400, std::uint64_t{whole.size()} - 1}) {
    for (const bool cut : {false, true}) {  // what was there before lies behind, or nothing does
      write(file(), open_one.substr(0, reached) + (cut ? "" : whole.substr(reached)));
      if (content_of(file()) == whole || content_of(file()) == open_one) continue;
      EXPECT_THAT(error_of([&] { (void)IffFile::open(file()); }), HasSubstr("closing section: ")) << reached;
      const IffFile there = IffFile::open_panels(file());
      EXPECT_THAT(there.closing_damage(), HasSubstr("closing section: "));
      EXPECT_FALSE(there.closed_as(Closure::automatic) || there.closed_as(Closure::off));
      EXPECT_THAT(there.damaged(), IsEmpty());
      close(Closure::automatic);
      EXPECT_EQ(content_of(file()), whole) << reached;
    }
  }
  // A damaged panel is not computed behind the user's back.
  std::string damaged = open_one;
  damaged[shape().panel_offset(2)] ^= 1;
  write(file(), damaged);
  EXPECT_THAT(error_of([&] { close(Closure::automatic); }), HasSubstr("panel 2 (rows 128 to 191): checksum differs"));
  EXPECT_EQ(content_of(file()), damaged);
}

TEST_F(Iff, TheGeometryDecidesAndTheLooksDoNot) {
  const auto hash = iff::geometry_hash(mesh_);
  PatchMesh repainted = mesh_;
  repainted.reflectance[3] = {0.1, 0.2, 0.3};
  repainted.emittance[0] = {7, 7, 7};
  EXPECT_EQ(iff::geometry_hash(repainted), hash);
  PatchMesh moved = mesh_;
  moved.vertices[5].x += 1e-12;
  EXPECT_NE(iff::geometry_hash(moved), hash);
  PatchMesh reordered = mesh_;
  std::swap(reordered.corners[0], reordered.corners[1]);
  EXPECT_NE(iff::geometry_hash(reordered), hash);
}

TEST_F(Iff, ASecondProcessIsKeptOut) {
  const IffStore first(file(), shape(), {});
  EXPECT_THAT(error_of([&] { const IffStore second(file(), shape(), {}); }),
              HasSubstr("another process is writing it"));
}

/// Files beyond the process's limit, as on a full disk.
TEST_F(Iff, AFullDiskLeavesWhatIsFinished) {
  (void)make(file("undisturbed.iff"));
  const iff::Shape shape = this->shape();
  struct rlimit before {};
  ::getrlimit(RLIMIT_FSIZE, &before);
  struct sigaction ignore {
  }, old{};
  ignore.sa_handler = SIG_IGN;
  ::sigaction(SIGXFSZ, &ignore, &old);
  for (const std::uint64_t room_for : {shape.panel_offset(2) + 4096, shape.closing_offset() + 20}) {
    std::filesystem::remove(file());
    struct rlimit tight = before;
    tight.rlim_cur = room_for;
    ::setrlimit(RLIMIT_FSIZE, &tight);
    const std::string line = error_of([&] { (void)make(file()); }, ErrorKind::limit);
    ::setrlimit(RLIMIT_FSIZE, &before);
    const char* kept = room_for < shape.closing_offset() ? "2 of 4 panels are kept" : "4 of 4 panels are kept";
    EXPECT_THAT(line, HasSubstr("File too large"));
    EXPECT_THAT(line, HasSubstr(kept));
    EXPECT_FALSE(std::filesystem::exists(file()));
    EXPECT_GE(make(file()).report.panels_reused, 2U);
    EXPECT_EQ(content_of(file()), content_of(file("undisturbed.iff")));
  }
  // The closing section anew, of a complete file.
  struct rlimit tight = before;
  tight.rlim_cur = shape.closing_offset() + 20;
  ::setrlimit(RLIMIT_FSIZE, &tight);
  const std::string line = error_of(
      [&] {
        IffStore store(file(), shape, {IffStore::Mode::close, {}, {}});
        AssemblyOptions assembly;
        assembly.panels = &store;
        assembly.closure = Closure::off;
        const FormFactors out = assemble(mesh_, assembly);
        store.finish(iff_closing(mesh_, materials_, assembly.closure, out.report));
      },
      ErrorKind::limit);
  ::setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_THAT(line,
              HasSubstr("File too large; 4 of 4 panels are kept in " + file() + ", and the same command goes on"));
  EXPECT_NE(error_of([&] { (void)IffFile::open(file()); }), "");
  EXPECT_EQ(make(file(), {IffStore::Mode::close, {}, {}}).report.panels_reused, 4U);
  EXPECT_EQ(content_of(file()), content_of(file("undisturbed.iff")));
  ::sigaction(SIGXFSZ, &old, nullptr);
}

TEST_F(Iff, FoldersAndReadOnlyPlacesAreRefused) {
  std::filesystem::create_directory(file("folder.iff"));
  EXPECT_THAT(error_of([&] { (void)make(file("folder.iff")); }), HasSubstr("is a folder"));
  EXPECT_THAT(error_of([&] { (void)make(file("none/room.iff")); }), HasSubstr("No such file"));
}

TEST_F(Iff, PanelsAreOfWholeTileRows) {
  EXPECT_EQ(iff::rows_of_panel(17128, 32U << 20), 480U);
  EXPECT_EQ(iff::rows_of_panel(100, 32U << 20), 128U);
  EXPECT_EQ(iff::rows_of_panel(1U << 30, 32U << 20), 32U);
  EXPECT_EQ(iff::rows_of_panel(240, 1), 32U);
}

}  // namespace
}  // namespace interflect
