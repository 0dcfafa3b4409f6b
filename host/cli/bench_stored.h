#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "bench_row.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/schedule/scheduler.h"

namespace interflect::cli {

/// F in one storage, of a dense matrix that must outlive it.
class Stored {
 public:
  /// Packs F, the tiled formats in patch_order() and sym16 with that block; or only refers to it for dense32. Throws
  /// what PackedMatrix throws.
  Stored(const FormFactorMatrix& dense, const PatchMesh& mesh, Storage storage, std::uint32_t block);
  /// The same for a matrix without a scene; patches stay in their order.
  Stored(const FormFactorMatrix& dense, std::span<const double> area, Storage storage, std::uint32_t block);

  [[nodiscard]] Storage storage() const { return packed_ == nullptr ? Storage::dense32 : packed_->storage(); }
  [[nodiscard]] std::uint32_t size() const { return dense_.size(); }
  [[nodiscard]] std::uint64_t bytes() const { return packed_ == nullptr ? dense_.bytes() : packed_->bytes(); }
  [[nodiscard]] std::unique_ptr<Scheduler> place(std::vector<std::unique_ptr<Device>> devices,
                                                 std::uint32_t columns) const;
  /// The relative error of an element of F x, all of one sign, that kernels/README.md allows the kernels together.
  [[nodiscard]] double bound() const;
  /// Sets storage, n, bytes and operations of one product of row.columns columns: F as it is stored, the vectors, and
  /// what lies between the kernels. Operations are those of the dense product, whatever the storage leaves out.
  void describe_product(BenchRow& row) const;

 private:
  const FormFactorMatrix& dense_;
  std::unique_ptr<PackedMatrix> packed_;  ///< null: dense32
};

/// Every storage that there is.
[[nodiscard]] const std::vector<Storage>& all_storages();
/// "dense32,sym16", or "all". Throws a usage Error for a storage that is not one, or is named twice.
[[nodiscard]] std::vector<Storage> parse_storages(const std::string& text);

}  // namespace interflect::cli
