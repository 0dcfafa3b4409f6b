// The file of form factors: what comes back, what damage is found.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <memory>
#include <new>

#include "formfactor/iff_room.h"
#include "interflect/formfactor/iff_closing.h"
#include "interflect/formfactor/iff_file.h"
#include "sanitized.h"

namespace interflect {
namespace {

using namespace test;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

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

TEST_F(Iff, PanelsAreOfWholeTileRows) {
  EXPECT_EQ(iff::rows_of_panel(17128, 32U << 20), 480U);
  EXPECT_EQ(iff::rows_of_panel(100, 32U << 20), 128U);
  EXPECT_EQ(iff::rows_of_panel(1U << 30, 32U << 20), 32U);
  EXPECT_EQ(iff::rows_of_panel(240, 1), 32U);
}

}  // namespace
}  // namespace interflect
