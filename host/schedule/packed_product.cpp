#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/tuning.h"
#include "interflect/schedule/product.h"
#include "interflect/schedule/scheduler.h"

namespace interflect {

namespace {

/// What the 16-bit formats share: panels of tiles with their index, the two scales, and x scaled once for all panels.
///
/// Traffic of a product beside that of the tiles, in column values: scale 2 reads, 1 write.
class PackedProduct : public PartProduct {
 public:
  [[nodiscard]] std::uint64_t needed_bytes() const override {
    std::uint64_t needed = std::uint64_t{shape_.vector_stride} * sizeof(float) * (2 + most_columns_);
    for (const Panel& panel : panels_) {
      needed +=
          panel.from.index.size() * sizeof(std::uint32_t) + (panel.tiles == nullptr ? panel.from.elements.size() : 0);
    }
    return needed;
  }
  void take(std::uint32_t first, std::uint32_t end) override {
    const DeviceInfo& info = device_.info();
    const std::uint64_t most_bytes =
        info.max_buffer_bytes != 0 ? info.max_buffer_bytes : std::numeric_limits<std::uint64_t>::max();
    const auto most_units = static_cast<std::uint32_t>(
        std::min<std::uint64_t>(info.max_groups * units_per_group_, std::numeric_limits<std::uint32_t>::max()));
    panels_.clear();
    try {
      for (PackedMatrix::Panel& panel : form_factors_.panels(most_bytes, most_units, first, end)) {
        std::unique_ptr<Buffer> shared = panel.shared != nullptr ? device_.share(panel.shared) : nullptr;
        panels_.push_back({std::move(panel), std::move(shared), nullptr});
      }
    } catch (const Error& error) {
      throw Error(error.kind(), fmt::format("{}: {}", info.id, error.what()));
    }
  }
  [[nodiscard]] bool in_place() const override {
    return device_.share(std::make_shared<PageBuffer>(std::size_t{1} << 12)) != nullptr;
  }
  void place() override {
    if (scale_ == nullptr) scale_ = compiled("scale", {});
    use(shape_, groups_);
    make_room();
    for (Panel& panel : panels_) {
      if (panel.index != nullptr) continue;
      if (panel.tiles == nullptr) {
        panel.tiles = panel.from.elements.empty() ? device_.allocate(sizeof(float)) : uploaded(panel.from.elements);
        uploaded_bytes_ += panel.from.elements.size();
      }
      panel.index = uploaded(std::as_bytes(std::span(panel.from.index)));
      uploaded_bytes_ += panel.index->size();
      panel.from.index = {};
    }
    if (scaled_ != nullptr) return;
    in_ = uploaded(std::as_bytes(form_factors_.scale_in()));
    out_ = uploaded(std::as_bytes(form_factors_.scale_out()));
    uploaded_bytes_ += in_->size() + out_->size();
    scaled_ = device_.allocate(std::size_t{most_columns_} * shape_.vector_stride * sizeof(float));
  }
  void apply(Buffer& x, Buffer& y) override {
    const std::array buffers{&x, in_.get(), scaled_.get()};
    launch(*scale_, groups_, buffers, shape_, "xs = s * x");
    multiply(y);
  }
  [[nodiscard]] std::vector<Buffer*> panel_buffers() const override {
    std::vector<Buffer*> buffers;
    for (const Panel& panel : panels_) buffers.push_back(panel.tiles.get());
    return buffers;
  }
  [[nodiscard]] Storage storage() const override { return form_factors_.storage(); }
  [[nodiscard]] std::uint64_t bytes() const override { return form_factors_.bytes(); }
  [[nodiscard]] std::span<const std::uint32_t> order() const override { return form_factors_.order(); }
  void exact(const Columns& x, std::vector<std::vector<double>>& y) const override {
    exact_product(form_factors_, x, y);
  }

 protected:
  struct Panel {
    PackedMatrix::Panel from;  ///< its index is dropped once it is uploaded
    std::unique_ptr<Buffer> tiles, index;
  };

  PackedProduct(const PackedMatrix& form_factors, Device& device, const VectorArguments& shape, std::uint32_t groups,
                std::uint64_t units_per_group)
      : PartProduct(device, shape, groups), form_factors_(form_factors), units_per_group_(units_per_group) {}

  /// Allocates and compiles what the format needs beside its product.
  virtual void make_room() {}
  virtual void multiply(Buffer& y) = 0;

  const PackedMatrix& form_factors_;
  std::uint64_t units_per_group_;
  std::vector<Panel> panels_;
  std::unique_ptr<Kernel> scale_;
  std::unique_ptr<Buffer> in_, out_, scaled_;
};

/// dense16, tiled16: a launch of tiles16 for each panel.
class TiledProduct final : public PackedProduct {
 public:
  TiledProduct(const PackedMatrix& form_factors, Device& device, const VectorArguments& shape, std::uint32_t groups)
      : TiledProduct(form_factors, device, shape, groups, launch_macros(device.info(), "tiles16", shape.columns)) {}

