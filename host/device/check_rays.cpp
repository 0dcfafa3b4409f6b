#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include "interflect/device/check_tools.h"
#include "interflect/device/hierarchy.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/kernel_table.h"

// shadow_rays against every triangle in double precision. Rays that pass so near an edge, or end so near a triangle,
// that fp32 cannot tell are left out; all others must agree.

namespace interflect::check {

namespace {

using Indices = std::array<std::uint32_t, 3>;

struct Ray {
  std::array<float, 3> origin{};
  float near = 0;
  std::array<float, 3> direction{};
  float far = 1;
};
static_assert(sizeof(Ray) == 8 * sizeof(float));

struct Mesh {
  std::vector<Vec3> vertices;  // of fp32 coordinates
  std::vector<Indices> triangles;

  void add(Vec3 a, Vec3 b, Vec3 c) {
    const auto first = static_cast<std::uint32_t>(vertices.size());
    for (const Vec3 p : {a, b, c}) vertices.push_back(rounded(p));
    triangles.push_back({first, first + 1, first + 2});
  }
  static Vec3 rounded(Vec3 p) {
    const auto round = [](double x) { return static_cast<double>(static_cast<float>(x)); };
    return {round(p.x), round(p.y), round(p.z)};
  }
};

Vec3 wide(const std::array<float, 3>& v) {
  return {static_cast<double>(v[0]), static_cast<double>(v[1]), static_cast<double>(v[2])};
}
std::array<float, 3> narrow(Vec3 v) {
  return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}
double largest(Vec3 v) {
  return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
}

enum class Answer { free, hidden, unsure };

/// How far fp32 may be off where it says on which side of an edge between p and q a ray passes: kernels/README.md
/// derives it. p, q: relative to the ray's origin; d its direction, with its largest component along axis k.
double side_error(Vec3 p, Vec3 q, Vec3 d, int k) {
  const int i = (k + 1) % 3, j = (k + 2) % 3;
  const auto across = [&](Vec3 v, int axis) { return std::abs(v[axis]) + std::abs(v[k] * d[axis] / d[k]); };
  return 12 * 0x1p-24 * std::abs(d[k]) * (across(p, i) * across(q, j) + across(p, j) * across(q, i));
}

Answer meets(const Ray& ray, Vec3 a, Vec3 b, Vec3 c) {
  const Vec3 o = wide(ray.origin), d = wide(ray.direction);
  const double near = static_cast<double>(ray.near), far = static_cast<double>(ray.far);
  if (!(near < far) || a == b || b == c || c == a) return Answer::free;
  a = a - o;
  b = b - o;
  c = c - o;
  const int k = std::abs(d.z) == largest(d) ? 2 : std::abs(d.y) == largest(d) ? 1 : 0;
  const std::array<double, 3> side{dot(d, cross(b, c)), dot(d, cross(c, a)), dot(d, cross(a, b))};
  const std::array<double, 3> error{side_error(b, c, d, k), side_error(c, a, d, k), side_error(a, b, d, k)};
  bool surely_left = false, surely_right = false, left = true, right = true;
  for (std::size_t e = 0; e < 3; ++e) {
    surely_left = surely_left || side[e] > error[e];
    surely_right = surely_right || side[e] < -error[e];
    left = left && side[e] > error[e];
    right = right && side[e] < -error[e];
  }
  if (surely_left && surely_right) return Answer::free;
  const Vec3 n = cross(b - a, c - a);
  const double slope = dot(d, n), height = dot(a, n);
  const double farthest = 3 * std::max({largest(a), largest(b), largest(c)}) * largest(d) / dot(d, d);
  const double sum = std::abs(side[0]) + std::abs(side[1]) + std::abs(side[2]);
  const double of_sides = error[0] + error[1] + error[2] + 12 * 0x1p-24 * sum;
  const double behind = height - near * slope, before = far * slope - height;
  const bool clear = std::abs(behind) > of_sides * (farthest + near) && std::abs(before) > of_sides * (farthest + far);
  if (clear && (behind > 0) != (before > 0)) return Answer::free;
  return clear && (left || right) ? Answer::hidden : Answer::unsure;
}

Answer reference(const Ray& ray, const Mesh& mesh) {
  Answer answer = Answer::free;
  for (const Indices& t : mesh.triangles) {
    const Answer one = meets(ray, mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]);
    if (one == Answer::hidden) return one;
    if (one == Answer::unsure) answer = one;
  }
  return answer;
}

/// A case: triangles, rays, and, where the reference need not be asked, that all are hidden.
struct Case {
  Mesh mesh;
  std::vector<Ray> rays;
  bool all_hidden = false;
};

/// In [0, 1).
double unit(Random& random) {
  return std::abs(static_cast<double>(random.next())) - 0.5;
}
Vec3 in_cube(Random& random) {
  const double x = unit(random), y = unit(random), z = unit(random);
  return {2 * x - 1, 2 * y - 1, 2 * z - 1};
}

/// Rays all over the cube and from outside it, of every kind that may come.
std::vector<Ray> random_rays(Random& random, std::size_t count) {
  std::vector<Ray> rays;
  for (std::size_t k = 0; k < count; ++k) {
    Vec3 direction = 2 * in_cube(random);
    if (k % 8 == 1) direction.x = 0;
    if (k % 8 == 2) direction = {0, k % 16 == 2 ? -1.5 : 1.5, 0};
    if (k % 8 == 3) direction.z = -0.0;
    if (k % 8 == 4) direction = 1e-3 * direction;
    Ray ray{narrow(1.3 * in_cube(random)), 0, narrow(direction), 1};
    if (k % 8 == 4) ray.far = 1000;
    if (k % 8 == 5) ray.far = 0.25F;
    if (k % 8 == 6) ray.near = 0.5F;
    if (k % 32 == 7) ray.far = -1;  // none
    rays.push_back(ray);
  }
  return rays;
}

/// Small triangles all over the cube, every fourth parallel to an axis. With `bad`, every third has no area, or is
/// many times the same.
Case soup(Random& random, std::size_t triangles, std::size_t rays, bool bad) {
  Case made;
  const double size = 0.8 / std::sqrt(static_cast<double>(triangles + 1));
  for (std::size_t k = 0; k < triangles; ++k) {
    const Vec3 a = in_cube(random);
    Vec3 b = a + size * in_cube(random), c = a + size * in_cube(random);
    if (k % 4 == 1) b.z = c.z = a.z;
    if (k % 4 == 2) b.x = c.x = a.x;
    if (bad && k % 9 == 1) b = a;
    if (bad && k % 9 == 4) b = c = a;
    if (bad && k % 9 == 7) c = 0.5 * (a + b);
    if (bad && k % 2 == 1 && k > triangles / 2) {
      made.mesh.triangles.push_back(made.mesh.triangles.front());
    } else {
      made.mesh.add(a, b, c);
    }
  }
  made.rays = random_rays(random, rays);
  return made;
}

/// The inside of a box of 12 n² triangles, its corners moved about, and rays to its vertices and its edges: none may
/// slip through.
Case closed_box(Random& random, std::size_t n, std::size_t rays) {
  Case made;
  made.all_hidden = true;
  const auto grid = [&](std::size_t k) { return 2 * static_cast<double>(k) / static_cast<double>(n) - 1; };
  for (const int axis : {0, 1, 2}) {
    for (const double side : {-1.1, 0.9}) {
      const auto place = [&](std::size_t i, std::size_t j) {
        // The same displacement for the same point of the box, whichever side asks for it.
        const std::array<double, 3> p{side > 0 ? 1 : -1.0, grid(i), grid(j)};
        Vec3 v = axis == 0 ? Vec3{p[0], p[1], p[2]} : axis == 1 ? Vec3{p[2], p[0], p[1]} : Vec3{p[1], p[2], p[0]};
        v = v + 0.1 * Vec3{std::sin(7 * v.y + 3 * v.z), std::sin(5 * v.z + 2 * v.x), std::sin(6 * v.x + v.y)};
        return v;
      };
      for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t j = 0; j < n; ++j) {
          made.mesh.add(place(i, j), place(i + 1, j), place(i + 1, j + 1));
          made.mesh.add(place(i, j), place(i + 1, j + 1), place(i, j + 1));
        }
      }
    }
  }
  for (std::size_t k = 0; k < rays; ++k) {
    const Vec3 origin = Mesh::rounded(0.6 * in_cube(random));
    const auto pick = static_cast<std::size_t>(unit(random) * static_cast<double>(made.mesh.triangles.size()));
    const Indices& t = made.mesh.triangles[pick];
    const Vec3 a = made.mesh.vertices[t[0]], b = made.mesh.vertices[t[1]];
    const Vec3 to = k % 3 == 0 ? a : a + unit(random) * (b - a);
    made.rays.push_back({narrow(origin), 0, narrow(to - origin), 4});
  }
  return made;
}

