#include "interflect/formfactor/form_factor_matrix.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <string>
#include <utility>

#include "interflect/base/error.h"

namespace interflect {

std::string_view name(Storage storage) {
  switch (storage) {
    case Storage::dense32: return "dense32";
    case Storage::dense16: return "dense16";
    case Storage::tiled16: return "tiled16";
    case Storage::sym16: return "sym16";
  }
  return "?";
}

namespace {

constexpr std::uint32_t row_alignment = 16;  // elements: one cache line of fp32, one AVX-512 register

std::uint64_t padded(std::uint64_t n) {
  return (n + row_alignment - 1) / row_alignment * row_alignment;
}

}  // namespace

std::uint64_t FormFactorMatrix::predicted_bytes(std::uint64_t n) {
  return n * padded(n) * sizeof(float);
}

std::uint32_t FormFactorMatrix::stride_of(std::uint32_t n) {
  return static_cast<std::uint32_t>(padded(n));
}

std::uint64_t FormFactorMatrix::default_panel_bytes() {
  const char* forced = std::getenv("INTERFLECT_MAX_PANEL_BYTES");
  if (forced == nullptr) return std::uint64_t{1} << 30;
  const std::string_view text(forced);
  std::uint64_t bytes = 0;
  const auto [end, status] = std::from_chars(text.data(), text.data() + text.size(), bytes);
  if (status != std::errc{} || end != text.data() + text.size() || bytes == 0) {
    throw Error(ErrorKind::usage, fmt::format("INTERFLECT_MAX_PANEL_BYTES: '{}' is not a count of bytes", text));
  }
  return bytes;
}

FormFactorMatrix::FormFactorMatrix(std::uint32_t n, std::uint64_t max_panel_bytes)
    : FormFactorMatrix(n, 0, n, max_panel_bytes) {}

FormFactorMatrix FormFactorMatrix::rows_only(std::uint32_t n, std::uint32_t first, std::uint32_t end) {
  return {n, first, end, default_panel_bytes()};
}

FormFactorMatrix::FormFactorMatrix(std::uint32_t n, std::uint32_t first, std::uint32_t end,
                                   std::uint64_t max_panel_bytes)
    : n_(n), first_(first), end_(end), stride_(stride_of(n)) {
  const std::uint64_t row_bytes = std::uint64_t{stride_} * sizeof(float);
  const std::uint64_t fitting = row_bytes == 0 ? 1 : std::max<std::uint64_t>(1, max_panel_bytes / row_bytes);
  rows_per_panel_ = static_cast<std::uint32_t>(std::min<std::uint64_t>(fitting, std::max(1U, end - first)));
  for (std::uint32_t at = first; at < end; at += rows_per_panel_) {
    const std::uint32_t rows = std::min(rows_per_panel_, end - at);
    panels_.push_back({at, rows, std::make_shared<PageBuffer>(rows * row_bytes)});
  }
}

std::uint64_t FormFactorMatrix::bytes() const {
  std::uint64_t sum = 0;
  for (const Panel& panel : panels_) sum += panel.data->size();
  return sum;
}

std::span<const float> FormFactorMatrix::row(std::uint32_t i) const {
  const Panel& panel = panels_[(i - first_) / rows_per_panel_];
  const auto* elements = reinterpret_cast<const float*>(panel.data->data());
  return {elements + std::size_t{i - panel.first} * stride_, n_};
}

std::span<float> FormFactorMatrix::row(std::uint32_t i) {
  const std::span<const float> constant = std::as_const(*this).row(i);
  return {const_cast<float*>(constant.data()), constant.size()};  // the panel's memory is not const
}

double FormFactorMatrix::nonzero_fraction() const {
  std::uint64_t count = 0;
#pragma omp parallel for reduction(+ : count) schedule(static)
  for (std::uint32_t i = first_; i < end_; ++i) {
    for (const float f : row(i)) count += f != 0.0F ? 1 : 0;
  }
  return n_ == 0 ? 0.0 : static_cast<double>(count) / (static_cast<double>(n_) * static_cast<double>(n_));
}

std::vector<double> FormFactorMatrix::row_sums() const {
  std::vector<double> sums(n_);
#pragma omp parallel for schedule(static)
  for (std::uint32_t i = 0; i < n_; ++i) {
    double sum = 0;
    for (const float f : row(i)) sum += static_cast<double>(f);
    sums[i] = sum;
  }
  return sums;
}

}  // namespace interflect
