#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/check.h"
#include "interflect/peers/peer.h"

namespace interflect::peers {

Problem::Problem(const FormFactorMatrix& f, const Columns& x, int threads)
    : f_(f), threads_(threads), by_columns_(columns * f.size()), by_rows_(columns * f.size()) {
  if (x.size() != columns) throw Error(ErrorKind::internal, "a peer's product has three columns");
  for (std::size_t c = 0; c < columns; ++c) {
    if (x[c].size() != n()) throw Error(ErrorKind::internal, "a peer's product has columns of n values");
    for (std::size_t i = 0; i < n(); ++i) by_columns_[c * n() + i] = by_rows_[i * columns + c] = x[c][i];
  }
}

const float* Problem::f_by_columns() const {
  std::call_once(once_, [&] {
    const std::size_t stride = f_.stride(), bytes = n() * stride * sizeof(float);
    if (available_memory() / 2 < bytes) return;
    transposed_ = PageBuffer(bytes);
    auto* const to = reinterpret_cast<float*>(transposed_.data());
    constexpr std::size_t tile = 64;
    const std::size_t tiles = (n() + tile - 1) / tile;
#pragma omp parallel for num_threads(threads_)
    for (std::size_t t = 0; t < tiles; ++t) {
      for (std::size_t first = 0; first < n(); first += tile) {
        for (std::size_t i = first; i < std::min(first + tile, n()); ++i) {
          const auto row = f_.row(static_cast<std::uint32_t>(i));
          for (std::size_t j = t * tile; j < std::min((t + 1) * tile, n()); ++j) to[j * stride + i] = row[j];
        }
      }
    }
  });
  return reinterpret_cast<const float*>(transposed_.data());
}

std::vector<Peer> all_peers(const std::vector<std::string>& devices) {
  std::vector<Peer> all;
  const auto append = [&all](std::vector<Peer> more) {
    for (Peer& peer : more) all.push_back(std::move(peer));
  };
  append(openblas());
  append(eigen());
  append(viennacl_on_host());
  for (const std::string& id : devices) {
    if (id.starts_with("opencl:")) {
      append(viennacl_on(id));
      append(clblast(id));
    } else if (id.starts_with("cuda:")) {
      append(cublas(id));
      append(cusparse(id));
    }
  }
  return all;
}

std::size_t fastest(const std::vector<Call>& calls) {
  std::vector<double> seconds(calls.size(), std::numeric_limits<double>::infinity());
  if (calls.size() > 1) {
    for (const Call& call : calls) call.run();
    for (int turn = 0; turn < 2; ++turn) {
      for (std::size_t k = 0; k < calls.size(); ++k) {
        const Timer timer;
        calls[k].run();
        seconds[k] = std::min(seconds[k], timer.seconds());
      }
    }
  }
  return static_cast<std::size_t>(std::min_element(seconds.begin(), seconds.end()) - seconds.begin());
}

double product_error(const FormFactorMatrix& f, const Columns& x, const Columns& y) {
  std::vector<std::vector<double>> exact;
  exact_product(f, x, exact);
  if (y.size() != exact.size()) return NAN;
  double error = 0;
  for (std::size_t c = 0; c < exact.size(); ++c) {
    if (y[c].size() != exact[c].size()) return NAN;
    for (std::size_t i = 0; i < exact[c].size(); ++i) {
      const double difference = std::abs(static_cast<double>(y[c][i]) - exact[c][i]);
      const double relative = exact[c][i] > 0 ? difference / exact[c][i] : difference;
      if (!(relative <= error)) error = relative;
      if (std::isnan(error)) return error;
    }
  }
  return error;
}

double product_bound(std::size_t n) {
  return matvec_bound(n) + 6 * std::sqrt(static_cast<double>(n)) * 0x1p-24;
}

std::size_t index_of(std::string_view id) {
  const std::size_t colon = id.find(':');
  std::size_t index = 0;
  const char* const end = id.data() + id.size();
  if (colon != std::string_view::npos) {
    const auto [next, status] = std::from_chars(id.data() + colon + 1, end, index);
    if (status == std::errc{} && next == end) return index;
  }
  throw Error(ErrorKind::usage, fmt::format("'{}' is not a device with an index", id));
}

Columns from_columns(const std::vector<float>& y, std::size_t n) {
  Columns out(columns);
  for (std::size_t c = 0; c < columns; ++c) {
    const auto first = y.begin() + static_cast<std::ptrdiff_t>(c * n);
    out[c].assign(first, first + static_cast<std::ptrdiff_t>(n));
  }
  return out;
}

Columns from_rows(const std::vector<float>& y, std::size_t n) {
  Columns out(columns, std::vector<float>(n));
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t c = 0; c < columns; ++c) out[c][i] = y[i * columns + c];
  }
  return out;
}

}  // namespace interflect::peers
