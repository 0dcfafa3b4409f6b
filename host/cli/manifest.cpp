#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "batch_plan.h"
#include "interflect/base/error.h"
#include "interflect/base/file.h"

namespace interflect::cli {

namespace {

using nlohmann::ordered_json;

/// JSON as it is; a key that comes twice in one object would hide the first.
ordered_json parse(const std::string& text, const std::string& file) {
  std::vector<std::set<std::string>> keys;
  std::string twice;
  const auto look = [&](int, ordered_json::parse_event_t event, ordered_json& value) {
    if (event == ordered_json::parse_event_t::object_start) keys.emplace_back();
    if (event == ordered_json::parse_event_t::object_end) keys.pop_back();
    if (event == ordered_json::parse_event_t::key && !keys.back().insert(value.get<std::string>()).second) {
      twice = value.get<std::string>();
    }
    return true;
  };
  ordered_json out;
  try {
    out = ordered_json::parse(text, look);
  } catch (const ordered_json::exception& error) {
    const std::string_view what = error.what();
    const std::size_t end = what.find("] ");
    throw input_error(file, 0,
                      fmt::format("is not JSON: {}", end == std::string_view::npos ? what : what.substr(end + 2)));
  }
  if (!twice.empty()) throw input_error(file, 0, fmt::format("the key '{}' comes twice in one object", twice));
  return out;
}

std::string_view type_of(const ordered_json& value) {
  if (value.is_object()) return "an object";
  if (value.is_array()) return "a list";
  if (value.is_boolean()) return "true or false";
  return value.is_null() ? "null" : value.is_string() ? "text" : "a number";
}

/// Turns the manifest's keys into options. Knows what solve takes from the options themselves.
class Reader {
 public:
  explicit Reader(std::string file) : file_(std::move(file)), app_("a job") {
    app_.set_help_flag();
    add_scene_options(app_, job_.scene);
    add_job_options(app_, job_);
  }

  [[noreturn]] void fail(const std::string& where, const std::string& cause) const {
    throw input_error(file_, 0, where.empty() ? cause : fmt::format("{}: {}", where, cause));
  }

  /// All keys of an object; "scene" only of a job.
  [[nodiscard]] GivenOptions options(const ordered_json& object, const std::string& where, bool job) const {
    GivenOptions given;
    for (const auto& [key, value] : object.items()) {
      if (key != "scene" || !job) given[key] = values_of(key, value, where);
    }
    return given;
  }

  /// `first`, and of `second` what it does not give itself nor exclude.
  [[nodiscard]] GivenOptions over(const GivenOptions& first, const GivenOptions& second) const {
    GivenOptions both = first;
    for (const auto& [name, values] : second) {
      const bool excluded = std::any_of(first.begin(), first.end(), [&, &name = name](const auto& mine) {
        // CLI11 keeps them without const.
        const auto& excludes = app_.get_option("--" + mine.first)->get_excludes();
        return std::any_of(excludes.begin(), excludes.end(),
                           [&](CLI::Option* option) { return option->check_lname(name); });
      });
      if (!excluded) both.emplace(name, values);
    }
    return both;
  }

 private:
  /// The values of a key as the command line would have them; none for a flag.
  [[nodiscard]] std::vector<std::string> values_of(const std::string& key, const ordered_json& value,
                                                   const std::string& where) const {
    const CLI::Option* const option = key.empty() ? nullptr : app_.get_option_no_throw("--" + key);
    if (key == "quiet" || key == "json-progress") fail(where, fmt::format("'{}' is for the whole run", key));
    if (option == nullptr) fail(where, fmt::format("'{}' is not an option of solve", key));
    if (option->get_items_expected_max() == 0) {
      if (!value.is_boolean()) fail(where, fmt::format("'{}' is {}, and true or false is wanted", key, type_of(value)));
      return value.get<bool>() ? std::vector<std::string>{} : std::vector<std::string>{"false"};
    }
    const bool several = option->get_items_expected_max() > 1;
    if (!value.is_array() || !several) return {text_of(key, value, where, several)};
    if (value.empty()) fail(where, fmt::format("'{}' is an empty list", key));
    std::vector<std::string> values;
    for (const ordered_json& one : value) values.push_back(text_of(key, one, where, false));
    return values;
  }
  [[nodiscard]] std::string text_of(const std::string& key, const ordered_json& value, const std::string& where,
                                    bool or_list) const {
    if (value.is_string()) return value.get<std::string>();
    if (value.is_number()) return value.dump();
    fail(where, fmt::format("'{}' is {}, and {} is wanted", key, type_of(value),
                            or_list ? "text or a list" : "text or a number"));
  }

  std::string file_;
  SolveJob job_;
  CLI::App app_;
};

}  // namespace

std::vector<PlannedJob> plan_manifest(const std::string& file, const GivenOptions& command_line) {
  constexpr std::uintmax_t largest = std::uintmax_t{1} << 28;
  const ordered_json manifest = parse(read_file(file, largest), file);
  const Reader reader(file);
  if (!manifest.is_object())
    reader.fail("", fmt::format("is {}, and an object with \"jobs\" is wanted", type_of(manifest)));
  for (const auto& [key, ignored] : manifest.items()) {
    if (key != "jobs" && key != "defaults") reader.fail("", fmt::format("'{}' is neither 'jobs' nor 'defaults'", key));
  }
  if (!manifest.contains("jobs")) reader.fail("", "has no 'jobs'");
  const ordered_json& list = manifest["jobs"];
  if (!list.is_array()) reader.fail("", fmt::format("'jobs' is {}, and a list is wanted", type_of(list)));
  if (list.empty()) reader.fail("", "'jobs' is an empty list");
  GivenOptions defaults = command_line;
  if (manifest.contains("defaults")) {
    const ordered_json& object = manifest["defaults"];
    if (!object.is_object()) {
      reader.fail("defaults", fmt::format("is {}, and an object is wanted", type_of(object)));
    }
    defaults = reader.over(command_line, reader.options(object, "defaults", false));
  }
  std::vector<PlannedJob> jobs;
  for (const ordered_json& object : list) {
    std::string where = fmt::format("job {}", jobs.size() + 1);
    if (!object.is_object()) reader.fail(where, fmt::format("is {}, and an object is wanted", type_of(object)));
    if (!object.contains("scene")) reader.fail(where, "has no 'scene'");
    const ordered_json& scene = object["scene"];
    if (!scene.is_string() || scene.get<std::string>().empty()) reader.fail(where, "'scene' is not the name of a file");
    where = fmt::format("{} ({})", where, scene.get<std::string>());
    const GivenOptions options = reader.over(reader.options(object, where, true), defaults);
    try {
      jobs.push_back(plan_job(scene.get<std::string>(), options, fmt::format("{}: {}", file, where)));
    } catch (const Error& error) {  // it names file and job
      throw Error(ErrorKind::input, error.what());
    }
  }
  return jobs;
}

}  // namespace interflect::cli
