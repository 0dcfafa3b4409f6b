#include <fmt/format.h>

#include <chrono>
#include <memory>
#include <string_view>
#include <thread>

#include "interflect/peers/library.h"
#include "interflect/peers/peer.h"

// OpenBLAS through its C interface, declared here as its header has it. Threads: openblas_set_num_threads, as many as
// everybody has. F lies in memory by rows (CblasTrans of a matrix by columns) or, as a copy, by columns.

namespace interflect::peers {

namespace {

enum Order : int { by_rows = 101, by_columns = 102 };
enum Transpose : int { as_is = 111, transposed = 112 };

using Sgemm = void(Order order, Transpose a_turned, Transpose b_turned, int m, int n, int k, float alpha,
                   const float* a, int a_stride, const float* b, int b_stride, float beta, float* c, int c_stride);
using Sgemv = void(Order order, Transpose a_turned, int m, int n, float alpha, const float* a, int a_stride,
                   const float* x, int x_step, float beta, float* y, int y_step);

struct OpenBlas {
  explicit OpenBlas(int threads)
      : library("INTERFLECT_OPENBLAS", {"libopenblas.so.0", "libopenblas.so"}),
        sgemm(library.function<Sgemm>("cblas_sgemm")),
        sgemv(library.function<Sgemv>("cblas_sgemv")) {
    library.function<void(int)>("openblas_set_num_threads")(threads);
  }
  [[nodiscard]] std::string about(int threads) const {
    auto* const config = library.function_or_null<char*()>("openblas_get_config");
    auto* const core = library.function_or_null<char*()>("openblas_get_corename");
    const std::string text = config != nullptr ? config() : "OpenBLAS";
    return fmt::format("{}{}, {} threads", text.substr(0, text.find(' ', text.find(' ') + 1)),
                       core != nullptr ? fmt::format(" for {}", core()) : "", threads);
  }
  Library library;
  Sgemm* sgemm;
  Sgemv* sgemv;
};

struct State {
  State(const Problem& given) : problem(given), blas(given.threads()), y(columns * given.n()) {}
  const Problem& problem;
  OpenBlas blas;
  std::vector<float> y;
  [[nodiscard]] int n() const { return static_cast<int>(problem.n()); }
  [[nodiscard]] int stride() const { return static_cast<int>(problem.f().stride()); }
};
using Shared = std::shared_ptr<State>;

/// Its threads turn for about 2^26 cycles after their last work.
void sleep_until_idle() {
  std::this_thread::sleep_for(std::chrono::milliseconds(40));
}

template <class Rows>
void for_panels(const State& state, Rows rows) {
  for (const Panel& panel : state.problem.f().panels()) {
    rows(reinterpret_cast<const float*>(panel.data->data()), static_cast<int>(panel.rows), std::size_t{panel.first});
  }
}

Columns columns_of(const Shared& s) {
  return from_columns(s->y, s->problem.n());
}
Columns rows_of(const Shared& s) {
  return from_rows(s->y, s->problem.n());
}

Ready sgemm(const Problem& problem) {
  const auto s = std::make_shared<State>(problem);
  Ready ready{.about = s->blas.about(problem.threads()), .calls = {}, .rest = sleep_until_idle};
  constexpr int three = columns;
  ready.calls.push_back({"F by rows, X by columns",
                         [s] {
                           for_panels(*s, [&](const float* f, int rows, std::size_t first) {
                             s->blas.sgemm(by_columns, transposed, as_is, rows, three, s->n(), 1, f, s->stride(),
                                           s->problem.x_by_columns().data(), s->n(), 0, s->y.data() + first, s->n());
                           });
                         },
                         [s] { return columns_of(s); }});
  ready.calls.push_back({"F and X by rows",
                         [s] {
                           for_panels(*s, [&](const float* f, int rows, std::size_t first) {
                             s->blas.sgemm(by_rows, as_is, as_is, rows, three, s->n(), 1, f, s->stride(),
                                           s->problem.x_by_rows().data(), three, 0, s->y.data() + columns * first,
                                           three);
                           });
                         },
                         [s] { return rows_of(s); }});
  if (const float* f = problem.f_by_columns()) {
    ready.calls.push_back({"F and X by columns",
                           [s, f] {
                             s->blas.sgemm(by_columns, as_is, as_is, s->n(), three, s->n(), 1, f, s->stride(),
                                           s->problem.x_by_columns().data(), s->n(), 0, s->y.data(), s->n());
                           },
                           [s] { return columns_of(s); }});
    ready.calls.push_back({"F by columns, X by rows",
                           [s, f] {
                             s->blas.sgemm(by_rows, transposed, as_is, s->n(), three, s->n(), 1, f, s->stride(),
                                           s->problem.x_by_rows().data(), three, 0, s->y.data(), three);
                           },
                           [s] { return rows_of(s); }});
  }
  return ready;
}

Ready sgemv(const Problem& problem) {
  const auto s = std::make_shared<State>(problem);
  Ready ready{.about = s->blas.about(problem.threads()), .calls = {}, .rest = sleep_until_idle};
  const auto product = [s](Transpose turned, const float* f, int m, int n, std::size_t first) {
    for (std::size_t c = 0; c < columns; ++c) {
      s->blas.sgemv(by_columns, turned, m, n, 1, f, s->stride(), s->problem.x_by_columns().data() + c * s->problem.n(),
                    1, 0, s->y.data() + c * s->problem.n() + first, 1);
    }
  };
  ready.calls.push_back({"F by rows",
                         [s, product] {
                           for_panels(*s, [&](const float* f, int rows, std::size_t first) {
                             product(transposed, f, s->n(), rows, first);
                           });
                         },
                         [s] { return columns_of(s); }});
  if (const float* f = problem.f_by_columns()) {
    ready.calls.push_back(
        {"F by columns", [s, f, product] { product(as_is, f, s->n(), s->n(), 0); }, [s] { return columns_of(s); }});
  }
  return ready;
}

}  // namespace

std::vector<Peer> openblas() {
  return {{.name = "openblas-sgemm", .device = "host", .prepare = sgemm},
          {.name = "openblas-sgemv", .device = "host", .prepare = sgemv}};
}

}  // namespace interflect::peers
