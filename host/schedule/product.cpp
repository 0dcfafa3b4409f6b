#include "interflect/schedule/product.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/tuning.h"
#include "interflect/schedule/scheduler.h"

namespace interflect {

namespace {

// Rows of a unit of dense32: of 64 a panel's rows begin on a memory page, of 16 on a cache line.
constexpr std::uint32_t most_rows_of_a_unit = 64, fewest_rows_of_a_unit = 16;
constexpr std::uint32_t units_worth_cutting = 64;

std::uint32_t rows_of_a_unit(std::uint32_t rows) {
  const std::uint32_t fine = rows / units_worth_cutting / fewest_rows_of_a_unit * fewest_rows_of_a_unit;
  return std::clamp(fine, fewest_rows_of_a_unit, most_rows_of_a_unit);
}

/// dense32: a launch of matvec for each panel.
class DenseProduct final : public PartProduct {
 public:
  DenseProduct(const FormFactorMatrix& form_factors, Device& device, const VectorArguments& shape, std::uint32_t groups)
      : PartProduct(device, shape, groups),
        form_factors_(form_factors),
        macros_(launch_macros(device.info(), "matvec", shape.columns)),
        group_(static_cast<std::uint32_t>(macros_.at("ROWS"))),
        most_rows_(rows_of_a_launch(device.info(), form_factors.size(), form_factors.stride(), group_)),
        piece_(most_rows_) {}

  void take_all() { cut_panels(form_factors_.first_row(), form_factors_.end_row()); }
  void take(std::uint32_t first, std::uint32_t end) override {
    if (division_.bytes.empty()) division_ = division_of(form_factors_);
    // What is copied is copied piece by piece, so that of rows that move only those go over the bus.
    const std::uint32_t rows = form_factors_.end_row() - form_factors_.first_row();
    piece_ = std::min(most_rows_, std::max(most_rows_of_a_unit, rows / 32 / most_rows_of_a_unit * most_rows_of_a_unit));
    cut_panels(division_.places.at(first), division_.places.at(end));
  }
  [[nodiscard]] bool in_place() const override {
    return device_.share(std::make_shared<PageBuffer>(std::size_t{1} << 12)) != nullptr;
  }

  [[nodiscard]] std::uint64_t needed_bytes() const override {
    std::uint64_t needed = 0;
    for (const Panel& panel : panels_) needed += panel.buffer == nullptr ? panel.rows * row_bytes() : 0;
    return needed;
  }
  void place() override {
    use(shape_, groups_);
    for (Panel& panel : panels_) {
      if (panel.buffer != nullptr) continue;
      const std::size_t bytes = panel.rows * row_bytes();
      panel.buffer = uploaded({panel.data, bytes});
      uploaded_bytes_ += bytes;
    }
  }
  void apply(Buffer& x, Buffer& y) override {
    for (const Panel& panel : panels_) {
      const MatvecArguments arguments{.n = form_factors_.size(),
                                      .first = panel.first,
                                      .rows = panel.rows,
                                      .row_stride = form_factors_.stride(),
                                      .vector_stride = shape_.vector_stride};
      const std::array buffers{panel.buffer.get(), &x, &y};
      launch(multiply_kernel(), (panel.rows + group_ - 1) / group_, buffers, arguments, "y = F x");
    }
  }
  [[nodiscard]] std::vector<Buffer*> panel_buffers() const override {
    std::vector<Buffer*> buffers;
    for (const Panel& panel : panels_) buffers.push_back(panel.buffer.get());
    return buffers;
  }
  [[nodiscard]] Storage storage() const override { return Storage::dense32; }
  [[nodiscard]] std::uint64_t bytes() const override { return form_factors_.bytes(); }
  void exact(const Columns& x, std::vector<std::vector<double>>& y) const override {
    exact_product(form_factors_, x, y);
  }

 private:
  [[nodiscard]] std::unique_ptr<Kernel> compile_multiply() override {
    return compiled("matvec", with_columns(macros_));  // the same rows for a group, by which the panels are cut
  }

  struct Panel {
    std::uint32_t first = 0, rows = 0;
    const std::byte* data = nullptr;  ///< on the host
    std::unique_ptr<Buffer> buffer;   ///< null until it is uploaded
  };

