#pragma once

#include <cstdint>
#include <span>

#include "interflect/base/half.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/reference.h"

// What the kernels of the 16-bit formats compute, as serial loops in double that can be checked by eye.
// kernels/README.md gives the same loops.

namespace interflect::reference {

/// tiles16 into y[c * vector_stride + i]; rows of other panels keep what they are.
void tiles16(const TileArguments& arguments, std::uint32_t columns, std::span<const Half> tiles,
             std::span<const std::uint32_t> index, std::span<const float> x, std::span<const float> scale,
             std::span<Sum> y);

/// sym16 into partial[((I * block_rows + J) * columns + c) * block + i]: the slots of the panel's blocks are set, the
/// others keep what they are.
void sym16(const SymmetricArguments& arguments, std::uint32_t columns, std::uint32_t block, std::span<const Half> tiles,
           std::span<const std::uint32_t> index, std::span<const float> x, std::span<Sum> partial);

/// sym16_fold into y[c * vector_stride + i].
void sym16_fold(const VectorArguments& arguments, std::span<const float> partial, std::span<const float> scale,
                std::span<Sum> y);

}  // namespace interflect::reference
