#include <array>
#include <map>
#include <utility>

#include "interflect/device/tuning.h"
#include "interflect/schedule/device_form_factors.h"
#include "interflect/schedule/product.h"

namespace interflect {

namespace {

/// dense32 where the device has made it: nothing to place but kernels.
class ResidentProduct final : public Product {
 public:
  ResidentProduct(DeviceMatrix matrix, Device& device, const VectorArguments& shape, std::uint32_t groups)
      : Product(device, shape, groups), matrix_(std::move(matrix)) {}

  [[nodiscard]] std::uint64_t needed_bytes() const override {
    return DeviceExactProduct::bytes(matrix_.stride(), shape_.columns);
  }
  void place() override {
    macros_ = launch_macros(device_.info(), "matvec", shape_.columns);
    group_ = static_cast<std::uint32_t>(macros_.at("ROWS"));
    use(shape_, groups_);
  }
  void apply(Buffer& x, Buffer& y) override {
    for (const DeviceMatrix::Panel& panel : matrix_.panels()) {
      const MatvecArguments arguments{.n = matrix_.size(),
                                      .first = panel.first,
                                      .rows = panel.rows,
                                      .row_stride = matrix_.stride(),
                                      .vector_stride = shape_.vector_stride};
      const std::array buffers{panel.buffer.get(), &x, &y};
      launch(multiply_kernel(), (panel.rows + group_ - 1) / group_, buffers, arguments, "y = F x");
    }
  }
  [[nodiscard]] std::vector<Buffer*> panel_buffers() const override {
    std::vector<Buffer*> buffers;
    for (const DeviceMatrix::Panel& panel : matrix_.panels()) buffers.push_back(panel.buffer.get());
    return buffers;
  }
  [[nodiscard]] Storage storage() const override { return Storage::dense32; }
  [[nodiscard]] std::uint64_t bytes() const override { return matrix_.bytes(); }
  void exact(const Columns& x, std::vector<std::vector<double>>& y) const override {
    exact_.at(shape_.columns).apply(x, y);
  }

 private:
  [[nodiscard]] std::unique_ptr<Kernel> compile_multiply() override {
    exact_.try_emplace(shape_.columns, device_, matrix_, shape_.columns,
                       [this](std::string_view name, const Macros& with) { return compiled(name, with); });
    return compiled("matvec", with_columns(macros_));
  }

  DeviceMatrix matrix_;
  std::uint32_t group_ = 1;  ///< rows of a work-group
  Macros macros_;
  mutable std::map<std::uint32_t, DeviceExactProduct> exact_;  ///< by the columns; its vectors are a place to work in
};

}  // namespace

std::unique_ptr<Product> make_product(DeviceMatrix matrix, Device& device, const VectorArguments& shape,
                                      std::uint32_t groups) {
  return std::make_unique<ResidentProduct>(std::move(matrix), device, shape, groups);
}

}  // namespace interflect
