#include <gmock/gmock.h>
#include <sys/resource.h>

#include <csignal>
#include <fstream>
#include <functional>
#include <random>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/output/html.h"
#include "interflect/output/output.h"
#include "output/rooms.h"

namespace interflect {
namespace {

using test::Lit;
using test::SceneBuilder;
using test::TemporaryFolder;

/// Lets no file of this process grow beyond a size while it lives, as a full disk would.
class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes) {
    std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = bytes;
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;
  ~FullDisk() { setrlimit(RLIMIT_FSIZE, &before_); }

 private:
  rlimit before_{};
};

class WritersTest : public ::testing::TestWithParam<const char*> {
 protected:
  WritersTest() : lit_(scene(), 0.001) {
    lit_.solution.radiosity.assign(lit_.mesh.size(), {0.5, 0.5, 0.5});
    picture_.width = picture_.height = 64;
    std::minstd_rand noise;  // so that no format packs it into a few bytes
    for (std::size_t k = 0; k < 3U * 64 * 64; ++k) {
      picture_.pixels.push_back(static_cast<float>(noise() % 1009) / 1009.0F);
    }
  }
  static Scene scene() {
    SceneBuilder s;
    s.quad("wall", s.material({0.5, 0.5, 0.5}), {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
    return s.scene();
  }
  void write(const std::filesystem::path& path) const {
    const std::string format = GetParam();
    if (format == "png") write_png(picture_, ToneMap::linear, path);
    if (format == "exr") write_exr(picture_, path);
    if (format == "ply") write_ply(lit_.solution, path);
    if (format == "glb") write_glb(lit_.solution, path);
    if (format == "csv") write_csv(lit_.solution, path);
    if (format == "npy") write_npy(lit_.solution, path);
    if (format == "html") write_html(lit_.solution, {}, path);
  }
  /// Writes to the path, which must fail with an input error that names it.
  void expect_refusal(const std::filesystem::path& path) const {
    try {
      write(path);
      ADD_FAILURE() << "written: " << path;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::input);
      EXPECT_THAT(error.what(), ::testing::HasSubstr(path.string()));
    }
  }
  static std::size_t files_in(const std::filesystem::path& folder) {
    return static_cast<std::size_t>(
        std::distance(std::filesystem::directory_iterator(folder), std::filesystem::directory_iterator()));
  }

  Lit lit_;
  Picture picture_;
};

TEST_P(WritersTest, LeaveOneWholeFile) {
  const TemporaryFolder folder;
  write(folder / "out");
  EXPECT_EQ(files_in(folder.path()), 1U);
  EXPECT_GT(std::filesystem::file_size(folder / "out"), 2000U);
}

TEST_P(WritersTest, LeaveNothingWhenTheDiskIsFull) {
  const TemporaryFolder folder;
  {
    const FullDisk full(1500);
    expect_refusal(folder / "out");
  }
  EXPECT_EQ(files_in(folder.path()), 0U);
}

TEST_P(WritersTest, KeepTheOldFileWhenTheDiskIsFull) {
  const TemporaryFolder folder;
  std::ofstream(folder / "out") << "old";
  {
    const FullDisk full(1500);
    expect_refusal(folder / "out");
  }
  EXPECT_EQ(files_in(folder.path()), 1U);
  EXPECT_TRUE(read_file(folder / "out") == "old");
}

TEST_P(WritersTest, NameAFolderThatIsMissing) {
  const TemporaryFolder folder;
  expect_refusal(folder / "missing/out");
  EXPECT_EQ(files_in(folder.path()), 0U);
  std::filesystem::create_directory(folder / "taken");
  expect_refusal(folder / "taken");
  EXPECT_EQ(files_in(folder / "taken"), 0U);
}

INSTANTIATE_TEST_SUITE_P(Formats, WritersTest, ::testing::Values("png", "exr", "ply", "glb", "csv", "npy", "html"),
                         [](const auto& info) { return std::string(info.param); });

TEST(SolutionTest, RefusedWhenItsPartsDoNotFit) {
  SceneBuilder s;
  s.quad("wall", s.material({0.5, 0.5, 0.5}), {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  const TemporaryFolder folder;
  const auto refused = [&](const std::function<void(Solution&)>& spoil) {
    Lit lit(s.scene(), 0);
    spoil(lit.solution);
    EXPECT_THROW(write_csv(lit.solution, folder / "x"), Error);
    EXPECT_THROW(write_glb(lit.solution, folder / "x"), Error);
    EXPECT_THROW((void)render(lit.solution, {}), Error);
    EXPECT_FALSE(std::filesystem::exists(folder / "x"));
  };
  refused([](Solution& x) { x.mesh = nullptr; });
  refused([](Solution& x) { x.radiosity.pop_back(); });
  refused([](Solution& x) { x.row_sum.pop_back(); });
  refused([](Solution& x) { x.grouping.names.clear(); });
  refused([](Solution& x) { x.grouping.of_surface.clear(); });
}

}  // namespace
}  // namespace interflect
