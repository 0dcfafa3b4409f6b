#include <fmt/format.h>

#include <cstdint>
#include <limits>
#include <memory>

#include "interflect/base/error.h"
#include "interflect/peers/cuda_place.h"
#include "interflect/peers/library.h"
#include "interflect/peers/peer.h"

// cuSPARSE on the non-zeros of F (CSR with 32-bit indices), declared here as NVIDIA's documentation has it. The calls
// are tested against a fake library only: this has not run on a GPU yet.

namespace interflect::peers {

namespace {

struct Opaque;
using Handle = Opaque*;
using Sparse = Opaque*;
using Dense = Opaque*;
enum Operation : int { as_is = 0 };
enum IndexType : int { index_32 = 2 };
enum IndexBase : int { from_zero = 0 };
enum ValueType : int { fp32 = 0 };
enum Order : int { by_columns = 1, by_rows = 2 };
enum Algorithm : int { default_algorithm = 0, csr_algorithm_2 = 6 };

using Create = int(Handle* handle);
using Destroy = int(Opaque* object);
using SetStream = int(Handle handle, cuda::Stream* stream);
using Version = int(Handle handle, int* version);
using CreateCsr = int(Sparse* matrix, std::int64_t rows, std::int64_t columns, std::int64_t count, void* row_starts,
                      void* column_indices, void* values, IndexType start_type, IndexType index_type, IndexBase base,
                      ValueType type);
using CreateDense = int(Dense* matrix, std::int64_t rows, std::int64_t columns, std::int64_t stride, void* values,
                        ValueType type, Order order);
using Size = int(Handle handle, Operation a, Operation b, const void* alpha, Sparse f, Dense x, const void* beta,
                 Dense y, ValueType type, Algorithm algorithm, std::size_t* bytes);
using Multiply = int(Handle handle, Operation a, Operation b, const void* alpha, Sparse f, Dense x, const void* beta,
                     Dense y, ValueType type, Algorithm algorithm, void* buffer);

/// The non-zeros of F by rows.
struct Csr {
  std::vector<std::int32_t> starts{0}, indices;
  std::vector<float> values;
};

Csr non_zeros(const FormFactorMatrix& f) {
  Csr csr;
  for (std::uint32_t i = 0; i < f.size(); ++i) {
    const auto row = f.row(i);
    for (std::size_t j = 0; j < row.size(); ++j) {
      if (row[j] == 0.0F) continue;
      csr.indices.push_back(static_cast<std::int32_t>(j));
      csr.values.push_back(row[j]);
    }
    if (csr.values.size() > std::size_t{std::numeric_limits<std::int32_t>::max()}) {
      throw Error(ErrorKind::limit, "more non-zeros than 32-bit indices can count");
    }
    csr.starts.push_back(static_cast<std::int32_t>(csr.values.size()));
  }
  return csr;
}

class State {
 public:
  State(const Problem& problem, const std::string& id)
      : place(problem, id),
        library_("INTERFLECT_CUSPARSE", {"libcusparse.so.12", "libcusparse.so.11", "libcusparse.so"}),
        multiply_(library_.function<Multiply>("cusparseSpMM")) {
    place.check(library_.function<Create>("cusparseCreate")(&handle_), "cusparseCreate");
    kept_handle_ = {handle_, library_.function<Destroy>("cusparseDestroy")};
    place.check(library_.function<SetStream>("cusparseSetStream")(handle_, place.stream()), "cusparseSetStream");
    const Csr csr = non_zeros(problem.f());
    const auto n = static_cast<std::int64_t>(problem.n());
    place.check(library_.function<CreateCsr>("cusparseCreateCsr")(
                    &f_, n, n, static_cast<std::int64_t>(csr.values.size()), upload(csr.starts), upload(csr.indices),
                    upload(csr.values), index_32, index_32, from_zero, fp32),
                "cusparseCreateCsr");
    kept_.emplace_back(f_, library_.function<Destroy>("cusparseDestroySpMat"));
    const auto dense = [&](Dense& matrix, cuda::DevicePointer memory, Order order) {
      place.check(library_.function<CreateDense>("cusparseCreateDnMat")(&matrix, n, columns,
                                                                        order == by_rows ? std::int64_t{columns} : n,
                                                                        reinterpret_cast<void*>(memory), fp32, order),
                  "cusparseCreateDnMat");
      kept_.emplace_back(matrix, library_.function<Destroy>("cusparseDestroyDnMat"));
    };
    dense(x_[0], place.x_by_columns, by_columns);
    dense(y_[0], place.y, by_columns);
    dense(x_[1], place.x_by_rows, by_rows);
    dense(y_[1], place.y, by_rows);
    for (const std::size_t order : {0U, 1U}) {
      std::size_t bytes = 0;
      place.check(library_.function<Size>("cusparseSpMM_bufferSize")(handle_, as_is, as_is, &one, f_, x_[order], &zero,
                                                                     y_[order], fp32, algorithm(order), &bytes),
                  "cusparseSpMM_bufferSize");
      if (bytes > 0) buffers_[order] = reinterpret_cast<void*>(place.allocate(bytes));
    }
  }
  void multiply(std::size_t order) {
    place.use();
    place.check(multiply_(handle_, as_is, as_is, &one, f_, x_[order], &zero, y_[order], fp32, algorithm(order),
                          buffers_[order]),
                "cusparseSpMM");
    place.wait();
  }
  [[nodiscard]] std::string about() const {
    int version = 0;
    place.check(library_.function<Version>("cusparseGetVersion")(handle_, &version), "cusparseGetVersion");
    return fmt::format("cuSPARSE {}, CSR", version);
  }
  CudaPlace place;

 private:
  static constexpr float one = 1, zero = 0;
  /// Its second CSR algorithm is the one for matrices by rows.
  static Algorithm algorithm(std::size_t order) { return order == 0 ? default_algorithm : csr_algorithm_2; }
  template <class T>
  void* upload(const std::vector<T>& values) {
    return reinterpret_cast<void*>(place.uploaded(std::as_bytes(std::span(values))));
  }

  Library library_;
  Multiply* multiply_;
  Handle handle_ = nullptr;
  Sparse f_ = nullptr;
  Dense x_[2] = {}, y_[2] = {};  ///< by columns, by rows
  void* buffers_[2] = {};
  // Given back before the place goes, the handle last.
  Given<Opaque> kept_handle_{nullptr, nullptr};
  std::vector<Given<Opaque>> kept_;
};

Ready ready(const Problem& problem, const std::string& id) {
  const auto s = std::make_shared<State>(problem, id);
  const std::size_t n = problem.n();
  return {.about = s->about(),
          .calls = {{"X by columns", [s] { s->multiply(0); }, [s, n] { return from_columns(s->place.download(), n); }},
                    {"X by rows", [s] { s->multiply(1); }, [s, n] { return from_rows(s->place.download(), n); }}}};
}

}  // namespace

std::vector<Peer> cusparse(const std::string& id) {
  return {{.name = "cusparse-spmm", .device = id, .storage = "csr32", .prepare = [id](const Problem& p) {
             return ready(p, id);
           }}};
}

}  // namespace interflect::peers
