#pragma once

#include <string>

namespace interflect::cli {

/// Solves a small closed room with uniform emittance and reflectance (the furnace: b = e / (1 − ρ) in every patch) on a
/// device with every method. "PASS", or "FAIL: REASON".
[[nodiscard]] std::string selftest(const std::string& device);

}  // namespace interflect::cli
