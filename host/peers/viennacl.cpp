#include "interflect/base/error.h"
#include "interflect/peers/peer.h"

#ifdef INTERFLECT_HAS_VIENNACL

#define VIENNACL_WITH_OPENMP
#define VIENNACL_WITH_OPENCL
#include <fmt/format.h>

#include <memory>
#include <viennacl/linalg/prod.hpp>
#include <viennacl/matrix.hpp>
#include <viennacl/ocl/backend.hpp>
#include <viennacl/vector.hpp>

#include "interflect/peers/opencl_place.h"

#endif

// ViennaCL, on the processor through its OpenMP loops (compiled so that their sums may be reordered, without which they
// could not use SIMD at all) and through OpenCL with the kernels that it makes for the device.

namespace interflect::peers {

#ifdef INTERFLECT_HAS_VIENNACL

namespace {

using Matrix = viennacl::matrix_base<float>;
using Vector = viennacl::vector_base<float>;

/// F's panels, X and Y as ViennaCL sees them. Behind pointers: to move one of its objects is to copy what it shows.
struct Views {
  struct Rows {
    std::unique_ptr<Matrix> f, y;             ///< y: rows x 3
    std::vector<std::unique_ptr<Vector>> ys;  ///< the same rows of three columns
  };
  std::vector<Rows> panels;
  std::unique_ptr<Matrix> x;
  std::vector<std::unique_ptr<Vector>> xs;
};

void matrices(const Views& views) {
  for (const Views::Rows& panel : views.panels) *panel.y = viennacl::linalg::prod(*panel.f, *views.x);
}
void vectors(const Views& views) {
  for (const Views::Rows& panel : views.panels) {
    for (std::size_t c = 0; c < columns; ++c) *panel.ys[c] = viennacl::linalg::prod(*panel.f, *views.xs[c]);
  }
}

/// What ViennaCL throws is no Error of ours.
template <class Act>
auto translated(const std::string& id, Act act) {
  try {
    return act();
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    throw device_error(id, "peer", fmt::format("ViennaCL: {}", error.what()));
  } catch (const char* text) {
    throw device_error(id, "peer", fmt::format("ViennaCL: {}", text));
  }
}

constexpr auto here = viennacl::MAIN_MEMORY;

/// X and Y are by rows for the matrices (ViennaCL asks for one layout throughout), by columns for the vectors.
Views views_on_host(const Problem& problem, std::vector<float>& y) {
  const std::size_t n = problem.n(), stride = problem.f().stride();
  Views views;
  auto* x_rows = const_cast<float*>(problem.x_by_rows().data());
  auto* x_columns = const_cast<float*>(problem.x_by_columns().data());
  views.x = std::make_unique<Matrix>(x_rows, here, n, 0, 1, n, columns, 0, 1, columns, true);
  for (std::size_t c = 0; c < columns; ++c) views.xs.push_back(std::make_unique<Vector>(x_columns, here, n, c * n, 1));
  for (const Panel& panel : problem.f().panels()) {
    const std::size_t rows = panel.rows, first = panel.first;
    auto* const f = reinterpret_cast<float*>(panel.data->data());
    Views::Rows& made = views.panels.emplace_back();
    made.f = std::make_unique<Matrix>(f, here, rows, 0, 1, rows, n, 0, 1, stride, true);
    made.y = std::make_unique<Matrix>(y.data(), here, rows, first, 1, n, columns, 0, 1, columns, true);
    for (std::size_t c = 0; c < columns; ++c) {
      made.ys.push_back(std::make_unique<Vector>(y.data(), here, rows, c * n + first, 1));
    }
  }
  return views;
}

/// The same with all by columns.
Views column_views_on_host(const Problem& problem, const float* f, std::vector<float>& y) {
  const std::size_t n = problem.n(), stride = problem.f().stride();
  Views views;
  auto* x = const_cast<float*>(problem.x_by_columns().data());
  views.x = std::make_unique<Matrix>(x, here, n, 0, 1, n, columns, 0, 1, columns, false);
  Views::Rows& all = views.panels.emplace_back();
  all.f = std::make_unique<Matrix>(const_cast<float*>(f), here, n, 0, 1, stride, n, 0, 1, n, false);
  all.y = std::make_unique<Matrix>(y.data(), here, n, 0, 1, n, columns, 0, 1, columns, false);
  for (std::size_t c = 0; c < columns; ++c) {
    views.xs.push_back(std::make_unique<Vector>(x, here, n, c * n, 1));
    all.ys.push_back(std::make_unique<Vector>(y.data(), here, n, c * n, 1));
  }
  return views;
}

struct OnHost {
  explicit OnHost(const Problem& problem) : y(columns * problem.n()), views(views_on_host(problem, y)) {
    if (const float* f = problem.f_by_columns()) column_views = column_views_on_host(problem, f, y);
  }
  std::vector<float> y;
  Views views, column_views;  ///< the second without panels where there is no F by columns
};

/// The calls of a place: `run` does them there, `y` gives its 3 n floats.
template <class Run, class Y>
std::vector<Call> calls_of(const Views& by_rows, const Views& by_columns, bool with_vectors, std::size_t n, Run run,
                           Y y) {
  std::vector<Call> calls;
  const auto call = [&](const char* how, const Views& views, bool y_by_rows) {
    calls.push_back({how,
                     [run, &views, with_vectors] { run([&] { with_vectors ? vectors(views) : matrices(views); }); },
                     [y, n, y_by_rows] { return y_by_rows ? from_rows(y(), n) : from_columns(y(), n); }});
  };
  call(with_vectors ? "F by rows" : "F and X by rows", by_rows, !with_vectors);
  if (!by_columns.panels.empty()) call(with_vectors ? "F by columns" : "F and X by columns", by_columns, false);
  return calls;
}

Ready on_host(const Problem& problem, bool with_vectors) {
  const auto s = std::make_shared<OnHost>(problem);
  return {.about = fmt::format("ViennaCL, OpenMP, {} threads", problem.threads()),
          .calls = calls_of(
              s->views, s->column_views, with_vectors, problem.n(), [s](auto act) { translated("host", act); },
              [s] { return s->y; })};
}

/// ViennaCL knows contexts by a number, and its objects belong to the one that is current when they are made.
struct OnOpenCl {
  OnOpenCl(const Problem& problem, const std::string& id) : place(problem, id) {
    static long last = 1000;  // others may have the small numbers
    context = ++last;
    viennacl::ocl::setup_context(context, place.context.get(), place.device, place.queue.get());
    use();
    const std::size_t n = problem.n(), stride = problem.f().stride();
    const viennacl::context in(viennacl::ocl::get_context(context));
    views.x = std::make_unique<Matrix>(place.x_by_rows.get(), in, n, 0, 1, n, columns, 0, 1, columns, true);
    for (std::size_t c = 0; c < columns; ++c) {
      views.xs.push_back(std::make_unique<Vector>(place.x_by_columns.get(), n, c * n, 1, in));
    }
    for (const OpenClPlace::Rows& panel : place.panels) {
      Views::Rows& made = views.panels.emplace_back();
      made.f = std::make_unique<Matrix>(panel.f.get(), in, panel.rows, 0, 1, panel.rows, n, 0, 1, stride, true);
      made.y = std::make_unique<Matrix>(place.y.get(), in, panel.rows, panel.first, 1, n, columns, 0, 1, columns, true);
      for (std::size_t c = 0; c < columns; ++c) {
        made.ys.push_back(std::make_unique<Vector>(place.y.get(), panel.rows, c * n + panel.first, 1, in));
      }
    }
    if (place.f_by_columns != nullptr) add_column_views(in);
  }
  void add_column_views(const viennacl::context& in) {
    const std::size_t n = place.problem.n(), stride = place.problem.f().stride();
    column_views.x = std::make_unique<Matrix>(place.x_by_columns.get(), in, n, 0, 1, n, columns, 0, 1, columns, false);
    Views::Rows& all = column_views.panels.emplace_back();
    all.f = std::make_unique<Matrix>(place.f_by_columns.get(), in, n, 0, 1, stride, n, 0, 1, n, false);
    all.y = std::make_unique<Matrix>(place.y.get(), in, n, 0, 1, n, columns, 0, 1, columns, false);
    for (std::size_t c = 0; c < columns; ++c) {
      column_views.xs.push_back(std::make_unique<Vector>(place.x_by_columns.get(), n, c * n, 1, in));
      all.ys.push_back(std::make_unique<Vector>(place.y.get(), n, c * n, 1, in));
    }
  }
  void use() const { viennacl::ocl::switch_context(context); }
  OpenClPlace place;
  long context = 0;
  Views views, column_views;
};

Ready on_opencl(const Problem& problem, const std::string& id, bool with_vectors) {
  return translated(id, [&]() -> Ready {
    const auto s = std::make_shared<OnOpenCl>(problem, id);
    const auto run = [s, id](auto act) {
      translated(id, [&] {
        s->use();
        act();
        s->place.wait();
      });
    };
    return {.about = "ViennaCL, its own choice for this device",
            .calls = calls_of(s->views, s->column_views, with_vectors, problem.n(), run,
                              [s] { return s->place.download(); })};
  });
}

}  // namespace

std::vector<Peer> viennacl_on_host() {
  return {{.name = "viennacl-gemm", .device = "host", .prepare = [](const Problem& p) { return on_host(p, false); }},
          {.name = "viennacl-gemv", .device = "host", .prepare = [](const Problem& p) { return on_host(p, true); }}};
}

std::vector<Peer> viennacl_on(const std::string& id) {
  return {
      {.name = "viennacl-gemm", .device = id, .prepare = [id](const Problem& p) { return on_opencl(p, id, false); }},
      {.name = "viennacl-gemv", .device = id, .prepare = [id](const Problem& p) { return on_opencl(p, id, true); }}};
}

#else

namespace {

Ready missing(const Problem&) {
  throw Error(ErrorKind::limit, "not in this build: ViennaCL was not found");
}

}  // namespace

std::vector<Peer> viennacl_on_host() {
  return viennacl_on("host");
}

std::vector<Peer> viennacl_on(const std::string& id) {
  return {{.name = "viennacl-gemm", .device = id, .prepare = missing},
          {.name = "viennacl-gemv", .device = id, .prepare = missing}};
}

#endif

}  // namespace interflect::peers
