#include "camera_path.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <sstream>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "outputs.h"

namespace interflect::cli {

namespace {

constexpr double degree = std::numbers::pi / 180;
constexpr std::uintmax_t largest_file = std::uintmax_t{1} << 24;
using nlohmann::json;

/// What is interpolated: eye, target, up, field of view.
using Values = std::array<double, 10>;

Values values_of(const Camera& c) {
  return {c.eye.x, c.eye.y, c.eye.z, c.target.x, c.target.y, c.target.z, c.up.x, c.up.y, c.up.z, c.vertical_fov};
}
Camera camera_of(const Values& v) {
  return {{v[0], v[1], v[2]}, {v[3], v[4], v[5]}, {v[6], v[7], v[8]}, v[9]};
}

/// A key as a file gives it; a missing time is NaN.
struct Given {
  KeyCamera key;
  bool timed = false;
  std::string where;  ///< "line 3" or "key 2"
};

/// Reads keys and says which is wrong.
class Keys {
 public:
  Keys(std::string file, const Camera& usual) : file_(std::move(file)), usual_(usual) {}

  [[nodiscard]] CameraPath read() {
    const std::string text = read_file(file_, largest_file);
    extension_of(file_) == ".csv" ? read_csv(text) : read_json(text);
    if (given_.empty()) throw input_error(file_, 0, "holds no key cameras");
    set_times();
    std::vector<KeyCamera> keys;
    for (const Given& g : given_) {
      check(g);
      keys.push_back(g.key);
    }
    return CameraPath(std::move(keys));
  }

 private:
  [[nodiscard]] Error fail(const std::string& where, const std::string& cause) const {
    return input_error(file_, 0, fmt::format("{}: {}", where, cause));
  }

  [[nodiscard]] double fov(double degrees, const std::string& where) const {
    if (!(degrees > 0 && degrees < 179)) throw fail(where, fmt::format("a field of view of {} degrees", degrees));
    return degrees * degree;
  }

  void read_csv(const std::string& text) {
    std::istringstream lines(text);
    std::string line;
    for (std::size_t number = 1; std::getline(lines, line); ++number) {
      line = line.substr(0, line.find('#'));
      if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
      if (given_.empty() && !heading_ && is_heading(line)) {
        heading_ = true;
        continue;
      }
      Given g{{0, usual_}, true, fmt::format("line {}", number)};
      std::vector<double> n;
      std::istringstream fields(line);
      for (std::string field; std::getline(fields, field, ',');) n.push_back(read_number(field, n.empty(), g));
      if (n.size() != 7 && n.size() != 8) {
        throw fail(g.where, fmt::format("{} values instead of time, eye x y z, target x y z[, fov]", n.size()));
      }
      g.key.time = n[0];
      g.key.camera.eye = {n[1], n[2], n[3]};
      g.key.camera.target = {n[4], n[5], n[6]};
      if (n.size() == 8) g.key.camera.vertical_fov = fov(n[7], g.where);
      given_.push_back(std::move(g));
    }
  }

