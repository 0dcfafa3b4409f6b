#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "formfactor/broken.h"
#include "interflect/base/error.h"
#include "interflect/formfactor/iff_store.h"

// A small room whose form factors are kept in files.

namespace interflect::test {

/// A closed room with a box in it: 240 patches, 8 rows of tiles.
inline Builder room() {
  Builder b;
  b.part("walls").box({0, 0, 0}, {4, 3, 2.5}, true, 4);
  b.part("box").box({1, 1, 0.2}, {2, 1.7, 1}, false, 2);
  return b;
}

inline std::string content_of(const std::string& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

inline void write(const std::string& path, const std::string& content) {
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

inline bool equal(const FormFactorMatrix& a, const FormFactorMatrix& b) {
  for (std::uint32_t i = 0; i < a.size(); ++i) {
    if (std::memcmp(a.row(i).data(), b.row(i).data(), a.row(i).size_bytes()) != 0) return false;
  }
  return a.size() == b.size();
}

}  // namespace interflect::test
