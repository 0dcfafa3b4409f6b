#include "interflect/device/tuning_load.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>
#include <span>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/base/half.h"
#include "interflect/base/tile.h"
#include "interflect/device/bandwidth.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/tuning.h"

namespace interflect {

namespace {

constexpr std::uint32_t columns = tuned_columns;
const float two_ones = std::bit_cast<float>(0x3C003C00U);  // as halves; as a float 0.0078

std::uint32_t ceil_div(std::uint32_t a, std::uint32_t b) {
  return (a + b - 1) / b;
}

class Load : public TuningLoad {
 protected:
  /// n is the largest multiple of 16 whose `elements_per_row_and_column` n² elements of `element` bytes fit.
  Load(Device& device, std::uint64_t bytes, double element_bytes) : device_(device) {
    const auto side = static_cast<std::uint32_t>(std::sqrt(static_cast<double>(bytes) / element_bytes));
    n_ = std::min(side, 1U << 16) / 16 * 16;
    if (n_ == 0) throw Error(ErrorKind::limit, device.info().id + ": no room to tune in");
    x_ = filled(std::uint64_t{columns} * n_, 1.0F);
    y_ = filled(std::uint64_t{columns} * n_, 0.0F);
  }

  [[nodiscard]] std::unique_ptr<Buffer> filled(std::uint64_t floats, float value) {
    auto buffer = device_.allocate(std::max<std::uint64_t>(floats, 1) * sizeof(float));
    fill(device_, *buffer, value);
    return buffer;
  }
  [[nodiscard]] std::shared_ptr<Buffer> uploaded(const std::vector<std::uint32_t>& values) {
    std::shared_ptr<Buffer> buffer = device_.allocate(values.size() * sizeof(std::uint32_t));
    device_.queue().upload(*buffer, 0, std::as_bytes(std::span(values)));
    return buffer;
  }
  template <class Arguments, std::size_t Count>
  void launch(const Kernel& kernel, std::uint32_t groups, const std::array<Buffer*, Count>& buffers,
              const Arguments& arguments) {
    device_.queue().launch(kernel, groups, buffers, std::as_bytes(std::span(&arguments, 1)), "Tuning");
  }
  /// Of whole groups that take `each` of `all`.
  [[nodiscard]] std::uint32_t groups(std::uint32_t all, int each) const {
    return ceil_div(all, static_cast<std::uint32_t>(each));
  }

  Device& device_;
  std::uint32_t n_ = 0;
  std::unique_ptr<Buffer> x_, y_, matrix_;
};

class MatvecLoad final : public Load {
 public:
  MatvecLoad(Device& device, std::uint64_t bytes) : Load(device, bytes, sizeof(float)) {
    matrix_ = filled(std::uint64_t{n_} * n_, two_ones);
  }
  [[nodiscard]] std::function<void()> product(const Macros& macros) override {
    const std::shared_ptr<Kernel> kernel = device_.kernel("matvec", macros);
    const MatvecArguments arguments{.n = n_, .first = 0, .rows = n_, .row_stride = n_, .vector_stride = n_};
    return [this, kernel, arguments, count = groups(n_, macros.at("ROWS"))] {
      launch(*kernel, count, std::array{matrix_.get(), x_.get(), y_.get()}, arguments);
    };
  }
};

class TilesLoad final : public Load {
 public:
  TilesLoad(Device& device, std::uint64_t bytes) : Load(device, bytes, sizeof(Half)) {
    const std::uint32_t strips = n_ / tile_rows, across = n_ / tile_columns;
    std::vector<std::uint32_t> index(strips + 1);
    for (std::uint32_t s = 0; s <= strips; ++s) index[s] = s * across;
    for (std::uint32_t s = 0; s < strips; ++s) {
      for (std::uint32_t t = 0; t < across; ++t) index.push_back(t);
    }
    arguments_ = {.n = n_, .first = 0, .strips = strips, .tiles = strips * across, .vector_stride = n_};
    index_ = uploaded(index);
    scale_ = filled(n_, 1.0F);
    matrix_ = filled(std::uint64_t{arguments_.tiles} * tile_elements / 2, two_ones);
  }
  [[nodiscard]] std::function<void()> product(const Macros& macros) override {
    const std::shared_ptr<Kernel> kernel = device_.kernel("tiles16", macros);
    return [this, kernel, count = groups(arguments_.strips, macros.at("STRIPS"))] {
      launch(*kernel, count, std::array{matrix_.get(), index_.get(), x_.get(), scale_.get(), y_.get()}, arguments_);
    };
  }