  static bool is_heading(const std::string& line) {
    // Letters other than those of numbers ("1e5").
    return std::any_of(line.begin(), line.end(), [](char c) {
      return ((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z')) && c != 'e' && c != 'E';
    });
  }

  [[nodiscard]] double read_number(std::string field, bool may_be_empty, Given& g) const {
    field.erase(0, field.find_first_not_of(" \t"));
    field.erase(field.find_last_not_of(" \t\r") + 1);
    if (field.empty() && may_be_empty) {
      g.timed = false;
      return 0;
    }
    double value = 0;
    const char* const end = field.data() + field.size();
    const auto [next, status] = std::from_chars(field.data(), end, value);
    if (status != std::errc{} || next != end || !std::isfinite(value)) {
      throw fail(g.where, fmt::format("'{}' is not a number", field));
    }
    return value;
  }

  void read_json(const std::string& text) {
    json root;
    try {
      root = json::parse(text);
    } catch (const json::exception& error) {
      throw input_error(file_, 0, fmt::format("not JSON: {}", error.what()));
    }
    const json& list = root.is_object() && root.contains("keys") ? root["keys"] : root;
    if (!list.is_array()) throw input_error(file_, 0, "neither a list of key cameras nor an object with 'keys'");
    for (const json& entry : list) {
      Given g{{0, usual_}, false, fmt::format("key {}", given_.size() + 1)};
      if (!entry.is_object()) throw fail(g.where, "is not an object");
      for (const auto& [name, value] : entry.items()) {
        if (name != "time" && name != "eye" && name != "target" && name != "up" && name != "fov") {
          throw fail(g.where, fmt::format("'{}' is not known (time, eye, target, up, fov)", name));
        }
      }
      g.key.camera.eye = point(entry, "eye", g.where);
      g.key.camera.target = point(entry, "target", g.where);
      if (entry.contains("up")) g.key.camera.up = point(entry, "up", g.where);
      if (entry.contains("fov")) g.key.camera.vertical_fov = fov(number_at(entry["fov"], "fov", g.where), g.where);
      g.timed = entry.contains("time");
      if (g.timed) g.key.time = number_at(entry["time"], "time", g.where);
      given_.push_back(std::move(g));
    }
  }

  [[nodiscard]] double number_at(const json& value, const char* name, const std::string& where) const {
    if (!value.is_number() || !std::isfinite(value.get<double>())) {
      throw fail(where, fmt::format("'{}' is not a number", name));
    }
    return value.get<double>();
  }

  [[nodiscard]] Vec3 point(const json& entry, const char* name, const std::string& where) const {
    const auto found = entry.find(name);
    if (found == entry.end()) throw fail(where, fmt::format("'{}' is missing", name));
    if (!found->is_array() || found->size() != 3) throw fail(where, fmt::format("'{}' is not [x, y, z]", name));
    return {number_at((*found)[0], name, where), number_at((*found)[1], name, where),
            number_at((*found)[2], name, where)};
  }

  /// Times grow; where none are given they are centripetal, 0 to 1 over the whole way.
  void set_times() {
    const bool timed = given_.front().timed;
    for (std::size_t k = 0; k < given_.size(); ++k) {
      Given& g = given_[k];
      if (g.timed != timed) throw fail(g.where, "some keys have a time and others have none");
      if (k == 0) continue;
      const Given& before = given_[k - 1];
      if (timed && !(g.key.time > before.key.time)) {
        throw fail(g.where, fmt::format("the time {} does not come after {}", g.key.time, before.key.time));
      }
      if (timed) continue;
      const double way =
          length(g.key.camera.eye - before.key.camera.eye) + length(g.key.camera.target - before.key.camera.target);
      if (!(way > 0)) throw fail(g.where, "the same eye and target as before, and no times to tell them apart");
      g.key.time = before.key.time + std::sqrt(way);
      if (!std::isfinite(g.key.time)) throw fail(g.where, "too far from the key before");
    }
    if (timed || given_.size() == 1) return;
    const double all = given_.back().key.time;
    for (std::size_t k = 0; k < given_.size(); ++k) {
      given_[k].key.time /= all;
      if (k == 0 || given_[k].key.time > given_[k - 1].key.time) continue;
      throw fail(given_[k].where, "too close to the key before for so long a way, and no times to tell them apart");
    }
  }

  void check(const Given& g) const {
    const Camera& c = g.key.camera;
    const Vec3 view = c.target - c.eye;
    if (!(length(cross(view, c.up)) > 1e-9 * length(view) * length(c.up))) {
      throw fail(g.where, "eye, target and up give no view (is the target the eye, or up along the view?)");
    }
  }

  std::string file_;
  Camera usual_;
  std::vector<Given> given_;
  bool heading_ = false;
};

}  // namespace

CameraPath::CameraPath(std::vector<KeyCamera> keys) : keys_(std::move(keys)) {
  bool good = !keys_.empty();
  for (std::size_t k = 1; k < keys_.size(); ++k) good = good && keys_[k].time > keys_[k - 1].time;
  if (!good) throw Error(ErrorKind::internal, "camera path: no keys, or times that do not grow");
}

Camera CameraPath::at(double time) const {
  if (!(time > begin())) return keys_.front().camera;
  if (time >= end()) return keys_.back().camera;
  const auto after =
      std::upper_bound(keys_.begin(), keys_.end(), time, [](double t, const KeyCamera& k) { return t < k.time; });
  const auto i = static_cast<std::size_t>(after - keys_.begin()) - 1;
  const auto value = [&](std::size_t k) { return values_of(keys_[k].camera); };
  // The slope at a key: of the parabola through it and its neighbours; at an end, of the line to the only neighbour.
  const auto slope = [&](std::size_t k, std::size_t c) {
    const auto chord = [&](std::size_t a) {
      return (value(a + 1)[c] - value(a)[c]) / (keys_[a + 1].time - keys_[a].time);
    };
    if (k == 0) return chord(0);
    if (k + 1 == keys_.size()) return chord(k - 1);
    const double before = keys_[k].time - keys_[k - 1].time, behind = keys_[k + 1].time - keys_[k].time;
    return (behind * chord(k - 1) + before * chord(k)) / (before + behind);
  };
  const double width = keys_[i + 1].time - keys_[i].time, s = (time - keys_[i].time) / width;
  const double s2 = s * s, s3 = s2 * s;
  const Values from = value(i), to = value(i + 1);
  Values out{};
  for (std::size_t c = 0; c < out.size(); ++c) {  // Hermite's form
    out[c] = (2 * s3 - 3 * s2 + 1) * from[c] + (s3 - 2 * s2 + s) * width * slope(i, c) + (3 * s2 - 2 * s3) * to[c] +
             (s3 - s2) * width * slope(i + 1, c);
  }
  out.back() = std::clamp(out.back(), 0.5 * degree, 178 * degree);
  return camera_of(out);
}

CameraPath read_camera_path(const std::string& file, const Camera& usual) {
  if (extension_of(file) != ".json" && extension_of(file) != ".csv") {
    throw Error(ErrorKind::usage, fmt::format("--path {}: '{}' is neither .json nor .csv", file, extension_of(file)));
  }
  return Keys(file, usual).read();
}

Camera orbit(const Camera& camera, std::size_t frame, std::size_t frames) {
  const double angle = 2 * std::numbers::pi * static_cast<double>(frame) / static_cast<double>(frames);
  const Vec3 axis = normalized(camera.up), from = camera.eye - camera.target;
  // Rodrigues' formula.
  const Vec3 turned =
      from * std::cos(angle) + cross(axis, from) * std::sin(angle) + axis * (dot(axis, from) * (1 - std::cos(angle)));
  Camera out = camera;
  out.eye = camera.target + turned;
  return out;
}

}  // namespace interflect::cli
