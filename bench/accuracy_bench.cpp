// Error of the form factors against time, as the tables of docs/accuracy.md:
//
//   accuracy_bench [--finest EPS] [SCENE.obj DIVIDE ...]      default: scenes/cornell-box.obj 4000
//
// Exact cases against catalogue values; scenes against themselves at the finest accuracy (default 2e-4) with other
// samples, which takes minutes. One thread per core; the best time of three where a run is short.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <utility>
#include <vector>

#include "interflect/formfactor/accuracy.h"
#include "interflect/formfactor/assembly.h"
#include "interflect/formfactor/estimate.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/scene/scene.h"

namespace {

using namespace interflect;

constexpr std::uint64_t other_seed = 99;

FormFactors run(const PatchMesh& mesh, const Accuracy& accuracy, std::uint64_t seed = 1) {
  AssemblyOptions options;
  options.closure = Closure::off;
  options.budget = budget_of(accuracy);
  options.seed = seed;
  return assemble(mesh, options);
}

/// The least seconds of three, where a run is short.
FormFactors timed(const PatchMesh& mesh, const Accuracy& accuracy) {
  FormFactors best = run(mesh, accuracy);
  for (int k = 0; k < 2 && best.report.seconds < 1; ++k) {
    best.report.seconds = std::min(best.report.seconds, run(mesh, accuracy).report.seconds);
  }
  return best;
}

const std::vector<Accuracy> accuracies{accuracy_of("low"), accuracy_of("medium"), accuracy_of("high"), {5e-4}};

/// Plates from o along u and v, front along u x v; a group each.
class Plates {
 public:
  Plates() { scene_.materials.resize(1); }
  Plates& add(const std::string& name, Vec3 o, Vec3 u, Vec3 v) {
    const auto first = static_cast<std::uint32_t>(scene_.positions.size());
    for (const Vec3 p : {o, o + u, o + u + v, o + v}) scene_.positions.push_back(p);
    const auto surface = static_cast<std::uint32_t>(scene_.surfaces.size());
    scene_.surfaces.push_back({name, name, 0});
    scene_.triangles.push_back({{first, first + 1, first + 2}, surface});
    scene_.triangles.push_back({{first, first + 2, first + 3}, surface});
    return *this;
  }
  [[nodiscard]] const Scene& scene() const { return scene_; }

 private:
  Scene scene_;
};

/// Rows of a table against the exact F from the first group to the second.
void exact_case(const std::string& name, const Scene& scene, double exact) {
  SubdivideOptions options;
  options.divide = 0.01;
  const PatchMesh mesh = subdivide(scene, options);
  for (const Accuracy& accuracy : accuracies) {
    const FormFactors f = timed(mesh, accuracy);
    const double value = between(f.matrix, mesh, group_surfaces(scene, GroupBy::group)).factors[0][1];
    const double estimate = row_sum_error(f.report.tile_variance, mesh.area).rms;
    fmt::print("| {} | {} | {} | {:.6f} | {:.6f} | {:.1e} | {:.1e} | {:.3f} |\n", name, mesh.size(), text_of(accuracy),
               exact, value, std::abs(value - exact), estimate, f.report.seconds);
  }
}

struct Errors {
  double rms = 0, max_row = 0, max_factor = 0;
};

Errors errors(const FormFactors& f, const FormFactors& reference) {
  Errors out;
  for (std::uint32_t i = 0; i < f.matrix.size(); ++i) {
    const double off = std::abs(f.report.row_sum_before[i] - reference.report.row_sum_before[i]);
    out.rms += off * off / f.matrix.size();
    out.max_row = std::max(out.max_row, off);
    const auto row = f.matrix.row(i), exact = reference.matrix.row(i);
    for (std::size_t j = 0; j < f.matrix.size(); ++j) {
      out.max_factor = std::max(out.max_factor, std::abs(static_cast<double>(row[j]) - static_cast<double>(exact[j])));
    }
  }
  out.rms = std::sqrt(out.rms);
  return out;
}

/// Rows of a table against the scene itself, much finer.
void scene_case(const std::string& path, double divide, double finest) {
  const Scene scene = read_scene(path);
  SubdivideOptions options;
  options.divide = divide;
  const PatchMesh mesh = subdivide(scene, options);
  std::fflush(stdout);
  const FormFactors reference = run(mesh, {finest}, other_seed);
  for (const Accuracy& accuracy : accuracies) {
    if (accuracy.eps < 2 * finest) continue;  // the reference's own error would count
    const FormFactors f = timed(mesh, accuracy);
    const Errors e = errors(f, reference);
    const double estimate = row_sum_error(f.report.tile_variance, mesh.area).rms;
    fmt::print("| {} | {} | {} | {:.1e} | {:.1e} | {:.2f} | {:.1e} | {:.1e} | {:.3g} | {:.2f} |\n", scene.name,
               mesh.size(), text_of(accuracy), e.rms, estimate, estimate / e.rms, e.max_row, e.max_factor,
               static_cast<double>(f.report.rays), f.report.seconds);
  }
  fmt::print("| {} | {} | {}, the reference | | | | | | {:.3g} | {:.2f} |\n", scene.name, mesh.size(), finest,
             static_cast<double>(reference.report.rays), reference.report.seconds);
}

void tables(const std::vector<std::pair<std::string, double>>& scenes, double finest) {
  fmt::print("| plates | patches | accuracy | exact F | F | error | estimated row error | s |\n");
  fmt::print("|---|--:|---|--:|--:|--:|--:|--:|\n");
  const Vec3 x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1};
  const auto opposite = [&] { return Plates().add("low", {}, x, y).add("high", z, y, x); };
  exact_case("opposite", opposite().scene(), 0.199824895698387);
  exact_case("perpendicular", Plates().add("floor", {}, x, y).add("wall", {}, z, x).scene(), 0.200043776075403);
  exact_case("half hidden", opposite().add("screen", {-3, -3, 0.5}, 3.5 * x, 7 * y).scene(), 0.199824895698387 / 2);
  fmt::print(
      "\n| scene | patches | accuracy | rms row error | estimated | ratio | largest row error | largest error of "
      "an F_ij | rays | s |\n");
  fmt::print("|---|--:|---|--:|--:|--:|--:|--:|--:|--:|\n");
  for (const auto& [path, divide] : scenes) scene_case(path, divide, finest);
}

}  // namespace

int main(int count, char** arguments) {
  try {
    double finest = 2e-4;
    std::vector<std::pair<std::string, double>> scenes;
    std::vector<std::string> words(arguments + 1, arguments + count);
    if (words.size() >= 2 && words[0] == "--finest") {
      finest = accuracy_of(words[1]).eps;
      words.erase(words.begin(), words.begin() + 2);
    }
    for (std::size_t k = 0; k + 1 < words.size(); k += 2) {
      scenes.emplace_back(words[k], std::strtod(words[k + 1].c_str(), nullptr));
    }
    if (scenes.empty()) scenes = {{"scenes/cornell-box.obj", 4000}};
    tables(scenes, finest);
  } catch (const std::exception& error) {
    fmt::print(stderr, "accuracy_bench: {}\n", error.what());
    return 1;
  }
  return 0;
}
