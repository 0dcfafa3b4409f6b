#include <fmt/format.h>

#include <memory>

#include "interflect/base/error.h"
#include "interflect/peers/cuda_place.h"
#include "interflect/peers/library.h"
#include "interflect/peers/peer.h"

// cuBLAS, declared here as NVIDIA's documentation has it; in its default mode a product of floats is one of floats, not
// of TF32. The calls are tested against a fake library only: this has not run on a GPU yet.

namespace interflect::peers {

namespace {

struct Context;
using Handle = Context*;
enum Transpose : int { as_is = 0, transposed = 1 };

using Create = int(Handle* handle);
using Destroy = int(Handle handle);
using SetStream = int(Handle handle, cuda::Stream* stream);
using Version = int(Handle handle, int* version);
using Sgemm = int(Handle handle, Transpose a_turned, Transpose b_turned, int m, int n, int k, const float* alpha,
                  const float* a, int a_stride, const float* b, int b_stride, const float* beta, float* c,
                  int c_stride);
using Sgemv = int(Handle handle, Transpose a_turned, int m, int n, const float* alpha, const float* a, int a_stride,
                  const float* x, int x_step, const float* beta, float* y, int y_step);

float* at(cuda::DevicePointer memory, std::size_t offset = 0) {
  return reinterpret_cast<float*>(memory) + offset;
}

struct State {
  State(const Problem& problem, const std::string& id)
      : library("INTERFLECT_CUBLAS", {"libcublas.so.13", "libcublas.so.12", "libcublas.so.11", "libcublas.so"}),
        sgemm(library.function<Sgemm>("cublasSgemm_v2")),
        sgemv(library.function<Sgemv>("cublasSgemv_v2")),
        place(problem, id),
        handle_(nullptr, library.function<Destroy>("cublasDestroy_v2")) {
    place.upload_f();
    place.check(library.function<Create>("cublasCreate_v2")(&handle), "cublasCreate");
    handle_.reset(handle);
    place.check(library.function<SetStream>("cublasSetStream_v2")(handle, place.stream()), "cublasSetStream");
  }
  [[nodiscard]] std::string about() const {
    int version = 0;
    place.check(library.function<Version>("cublasGetVersion_v2")(handle, &version), "cublasGetVersion");
    return fmt::format("cuBLAS {}, fp32 without TF32", version);
  }
  Library library;
  Sgemm* sgemm;
  Sgemv* sgemv;
  CudaPlace place;
  Handle handle = nullptr;

 private:
  Given<Context> handle_;
};
using Shared = std::shared_ptr<State>;

constexpr float one = 1, zero = 0;
constexpr int three = columns;

/// cuBLAS knows matrices by columns: F by rows is the transposed of one, and so are X and Y by rows.
void by_columns(State& s) {
  s.place.use();
  const int n = static_cast<int>(s.place.problem.n()), stride = static_cast<int>(s.place.problem.f().stride());
  for (const CudaPlace::Rows& panel : s.place.panels) {
    s.place.check(s.sgemm(s.handle, transposed, as_is, static_cast<int>(panel.rows), three, n, &one, at(panel.f),
                          stride, at(s.place.x_by_columns), n, &zero, at(s.place.y, panel.first), n),
                  "cublasSgemm");
  }
  s.place.wait();
}

void by_rows(State& s) {
  s.place.use();
  const int n = static_cast<int>(s.place.problem.n()), stride = static_cast<int>(s.place.problem.f().stride());
  for (const CudaPlace::Rows& panel : s.place.panels) {
    s.place.check(s.sgemm(s.handle, as_is, as_is, three, static_cast<int>(panel.rows), n, &one, at(s.place.x_by_rows),
                          three, at(panel.f), stride, &zero, at(s.place.y, columns * panel.first), three),
                  "cublasSgemm");
  }
  s.place.wait();
}

void all_by_columns(State& s) {
  s.place.use();
  const int n = static_cast<int>(s.place.problem.n()), stride = static_cast<int>(s.place.problem.f().stride());
  s.place.check(s.sgemm(s.handle, as_is, as_is, n, three, n, &one, at(s.place.f_by_columns), stride,
                        at(s.place.x_by_columns), n, &zero, at(s.place.y), n),
                "cublasSgemm");
  s.place.wait();
}

/// Three products with a part of F that has m rows and n columns as it lies.
void vectors(State& s, Transpose turned, cuda::DevicePointer f, std::size_t m, std::size_t n, std::size_t first) {
  for (std::size_t c = 0; c < columns; ++c) {
    const std::size_t start = c * s.place.problem.n();
    s.place.check(s.sgemv(s.handle, turned, static_cast<int>(m), static_cast<int>(n), &one, at(f),
                          static_cast<int>(s.place.problem.f().stride()), at(s.place.x_by_columns, start), 1, &zero,
                          at(s.place.y, start + first), 1),
                  "cublasSgemv");
  }
}

Ready sgemm(const Problem& problem, const std::string& id) {
  const auto s = std::make_shared<State>(problem, id);
  const std::size_t n = problem.n();
  const auto y_columns = [s, n] { return from_columns(s->place.download(), n); };
  Ready ready{.about = s->about(), .calls = {}};
  ready.calls.push_back({"F by rows, X by columns", [s] { by_columns(*s); }, y_columns});
  ready.calls.push_back(
      {"F and X by rows", [s] { by_rows(*s); }, [s, n] { return from_rows(s->place.download(), n); }});
  if (s->place.f_by_columns != 0) {
    ready.calls.push_back({"F and X by columns", [s] { all_by_columns(*s); }, y_columns});
  }
  return ready;
}

Ready sgemv(const Problem& problem, const std::string& id) {
  const auto s = std::make_shared<State>(problem, id);
  const std::size_t n = problem.n();
  const auto y_columns = [s, n] { return from_columns(s->place.download(), n); };
  Ready ready{.about = s->about(), .calls = {}};
  ready.calls.push_back({"F by rows",
                         [s, n] {
                           s->place.use();
                           for (const CudaPlace::Rows& panel : s->place.panels) {
                             vectors(*s, transposed, panel.f, n, panel.rows, panel.first);
                           }
                           s->place.wait();
                         },
                         y_columns});
  if (s->place.f_by_columns != 0) {
    ready.calls.push_back({"F by columns",
                           [s, n] {
                             s->place.use();
                             vectors(*s, as_is, s->place.f_by_columns, n, n, 0);
                             s->place.wait();
                           },
                           y_columns});
  }
  return ready;
}

}  // namespace

std::vector<Peer> cublas(const std::string& id) {
  return {{.name = "cublas-sgemm", .device = id, .prepare = [id](const Problem& p) { return sgemm(p, id); }},
          {.name = "cublas-sgemv", .device = id, .prepare = [id](const Problem& p) { return sgemv(p, id); }}};
}

}  // namespace interflect::peers
