#pragma once

#include <string>
#include <string_view>

#include "interflect/serve/live_scene.h"

namespace interflect::serve {

/// The body of a request for a solve.
struct SolveRequest {
  std::string client;  ///< of those with the same name only the newest is solved; empty: of nobody else
  Change change;
};

/// Reads {"client": NAME, "tolerance": T, "reflectance": {MATERIAL: [R, G, B], ...}, "emittance": {MATERIAL: [R, G, B],
/// ...}}, every part of which may be missing. Throws an input Error, one line that says what is wrong: no JSON, an
/// unknown or repeated key, an unknown material, a reflectance outside [0, 1], an emittance that is negative, above
/// 1e9, or of a material that does not emit, a tolerance outside [1e-7, 0.1] (`tolerance`, which is
/// asked for where the body names none, may be smaller, and may be named).
[[nodiscard]] SolveRequest read_solve_request(std::string_view body, const LiveScene& scene, double tolerance);

/// Reads {"device": ID}. Throws likewise.
[[nodiscard]] std::string read_device_request(std::string_view body);

}  // namespace interflect::serve
