#pragma once

#include <gtest/gtest.h>
#include <stdlib.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <stdexcept>
#include <string>

// A copy of kernels/ that a test may break, and the environment that makes the backends read it. Not while another
// thread of the test reads the environment.

namespace interflect::test {

/// A fresh empty folder of this process, removed with all it holds.
class TemporaryFolder {
 public:
  explicit TemporaryFolder(const std::string& name) {
    static std::atomic<unsigned> count = 0;
    path_ = std::filesystem::path(::testing::TempDir()) /
            (name + "-" + std::to_string(::getpid()) + "-" + std::to_string(count++));
    std::filesystem::remove_all(path_);
    std::filesystem::create_directories(path_);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// An environment variable with another value for as long as this lives.
class Variable {
 public:
  Variable(std::string name, const std::string& value) : name_(std::move(name)) {
    if (const char* before = ::getenv(name_.c_str())) before_ = before;
    ::setenv(name_.c_str(), value.c_str(), 1);
  }
  Variable(const Variable&) = delete;
  Variable& operator=(const Variable&) = delete;
  ~Variable() {
    if (before_) {
      ::setenv(name_.c_str(), before_->c_str(), 1);
    } else {
      ::unsetenv(name_.c_str());
    }
  }

 private:
  std::string name_;
  std::optional<std::string> before_;
};

/// An empty cache of compiled kernels.
class FreshCache {
 public:
  FreshCache() : folder_("cache"), variable_("XDG_CACHE_HOME", folder_.path().string()) {}
  /// Where the backends keep their entries.
  [[nodiscard]] std::filesystem::path entries() const { return folder_.path() / "interflect" / "kernels"; }

 private:
  TemporaryFolder folder_;
  Variable variable_;
};

/// A copy of kernels/ in INTERFLECT_KERNEL_DIR, with an empty cache of compiled kernels.
class KernelFolder {
 public:
  KernelFolder() : folder_("kernels"), variable_("INTERFLECT_KERNEL_DIR", folder_.path().string()) {
    std::filesystem::copy(std::filesystem::path(INTERFLECT_SOURCE_DIR) / "kernels", folder_.path(),
                          std::filesystem::copy_options::recursive);
  }

  /// Replaces every `from` in a file ("cl/matvec.cl"). Throws when there is none: a mutation must have happened.
  void replace(const std::string& file, const std::string& from, const std::string& to) {
    std::string text = read(file);
    std::size_t at = text.find(from);
    if (at == std::string::npos) throw std::runtime_error(file + " has no '" + from + "'");
    for (; at != std::string::npos; at = text.find(from, at + to.size())) text.replace(at, from.size(), to);
    std::ofstream(folder_.path() / file, std::ios::binary) << text;
  }

  [[nodiscard]] std::string read(const std::string& file) const {
    std::ifstream in(folder_.path() / file, std::ios::binary);
    if (!in) throw std::runtime_error("no kernel file " + file);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  [[nodiscard]] const std::filesystem::path& path() const { return folder_.path(); }
  [[nodiscard]] const FreshCache& cache() const { return cache_; }

 private:
  TemporaryFolder folder_;
  Variable variable_;
  FreshCache cache_;
};

}  // namespace interflect::test
