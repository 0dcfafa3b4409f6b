// Files of form factors and who made them, as a user meets it: a device that fails, another backend, a crafted header.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>

#include "backends/devices.h"
#include "cli/program.h"
#include "device/kernel_folder.h"
#include "interflect/formfactor/iff_format.h"

namespace interflect::test {
namespace {

using ::testing::HasSubstr;

const std::string small_panels = "INTERFLECT_MAX_PANEL_BYTES=60000";  // 32 rows of 400: 13 panels or so

std::vector<std::string> keeping(const std::string& file, const std::string& devices) {
  return {
      "formfactors", scene_file("cornell-box.obj"), "--patches", "400", "-o", file, "--assembly", "device", "--device",
      devices};
}

iff::HeaderBytes header_of(const std::string& bytes) {
  iff::HeaderBytes header{};
  std::memcpy(&header, bytes.data(), sizeof header);
  return header;
}

/// The file as it was when its first panel was finished.
std::string begun(std::string bytes) {
  const iff::HeaderBytes header = header_of(bytes);
  std::memset(bytes.data() + header.table_offset + sizeof(iff::EntryBytes), 0,
              (header.panels - 1) * sizeof(iff::EntryBytes));
  bytes.resize(header.data_offset + header.pitch);
  return bytes;
}

TEST(KeptByADevice, PanelsOfAnotherMakerAreNotMixedIn) {
  if (const std::string why = why_unavailable("opencl:0"); !why.empty()) GTEST_SKIP() << why;
  const Folder folder;
  const std::string file = folder.file("room.iff"), partial = file + ".partial";
  ASSERT_EQ(run_program(keeping(file, "opencl:0"), {small_panels}).status, 0);
  const std::string whole = content_of(file);
  ASSERT_EQ(header_of(whole).maker, iff::maker_opencl);
  ASSERT_GT(header_of(whole).panels, 4U);
  std::filesystem::remove(file);

  // The device fails (its kernels do not compile) with a panel finished: that panel is kept, and nothing else begins.
  const auto run_broken = [](const std::vector<std::string>& arguments) {
    KernelFolder kernels;  // also for the programs that are run while it lives
    kernels.replace("shared/tile_store.h", "PANEL_AT(row_j, i) = s;", "PANEL_AT(row_j, i) = no_such_name;");
    return run_program(arguments, {small_panels});
  };
  static_cast<void>(folder.write("room.iff.partial", begun(whole)));
  const Outcome failed = run_broken(keeping(file, "opencl:0,openmp"));
  EXPECT_EQ(failed.status, 4) << failed.err;
  EXPECT_THAT(failed.err, HasSubstr("1 of " + std::to_string(header_of(whole).panels) + " panels are kept in " +
                                    partial + ", and the same command goes on from there once the device works"));
  EXPECT_TRUE(content_of(partial).starts_with(begun(whole)));
  EXPECT_FALSE(std::filesystem::exists(file));

  // Nor by the CPU path or another backend that was asked for.
  for (const std::string device : {"openmp", "vulkan:0"}) {
    if (!why_unavailable(device).empty()) continue;
    const Outcome other = run_program(keeping(file, device), {small_panels});
    EXPECT_EQ(other.status, 3);
    EXPECT_THAT(other.err, HasSubstr("OpenCL kernels made it (--assembly device --device opencl:0"));
    EXPECT_TRUE(content_of(partial).starts_with(begun(whole)));
  }
  // The device works again.
  const Outcome again = run_program(keeping(file, "opencl:0"), {small_panels});
  EXPECT_EQ(again.status, 0) << again.err;
  EXPECT_TRUE(content_of(file) == whole);

  // A repair is by whoever made it, too; the message says how.
  std::string damaged = whole;
  damaged[header_of(whole).data_offset + 2 * header_of(whole).pitch + 44] ^= 1;
  static_cast<void>(folder.write("room.iff", damaged));
  std::vector<std::string> repair = keeping(file, "opencl:0,openmp");
  repair.emplace_back("--repair");
  EXPECT_EQ(run_broken(repair).status, 4);
  EXPECT_TRUE(content_of(file) == damaged);
  const Outcome by_host =
      run_program({"formfactors", scene_file("cornell-box.obj"), "--patches", "400", "-o", file, "--repair"});
  EXPECT_EQ(by_host.status, 3);
  EXPECT_THAT(by_host.err, HasSubstr("--assembly device --device opencl:0"));
  EXPECT_EQ(run_program(repair).status, 0);
  EXPECT_TRUE(content_of(file) == whole);
}

/// Without a finished panel the next candidate makes the file, and says so in it.
TEST(KeptByADevice, BeforeTheFirstPanelTheNextCandidateTakesOver) {
  if (const std::string why = why_unavailable("opencl:0"); !why.empty()) GTEST_SKIP() << why;
  const Folder folder;
  KernelFolder kernels;
  kernels.replace("shared/tile_store.h", "PANEL_AT(row_j, i) = s;", "PANEL_AT(row_j, i) = no_such_name;");
  const Outcome made = run_program(keeping(folder.file("room.iff"), "opencl:0,openmp"), {small_panels});
  EXPECT_EQ(made.status, 0) << made.err;
  EXPECT_THAT(made.err, HasSubstr("going on with openmp"));
  EXPECT_EQ(header_of(content_of(folder.file("room.iff"))).maker, iff::maker_embree);
  ASSERT_EQ(run_program(keeping(folder.file("host.iff"), "openmp"), {small_panels}).status, 0);
  EXPECT_TRUE(content_of(folder.file("room.iff")) == content_of(folder.file("host.iff")));
}

/// This scene's hash and another number of patches: no command may believe it.
TEST(KeptFile, AHeaderOfAnotherSizeIsRefused) {
  const Folder folder;
  const std::string file = folder.file("room.iff");
  ASSERT_EQ(run_program(keeping(file, "openmp"), {small_panels}).status, 0);
  const std::string whole = content_of(file);
  const iff::HeaderBytes header = header_of(whole);
  for (const std::uint32_t n : {header.n - 32, header.n + 64}) {
    const iff::Shape crafted{n,
                             header.rows_per_panel,
                             header.divide,
                             false,
                             {header.geometry, header.eps, header.seed, header.algorithm, header.maker}};
    const iff::HeaderBytes lie = iff::header_of(crafted);
    std::string bytes = whole;
    std::memcpy(bytes.data(), &lie, sizeof lie);
    bytes.resize(crafted.closing_offset() + 4096);
    static_cast<void>(folder.write("room.iff", bytes));
    const std::string says = "its geometry is another: " + std::to_string(n) + " patches";
    const Outcome solved = run_program(
        {"solve", scene_file("cornell-box.obj"), "--patches", "400", "--device", "openmp", "--form-factors", file});
    EXPECT_EQ(solved.status, 3);
    EXPECT_THAT(solved.err, HasSubstr(says));
    std::vector<std::string> repair = keeping(file, "openmp");
    repair.emplace_back("--repair");
    const Outcome repaired = run_program(repair, {small_panels});
    EXPECT_EQ(repaired.status, 3);
    EXPECT_THAT(repaired.err, HasSubstr(says));
    EXPECT_TRUE(content_of(file) == bytes);
    const Outcome made = run_program(keeping(file, "openmp"), {small_panels});
    EXPECT_EQ(made.status, 0);
    EXPECT_THAT(made.err, HasSubstr(says));
    EXPECT_TRUE(content_of(file) == whole) << "replaced";
  }
}

}  // namespace
}  // namespace interflect::test