 private:
  TiledProduct(const PackedMatrix& form_factors, Device& device, const VectorArguments& shape, std::uint32_t groups,
               Macros macros)
      : PackedProduct(form_factors, device, shape, groups, static_cast<std::uint64_t>(macros.at("STRIPS"))),
        macros_(std::move(macros)) {}
  [[nodiscard]] std::unique_ptr<Kernel> compile_multiply() override {
    return compiled("tiles16", with_columns(macros_));
  }
  void multiply(Buffer& y) override {
    const auto strips = static_cast<std::uint32_t>(macros_.at("STRIPS"));
    for (const Panel& panel : panels_) {
      const TileArguments arguments{.n = form_factors_.size(),
                                    .first = panel.from.first * tile_rows,
                                    .strips = panel.from.strips,
                                    .tiles = panel.from.tiles,
                                    .vector_stride = shape_.vector_stride};
      const std::array buffers{panel.tiles.get(), panel.index.get(), scaled_.get(), out_.get(), &y};
      launch(multiply_kernel(), (arguments.strips + strips - 1) / strips, buffers, arguments, "y = F x");
    }
  }

  Macros macros_;
};

/// sym16: a launch of sym16 for each panel, whose blocks write slots of their own, then sym16_fold.
///
/// Traffic of a product beside that of tiles and scale: 4 columns n block_rows bytes of partial sums, written and read.
class SymmetricProduct final : public PackedProduct {
 public:
  SymmetricProduct(const PackedMatrix& form_factors, Device& device, const VectorArguments& shape, std::uint32_t groups)
      : PackedProduct(form_factors, device, shape, groups, 1) {
    const std::uint64_t most = device.info().max_buffer_bytes;
    if (most != 0 && partial_bytes() > most) {
      throw Error(ErrorKind::limit,
                  fmt::format("{}: the partial sums of sym16 need {} bytes, the device's largest buffer "
                              "has {}; use another storage format or device",
                              device.info().id, partial_bytes(), most));
    }
  }
  [[nodiscard]] std::uint64_t needed_bytes() const override { return PackedProduct::needed_bytes() + partial_bytes(); }
  /// With other columns slots lie elsewhere, and those that no block writes must be zero.
  void use(const VectorArguments& shape, std::uint32_t groups) override {
    const bool other = shape.columns != shape_.columns;
    PackedProduct::use(shape, groups);
    if (!other || partial_ == nullptr) return;
    partial_.reset();
    make_room();
  }

 private:
  [[nodiscard]] std::uint64_t partial_bytes() const {
    return std::uint64_t{form_factors_.block_rows()} * form_factors_.block_rows() * most_columns_ *
           form_factors_.block() * sizeof(float);
  }
  [[nodiscard]] std::unique_ptr<Kernel> compile_multiply() override {
    Macros macros = launch_macros(device_.info(), "sym16", shape_.columns);
    macros.insert_or_assign("BLOCK", static_cast<int>(form_factors_.block()));  // the matrix has been cut by it
    return compiled("sym16", macros);
  }
  /// Of another part other sums stay zero.
  void take(std::uint32_t first, std::uint32_t end) override {
    PackedProduct::take(first, end);
    partial_.reset();
  }
  void make_room() override {
    if (fold_ == nullptr) fold_ = compiled("sym16_fold", {});
    if (partial_ == nullptr) partial_ = device_.allocate(partial_bytes());
  }
  void multiply(Buffer& y) override {
    for (const Panel& panel : panels_) {
      const SymmetricArguments arguments{.blocks = panel.from.units,
                                         .strips = panel.from.strips,
                                         .tiles = panel.from.tiles,
                                         .block_rows = form_factors_.block_rows(),
                                         .vector_stride = shape_.vector_stride};
      const std::array buffers{panel.tiles.get(), panel.index.get(), scaled_.get(), partial_.get()};
      launch(multiply_kernel(), arguments.blocks, buffers, arguments, "Blocks of F x");
    }
    VectorArguments arguments = shape_;
    arguments.option = form_factors_.block();
    arguments.slot = form_factors_.block_rows();
    const std::array buffers{partial_.get(), out_.get(), &y};
    launch(*fold_, groups_, buffers, arguments, "y = F x");
  }

  std::unique_ptr<Kernel> fold_;
  std::unique_ptr<Buffer> partial_;
};

}  // namespace

std::unique_ptr<Product> make_product(const PackedMatrix& form_factors, Device& device, const VectorArguments& shape,
                                      std::uint32_t groups) {
  std::unique_ptr<PartProduct> product = make_part(form_factors, device, shape, groups);
  product->take(0, form_factors.units());
  return product;
}

Division division_of(const PackedMatrix& form_factors) {
  Division division;
  for (const std::uint64_t elements : form_factors.elements_before()) division.bytes.push_back(elements * sizeof(Half));
  division.added = form_factors.storage() == Storage::sym16;
  for (std::uint32_t u = 0; u < division.bytes.size(); ++u) {
    division.places.push_back(division.added ? 0 : std::min(form_factors.size(), u * tile_rows));
  }
  return division;
}

std::unique_ptr<PartProduct> make_part(const PackedMatrix& form_factors, Device& device, const VectorArguments& shape,
                                       std::uint32_t groups) {
  if (form_factors.storage() == Storage::sym16) {
    return std::make_unique<SymmetricProduct>(form_factors, device, shape, groups);
  }
  return std::make_unique<TiledProduct>(form_factors, device, shape, groups);
}

}  // namespace interflect
