#pragma once

#include <string>
#include <string_view>

namespace interflect {

/// The text of kernels/LANGUAGE/FILE ("cl", "matvec.cl"): embedded in the library, or read from the folder that
/// INTERFLECT_KERNEL_DIR names. A line `#include "OTHER"` is replaced by that file, its name relative to the folder of the
/// file with the line ("../shared/occluded.h": what all languages share), once; #line directives name file and line of every part ("cl/matvec.cl"), so that a compiler's messages do.
/// Throws a device Error for a file that is not there or cannot be read.
[[nodiscard]] std::string kernel_source(std::string_view language, std::string_view file);

}  // namespace interflect
