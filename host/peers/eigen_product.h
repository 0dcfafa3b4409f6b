#pragma once

#include <cstddef>

namespace interflect::peers {

/// A product for Eigen, in plain pointers: this header is also included by files that are compiled for newer processors
/// and must not share inline functions with the rest.
struct EigenProduct {
  const float* f;         ///< rows x n
  bool f_by_columns;      ///< else by rows
  std::ptrdiff_t stride;  ///< floats from one row (column) of F to the next
  std::ptrdiff_t rows, n;
  const float* x;  ///< n x 3
  float* y;        ///< rows x 3 of whole columns (rows) of n (3) floats
  bool x_by_rows;  ///< X and Y by rows, else by columns, n floats each
  bool vectors;    ///< three products of a matrix and a vector, else one of two matrices
  int threads;     ///< blocks of rows, one for each thread; 0: the whole, with Eigen's own threads
};

// Compiled for the processors of the time: x86-64, -v3 (AVX2) and -v4 (AVX-512); elsewhere only the first is there.
void eigen_multiply_base(const EigenProduct& product);
void eigen_multiply_v3(const EigenProduct& product);
void eigen_multiply_v4(const EigenProduct& product);

}  // namespace interflect::peers
