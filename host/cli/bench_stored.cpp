#include "bench_stored.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/check.h"
#include "pipeline.h"

namespace interflect::cli {

Stored::Stored(const FormFactorMatrix& dense, const PatchMesh& mesh, Storage storage, std::uint32_t block)
    : dense_(dense) {
  if (storage != Storage::dense32) packed_ = std::make_unique<PackedMatrix>(pack(dense, mesh, storage, block));
}

Stored::Stored(const FormFactorMatrix& dense, std::span<const double> area, Storage storage, std::uint32_t block)
    : dense_(dense) {
  PackedMatrix::Options options;
  options.block = block;
  if (storage != Storage::dense32) packed_ = std::make_unique<PackedMatrix>(dense, area, storage, std::move(options));
}

std::unique_ptr<Scheduler> Stored::place(std::vector<std::unique_ptr<Device>> devices, std::uint32_t columns) const {
  if (packed_ != nullptr) return std::make_unique<Scheduler>(*packed_, std::move(devices), columns);
  return std::make_unique<Scheduler>(dense_, std::move(devices), columns);
}

double Stored::bound() const {
  const auto roundings = [](double count) { return count * 0x1p-24 / (1 - count * 0x1p-24); };
  if (packed_ == nullptr) return matvec_bound(size());
  const bool symmetric = storage() == Storage::sym16;
  const double product = symmetric ? sym16_bound(packed_->block()) : packed_bound(size());
  // scale before it, sym16_fold behind it
  const double others = roundings(1 + (symmetric ? packed_->block_rows() + 2 : 0));
  return product + others + product * others;
}

void Stored::describe_product(BenchRow& row) const {
  const std::uint64_t vector = std::uint64_t{row.columns} * size() * sizeof(float);
  row.storage = std::string(name(storage()));
  row.n = size();
  row.products = 1;
  row.flops = std::uint64_t{2} * row.columns * size() * size();
  row.bytes = bytes() + 2 * vector;
  row.bytes_written = vector;
  if (packed_ == nullptr) return;
  std::uint64_t between = vector;  // the scaled x: written, and read by the product in place of x
  if (storage() == Storage::sym16) between += vector * packed_->block_rows();  // partial
  row.bytes += 2 * between;
  row.bytes_written += between;
}

const std::vector<Storage>& all_storages() {
  static const std::vector<Storage> all{Storage::dense32, Storage::dense16, Storage::tiled16, Storage::sym16};
  return all;
}

std::vector<Storage> parse_storages(const std::string& text) {
  if (text == "all") return all_storages();
  std::vector<Storage> storages;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    const std::string one = text.substr(at, end - at);
    const auto found = std::find_if(all_storages().begin(), all_storages().end(),
                                    [&](Storage storage) { return name(storage) == one; });
    if (found == all_storages().end()) {
      std::string names = "all";
      for (const Storage storage : all_storages()) names += ", " + std::string(name(storage));
      throw Error(ErrorKind::usage, fmt::format("--storage: '{}' is no storage; there are {}", one, names));
    }
    if (std::find(storages.begin(), storages.end(), *found) != storages.end()) {
      throw Error(ErrorKind::usage, fmt::format("--storage: {} is named twice", one));
    }
    storages.push_back(*found);
    at = end + 1;
  }
  return storages;
}

}  // namespace interflect::cli
