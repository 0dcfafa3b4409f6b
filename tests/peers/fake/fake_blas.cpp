// Stands for OpenBLAS, cuBLAS and cuSPARSE in the tests: what the peers use of them, as serial loops that can be
// checked by eye. With FAKE_BROKEN the last element of every sum is left out. Memory of the fake CUDA driver
// (tests/device/ fake_cuda) is the host's under another address.
#include <cstddef>
#include <cstdint>

namespace {

#ifdef FAKE_BROKEN
constexpr std::int64_t dropped = 1;
#else
constexpr std::int64_t dropped = 0;
#endif

template <class T>
T* host(T* device) {
  return reinterpret_cast<T*>(reinterpret_cast<std::uintptr_t>(device) & ~(std::uintptr_t{1} << 60U));
}

/// Element (i, j) of a matrix: by columns i + j * stride.
struct Matrix {
  const float* at;
  bool by_columns;
  std::int64_t stride;
  [[nodiscard]] float operator()(std::int64_t i, std::int64_t j) const {
    return at[by_columns ? i + j * stride : i * stride + j];
  }
};

/// c = alpha a b + beta c, with a m x k and b k x n as they are after turning.
void multiply(std::int64_t m, std::int64_t n, std::int64_t k, float alpha, Matrix a, Matrix b, float beta, float* c,
              bool c_by_columns, std::int64_t c_stride) {
  for (std::int64_t i = 0; i < m; ++i) {
    for (std::int64_t j = 0; j < n; ++j) {
      double sum = 0;
      for (std::int64_t p = 0; p < k - dropped; ++p) sum += static_cast<double>(a(i, p)) * static_cast<double>(b(p, j));
      float& to = c[c_by_columns ? i + j * c_stride : i * c_stride + j];
      const float old = beta == 0 ? 0 : beta * to;
      to = alpha * static_cast<float>(sum) + old;
    }
  }
}

/// A matrix that is turned lies the other way round.
Matrix turned(const float* at, bool by_columns, bool turn, std::int64_t stride) {
  return {at, by_columns != turn, stride};
}

struct Sparse {
  std::int64_t rows;
  const std::int32_t *starts, *indices;
  const float* values;
};
struct Dense {
  float* values;
  std::int64_t columns, stride;
  bool by_columns;
};
int handle = 0;  // what a handle points to
int given = 0;   // handles and matrices that are not given back

}  // namespace

