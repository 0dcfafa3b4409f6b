#include "interflect/base/file.h"

#include <gmock/gmock.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "interflect/base/error.h"

namespace interflect {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
namespace fs = std::filesystem;

class FileTest : public ::testing::Test {
 protected:
  FileTest() {
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::path(::testing::TempDir()) /
              (std::string(test->test_suite_name()) + "-" + test->name() + "-" + std::to_string(::getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  ~FileTest() override {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  [[nodiscard]] std::vector<std::string> listing() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_)) names.push_back(entry.path().filename().string());
    return names;
  }
  static std::string message_of(const std::function<void()>& action) {
    try {
      action();
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::input);
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      return error.what();
    }
    ADD_FAILURE() << "no error was thrown";
    return {};
  }
  fs::path folder_;
};

using AtomicFileTest = FileTest;
using ReadFileTest = FileTest;

TEST_F(AtomicFileTest, AppearsWholeOnCommit) {
  const fs::path path = folder_ / "result";
  const std::string half(300000, 'a');
  {
    AtomicFile file(path);
    file.write(half);
    EXPECT_FALSE(fs::exists(path));
    file.write(std::string_view("end"));
    EXPECT_FALSE(fs::exists(path));
    file.commit();
    EXPECT_EQ(read_file(path), half + "end");
  }
  EXPECT_THAT(listing(), ::testing::ElementsAre("result"));
}

TEST_F(AtomicFileTest, ReplacesAnOldFileOnlyOnCommit) {
  const fs::path path = folder_ / "result";
  std::ofstream(path) << "old";
  {
    AtomicFile file(path);
    file.write(std::string_view("new"));
    EXPECT_EQ(read_file(path), "old");
  }
  EXPECT_EQ(read_file(path), "old");
  AtomicFile file(path);
  file.write(std::string_view("new"));
  file.commit();
  EXPECT_EQ(read_file(path), "new");
}

TEST_F(AtomicFileTest, LeavesNothingBehindWhenAnExceptionPasses) {
  try {
    AtomicFile file(folder_ / "result");
    file.write(std::string_view("half"));
    EXPECT_FALSE(listing().empty());
    throw std::runtime_error("elsewhere");
  } catch (const std::runtime_error&) {
  }
  EXPECT_THAT(listing(), IsEmpty());
}

TEST_F(AtomicFileTest, HasThePermissionsOfAnyNewFile) {
  const mode_t old = ::umask(027);
  AtomicFile file(folder_ / "result");
  file.commit();
  ::umask(old);
  EXPECT_EQ(fs::status(folder_ / "result").permissions(), fs::perms(0640));
}

TEST_F(AtomicFileTest, TheTemporaryNameCanBeWrittenByOthers) {
  AtomicFile file(folder_ / "result");
  EXPECT_EQ(file.temporary().parent_path(), folder_);
  std::ofstream(file.temporary()) << "by a library";
  file.commit();
  EXPECT_EQ(read_file(folder_ / "result"), "by a library");
}

TEST_F(AtomicFileTest, MissingFoldersAndFoldersAreErrors) {
  EXPECT_THAT(message_of([&] { AtomicFile file(folder_ / "none" / "result"); }), HasSubstr("none/result: cannot"));
  EXPECT_THAT(message_of([&] { AtomicFile file(folder_); }), HasSubstr("folder"));
  EXPECT_THAT(listing(), IsEmpty());
}

TEST_F(AtomicFileTest, PipesDevicesAndProtectedFilesAreNotReplaced) {
  ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
  EXPECT_THAT(message_of([&] { AtomicFile file(folder_ / "pipe"); }), HasSubstr("not a regular file"));
  EXPECT_THAT(message_of([&] { AtomicFile file("/dev/null"); }), HasSubstr("not a regular file"));
  EXPECT_THAT(listing(), ::testing::ElementsAre("pipe"));
  if (::geteuid() == 0) return;  // root may write anything
  std::ofstream(folder_ / "protected") << "old";
  fs::permissions(folder_ / "protected", fs::perms::owner_read);
  EXPECT_THAT(message_of([&] { AtomicFile file(folder_ / "protected"); }), HasSubstr("cannot replace"));
}

TEST_F(AtomicFileTest, ALinkIsFollowed) {
  fs::create_directory(folder_ / "there");
  std::ofstream(folder_ / "there" / "target") << "old";
  fs::create_symlink("there/target", folder_ / "link");
  fs::create_symlink("there/new", folder_ / "dangling");
  fs::create_symlink("circle", folder_ / "circle");
  for (const char* name : {"link", "dangling"}) {
    AtomicFile file(folder_ / name);
    file.write(std::string_view("new"));
    file.commit();
    EXPECT_TRUE(fs::is_symlink(folder_ / name)) << name;
  }
  EXPECT_EQ(read_file(folder_ / "there" / "target"), "new");
  EXPECT_EQ(read_file(folder_ / "there" / "new"), "new");
  EXPECT_THAT(message_of([&] { AtomicFile file(folder_ / "circle"); }), HasSubstr("circle: cannot create"));
}

TEST_F(AtomicFileTest, ASignalRemovesWhatIsNotFinished) {
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    remove_temporaries_on_signals();
    AtomicFile finished(folder_ / "finished"), first(folder_ / "first"), second(folder_ / "second");
    finished.commit();
    ::raise(SIGTERM);
    ::_exit(0);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGTERM) << status;
  EXPECT_THAT(listing(), ::testing::ElementsAre("finished"));
}

