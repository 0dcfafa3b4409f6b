#include "interflect/schedule/rank_product.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <string>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/tuning.h"
#include "interflect/schedule/scheduler.h"

namespace interflect {

namespace {

/// Two devices of which these are equal give the same bits.
std::string signature(const DeviceInfo& device, Storage storage, std::uint32_t columns) {
  std::string out = fmt::format("{}|{}|{}", device.backend, device.name, device.driver);
  const char* kernel = storage == Storage::dense32 ? "matvec" : "tiles16";
  for (const auto& [macro, value] : launch_macros(device, kernel, columns)) out += fmt::format("|{}={}", macro, value);
  return out;
}

class RankProduct final : public Product {
 public:
  RankProduct(std::unique_ptr<Product> local, RankRows rows, Ranks& ranks, Device& device, const VectorArguments& shape,
              std::uint32_t groups)
      : Product(device, shape, groups), local_(std::move(local)), rows_(std::move(rows)), ranks_(ranks) {
    const auto devices = ranks.all_texts(signature(device.info(), local_->storage(), shape.columns));
    differ_ = std::adjacent_find(devices.begin(), devices.end(), std::not_equal_to<>()) != devices.end();
  }

  [[nodiscard]] std::uint64_t needed_bytes() const override { return local_->needed_bytes(); }
  void place() override {
    agreed(ranks_, [&] { local_->place(); });
    uploaded_bytes_ = local_->uploaded_bytes();
    compile_seconds_ = local_->compile_seconds();
  }
  void use(const VectorArguments& shape, std::uint32_t groups) override {
    shape_ = shape;
    groups_ = groups;
    local_->use(shape, groups);
    compile_seconds_ = local_->compile_seconds();
  }
  void apply(Buffer& x, Buffer& y) override {
    whole_.resize(std::size_t{shape_.columns} * shape_.vector_stride);
    const auto bytes = std::as_writable_bytes(std::span(whole_));
    if (differ_) {
      device_.queue().download(x, 0, bytes);
      ranks_.broadcast(bytes);
      device_.queue().upload(x, 0, bytes);
    }
    local_->apply(x, y);
    device_.queue().download(y, 0, bytes);
    rows_.gather<float>(shape_.columns, [&](std::size_t c) { return whole_.data() + c * shape_.vector_stride; });
    device_.queue().upload(y, 0, bytes);
  }
  [[nodiscard]] std::vector<Buffer*> panel_buffers() const override { return local_->panel_buffers(); }
  [[nodiscard]] Storage storage() const override { return local_->storage(); }
  [[nodiscard]] std::uint64_t bytes() const override { return local_->bytes(); }
  [[nodiscard]] std::span<const std::uint32_t> order() const override { return local_->order(); }
  void exact(const Columns& x, std::vector<std::vector<double>>& y) const override {
    local_->exact(x, y);
    rows_.gather<double>(y.size(), [&](std::size_t c) { return y[c].data(); });
  }
  [[nodiscard]] std::vector<DeviceShare> device_shares() const override { return local_->device_shares(); }
  [[nodiscard]] std::vector<DeviceFailure> failures() const override { return local_->failures(); }
  void agree(std::span<float> values) override {
    if (differ_) ranks_.broadcast_values(values);
  }

 private:
  [[nodiscard]] std::unique_ptr<Kernel> compile_multiply() override { return nullptr; }

  std::unique_ptr<Product> local_;
  RankRows rows_;
  Ranks& ranks_;
  bool differ_ = false;
  std::vector<float> whole_;
};

}  // namespace

RankRows::RankRows(Ranks& ranks, const FormFactorMatrix& rows) : ranks_(ranks), size_(rows.size()) {
  const std::vector<double> firsts = ranks.all_values(static_cast<double>(rows.first_row()));
  const std::vector<double> ends = ranks.all_values(static_cast<double>(rows.end_row()));
  double next = 0;
  for (std::size_t k = 0; k < ends.size() && firsts[k] == next; next = ends[k++]) {
    rows_.push_back({static_cast<std::uint32_t>(firsts[k]), static_cast<std::uint32_t>(ends[k] - firsts[k])});
  }
  if (next == static_cast<double>(rows.size()) && rows_.size() == ranks.size()) return;
  throw AgreedError(ErrorKind::internal, "the ranks' rows are not all rows of F in their order");
}

std::unique_ptr<Product> make_rank_product(std::unique_ptr<Product> local, RankRows rows, Ranks& ranks, Device& device,
                                           const VectorArguments& shape, std::uint32_t groups) {
  return std::make_unique<RankProduct>(std::move(local), std::move(rows), ranks, device, shape, groups);
}

void exact_product(const FormFactorMatrix& rows, Ranks& ranks, const Columns& x, std::vector<std::vector<double>>& y) {
  exact_product(rows, x, y);
  RankRows(ranks, rows).gather<double>(y.size(), [&](std::size_t c) { return y[c].data(); });
}

}  // namespace interflect
