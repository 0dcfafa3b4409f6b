#include "interflect/schedule/rank_product.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/tuning.h"

namespace interflect {

namespace {

/// Two devices of which these are equal give the same bits.
std::string signature(const DeviceInfo& device, std::uint32_t columns) {
  std::string out = fmt::format("{}|{}|{}", device.backend, device.name, device.driver);
  for (const auto& [macro, value] : launch_macros(device, "matvec", columns))
    out += fmt::format("|{}={}", macro, value);
  return out;
}

class RankProduct final : public Product {
 public:
  RankProduct(std::unique_ptr<Product> local, const FormFactorMatrix& form_factors, Ranks& ranks, Device& device,
              const VectorArguments& shape, std::uint32_t groups)
      : Product(device, shape, groups), local_(std::move(local)), ranks_(ranks) {
    const std::vector<std::string> devices = ranks.all_texts(signature(device.info(), shape.columns));
    differ_ = std::adjacent_find(devices.begin(), devices.end(), std::not_equal_to<>()) != devices.end();
    const std::vector<double> firsts = ranks.all_values(static_cast<double>(form_factors.first_row()));
    const std::vector<double> ends = ranks.all_values(static_cast<double>(form_factors.end_row()));
    double next = 0;
    for (std::size_t k = 0; k < ends.size(); next = ends[k++]) {
      if (firsts[k] != next) break;
      rows_.push_back({static_cast<std::uint32_t>(firsts[k]), static_cast<std::uint32_t>(ends[k] - firsts[k])});
    }
    if (next != shape.n) throw AgreedError(ErrorKind::internal, "the ranks' rows are not all rows of F in their order");
  }

  [[nodiscard]] std::uint64_t needed_bytes() const override { return local_->needed_bytes(); }
  void place() override {
    agreed(ranks_, [&] { local_->place(); });
    uploaded_bytes_ = local_->uploaded_bytes();
    use(shape_, groups_);
  }
  void apply(Buffer& x, Buffer& y) override {
    local_->use(shape_, groups_);
    compile_seconds_ = local_->compile_seconds();
    whole_.resize(std::size_t{shape_.columns} * shape_.vector_stride);
    const auto bytes = std::as_writable_bytes(std::span(whole_));
    if (differ_) {
      device_.queue().download(x, 0, bytes);
      ranks_.broadcast(bytes);
      device_.queue().upload(x, 0, bytes);
    }
    local_->apply(x, y);
    device_.queue().download(y, 0, bytes);
    const Rows& own = rows_[ranks_.rank()];
    mine_.clear();
    for (std::size_t c = 0; c < shape_.columns; ++c) {
      const float* column = whole_.data() + c * shape_.vector_stride + own.first;
      mine_.insert(mine_.end(), column, column + own.count);
    }
    gather<float>(mine_, shape_.columns, gathered_,
                  [&](std::size_t c) { return whole_.data() + c * shape_.vector_stride; });
    device_.queue().upload(y, 0, bytes);
  }
  [[nodiscard]] std::vector<Buffer*> panel_buffers() const override { return local_->panel_buffers(); }
  [[nodiscard]] Storage storage() const override { return local_->storage(); }
  [[nodiscard]] std::uint64_t bytes() const override { return local_->bytes(); }
  void exact(const Columns& x, std::vector<std::vector<double>>& y) const override {
    local_->exact(x, y);
    const Rows& own = rows_[ranks_.rank()];
    std::vector<double> mine, all;
    for (const std::vector<double>& column : y) {
      mine.insert(mine.end(), column.begin() + own.first, column.begin() + own.first + own.count);
    }
    gather<double>(mine, x.size(), all, [&](std::size_t c) { return y[c].data(); });
  }
  void agree(std::span<float> values) override {
    if (differ_) ranks_.broadcast_values(values);
  }

 private:
  struct Rows {
    std::uint32_t first = 0, count = 0;
  };

  /// The own product's kernel for the columns in use; this one has none of its own.
  [[nodiscard]] std::unique_ptr<Kernel> compile_multiply() override {
    local_->use(shape_, groups_);
    compile_seconds_ = local_->compile_seconds();
    return nullptr;
  }

  /// Every rank's rows, column by column, into the columns.
  template <class T, class ColumnAt>
  void gather(const std::vector<T>& mine, std::size_t columns, std::vector<T>& all, const ColumnAt& column) const {
    std::vector<std::uint64_t> bytes;
    std::size_t values = 0;
    for (const Rows& rows : rows_) {
      bytes.push_back(columns * rows.count * sizeof(T));
      values += columns * rows.count;
    }
    all.resize(values);
    ranks_.all_gather(std::as_bytes(std::span(mine)), bytes, std::as_writable_bytes(std::span(all)));
    const T* from = all.data();
    for (const Rows& rows : rows_) {
      for (std::size_t c = 0; c < columns; ++c, from += rows.count) {
        std::copy(from, from + rows.count, column(c) + rows.first);
      }
    }
  }

  std::unique_ptr<Product> local_;
  Ranks& ranks_;
  bool differ_ = false;
  std::vector<Rows> rows_;  ///< by rank
  std::vector<float> whole_, mine_, gathered_;
};

}  // namespace

std::unique_ptr<Product> make_product(const FormFactorMatrix& form_factors, Ranks& ranks, Device& device,
                                      const VectorArguments& shape, std::uint32_t groups) {
  return std::make_unique<RankProduct>(make_product(form_factors, device, shape, groups), form_factors, ranks, device,
                                       shape, groups);
}

}  // namespace interflect