TEST_F(AtomicFileTest, AFailedWriteIsAnErrorThatNamesTheFinalFile) {
  // What a full disk does, by a limit on the size of files.
  struct rlimit old {};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &old), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const struct rlimit small { 4096, old.rlim_max };
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  std::string message;
  try {
    AtomicFile file(folder_ / "result");
    file.write(std::string(100000, 'x'));
    file.commit();
  } catch (const Error& error) {
    message = error.what();
  }
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &old), 0);
  std::signal(SIGXFSZ, handler);
  EXPECT_THAT(message, HasSubstr("result: cannot write: "));
  EXPECT_THAT(message, ::testing::Not(HasSubstr(".part-")));
  EXPECT_THAT(listing(), IsEmpty());
}

TEST_F(AtomicFileTest, AFailedRenameLeavesNothingBehind) {
  const fs::path path = folder_ / "result";
  AtomicFile file(path);
  fs::create_directories(path / "in the way");
  EXPECT_THAT(message_of([&] { file.commit(); }), HasSubstr("rename"));
}

TEST_F(ReadFileTest, ReadsBytesAsTheyAre) {
  std::string bytes;
  for (int i = 0; i < 200000; ++i) bytes += static_cast<char>(i * 31);
  std::ofstream(folder_ / "bytes", std::ios::binary) << bytes;
  EXPECT_EQ(read_file(folder_ / "bytes"), bytes);
  std::ofstream(folder_ / "empty").flush();
  EXPECT_EQ(read_file(folder_ / "empty"), "");
}

TEST_F(ReadFileTest, TheLimitIsKept) {
  std::ofstream(folder_ / "ten") << "0123456789";
  EXPECT_EQ(read_file(folder_ / "ten", 10).size(), 10u);
  EXPECT_THAT(message_of([&] { (void)read_file(folder_ / "ten", 9); }),
              HasSubstr("ten: is larger than the limit of 9"));
}

TEST_F(ReadFileTest, PipesAndDevicesAreRefusedWithoutWaiting) {
  ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);  // without a writer: a plain open() would wait for ever
  EXPECT_THAT(message_of([&] { (void)read_file(folder_ / "pipe"); }), HasSubstr("not a regular file"));
  EXPECT_THAT(message_of([&] { (void)read_file("/dev/zero"); }), HasSubstr("not a regular file"));
}

TEST_F(ReadFileTest, MissingFilesAndFoldersAreErrors) {
  EXPECT_THAT(message_of([&] { (void)read_file(folder_ / "none"); }), HasSubstr("none: cannot open"));
  EXPECT_THAT(message_of([&] { (void)read_file(folder_); }), HasSubstr("folder"));
}

}  // namespace
}  // namespace interflect
