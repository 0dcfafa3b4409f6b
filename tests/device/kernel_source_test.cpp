#include "interflect/device/kernel_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "interflect/base/error.h"
#include "interflect/device/embedded_kernels.h"

namespace interflect {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

/// A kernel folder of the test's own, in use as long as the object lives.
class Folder {
 public:
  Folder()
      : path_(fs::path(testing::TempDir()) / ("kernel-source-" + std::to_string(::getpid()) + "-" +
                                              testing::UnitTest::GetInstance()->current_test_info()->name())) {
    fs::create_directories(path_ / "cl");
    ::setenv("INTERFLECT_KERNEL_DIR", path_.c_str(), 1);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  ~Folder() {
    ::unsetenv("INTERFLECT_KERNEL_DIR");
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  void write(const std::string& name, const std::string& text) const { std::ofstream(path_ / name) << text; }
  [[nodiscard]] std::string path() const { return path_.string(); }

 private:
  fs::path path_;
};

TEST(KernelSource, EveryFileOfTheKernelFolderIsBuiltIn) {
  std::size_t files = 0;
  for (const char* language : {"cl", "glsl", "cuda", "shared"}) {
    const fs::path folder = fs::path(INTERFLECT_SOURCE_DIR) / "kernels" / language;
    for (const auto& entry : fs::directory_iterator(folder)) {
      const std::string path = std::string(language) + "/" + entry.path().filename().string();
      const auto all = embedded_kernels();
      const auto found = std::find_if(all.begin(), all.end(), [&](const EmbeddedKernel& k) { return k.path == path; });
      ASSERT_NE(found, all.end()) << path;
      std::ifstream stream(entry.path());
      const std::string text{std::istreambuf_iterator<char>(stream), {}};
      EXPECT_EQ(found->text, text) << path;
      ++files;
    }
  }
  EXPECT_EQ(files, embedded_kernels().size());
}

TEST(KernelSource, IncludesAreExpandedOnceAndLinesKeepTheirNames) {
  const Folder folder;
  folder.write("cl/main.cl", "first\n#include \"a.h\"\n#include \"b.h\"\nlast");
  folder.write("cl/a.h", "of a\n");
  folder.write("cl/b.h", "#include \"a.h\"\nof b\n");
  EXPECT_EQ(kernel_source("cl", "main.cl"),
            "#line 1 \"cl/main.cl\"\nfirst\n"
            "#line 1 \"cl/a.h\"\nof a\n#line 3 \"cl/main.cl\"\n"
            "#line 1 \"cl/b.h\"\n#line 2 \"cl/b.h\"\nof b\n#line 4 \"cl/main.cl\"\nlast\n");
}

TEST(KernelSource, AnIncludeMayNameAFileOfAnotherFolder) {
  const Folder folder;
  fs::create_directories(fs::path(folder.path()) / "shared");
  folder.write("cl/main.cl", "#include \"../shared/a.h\"\n#include \"b.h\"\nlast\n");
  folder.write("cl/b.h", "#include \"../shared/a.h\"\nof cl\n");
  folder.write("shared/a.h", "#include \"b.h\"\nof a\n");
  folder.write("shared/b.h", "of shared\n");
  EXPECT_EQ(kernel_source("cl", "main.cl"),
            "#line 1 \"cl/main.cl\"\n#line 1 \"shared/a.h\"\n#line 1 \"shared/b.h\"\nof shared\n"
            "#line 2 \"shared/a.h\"\nof a\n#line 2 \"cl/main.cl\"\n"
            "#line 1 \"cl/b.h\"\n#line 2 \"cl/b.h\"\nof cl\n#line 3 \"cl/main.cl\"\nlast\n");
}

TEST(KernelSource, AnIncludeOfItselfEnds) {
  const Folder folder;
  folder.write("cl/main.cl", "#include \"main.cl\"\nx\n");
  EXPECT_THAT(kernel_source("cl", "main.cl"), HasSubstr("x\n"));
}

TEST(KernelSource, AMissingFileIsAnErrorThatNamesIt) {
  try {
    static_cast<void>(kernel_source("cl", "nothing.cl"));
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::device);
    EXPECT_THAT(error.what(), HasSubstr("kernels/cl/nothing.cl"));
  }
  const Folder folder;
  folder.write("cl/main.cl", "#include \"gone.h\"\n");
  try {
    static_cast<void>(kernel_source("cl", "main.cl"));
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::device);
    EXPECT_THAT(error.what(), HasSubstr(folder.path() + "/cl/gone.h"));
  }
}

}  // namespace
}  // namespace interflect
