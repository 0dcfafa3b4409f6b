#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/base/memory.h"
#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/schedule/scheduler.h"

// Other people's libraries on the product that Interflect lives on, Y = F X with F n x n and X n x 3 in fp32, for
// `bench --peers`. None is needed to build or to run: C libraries are opened at run time, header-only ones are compiled
// in where CMake finds them.

namespace interflect::peers {

inline constexpr std::size_t columns = 3;

/// The product that every peer does, in the layouts that libraries take. Nothing of F is copied unless it is asked for.
class Problem {
 public:
  /// F and x (3 columns of n values) must outlive it. `threads`: what a library on the processor may use. Throws an
  /// internal Error for an x of another shape.
  Problem(const FormFactorMatrix& f, const Columns& x, int threads);

  [[nodiscard]] const FormFactorMatrix& f() const { return f_; }
  [[nodiscard]] std::size_t n() const { return f_.size(); }
  [[nodiscard]] int threads() const { return threads_; }
  /// X column after column, 3 n floats.
  [[nodiscard]] const std::vector<float>& x_by_columns() const { return by_columns_; }
  /// X row after row (red, green, blue of a patch), 3 n floats.
  [[nodiscard]] const std::vector<float>& x_by_rows() const { return by_rows_; }
  /// F column after column, each f().stride() floats after the last: a copy, made when it is first asked for. Null
  /// where memory for it is short.
  [[nodiscard]] const float* f_by_columns() const;

 private:
  const FormFactorMatrix& f_;
  int threads_;
  std::vector<float> by_columns_, by_rows_;
  mutable std::once_flag once_;
  mutable PageBuffer transposed_;
};

/// One way to ask a library for the product.
struct Call {
  std::string how;                  ///< "F by rows, X by columns"
  std::function<void()> run;        ///< once; everything is done on return. Throws device Errors
  std::function<Columns()> result;  ///< Y as the last run left it
};

/// A library with F and X in place, and the calls that are worth a try: the fastest of them counts.
struct Ready {
  std::string about;  ///< version, threads
  std::vector<Call> calls;
  /// Waits until the library's idle threads no longer turn: nobody else's time may pay for them. Empty: none do.
  std::function<void()> rest = {};
};

/// A library on a device.
struct Peer {
  std::string name;    ///< "openblas-sgemm"
  std::string device;  ///< "host", or the id of a device
  std::string storage = "dense32";
  /// Throws an Error: of kind limit when the library or something that it needs is not there ("not installed:
  /// libopenblas.so.0"), device when it fails. The Problem must outlive what is returned.
  std::function<Ready(const Problem&)> prepare;
};

/// Every peer: those on the processor, then those on each of the devices (ids) that they know how to use. A peer that
/// is not there is listed too; its prepare() says why.
[[nodiscard]] std::vector<Peer> all_peers(const std::vector<std::string>& devices);

/// Runs each call once, then twice in turn, and gives the place of the fastest. Throws what they throw.
[[nodiscard]] std::size_t fastest(const std::vector<Call>& calls);

// The libraries, a file each.
[[nodiscard]] std::vector<Peer> openblas();
[[nodiscard]] std::vector<Peer> eigen();
[[nodiscard]] std::vector<Peer> viennacl_on_host();
[[nodiscard]] std::vector<Peer> viennacl_on(const std::string& opencl_device);
[[nodiscard]] std::vector<Peer> clblast(const std::string& opencl_device);
[[nodiscard]] std::vector<Peer> cublas(const std::string& cuda_device);
[[nodiscard]] std::vector<Peer> cusparse(const std::string& cuda_device);

/// The largest |y − F x| / |F x| of all rows and columns against the product in double (x and F are not negative, so
/// that |F x| is the magnitude of what is added); not a number when y holds such or has another shape.
[[nodiscard]] double product_error(const FormFactorMatrix& f, const Columns& x, const Columns& y);

/// What product_error() may be at most: the bound of our own matvec, and 6 √n u (u = 2^-24) for libraries that add a
/// row up in one accumulator. No library promises an order of sums; 2.3 √n u was the most that was seen (CLBlast and
/// ViennaCL's OpenCL kernels, n = 17,128), and the worst case, n u, would let a dropped column through.
[[nodiscard]] double product_bound(std::size_t n);

/// The index of "opencl:1" and the like; a usage Error where there is none.
[[nodiscard]] std::size_t index_of(std::string_view id);

/// Y from 3 n floats, column after column or row after row.
[[nodiscard]] Columns from_columns(const std::vector<float>& y, std::size_t n);
[[nodiscard]] Columns from_rows(const std::vector<float>& y, std::size_t n);

}  // namespace interflect::peers