 private:
  TileArguments arguments_;
  std::shared_ptr<Buffer> index_;
  std::unique_ptr<Buffer> scale_;
};

class SymmetricLoad final : public Load {
 public:
  /// All tiles on and above the diagonal: a little more than half of n², at most 1.2 bytes for an element.
  SymmetricLoad(Device& device, std::uint64_t bytes) : Load(device, bytes, 1.25) {
    scale_ = filled(n_, 1.0F);
    matrix_ = filled(bytes / sizeof(float), two_ones);
  }
  [[nodiscard]] std::function<void()> product(const Macros& macros) override {
    const auto block = static_cast<std::uint32_t>(macros.at("BLOCK"));
    const auto cut = std::make_shared<Cut>(cut_by(block));
    if (std::uint64_t{cut->arguments.tiles} * tile_elements * sizeof(Half) > matrix_->size()) {
      throw Error(ErrorKind::limit, device_.info().id + ": no room to tune sym16 in");
    }
    const std::shared_ptr<Kernel> kernel = device_.kernel("sym16", macros), fold = device_.kernel("sym16_fold", {});
    VectorArguments folding{.n = n_, .vector_stride = n_, .columns = columns};
    folding.blocks = ceil_div(n_, reduction_block);
    folding.blocks_per_group = device_.info().blocks_per_group;
    folding.option = block;
    folding.slot = cut->arguments.block_rows;
    const std::uint32_t fold_groups = ceil_div(columns * folding.blocks, folding.blocks_per_group);
    return [this, kernel, fold, cut, folding, fold_groups] {
      launch(*kernel, cut->arguments.blocks, std::array{matrix_.get(), cut->index.get(), x_.get(), cut->partial.get()},
             cut->arguments);
      launch(*fold, fold_groups, std::array{cut->partial.get(), scale_.get(), y_.get()}, folding);
    };
  }

 private:
  struct Cut {
    SymmetricArguments arguments;
    std::shared_ptr<Buffer> index;
    std::unique_ptr<Buffer> partial;
  };
  [[nodiscard]] Cut cut_by(std::uint32_t block) {
    Cut cut;
    SymmetricArguments& a = cut.arguments;
    a.block_rows = ceil_div(n_, block);
    a.vector_stride = n_;
    std::vector<std::uint32_t> index, strips, begin{0}, column;
    for (std::uint32_t i = 0; i < a.block_rows; ++i) {
      for (std::uint32_t j = i; j < a.block_rows; ++j) {
        const auto first = static_cast<std::uint32_t>(strips.size());
        const std::uint32_t rows = std::min(block, n_ - i * block), width = std::min(block, n_ - j * block);
        for (std::uint32_t s = 0; s < rows / tile_rows; ++s) {
          strips.push_back(s);
          for (std::uint32_t t = i == j ? s * tile_rows / tile_columns : 0; t < width / tile_columns; ++t) {
            column.push_back(t);
          }
          begin.push_back(static_cast<std::uint32_t>(column.size()));
        }
        index.insert(index.end(), {i, j, first, static_cast<std::uint32_t>(strips.size())});
      }
    }
    a.blocks = static_cast<std::uint32_t>(index.size() / 4);
    a.strips = static_cast<std::uint32_t>(strips.size());
    a.tiles = static_cast<std::uint32_t>(column.size());
    for (const auto* part : {&strips, &begin, &column}) index.insert(index.end(), part->begin(), part->end());
    cut.index = uploaded(index);
    cut.partial = filled(std::uint64_t{a.block_rows} * a.block_rows * columns * block, 0.0F);
    return cut;
  }

  std::unique_ptr<Buffer> scale_;
};

}  // namespace

std::unique_ptr<TuningLoad> make_tuning_load(Device& device, std::string_view kernel, std::uint64_t bytes) {
  const std::uint64_t wanted =
      bytes != 0 ? bytes : std::uint64_t{device.info().type == DeviceType::cpu ? 128U : 512U} << 20;
  const std::uint64_t fitting = measurable_bytes(device.info(), wanted);
  if (kernel == "matvec") return std::make_unique<MatvecLoad>(device, fitting);
  if (kernel == "tiles16") return std::make_unique<TilesLoad>(device, fitting);
  if (kernel == "sym16") return std::make_unique<SymmetricLoad>(device, fitting);
  throw Error(ErrorKind::internal, "a kernel that cannot be tuned");
}

}  // namespace interflect
