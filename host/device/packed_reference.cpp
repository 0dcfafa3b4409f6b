#include "interflect/device/packed_reference.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace interflect::reference {

namespace {

void add(Sum& sum, Half h, float x) {
  const double product = static_cast<double>(from_half(h)) * static_cast<double>(x);
  sum.value += product;
  sum.magnitude += std::abs(product);
}

Sum scaled(Sum sum, float scale) {
  const auto s = static_cast<double>(scale);
  return {sum.value * s, sum.magnitude * std::abs(s)};
}

}  // namespace

void tiles16(const TileArguments& a, std::uint32_t columns, std::span<const Half> tiles,
             std::span<const std::uint32_t> index, std::span<const float> x, std::span<const float> scale,
             std::span<Sum> y) {
  const auto tile_begin = index.first(std::size_t{a.strips} + 1);
  const auto tile_column = index.subspan(std::size_t{a.strips} + 1);
  for (std::size_t c = 0; c < columns; ++c) {
    for (std::size_t r = 0; r < std::size_t{a.strips} * tile_rows && a.first + r < a.n; ++r) {
      const std::size_t s = r / tile_rows, q = r % tile_rows;
      Sum sum;
      for (std::size_t t = tile_begin[s]; t < tile_begin[s + 1]; ++t) {
        for (std::size_t l = 0; l < tile_columns; ++l) {
          add(sum, tiles[t * tile_elements + q * tile_columns + l],
              x[c * a.vector_stride + tile_column[t] * std::size_t{tile_columns} + l]);
        }
      }
      y[c * a.vector_stride + a.first + r] = scaled(sum, scale[a.first + r]);
    }
  }
}

void sym16(const SymmetricArguments& a, std::uint32_t columns, std::uint32_t block, std::span<const Half> tiles,
           std::span<const std::uint32_t> index, std::span<const float> x, std::span<Sum> partial) {
  const auto blocks = index.first(std::size_t{a.blocks} * 4);
  const auto strip_in_block = index.subspan(blocks.size(), a.strips);
  const auto tile_begin = index.subspan(blocks.size() + a.strips, std::size_t{a.strips} + 1);
  const auto tile_column = index.subspan(blocks.size() + a.strips + a.strips + 1);
  for (std::size_t k = 0; k < a.blocks; ++k) {
    const std::size_t block_row = blocks[4 * k], block_column = blocks[4 * k + 1];
    Sum* rows = &partial[(block_row * a.block_rows + block_column) * columns * block];
    Sum* cols = &partial[(block_column * a.block_rows + block_row) * columns * block];
    std::fill_n(rows, std::size_t{columns} * block, Sum{});
    std::fill_n(cols, std::size_t{columns} * block, Sum{});
    for (std::size_t s = blocks[4 * k + 2]; s < blocks[4 * k + 3]; ++s) {
      for (std::size_t t = tile_begin[s]; t < tile_begin[s + 1]; ++t) {
        for (std::size_t e = 0; e < std::size_t{columns} * tile_elements; ++e) {
          const std::size_t c = e / tile_elements, element = e % tile_elements;
          const std::size_t i = strip_in_block[s] * std::size_t{tile_rows} + element / tile_columns;
          const std::size_t j = tile_column[t] * std::size_t{tile_columns} + element % tile_columns;
          const Half h = tiles[t * tile_elements + element];
          add(rows[c * block + i], h, x[c * a.vector_stride + block_column * block + j]);
          add(cols[c * block + j], h, x[c * a.vector_stride + block_row * block + i]);
        }
      }
    }
  }
}

void sym16_fold(const VectorArguments& a, std::span<const float> partial, std::span<const float> scale,
                std::span<Sum> y) {
  const std::size_t block = a.option, block_rows = a.slot;
  for (std::size_t c = 0; c < a.columns; ++c) {
    for (std::size_t i = 0; i < a.n; ++i) {
      Sum sum;
      for (std::size_t j = 0; j < block_rows; ++j) {
        const auto part =
            static_cast<double>(partial[((i / block * block_rows + j) * a.columns + c) * block + i % block]);
        sum.value += part;
        sum.magnitude += std::abs(part);
      }
      y[c * a.vector_stride + i] = scaled(sum, scale[i]);
    }
  }
}

}  // namespace interflect::reference
