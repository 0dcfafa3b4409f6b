#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/schedule/balance.h"
#include "interflect/schedule/product.h"

namespace interflect {

/// Makes a device's part of one F, as make_part() does.
using MakePart =
    std::function<std::unique_ptr<PartProduct>(Device& device, const VectorArguments& shape, std::uint32_t groups)>;

/// y = F x over several devices, each of which has a range of F's units. The first one has x and y; x goes through the
/// host to the others, each driven by a thread of its own, while the first works on its own rows, and their rows of y
/// come back the same way. Where units reach all of y (sym16) the devices' results are added in the devices' order.
/// With the same ranges the same bits come out.
///
/// Ranges follow the rates that are measured (Balance); they change between two products. A device other than the first
/// that fails, or has no room, loses its range to those that are left, and the product is done again: nothing of it is
/// seen from outside but failures(). What the first one throws is thrown.
///
/// Traffic of a product beside that of the parts, per device other than the first, in column values: 1 sent (x), its
/// rows of y fetched.
class SplitProduct final : public Product {
 public:
  /// Plans without allocating; nothing of the devices is used but their memory's size. Throws a limit Error where the
  /// devices together have no room for F. The devices must outlive it.
  SplitProduct(Division division, const MakePart& make, const std::vector<Device*>& devices,
               const VectorArguments& shape, std::uint32_t groups, const SplitOptions& options);
  ~SplitProduct() override;

  [[nodiscard]] std::uint64_t needed_bytes() const override;
  void place() override;
  void use(const VectorArguments& shape, std::uint32_t groups) override;
  void apply(Buffer& x, Buffer& y) override;
  [[nodiscard]] std::vector<Buffer*> panel_buffers() const override;
  [[nodiscard]] Storage storage() const override;
  [[nodiscard]] std::uint64_t bytes() const override;
  [[nodiscard]] std::span<const std::uint32_t> order() const override;
  void exact(const Columns& x, std::vector<std::vector<double>>& y) const override;
  [[nodiscard]] std::vector<DeviceShare> device_shares() const override;
  [[nodiscard]] std::vector<DeviceFailure> failures() const override { return failures_; }

 private:
  struct Part;

  [[nodiscard]] std::unique_ptr<Kernel> compile_multiply() override { return nullptr; }
  [[nodiscard]] std::vector<double> rooms() const;
  [[nodiscard]] std::uint64_t bytes_of(const Part& part) const;
  void cut_anew();
  void bring();
  void lose(std::size_t part, const Error& error);
  template <class Act>
  bool survives(std::size_t part, const Act& act);
  bool run(Buffer& x, Buffer& y);
  void work(Part& part);
  void work_on_own(Buffer& x, Buffer& y);
  void collect(Buffer& y);
  void note();

  Division division_;
  SplitOptions options_;
  std::vector<std::unique_ptr<Part>> parts_;
  std::unique_ptr<Balance> balance_;
  std::vector<DeviceFailure> failures_;
  std::vector<float> x_, y_;  ///< on the host
  bool due_ = false;          ///< the shares are others than the ranges
};

}  // namespace interflect