/// Thin triangles one above the other, in whose boxes the rays run without meeting one: every node and leaf is visited.
Case comb(Random& random, std::size_t triangles, std::size_t rays) {
  Case made;
  for (std::size_t k = 0; k < triangles; ++k) {
    const double z = 2 * static_cast<double>(k) / static_cast<double>(triangles) - 1;
    made.mesh.add({-1, -1, z}, {1, 1, z}, {-0.98, -1, z});
  }
  for (std::size_t k = 0; k < rays; ++k) {
    const double x = 0.3 + 0.5 * unit(random), y = -0.5 * unit(random);
    made.rays.push_back({narrow({x, y, -2}), 0, {0, 0, 4}, 1});
  }
  if (!made.rays.empty()) made.rays.back() = {{0.5F, 0.499F, -2}, 0, {0, 0, 4}, 1};  // and one that ends on the first
  return made;
}

Finding run(Device& device, const Case& c, std::uint32_t groups) {
  const Hierarchy hierarchy(c.mesh.vertices, c.mesh.triangles);
  const ShadowRayArguments a{static_cast<std::uint32_t>(c.rays.size()), hierarchy.node_count(), hierarchy.leaf_count()};
  const auto floats = [](const auto& values) {
    std::vector<float> all(values.size() * sizeof values[0] / sizeof(float));
    std::memcpy(all.data(), values.data(), all.size() * sizeof(float));
    return all;
  };
  const auto kernel = device.kernel("shadow_rays", {});
  const GuardedBuffer nodes(device, floats(hierarchy.nodes())), leaves(device, floats(hierarchy.leaves()));
  const GuardedBuffer rays(device, floats(c.rays));
  const GuardedBuffer hidden(device, std::vector<float>(c.rays.size(), sentinel()));
  Buffer* const buffers[] = {nodes.get(), leaves.get(), rays.get(), hidden.get()};
  device.queue().launch(*kernel, groups, buffers, std::as_bytes(std::span(&a, 1)), "Check rays");
  const std::vector<float> found = hidden.values(device);
  for (const GuardedBuffer* input : {&nodes, &leaves, &rays}) static_cast<void>(input->values(device));

  Finding finding;
  std::size_t wrong = 0, unsure = 0;
  for (std::size_t k = 0; k < c.rays.size(); ++k) {
    std::uint32_t answer = 0;
    std::memcpy(&answer, &found[k], sizeof answer);
    const Answer expected = c.all_hidden ? Answer::hidden : reference(c.rays[k], c.mesh);
    if (expected == Answer::unsure) ++unsure;
    const bool right = expected == Answer::unsure ? answer <= 1 : answer == (expected == Answer::hidden ? 1U : 0U);
    if (right) continue;
    ++wrong;
    if (finding.wrong.empty()) finding.wrong = fmt::format("ray {} gives {}", k, answer);
  }
  finding.error = static_cast<double>(wrong) / static_cast<double>(c.rays.size());
  if (unsure * 10 > c.rays.size()) finding.wrong = fmt::format("{} rays are too near an edge to be judged", unsure);
  return finding;
}

}  // namespace

