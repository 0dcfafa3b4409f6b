// The matvec's share of the read bandwidth: both over the same matrix, in turn, with the same threads.
//
//   matvec_bench [N [REPETITIONS [COLUMNS]]]        default 17128 21 3; INTERFLECT_SIMD and OMP_NUM_THREADS apply

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/bandwidth.h"
#include "interflect/device/check.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/reference.h"
#include "interflect/device/registry.h"
#include "interflect/formfactor/form_factor_matrix.h"

namespace {

using namespace interflect;

FormFactorMatrix random_matrix(std::uint32_t n) {
  FormFactorMatrix matrix(n);
#pragma omp parallel for
  for (std::uint32_t i = 0; i < n; ++i) {
    check::Random random(i);
    for (float& f : matrix.row(i)) f = std::abs(random.next()) / static_cast<float>(n);
  }
  return matrix;
}

/// The matrix on the device, with x and y, ready to multiply.
class Product {
 public:
  Product(Device& device, const FormFactorMatrix& matrix, std::uint32_t columns)
      : device_(device),
        matrix_(matrix),
        columns_(columns),
        kernel_(device.kernel("matvec", {{"COLUMNS", static_cast<int>(columns)}})),
        values_(check::Random(1).numbers(std::size_t{columns} * matrix.stride())),
        x_(device.allocate(values_.size() * sizeof(float))),
        y_(device.allocate(values_.size() * sizeof(float))) {
    device.queue().upload(*x_, 0, std::as_bytes(std::span(values_)));
    for (const Panel& panel : matrix.panels()) panels_.push_back(device.share(panel.data));
  }

  double seconds() {
    const Timer timer;
    for (std::size_t p = 0; p < panels_.size(); ++p) {
      const Panel& panel = matrix_.panels()[p];
      const MatvecArguments arguments{matrix_.size(), panel.first, panel.rows, matrix_.stride(), matrix_.stride()};
      const std::array buffers = {panels_[p].get(), x_.get(), y_.get()};
      device_.queue().launch(*kernel_, 1, buffers, std::as_bytes(std::span(&arguments, 1)), "Benchmark matvec");
    }
    device_.queue().wait();
    return timer.seconds();
  }

  double read_seconds(int streams) {
    double sum = 0;
    for (const auto& panel : panels_) sum += time_read(device_, *panel, streams);
    return sum;
  }

  /// The largest relative error of 100 rows against the fp64 reference.
  double error() {
    std::vector<float> y(values_.size());
    device_.queue().download(*y_, 0, std::as_writable_bytes(std::span(y)));
    const std::uint32_t n = matrix_.size();
    check::Finding finding;
    std::vector<reference::Sum> exact(columns_);
    for (std::uint32_t i = 0; i < n; i += std::max(1U, n / 100)) {
      const MatvecArguments row{n, i, 1, matrix_.stride(), matrix_.stride()};
      reference::matvec(row, columns_, matrix_.row(i), values_, exact);
      for (std::uint32_t c = 0; c < columns_; ++c) {
        check::compare(finding, y[std::size_t{c} * matrix_.stride() + i], exact[c].value, exact[c].magnitude);
      }
    }
    return finding.error;
  }

 private:
  Device& device_;
  const FormFactorMatrix& matrix_;
  std::uint32_t columns_;
  std::unique_ptr<Kernel> kernel_;
  std::vector<float> values_;
  std::unique_ptr<Buffer> x_;
  std::unique_ptr<Buffer> y_;
  std::vector<std::unique_ptr<Buffer>> panels_;
};

double median(std::vector<double> seconds) {
  std::sort(seconds.begin(), seconds.end());
  return seconds[seconds.size() / 2];
}

/// Prints the table; whether the product is right.
bool run(std::uint32_t n, int repetitions, std::uint32_t columns) {
  const auto device = open_device("openmp");
  const FormFactorMatrix matrix = random_matrix(n);
  Product product(*device, matrix, columns);
  constexpr std::array stream_counts = {1, 2, 4, 8};
  std::array<std::vector<double>, stream_counts.size()> reads;
  std::vector<double> products;
  for (int i = 0; i <= repetitions; ++i) {  // the first round warms up
    for (std::size_t s = 0; s < stream_counts.size(); ++s) {
      const double seconds = product.read_seconds(stream_counts[s]);
      if (i > 0) reads[s].push_back(seconds);
    }
    const double seconds = product.seconds();
    if (i > 0) products.push_back(seconds);
  }

  const auto gb = static_cast<double>(matrix.bytes()) * 1e-9;
  fmt::print("{}, {}, {} threads\n", device->info().name, device->info().driver, device->info().compute_units);
  fmt::print("n {}, columns {}, {:.3f} GB of F, medians of {} rounds\n", n, columns, gb, repetitions);
  double best = std::numeric_limits<double>::infinity();
  for (std::size_t s = 0; s < stream_counts.size(); ++s) {
    best = std::min(best, median(reads[s]));
    fmt::print("read, {} streams   {:8.3f} ms  {:6.2f} GB/s\n", stream_counts[s], median(reads[s]) * 1e3,
               gb / median(reads[s]));
  }
  fmt::print("matvec            {:8.3f} ms  {:6.2f} GB/s  {:.3f} of the best read\n", median(products) * 1e3,
             gb / median(products), best / median(products));
  const double error = product.error();
  const double bound = matvec_bound(n);
  fmt::print("error {:.2e}, bound {:.2e}: {}\n", error, bound, error <= bound ? "verified" : "WRONG");
  return error <= bound;
}

}  // namespace

int main(int count, char** arguments) {
  const auto number = [&](int i, int otherwise) {
    return count > i ? std::max(1, std::atoi(arguments[i])) : otherwise;
  };
  try {
    const auto n = static_cast<std::uint32_t>(number(1, 17128));
    return run(n, number(2, 21), static_cast<std::uint32_t>(number(3, 3))) ? 0 : 1;
  } catch (const Error& error) {
    fmt::print(stderr, "matvec_bench: {}\n", error.what());
    return exit_status(error.kind());
  }
}
