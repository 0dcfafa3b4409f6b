#include <fmt/format.h>

#include <memory>

#include "interflect/base/error.h"
#include "interflect/peers/library.h"
#include "interflect/peers/opencl_place.h"
#include "interflect/peers/peer.h"

// CLBlast through its C interface, declared here as its header has it. It takes what its own database knows of the
// device (nothing is tuned for it here), as it would for anybody.

namespace interflect::peers {

namespace {

enum Layout : int { by_rows = 101, by_columns = 102 };
enum Transpose : int { as_is = 111, transposed = 112 };

using Sgemm = int(Layout layout, Transpose a_turned, Transpose b_turned, std::size_t m, std::size_t n, std::size_t k,
                  float alpha, cl_mem a, std::size_t a_offset, std::size_t a_stride, cl_mem b, std::size_t b_offset,
                  std::size_t b_stride, float beta, cl_mem c, std::size_t c_offset, std::size_t c_stride,
                  cl_command_queue* queue, cl_event* event);
using Sgemv = int(Layout layout, Transpose a_turned, std::size_t m, std::size_t n, float alpha, cl_mem a,
                  std::size_t a_offset, std::size_t a_stride, cl_mem x, std::size_t x_offset, std::size_t x_step,
                  float beta, cl_mem y, std::size_t y_offset, std::size_t y_step, cl_command_queue* queue,
                  cl_event* event);

struct State {
  State(const Problem& problem, const std::string& id)
      : library("INTERFLECT_CLBLAST", {"libclblast.so.1", "libclblast.so"}),
        sgemm(library.function<Sgemm>("CLBlastSgemm")),
        sgemv(library.function<Sgemv>("CLBlastSgemv")),
        place(problem, id) {}
  Library library;
  Sgemm* sgemm;
  Sgemv* sgemv;
  OpenClPlace place;

  void check(int status, const char* function) const {
    if (status != 0) throw device_error(place.id, "peer", fmt::format("{} gave status {}", function, status));
  }
};
using Shared = std::shared_ptr<State>;

void multiply(State& s, bool x_by_rows) {
  const std::size_t n = s.place.problem.n(), stride = s.place.problem.f().stride();
  cl_command_queue queue = s.place.queue.get();
  for (const OpenClPlace::Rows& panel : s.place.panels) {
    const int status =
        x_by_rows ? s.sgemm(by_rows, as_is, as_is, panel.rows, columns, n, 1, panel.f.get(), 0, stride,
                            s.place.x_by_rows.get(), 0, columns, 0, s.place.y.get(), columns * panel.first, columns,
                            &queue, nullptr)
                  : s.sgemm(by_columns, transposed, as_is, panel.rows, columns, n, 1, panel.f.get(), 0, stride,
                            s.place.x_by_columns.get(), 0, n, 0, s.place.y.get(), panel.first, n, &queue, nullptr);
    s.check(status, "CLBlastSgemm");
  }
  s.place.wait();
}

void multiply_by_columns(State& s) {
  const std::size_t n = s.place.problem.n();
  cl_command_queue queue = s.place.queue.get();
  s.check(
      s.sgemm(by_columns, as_is, as_is, n, columns, n, 1, s.place.f_by_columns.get(), 0, s.place.problem.f().stride(),
              s.place.x_by_columns.get(), 0, n, 0, s.place.y.get(), 0, n, &queue, nullptr),
      "CLBlastSgemm");
  s.place.wait();
}

/// Three products with a part of F that has m rows (columns) of n as it lies.
void vectors(State& s, Layout layout, Transpose turned, cl_mem f, std::size_t m, std::size_t n, std::size_t first) {
  cl_command_queue queue = s.place.queue.get();
  for (std::size_t c = 0; c < columns; ++c) {
    const std::size_t start = c * s.place.problem.n();
    s.check(s.sgemv(layout, turned, m, n, 1, f, 0, s.place.problem.f().stride(), s.place.x_by_columns.get(), start, 1,
                    0, s.place.y.get(), start + first, 1, &queue, nullptr),
            "CLBlastSgemv");
  }
}

constexpr const char* about = "CLBlast, its own choice for this device";

Ready sgemm(const Problem& problem, const std::string& id) {
  const auto s = std::make_shared<State>(problem, id);
  const std::size_t n = problem.n();
  const auto y_columns = [s, n] { return from_columns(s->place.download(), n); };
  Ready ready{.about = about, .calls = {}};
  ready.calls.push_back({"F by rows, X by columns", [s] { multiply(*s, false); }, y_columns});
  ready.calls.push_back(
      {"F and X by rows", [s] { multiply(*s, true); }, [s, n] { return from_rows(s->place.download(), n); }});
  if (s->place.f_by_columns != nullptr) {
    ready.calls.push_back({"F and X by columns", [s] { multiply_by_columns(*s); }, y_columns});
  }
  return ready;
}

Ready sgemv(const Problem& problem, const std::string& id) {
  const auto s = std::make_shared<State>(problem, id);
  const std::size_t n = problem.n();
  const auto y_columns = [s, n] { return from_columns(s->place.download(), n); };
  Ready ready{.about = about, .calls = {}};
  ready.calls.push_back({"F by rows",
                         [s, n] {
                           for (const auto& panel : s->place.panels) {
                             vectors(*s, by_rows, as_is, panel.f.get(), panel.rows, n, panel.first);
                           }
                           s->place.wait();
                         },
                         y_columns});
  if (s->place.f_by_columns != nullptr) {
    ready.calls.push_back({"F by columns",
                           [s, n] {
                             vectors(*s, by_columns, as_is, s->place.f_by_columns.get(), n, n, 0);
                             s->place.wait();
                           },
                           y_columns});
  }
  return ready;
}

}  // namespace

std::vector<Peer> clblast(const std::string& id) {
  return {{.name = "clblast-sgemm", .device = id, .prepare = [id](const Problem& p) { return sgemm(p, id); }},
          {.name = "clblast-sgemv", .device = id, .prepare = [id](const Problem& p) { return sgemv(p, id); }}};
}

}  // namespace interflect::peers
