#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "checkpoint.h"
#include "interflect/formfactor/estimate.h"
#include "kept.h"
#include "pipeline.h"
#include "place.h"

namespace interflect::cli {

/// Everything that `solve` has to say, for people and for programs.
struct SolveSummary {
  const MeshedScene* loaded = nullptr;
  const AssemblyReport* assembled = nullptr;
  const Solved* solved = nullptr;
  Method method = Method::cg;
  StopTest stop;
  Energy energy;
  AssemblyUse assembly;
  double estimate_seconds = 0, write_seconds = 0, total_seconds = 0;
  Kept kept = {};
  EstimatedError row_error = {}, radiosity_error = {};
  std::optional<RanksReport> ranks = {};
  std::optional<CheckpointUse> checkpoint = {};
};

/// The JSON report: the fields that DESIGN's section on the command line fixes, and more beside them.
[[nodiscard]] nlohmann::ordered_json to_json(const SolveSummary& summary);
/// The same in a dozen lines.
[[nodiscard]] std::string to_text(const SolveSummary& summary);

/// What packing took and its rounding costs, as the end of a line; nothing for dense32.
[[nodiscard]] std::string rounding_text(const StorageUse& storage);

/// How the panels that stayed in a file were read, a line; nothing where none did.
[[nodiscard]] std::string stream_text(const StorageUse& storage);

/// Row sums, closure, set-aside patches: the part of the report that `formfactors` prints as well.
[[nodiscard]] nlohmann::ordered_json closure_json(const AssemblyReport& report, const MeshedScene& loaded);
/// Where and with how much work F was assembled.
[[nodiscard]] nlohmann::ordered_json assembly_json(const AssemblyReport& report, const AssemblyUse& use);
[[nodiscard]] std::string closure_text(const AssemblyReport& report);

[[nodiscard]] nlohmann::ordered_json closure_json(const AssemblyReport& report,
                                                  const std::function<std::string(std::uint32_t)>& object_of);

/// Where the form factors are kept and what was done; null without a file. As text: a line, or nothing.
[[nodiscard]] nlohmann::ordered_json kept_json(const Kept& kept);
[[nodiscard]] std::string kept_text(const Kept& kept);
[[nodiscard]] nlohmann::ordered_json error_json(const EstimatedError& error);

/// A device's reason may hold a compiler's log: its first line.
[[nodiscard]] std::string_view first_line(std::string_view text);

/// JSON text of a value: indented, invalid UTF-8 in names replaced, a newline at the end.
[[nodiscard]] std::string dump(const nlohmann::ordered_json& value);

}  // namespace interflect::cli
