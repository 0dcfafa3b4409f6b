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

/// dense32: a launch of matvec for each panel.
class DenseProduct final : public Product {
 public:
  DenseProduct(const FormFactorMatrix& form_factors, Device& device, const VectorArguments& shape, std::uint32_t groups)
      : Product(device, shape, groups),
        form_factors_(form_factors),
        macros_(launch_macros(device.info(), "matvec", shape.columns)),
        group_(static_cast<std::uint32_t>(macros_.at("ROWS"))) {
    cut_panels();
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

  void cut_panels() {
    const std::uint32_t most = rows_of_a_launch(device_.info(), form_factors_.size(), form_factors_.stride(), group_);
    for (const interflect::Panel& panel : form_factors_.panels()) {
      std::unique_ptr<Buffer> shared = panel.rows <= most ? device_.share(panel.data) : nullptr;
      if (shared != nullptr) {
        panels_.push_back({panel.first, panel.rows, panel.data->data(), std::move(shared)});
        continue;
      }
      for (std::uint32_t done = 0; done < panel.rows; done += most) {
        panels_.push_back(
            {panel.first + done, std::min(most, panel.rows - done), panel.data->data() + done * row_bytes(), nullptr});
      }
    }
  }

  const FormFactorMatrix& form_factors_;
  Macros macros_;
  std::uint32_t group_;  ///< rows of a work-group
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
  return std::make_unique<DenseProduct>(form_factors, device, shape, groups);
}

}  // namespace interflect
