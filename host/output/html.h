#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/output/output.h"

namespace interflect {

/// What a page says beside its solution.
struct PageOptions {
  std::string title;                   ///< the scene's name
  std::vector<std::string> materials;  ///< names by Surface::material; may be shorter: then there is no name to show
  std::optional<Camera> camera;        ///< none: frame_scene()
  std::vector<std::array<std::string, 2>> statistics;  ///< lines of name and value
  bool complete = true;                                ///< all bounces are in the solution, so that the page may say so
  bool served = false;                                 ///< it may talk to the server that it came from, to no other
  /// The bounce series is left out of a page where it would take more bytes than this.
  std::uint64_t largest_bounces = std::uint64_t{128} << 20;
};

/// The page as one text, handed over in pieces: HTML that holds its program, its style, three.js and the solution, and
/// asks the network for nothing (a content security policy in the page forbids it). In it every group of
/// Solution::lights has a weight per channel, and B = Σ_g w_g lit[g] is computed where the page is opened; a solution
/// without groups is one lamp.
///   Numbers: positions relative to the middle of the mesh, ρ, E, areas, row sums and lit are single precision. The
/// bounce series is half precision in units of its largest value m: each radiosity is within max(2^-11 of itself,
/// 2^-25 m) of what it was. Radiosities that are not finite become NaN, and show black.
///   Names are text, whatever they hold: bytes that are not UTF-8 become U+FFFD.
/// Throws an internal Error for a solution whose parts do not fit together, a limit Error for a page above 1 GiB, which
/// no browser opens.
void make_page(const Solution& solution, const PageOptions& options,
               const std::function<void(std::string_view)>& write);

/// make_page() into a file, which appears whole under its final name or not at all; an input Error names it otherwise.
void write_html(const Solution& solution, const PageOptions& options, const std::filesystem::path& path);

}  // namespace interflect