extern "C" {

int fake_blas_given() {
  return given;
}

// OpenBLAS: 101 rows, 102 columns; 111 as it is, 112 turned.

void openblas_set_num_threads(int) {}
void cblas_sgemm(int order, int a_turn, int b_turn, int m, int n, int k, float alpha, const float* a, int a_stride,
                 const float* b, int b_stride, float beta, float* c, int c_stride) {
  const bool columns = order == 102;
  multiply(m, n, k, alpha, turned(a, columns, a_turn == 112, a_stride), turned(b, columns, b_turn == 112, b_stride),
           beta, c, columns, c_stride);
}
void cblas_sgemv(int order, int turn, int m, int n, float alpha, const float* a, int stride, const float* x, int x_step,
                 float beta, float* y, int y_step) {
  const bool turns = turn == 112;
  multiply(turns ? n : m, 1, turns ? m : n, alpha, turned(a, order == 102, turns, stride), {x, false, x_step}, beta, y,
           false, y_step);
}

// cuBLAS: by columns; 0 as it is, 1 turned; scalars on the host.

int cublasCreate_v2(void** made) {
  *made = &handle;
  ++given;
  return 0;
}
int cublasDestroy_v2(void*) {
  --given;
  return 0;
}
int cublasSetStream_v2(void* used, void* stream) {
  return used == &handle && stream != nullptr ? 0 : 1;
}
int cublasGetVersion_v2(void*, int* version) {
  *version = 1;
  return 0;
}
int cublasSgemm_v2(void*, int a_turn, int b_turn, int m, int n, int k, const float* alpha, const float* a, int a_stride,
                   const float* b, int b_stride, const float* beta, float* c, int c_stride) {
  cblas_sgemm(102, 111 + a_turn, 111 + b_turn, m, n, k, *alpha, host(a), a_stride, host(b), b_stride, *beta, host(c),
              c_stride);
  return 0;
}
int cublasSgemv_v2(void*, int turn, int m, int n, const float* alpha, const float* a, int stride, const float* x,
                   int x_step, const float* beta, float* y, int y_step) {
  cblas_sgemv(102, 111 + turn, m, n, *alpha, host(a), stride, host(x), x_step, *beta, host(y), y_step);
  return 0;
}

// cuSPARSE: order 1 columns, 2 rows.

int cusparseCreate(void** made) {
  return cublasCreate_v2(made);
}
int cusparseDestroy(void* object) {
  return cublasDestroy_v2(object);
}
int cusparseSetStream(void* used, void* stream) {
  return cublasSetStream_v2(used, stream);
}
int cusparseGetVersion(void* used, int* version) {
  return cublasGetVersion_v2(used, version);
}
int cusparseCreateCsr(void** made, std::int64_t rows, std::int64_t, std::int64_t count, void* starts, void* indices,
                      void* values, int start_type, int index_type, int base, int type) {
  if (start_type != 2 || index_type != 2 || base != 0 || type != 0) return 3;
  auto* const matrix = new Sparse{rows, host(static_cast<std::int32_t*>(starts)),
                                  host(static_cast<std::int32_t*>(indices)), host(static_cast<float*>(values))};
  if (matrix->starts[rows] != count) {
    delete matrix;
    return 3;
  }
  ++given;
  *made = matrix;
  return 0;
}
int cusparseCreateDnMat(void** made, std::int64_t, std::int64_t columns, std::int64_t stride, void* values, int type,
                        int order) {
  if (type != 0 || (order != 1 && order != 2)) return 3;
  ++given;
  *made = new Dense{host(static_cast<float*>(values)), columns, stride, order == 1};
  return 0;
}
int cusparseDestroySpMat(void* matrix) {
  --given;
  delete static_cast<Sparse*>(matrix);
  return 0;
}
int cusparseDestroyDnMat(void* matrix) {
  --given;
  delete static_cast<Dense*>(matrix);
  return 0;
}
int cusparseSpMM_bufferSize(void*, int, int, const void*, void*, void*, const void*, void*, int, int,
                            std::size_t* bytes) {
  *bytes = 64;
  return 0;
}
int cusparseSpMM(void*, int a_turn, int b_turn, const void* alpha, void* f, void* x, const void* beta, void* y,
                 int type, int, void* buffer) {
  if (a_turn != 0 || b_turn != 0 || type != 0 || buffer == nullptr) return 3;
  const auto& sparse = *static_cast<const Sparse*>(f);
  const auto& from = *static_cast<const Dense*>(x);
  const auto& to = *static_cast<const Dense*>(y);
  const float one = *static_cast<const float*>(alpha), zero = *static_cast<const float*>(beta);
  if (one != 1 || zero != 0 || from.columns != to.columns) return 3;
  for (std::int64_t i = 0; i < sparse.rows; ++i) {
    for (std::int64_t c = 0; c < to.columns; ++c) {
      double sum = 0;
      for (std::int64_t k = sparse.starts[i]; k < sparse.starts[i + 1] - dropped; ++k) {
        const std::int64_t j = sparse.indices[k];
        sum += static_cast<double>(sparse.values[k]) *
               static_cast<double>(from.values[from.by_columns ? j + c * from.stride : j * from.stride + c]);
      }
      to.values[to.by_columns ? i + c * to.stride : i * to.stride + c] = static_cast<float>(sum);
    }
  }
  return 0;
}
}
