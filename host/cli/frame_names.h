#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace interflect::cli {

/// The name of frame k: "%d" or "%04d" in the pattern stand for the number, "%%" for a per cent sign.
[[nodiscard]] std::string frame_name(const std::string& pattern, std::uint64_t k);

/// A text as part of a pattern: each per cent sign stands for itself.
[[nodiscard]] std::string as_pattern(const std::string& text);

/// Throws a usage Error for an output that is neither .png nor .exr, that holds anything else after a per cent sign or
/// more than one number, or, where there are `several` frames, no number.
void check_frame_names(const std::vector<std::string>& patterns, bool several);

/// Throws a usage Error when one of the frames would replace a file of the scene.
void check_frames_spare(const std::vector<std::string>& patterns, std::uint64_t first, std::uint64_t end,
                        const std::vector<std::filesystem::path>& files);

}  // namespace interflect::cli
