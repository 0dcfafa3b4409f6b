#include <fmt/format.h>

#include <memory>

#include "interflect/base/error.h"
#include "interflect/peers/eigen_product.h"
#include "interflect/peers/peer.h"

// Eigen, compiled for the instruction set that the machine has, with its own threads and with a block of rows for each
// of ours: its own serve only products of matrices.

namespace interflect::peers {

namespace {

#ifdef INTERFLECT_HAS_EIGEN

struct Compiled {
  const char* name;
  void (*multiply)(const EigenProduct&);
};

Compiled best() {
#if defined(__x86_64__)
  // What x86-64-v4 and -v3 are made of, as far as compilers of today can ask for it.
  const bool v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2");
  const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                  __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
                  __builtin_cpu_supports("avx512vl");
  if (v4) return {"x86-64-v4", eigen_multiply_v4};
  if (v3) return {"x86-64-v3", eigen_multiply_v3};
#endif
  return {"the build's processor", eigen_multiply_base};
}

Ready ready(const Problem& problem, bool vectors) {
  const Compiled compiled = best();
  const auto y = std::make_shared<std::vector<float>>(columns * problem.n());
  Ready out{.about = fmt::format("Eigen {} for {}, {} threads", INTERFLECT_HAS_EIGEN, compiled.name, problem.threads()),
            .calls = {}};
  const auto add = [&](const float* whole, bool x_by_rows, int threads) {
    const auto run = [=, &problem] {
      EigenProduct product{.f = whole,
                           .f_by_columns = whole != nullptr,
                           .stride = static_cast<std::ptrdiff_t>(problem.f().stride()),
                           .rows = static_cast<std::ptrdiff_t>(problem.n()),
                           .n = static_cast<std::ptrdiff_t>(problem.n()),
                           .x = (x_by_rows ? problem.x_by_rows() : problem.x_by_columns()).data(),
                           .y = y->data(),
                           .x_by_rows = x_by_rows,
                           .vectors = vectors,
                           .threads = threads};
      if (whole != nullptr) {
        compiled.multiply(product);
        return;
      }
      for (const Panel& panel : problem.f().panels()) {
        product.f = reinterpret_cast<const float*>(panel.data->data());
        product.rows = panel.rows;
        product.y = y->data() + std::size_t{panel.first} * (x_by_rows ? columns : 1);
        compiled.multiply(product);
      }
    };
    const std::size_t n = problem.n();
    out.calls.push_back(
        {fmt::format("F by {}, X by {}, {}", whole != nullptr ? "columns" : "rows", x_by_rows ? "rows" : "columns",
                     threads == 0 ? "Eigen's threads" : "a block of rows for each thread"),
         run, [=] { return x_by_rows ? from_rows(*y, n) : from_columns(*y, n); }});
  };
  std::vector<const float*> layouts{nullptr};
  if (const float* whole = problem.f_by_columns()) layouts.push_back(whole);
  for (const float* whole : layouts) {
    for (const bool x_by_rows : {false, true}) {
      if (vectors && x_by_rows) continue;  // a vector lies in one piece
      add(whole, x_by_rows, problem.threads());
      if (!vectors) add(whole, x_by_rows, 0);
    }
  }
  return out;
}

#else

Ready ready(const Problem&, bool) {
  throw Error(ErrorKind::limit, "not in this build: Eigen was not found");
}

#endif

}  // namespace

std::vector<Peer> eigen() {
  return {{.name = "eigen-gemm", .device = "host", .prepare = [](const Problem& p) { return ready(p, false); }},
          {.name = "eigen-gemv", .device = "host", .prepare = [](const Problem& p) { return ready(p, true); }}};
}

}  // namespace interflect::peers