void check_rays(Device& device, std::vector<KernelCheck>& rows, const Selection& selection) {
  const auto add = [&](std::string_view name, std::size_t triangles, std::size_t rays, std::uint32_t groups,
                       const auto& make) {
    if (triangles > selection.max_size || rays > selection.max_size * 8) return;
    KernelCheck row;
    row.kernel = "shadow_rays";
    row.size = triangles;
    row.parameters = fmt::format("{} rays={} groups={}", name, rays, groups);
    add_case(rows, std::move(row), [&] {
      Random random(triangles * 2654435761U + rays);
      return run(device, make(random), groups);
    });
  };
  const auto groups_for = [](std::size_t rays) {
    return static_cast<std::uint32_t>((rays + rays_for_a_group - 1) / rays_for_a_group);
  };
  struct Size {
    std::size_t triangles, rays;
  };
  constexpr Size sizes[] = {{0, 9},    {1, 1},    {1, 100},   {2, 130},    {4, 129},   {5, 64},
                            {17, 130}, {65, 500}, {300, 500}, {1000, 500}, {3000, 500}};
  for (const Size s : sizes) {
    for (const bool bad : {false, true}) {
      if (bad && s.triangles < 4) continue;
      // Some groups have no rays, or all have as many as they may.
      const std::uint32_t groups = groups_for(s.rays) + (bad ? 3 : 0);
      add(bad ? "soup with degenerate triangles" : "soup", s.triangles, s.rays, groups,
          [=](Random& random) { return soup(random, s.triangles, s.rays, bad); });
    }
  }
  for (const std::size_t n : {1U, 5U, 12U}) {
    add("closed box", 12 * n * n, 400, groups_for(400), [=](Random& random) { return closed_box(random, n, 400); });
  }
  // As many steps as a launch lets an invocation make, and more: lavapipe would end its loops silently.
  add("comb", 1500, rays_for_a_group, 1, [](Random& random) { return comb(random, 1500, rays_for_a_group); });
}

}  // namespace interflect::check
