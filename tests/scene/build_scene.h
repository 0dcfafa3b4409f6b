#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <string>

#include "interflect/base/error.h"
#include "interflect/scene/patch_mesh.h"

namespace interflect::testing {

/// A scene with one grey material that emits, to which triangles are added.
struct SceneBuilder {
  Scene scene;
  SceneBuilder() {
    scene.file = "built.obj";
    scene.materials.push_back({.name = "grey", .reflectance = {0.5, 0.5, 0.5}, .emittance = {1, 1, 1}});
    scene.surfaces.push_back({"thing", "part", 0});
  }
  /// Adds a triangle with vertices of its own.
  SceneBuilder& triangle(Vec3 a, Vec3 b, Vec3 c) {
    const auto first = static_cast<std::uint32_t>(scene.positions.size());
    scene.positions.insert(scene.positions.end(), {a, b, c});
    Triangle t;
    t.vertex = {first, first + 1, first + 2};
    t.line = static_cast<std::uint32_t>(scene.triangles.size()) + 1;
    scene.triangles.push_back(t);
    return *this;
  }
  SceneBuilder& quad(Vec3 a, Vec3 b, Vec3 c, Vec3 d) { return triangle(a, b, c).triangle(a, c, d); }
  /// The unit cube, seen from outside.
  SceneBuilder& cube() {
    const auto p = [](int i) { return Vec3{double(i & 1), double(i >> 1 & 1), double(i >> 2 & 1)}; };
    for (const auto& side : {std::array{0, 2, 3, 1}, std::array{4, 5, 7, 6}, std::array{0, 1, 5, 4},
                             std::array{2, 6, 7, 3}, std::array{0, 4, 6, 2}, std::array{1, 3, 7, 5}}) {
      quad(p(side[0]), p(side[1]), p(side[2]), p(side[3]));
    }
    return *this;
  }
};

/// Runs `action`, expects an Error of this kind and returns its message.
template <typename Action>
std::string message_of(ErrorKind kind, const Action& action) {
  try {
    action();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind) << error.what();
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
    return error.what();
  }
  ADD_FAILURE() << "no error was thrown";
  return {};
}

/// An empty folder for the running test, removed at its end.
class TestFolder {
 public:
  TestFolder() {
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    path_ = std::filesystem::path(::testing::TempDir()) /
            (std::string(test->test_suite_name()) + "-" + test->name() + "-" + std::to_string(::getpid()));
    std::filesystem::remove_all(path_);
    std::filesystem::create_directories(path_);
  }
  TestFolder(const TestFolder&) = delete;
  TestFolder& operator=(const TestFolder&) = delete;
  ~TestFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  /// Writes a file and returns its path.
  [[nodiscard]] std::filesystem::path file(const std::string& name, const std::string& content) const {
    std::ofstream(path_ / name, std::ios::binary) << content;
    return path_ / name;
  }

 private:
  std::filesystem::path path_;
};

}  // namespace interflect::testing
