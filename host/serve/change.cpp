#include "interflect/serve/change.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <vector>

#include "interflect/base/error.h"

namespace interflect::serve {

namespace {

using Json = nlohmann::ordered_json;

constexpr double largest_emittance = 1e9, smallest_tolerance = 1e-7, largest_tolerance = 0.1;
constexpr std::size_t longest_client = 64;
constexpr int deepest = 8;

[[noreturn]] void refuse(const std::string& cause) {
  throw Error(ErrorKind::input, cause);
}

/// What a client wrote, short and printable.
std::string shortened(std::string_view text) {
  std::string out = Json(std::string(text.substr(0, 60))).dump(-1, ' ', true, Json::error_handler_t::replace);
  return text.size() > 60 ? out.insert(out.size() - 1, "...") : out;
}

/// JSON as RFC 8259 has it, of an object; a key that is repeated is an error, as which one counts would be a guess.
Json parsed(std::string_view body) {
  std::vector<std::set<std::string>> keys;
  const auto watch = [&](int depth, Json::parse_event_t event, Json& value) {
    if (depth > deepest) refuse("the body is nested too deeply");
    if (event == Json::parse_event_t::object_start) keys.emplace_back();
    if (event == Json::parse_event_t::object_end) keys.pop_back();
    if (event == Json::parse_event_t::key && !keys.back().insert(value.get<std::string>()).second) {
      refuse(fmt::format("{} stands twice", shortened(value.get<std::string>())));
    }
    return true;
  };
  try {
    Json json = Json::parse(body, watch);
    if (!json.is_object()) refuse("the body is not a JSON object");
    return json;
  } catch (const Json::exception& error) {
    std::string_view why = error.what();  // "[json.exception.NAME.NUMBER] parse error at ..."
    if (const std::size_t end = why.find("] "); end != std::string_view::npos) why.remove_prefix(end + 2);
    refuse(fmt::format("the body is not JSON: {}", shortened(why)));
  }
}

double number_of(const Json& json, double least, double most, const std::string& what) {
  const double value = json.is_number() ? json.get<double>() : least - 1;
  if (!(value >= least && value <= most)) {
    refuse(fmt::format("{}: {} is not a number from {} to {}", what,
                       shortened(json.dump(-1, ' ', true, Json::error_handler_t::replace)), least, most));
  }
  return value;
}

std::map<std::size_t, Rgb> colours_of(const Json& json, const char* key, const LiveScene& scene, double most) {
  std::map<std::size_t, Rgb> colours;
  if (!json.is_object()) refuse(fmt::format("{}: not an object of materials", key));
  const auto& materials = scene.materials();
  for (const auto& [name, value] : json.items()) {
    const std::string& wanted = name;  // lambdas cannot hold a structured binding
    const auto found =
        std::find_if(materials.begin(), materials.end(), [&](const auto& m) { return m.name == wanted; });
    if (found == materials.end()) refuse(fmt::format("{}: there is no material {}", key, shortened(name)));
    if (!value.is_array() || value.size() != 3) {
      refuse(fmt::format("{} of {}: three numbers are needed, [R, G, B]", key, shortened(name)));
    }
    Rgb& colour = colours[static_cast<std::size_t>(found - materials.begin())];
    for (std::size_t c = 0; c < 3; ++c) {
      colour[c] = number_of(value[c], 0, most, fmt::format("{} of {}", key, shortened(name)));
    }
  }
  return colours;
}

std::string text_of(const Json& json, const char* key, std::size_t longest) {
  if (!json.is_string()) refuse(fmt::format("{}: not a text", key));
  std::string text = json.get<std::string>();
  if (text.size() > longest) refuse(fmt::format("{}: longer than {} bytes", key, longest));
  return text;
}

}  // namespace

SolveRequest read_solve_request(std::string_view body, const LiveScene& scene, double tolerance) {
  SolveRequest request;
  request.change.tolerance = tolerance;
  const Json json = parsed(body);
  for (const auto& [key, value] : json.items()) {
    if (key == "client") {
      request.client = text_of(value, "client", longest_client);
    } else if (key == "tolerance") {
      request.change.tolerance =
          number_of(value, std::min(smallest_tolerance, tolerance), largest_tolerance, "tolerance");
    } else if (key == "reflectance") {
      request.change.reflectance = colours_of(value, "reflectance", scene, 1);
    } else if (key == "emittance") {
      request.change.emittance = colours_of(value, "emittance", scene, largest_emittance);
    } else {
      refuse(fmt::format("{} is not known: client, tolerance, reflectance, emittance are", shortened(key)));
    }
  }
  for (const auto& [index, colour] : request.change.emittance) {
    const LiveMaterial& material = scene.materials()[index];
    if (!material.emits)
      refuse(fmt::format("emittance of {}: it does not emit in the scene", shortened(material.name)));
  }
  return request;
}

std::string read_device_request(std::string_view body) {
  const Json json = parsed(body);
  if (json.size() != 1 || !json.contains("device")) refuse("one key is needed: device");
  return text_of(json["device"], "device", longest_client);
}

}  // namespace interflect::serve
