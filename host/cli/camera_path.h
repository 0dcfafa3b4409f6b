#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "interflect/scene/scene.h"

namespace interflect::cli {

/// A camera at a moment.
struct KeyCamera {
  double time = 0;
  Camera camera;
};

/// A way of a camera through its keys: eye, target and field of view run through them along Catmull-Rom splines. Where
/// the keys have times these are the splines' knots; else the knots are centripetal (the square roots of the distances
/// between the keys), so that close keys make no loops.
class CameraPath {
 public:
  /// Throws an internal Error without keys or with times that do not grow.
  explicit CameraPath(std::vector<KeyCamera> keys);

  [[nodiscard]] double begin() const { return keys_.front().time; }
  [[nodiscard]] double end() const { return keys_.back().time; }
  /// The camera at a moment, that of the nearest end outside.
  [[nodiscard]] Camera at(double time) const;

 private:
  std::vector<KeyCamera> keys_;
};

/// Key cameras of a file, by its extension.
/// .json: {"keys": [{"time": 0, "eye": [x, y, z], "target": [x, y, z], "up": [x, y, z], "fov": degrees}, ...]}, or the
/// list alone; time (for all or none), up and fov (vertical) may be missing.
/// .csv: a line for each key, time,eye x,y,z,target x,y,z[,fov]; the time may be empty in all lines; a first line of
/// words is a heading, and what follows a # is not read.
/// `usual` gives up and fov where they are missing. Throws an input Error naming line or key.
[[nodiscard]] CameraPath read_camera_path(const std::string& file, const Camera& usual);

/// Camera `frame` of `frames` once around the target, about the camera's up.
[[nodiscard]] Camera orbit(const Camera& camera, std::size_t frame, std::size_t frames);

}  // namespace interflect::cli
