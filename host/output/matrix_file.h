#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "interflect/formfactor/form_factor_rows.h"

namespace interflect {

/// F as a NumPy array float32 [n, n], row by row. Throws as AtomicFile.
void write_matrix_npy(const FormFactorRows& rows, std::uint32_t n, const std::filesystem::path& path);

/// The non-zero elements of F in the Matrix Market exchange format: coordinate real general, indices from 1, each value
/// with as many digits as it takes to read the same float back. `comment` is one line. The rows are visited twice.
void write_matrix_market(const FormFactorRows& rows, std::uint32_t n, const std::string& comment,
                         const std::filesystem::path& path);

}  // namespace interflect
