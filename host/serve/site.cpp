#include "interflect/serve/site.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/serve/change.h"

namespace interflect::serve {

namespace {

using Json = nlohmann::ordered_json;

struct Path {
  std::string_view path, method;
};
constexpr std::array paths{Path{"/", "GET"}, Path{"/scene", "GET"}, Path{"/devices", "GET"}, Path{"/solve", "POST"},
                           Path{"/device", "POST"}};

std::string dump(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void append(std::string& out, std::uint32_t word) {
  for (unsigned shift = 0; shift < 32; shift += 8) out += static_cast<char>(word >> shift & 0xFFU);
}

Json said_of(const LiveSolution& solution) {
  Json residuals = Json::array();
  for (const double r : solution.report.relative_residual) residuals.push_back(std::isfinite(r) ? Json(r) : Json());
  return {{"number", solution.number},
          {"lamps", solution.radiosity.size() / 3},
          {"patches", solution.radiosity.front().size()},
          {"converged", solution.report.converged},
          {"reason", solution.report.reason},
          {"tolerance", solution.tolerance},
          {"warm", solution.warm},
          {"iterations", solution.report.iterations},
          {"products", solution.report.products},
          {"relative_residual", std::move(residuals)},
          {"seconds", solution.seconds},
          {"device", solution.device},
          {"storage", solution.storage},
          {"rounding_error", solution.rounding_error ? Json(*solution.rounding_error) : Json()},
          {"notice", solution.notice}};
}

/// The case of letters, blanks and parameters do not matter in a type (RFC 9110).
bool is_json(const std::string& type) {
  constexpr std::string_view wanted = "application/json";
  std::string_view bare = std::string_view(type).substr(0, type.find(';'));
  while (bare.ends_with(' ') || bare.ends_with('\t')) bare.remove_suffix(1);
  return std::equal(bare.begin(), bare.end(), wanted.begin(), wanted.end(),
                    [](char a, char b) { return (a >= 'A' && a <= 'Z' ? a - 'A' + 'a' : a) == b; });
}

}  // namespace

std::string solution_bytes(const LiveSolution& solution) {
  std::string json = dump(said_of(solution));
  json.append((4 - json.size() % 4) % 4, ' ');
  const Columns& b = solution.radiosity;
  const std::size_t n = b.front().size();
  std::string bytes;
  bytes.reserve(4 + json.size() + 4 * b.size() * n);
  append(bytes, static_cast<std::uint32_t>(json.size()));
  bytes += json;
  for (std::size_t g = 0; 3 * g < b.size(); ++g) {
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t c = 0; c < 3; ++c) append(bytes, std::bit_cast<std::uint32_t>(b[3 * g + c][i]));
    }
  }
  return bytes;
}

Site::Site(Guard guard, std::string page, const LiveScene& scene, LiveSolver& solver, Desk& desk, double tolerance,
           ListDevices list)
    : guard_(std::move(guard)),
      page_(std::make_shared<const std::string>(std::move(page))),
      scene_(scene),
      solver_(solver),
      desk_(desk),
      tolerance_(tolerance),
      list_(std::move(list)) {}

std::optional<Answer> Site::refuse(const Request& request) const {
  if (auto refused = guard_.refuse(request)) return refused;
  const std::string path = request.path();
  const auto found = std::find_if(paths.begin(), paths.end(), [&](const Path& p) { return p.path == path; });
  if (found == paths.end()) return refusal(404, "there is nothing at this path");
  const bool right = request.method == found->method || (request.method == "HEAD" && found->method == "GET");
  if (!right) {
    Answer answer = refusal(405, fmt::format("this path takes {}", found->method));
    answer.allow = found->method == "GET" ? "GET, HEAD" : "POST";
    return answer;
  }
  // A form of another origin can send texts, not this type.
  if (found->method == "POST" && !is_json(request.content_type)) {
    return refusal(415, "the body must be application/json (header Content-Type)");
  }
  return std::nullopt;
}

void Site::answer(const Request& request, Desk::Done done) {
  const std::string path = request.path();
  if (path == "/") return done({200, "text/html; charset=utf-8", page_, {}});
  // What follows looks at the solver, which is its thread's own.
  if (path == "/scene") {
    return desk_.leave(
        "", [this] { return text_answer(200, "application/json", scene_json()); }, std::move(done));
  }
  if (path == "/devices")
    return desk_.leave(
        "", [this] { return devices_answer(); }, std::move(done));
  if (path == "/solve") return solve(request, std::move(done));
  try {
    const std::string id = read_device_request(request.body);
    desk_.leave(
        "", [this, id] { return device_answer(id); }, std::move(done));
  } catch (const Error& error) {
    done(refusal(400, error.what()));
  }
}

void Site::solve(const Request& request, Desk::Done done) {
  SolveRequest wanted;
  try {
    wanted = read_solve_request(request.body, scene_, tolerance_);
  } catch (const Error& error) {
    return done(refusal(400, error.what()));
  }
  const auto work = [this, change = std::move(wanted.change)] {
    return text_answer(200, "application/octet-stream", solution_bytes(solver_.solve(change)));
  };
  desk_.leave(wanted.client, work, std::move(done));
}

std::string Site::scene_json() const {
  Json materials = Json::array();
  for (const LiveMaterial& m : scene_.materials()) {
    materials.push_back({{"name", m.name},
                         {"patches", m.patches},
                         {"area", m.area},
                         {"surfaces", m.surfaces},
                         {"reflectance", m.reflectance},
                         {"emittance", m.emits ? Json(m.emittance) : Json()},
                         {"varies", m.varies}});
  }
  const LiveSolution& last = solver_.last();
  return dump({{"patches", scene_.mesh().size()},
               {"lamps", scene_.lamps()},
               {"tolerance", tolerance_},
               {"device", solver_.device()},
               {"device_name", solver_.device_name()},
               {"storage", last.storage},
               {"materials", std::move(materials)}});
}

Answer Site::devices_answer() {
  if (devices_.empty()) devices_ = list_();
  Json list = Json::array();
  for (const DeviceEntry& entry : devices_) {
    list.push_back({{"id", entry.info.id},
                    {"name", entry.info.name},
                    {"emulated", entry.info.emulated()},
                    {"available", entry.available},
                    {"reason", entry.reason.substr(0, entry.reason.find('\n'))},
                    {"used", entry.info.id == solver_.device()}});
  }
  return text_answer(200, "application/json", dump(list));
}

Answer Site::device_answer(const std::string& id) {
  try {
    solver_.use_device(id);
  } catch (const Error& error) {
    const std::string_view why = error.what();
    if (error.kind() == ErrorKind::usage) return refusal(400, why);  // no such id
    return refusal(409, fmt::format("{}; {} stays in use", why.substr(0, why.find('\n')), solver_.device()));
  }
  return text_answer(
      200, "application/json",
      dump(
          {{"device", solver_.device()}, {"device_name", solver_.device_name()}, {"storage", solver_.last().storage}}));
}

}  // namespace interflect::serve