  [[nodiscard]] std::uint64_t row_bytes() const { return std::uint64_t{form_factors_.stride()} * sizeof(float); }

  /// The buffer that holds exactly these rows already, if there is one.
  static std::unique_ptr<Buffer> taken_from(std::vector<Panel>& before, std::uint32_t first, std::uint32_t rows) {
    for (Panel& panel : before) {
      if (panel.first == first && panel.rows == rows) return std::move(panel.buffer);
    }
    return nullptr;
  }

  [[nodiscard]] std::unique_ptr<Buffer> shared(const interflect::Panel& panel, std::uint32_t first, std::uint32_t end) {
    if (end - first > most_rows_) return nullptr;
    if (end - first == panel.rows) return device_.share(panel.data);
    return device_.share(
        PageBuffer::part(panel.data, (first - panel.first) * row_bytes(), (end - first) * row_bytes()));
  }

  void cut_panels(std::uint32_t first, std::uint32_t end) {
    std::vector<Panel> before = std::move(panels_);
    panels_.clear();
    for (const interflect::Panel& panel : form_factors_.panels()) {
      const std::uint32_t from = std::max(first, panel.first), to = std::min(end, panel.first + panel.rows);
      if (from >= to) continue;
      const auto data = [&](std::uint32_t row) { return panel.data->data() + (row - panel.first) * row_bytes(); };
      if (std::unique_ptr<Buffer> in_place = shared(panel, from, to)) {
        panels_.push_back({from, to - from, data(from), std::move(in_place)});
        continue;
      }
      for (std::uint32_t row = from; row < to;) {
        const std::uint32_t next = panel.first + ((row - panel.first) / piece_ + 1) * piece_;
        const std::uint32_t rows = std::min(next, to) - row;
        panels_.push_back({row, rows, data(row), taken_from(before, row, rows)});
        row += rows;
      }
    }
  }

  const FormFactorMatrix& form_factors_;
  Macros macros_;
  std::uint32_t group_;      ///< rows of a work-group
  std::uint32_t most_rows_;  ///< of a launch
  std::uint32_t piece_;      ///< rows that are copied as one
  Division division_;        ///< of a part
  std::vector<Panel> panels_;
};

}  // namespace

std::uint32_t rows_of_a_launch(const DeviceInfo& device, std::uint32_t n, std::uint32_t stride, std::uint32_t group) {
  const std::uint64_t row_bytes = std::uint64_t{stride} * sizeof(float);
  std::uint64_t rows = std::min<std::uint64_t>(n, std::uint64_t{device.max_groups} * group);
  if (device.max_buffer_bytes != 0) rows = std::min(rows, device.max_buffer_bytes / row_bytes);
  if (rows == 0) {
    throw Error(ErrorKind::limit,
                fmt::format("{}: one row of the form factors has {} bytes, the device's largest buffer {}; use fewer "
                            "patches or another device",
                            device.id, row_bytes, device.max_buffer_bytes));
  }
  if (rows < n && rows > group) rows -= rows % group;
  return static_cast<std::uint32_t>(rows);
}

std::unique_ptr<Product> make_product(const FormFactorMatrix& form_factors, Device& device,
                                      const VectorArguments& shape, std::uint32_t groups) {
  auto product = std::make_unique<DenseProduct>(form_factors, device, shape, groups);
  product->take_all();
  return product;
}

std::unique_ptr<PartProduct> make_part(const FormFactorMatrix& form_factors, Device& device,
                                       const VectorArguments& shape, std::uint32_t groups) {
  return std::make_unique<DenseProduct>(form_factors, device, shape, groups);
}

Division division_of(const FormFactorMatrix& form_factors) {
  Division division;
  const std::uint32_t first = form_factors.first_row(), end = form_factors.end_row();
  const std::uint32_t step = rows_of_a_unit(end - first);
  for (std::uint32_t row = first; row < end; row = std::min(end, row + step)) division.places.push_back(row);
  division.places.push_back(end);
  for (const std::uint32_t row : division.places) {
    division.bytes.push_back(std::uint64_t{row - first} * form_factors.stride() * sizeof(float));
  }
  return division;
}

}  // namespace interflect
