#pragma once

#include <string_view>

namespace interflect {

/// How F is stored. A format is a pair: a host layout and matvec kernels in every backend, all with fp32 sums.
enum class Storage {
  dense32,  ///< FormFactorMatrix: every element, fp32
  dense16,  ///< PackedMatrix: every element, fp16
  tiled16,  ///< PackedMatrix: the tiles that are not empty, fp16
  sym16,    ///< PackedMatrix: of these the upper triangle's, each used for its rows and its columns
};
[[nodiscard]] std::string_view name(Storage storage);

}  // namespace interflect
