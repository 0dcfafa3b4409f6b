#include "interflect/schedule/device_matrix.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "interflect/base/error.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/formfactor/patch_table.h"

namespace interflect {

namespace {

constexpr std::uint32_t tile_row = PatchTable::block;

}  // namespace

DeviceMatrix::DeviceMatrix(Device& device, std::uint32_t n, std::uint64_t max_panel_bytes)
    : n_(n), stride_((n + 15) / 16 * 16) {
  const DeviceInfo& info = device.info();
  const std::uint64_t row_bytes = std::uint64_t{stride_} * sizeof(float);
  const std::uint32_t whole = (n + tile_row - 1) / tile_row * tile_row;
  const auto tile_rows_of = [&](std::uint64_t bytes) { return bytes / row_bytes / tile_row * tile_row; };
  // Every kernel that reads a panel by groups takes at least one row a group.
  std::uint64_t most = std::min<std::uint64_t>(whole, info.max_groups / tile_row * tile_row);
  if (info.max_buffer_bytes != 0) most = std::min(most, tile_rows_of(info.max_buffer_bytes));
  if (n > 0 && most == 0) {
    throw Error(ErrorKind::limit,
                fmt::format("{}: {} rows of the form factors have {} bytes, the device's largest buffer {}; use fewer "
                            "patches, another device, or --assembly host",
                            info.id, tile_row, tile_row * row_bytes, info.max_buffer_bytes));
  }
  most = std::min(most, std::max<std::uint64_t>(tile_row, tile_rows_of(max_panel_bytes)));
  for (std::uint32_t first = 0; first < n; first += static_cast<std::uint32_t>(most)) {
    const auto rows = static_cast<std::uint32_t>(std::min<std::uint64_t>(most, n - first));
    panels_.push_back({first, rows, device.allocate(rows * row_bytes)});
  }
}

FormFactorMatrix DeviceMatrix::download(Device& device) const {
  FormFactorMatrix matrix(n_);
  const std::size_t row_bytes = std::size_t{stride_} * sizeof(float);
  for (const Panel& panel : panels_) {
    // Both have whole rows of the same stride: what lies between two ends is one piece.
    for (const interflect::Panel& to : matrix.panels()) {
      const std::uint32_t first = std::max(panel.first, to.first);
      const std::uint32_t end = std::min(panel.first + panel.rows, to.first + to.rows);
      if (first >= end) continue;
      const std::span<std::byte> piece(to.data->data() + (first - to.first) * row_bytes, (end - first) * row_bytes);
      device.queue().download(*panel.buffer, (first - panel.first) * row_bytes, piece);
    }
  }
  return matrix;
}

DeviceExactProduct::DeviceExactProduct(Device& device, const DeviceMatrix& matrix, std::uint32_t columns,
                                       const Compile& compile)
    : device_(device), matrix_(matrix), columns_(columns) {
  const Macros macros{{"COLUMNS", static_cast<int>(columns)}};
  kernel_ = compile ? compile("matvec_exact", macros) : device.kernel("matvec_exact", macros);
  const std::size_t vectors = std::size_t{columns} * matrix.stride() * sizeof(float);
  x_ = device.allocate(vectors);
  y_ = device.allocate(2 * vectors);
}

void DeviceExactProduct::apply(const Columns& x, std::vector<std::vector<double>>& y) {
  const std::uint32_t n = matrix_.size();
  const std::size_t stride = matrix_.stride(), half = columns_ * stride;
  if (x.size() != columns_) throw Error(ErrorKind::internal, "exact product: wrong number of columns");
  staging_.assign(2 * half, 0.0F);
  for (std::size_t c = 0; c < columns_; ++c) {
    if (x[c].size() != n) throw Error(ErrorKind::internal, "exact product: a column of the wrong length");
    std::copy(x[c].begin(), x[c].end(), staging_.data() + c * stride);
  }
  Queue& queue = device_.queue();
  queue.upload(*x_, 0, std::as_bytes(std::span(staging_).first(half)));
  for (const DeviceMatrix::Panel& panel : matrix_.panels()) {
    const MatvecArguments arguments{.n = n,
                                    .first = panel.first,
                                    .rows = panel.rows,
                                    .row_stride = matrix_.stride(),
                                    .vector_stride = matrix_.stride()};
    const std::array buffers{panel.buffer.get(), x_.get(), y_.get()};
    queue.launch(*kernel_, (panel.rows + panel_group - 1) / panel_group, buffers,
                 std::as_bytes(std::span(&arguments, 1)), "y = F x, exactly");
  }
  queue.download(*y_, 0, std::as_writable_bytes(std::span(staging_)));
  y.assign(columns_, std::vector<double>(n));
  for (std::size_t c = 0; c < columns_; ++c) {
    const float* hi = staging_.data() + c * stride;
    for (std::uint32_t i = 0; i < n; ++i) y[c][i] = static_cast<double>(hi[i]) + static_cast<double>(hi[half + i]);
  }
}

}  // namespace interflect
