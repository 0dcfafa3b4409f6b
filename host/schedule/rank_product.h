#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "interflect/base/ranks.h"
#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/schedule/product.h"

namespace interflect {

/// Every rank's rows of vectors, brought together on every rank. Collective.
class RankRows {
 public:
  /// The rows of F that this rank's matrix has: all ranks' rows are all rows, in their order, and one rank may have
  /// none. Throws an internal Error on all ranks where that is not so.
  RankRows(Ranks& ranks, const FormFactorMatrix& rows);

  /// column(c) is where column c begins: its own rows are read there, and the others written.
  template <class T, class ColumnAt>
  void gather(std::size_t columns, const ColumnAt& column) const {
    std::vector<std::uint64_t> bytes;
    for (const Rows& rows : rows_) bytes.push_back(columns * rows.count * sizeof(T));
    std::vector<T> mine, all(columns * size_);
    const Rows& own = rows_[ranks_.rank()];
    for (std::size_t c = 0; c < columns; ++c) {
      mine.insert(mine.end(), column(c) + own.first, column(c) + own.first + own.count);
    }
    ranks_.all_gather(std::as_bytes(std::span(mine)), bytes, std::as_writable_bytes(std::span(all)));
    const T* from = all.data();
    for (const Rows& rows : rows_) {
      for (std::size_t c = 0; c < columns; ++c, from += rows.count) {
        std::copy(from, from + rows.count, column(c) + rows.first);
      }
    }
  }

 private:
  struct Rows {
    std::uint32_t first = 0, count = 0;
  };
  Ranks& ranks_;
  std::uint32_t size_ = 0;
  std::vector<Rows> rows_;  ///< by rank
};

/// y = F x where each rank has some rows of F: `local` is the product of these alone on the rank's own device (other
/// places of its y are of no account), and all_gather() brings y together on every rank. A row's sum depends on the
/// row, x and the kernel alone: with equal devices y has the same bits for every number of ranks. Where the devices (or
/// how they are tuned) differ, apply() first gives every rank rank 0's x, so that the ranks never part. Collective.
[[nodiscard]] std::unique_ptr<Product> make_rank_product(std::unique_ptr<Product> local, RankRows rows, Ranks& ranks,
                                                         Device& device, const VectorArguments& shape,
                                                         std::uint32_t groups);

/// exact_product() of all ranks' rows: every rank gets the whole of y.
void exact_product(const FormFactorMatrix& rows, Ranks& ranks, const Columns& x, std::vector<std::vector<double>>& y);

}  // namespace interflect
