#include "interflect/device/compile_cache.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <span>

#include "interflect/base/error.h"

namespace interflect {
namespace {

namespace fs = std::filesystem;

std::vector<std::byte> bytes(std::string_view text) {
  const auto all = std::as_bytes(std::span(text.data(), text.size()));
  return {all.begin(), all.end()};
}

class CompileCache : public testing::Test {
 protected:
  void SetUp() override {
    home_ = fs::path(testing::TempDir()) / ("compile-cache-" + std::to_string(::getpid()) + "-" +
                                            testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(home_);
    for (const char* name : {"XDG_CACHE_HOME", "INTERFLECT_CACHE"}) {
      const char* value = std::getenv(name);
      before_.emplace_back(name, value == nullptr ? std::optional<std::string>() : std::string(value));
    }
    ::setenv("XDG_CACHE_HOME", home_.c_str(), 1);
    ::unsetenv("INTERFLECT_CACHE");
  }
  void TearDown() override {
    for (const auto& [name, value] : before_) {
      if (value) {
        ::setenv(name.c_str(), value->c_str(), 1);
      } else {
        ::unsetenv(name.c_str());
      }
    }
    std::error_code ignored;
    fs::remove_all(home_, ignored);
  }

  /// What cached_compile() gives when a compiler would give `text`, and whether that compiler ran.
  std::pair<std::vector<std::byte>, bool> get(const CompileKey& key, std::string_view text) {
    bool ran = false;
    auto binary = cached_compile(key, [&] {
      ran = true;
      return bytes(text);
    });
    return {std::move(binary), ran};
  }
  [[nodiscard]] std::vector<fs::path> entries() const {
    std::vector<fs::path> all;
    if (!fs::exists(home_ / "interflect" / "kernels")) return all;
    for (const auto& entry : fs::directory_iterator(home_ / "interflect" / "kernels")) all.push_back(entry.path());
    return all;
  }

  fs::path home_;
  std::vector<std::pair<std::string, std::optional<std::string>>> before_;
  const CompileKey key{"opencl", "a device", "driver 1", "-DROWS=8", "kernel void f() {}"};
};

TEST_F(CompileCache, ASecondCompileComesFromTheDisk) {
  const CompileStatistics before = compile_statistics();
  EXPECT_EQ(get(key, "binary"), std::pair(bytes("binary"), true));
  EXPECT_EQ(get(key, "other"), std::pair(bytes("binary"), false));
  EXPECT_EQ(entries().size(), 1U);
  const CompileStatistics after = compile_statistics();
  EXPECT_EQ(after.compiled - before.compiled, 1U);
  EXPECT_EQ(after.from_cache - before.from_cache, 1U);
  EXPECT_GT(after.seconds, before.seconds);
}

TEST_F(CompileCache, EveryPartOfTheKeyCounts) {
  static_cast<void>(get(key, "binary"));
  for (std::string CompileKey::*part :
       {&CompileKey::backend, &CompileKey::device, &CompileKey::driver, &CompileKey::options, &CompileKey::source}) {
    CompileKey other = key;
    other.*part += " ";
    EXPECT_TRUE(get(other, "other").second);
  }
  CompileKey moved = key;  // the same characters, cut elsewhere
  moved.device = "a";
  moved.driver = " devicedriver 1";
  EXPECT_TRUE(get(moved, "other").second);
  EXPECT_FALSE(get(key, "").second);
}

TEST_F(CompileCache, DamageIsNoticedWhereverItIs) {
  static_cast<void>(get(key, "binary"));
  ASSERT_EQ(entries().size(), 1U);
  const fs::path entry = entries().front();
  const std::uintmax_t size = fs::file_size(entry);
  ASSERT_GT(size, 40U);
  for (std::uintmax_t at = 0; at < size; ++at) {
    {
      std::fstream file(entry, std::ios::in | std::ios::out | std::ios::binary);
      file.seekg(static_cast<std::streamoff>(at));
      const int c = file.get();
      file.seekp(static_cast<std::streamoff>(at));
      file.put(static_cast<char>(c ^ 1));
    }
    EXPECT_EQ(get(key, "binary"), std::pair(bytes("binary"), true)) << "byte " << at;
  }
  for (std::uintmax_t length = 0; length < size; length += 7) {
    fs::resize_file(entry, length);
    EXPECT_EQ(get(key, "binary"), std::pair(bytes("binary"), true)) << "cut to " << length;
  }
  EXPECT_FALSE(get(key, "").second) << "whole again";
}

TEST_F(CompileCache, AnotherKeysEntryUnderTheNameIsNotTrusted) {
  static_cast<void>(get(key, "binary"));
  const fs::path entry = entries().front();
  CompileKey other = key;
  other.source = "something else";
  static_cast<void>(get(other, "else"));
  for (const fs::path& path : entries()) {
    if (path != entry) fs::copy_file(path, entry, fs::copy_options::overwrite_existing);
  }
  EXPECT_EQ(get(key, "binary"), std::pair(bytes("binary"), true));
}

TEST_F(CompileCache, AForgottenEntryIsCompiledAgain) {
  static_cast<void>(get(key, "binary"));
  forget_compiled(key);
  EXPECT_TRUE(entries().empty());
  EXPECT_TRUE(get(key, "binary").second);
}

TEST_F(CompileCache, AFailedCompileLeavesNothing) {
  EXPECT_THROW(static_cast<void>(cached_compile(
                   key, []() -> std::vector<std::byte> { throw device_error("opencl:0", "compile", "no"); })),
               Error);
  EXPECT_TRUE(entries().empty());
  EXPECT_TRUE(get(key, "binary").second);
}

TEST_F(CompileCache, WithoutAPlaceNothingIsKept) {
  ::setenv("INTERFLECT_CACHE", "off", 1);
  EXPECT_TRUE(get(key, "binary").second);
  EXPECT_TRUE(get(key, "binary").second);
  EXPECT_TRUE(entries().empty());
  ::unsetenv("INTERFLECT_CACHE");
  std::ofstream(home_ / "file") << "not a folder";
  ::setenv("XDG_CACHE_HOME", (home_ / "file").c_str(), 1);
  EXPECT_TRUE(get(key, "binary").second);
  EXPECT_EQ(get(key, "binary"), std::pair(bytes("binary"), true));
}

}  // namespace
}  // namespace interflect
