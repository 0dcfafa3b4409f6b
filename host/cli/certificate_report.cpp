#include "certificate_report.h"

#include <fmt/format.h>

#include <algorithm>

namespace interflect::cli {

using nlohmann::ordered_json;

ordered_json moved_json(const AssemblyReport& report) {
  double worst = 0;
  for (std::size_t i = 0; i < report.row_sum.size(); ++i) worst = std::max(worst, report.row_change(i));
  const std::vector<std::uint32_t> patches = report.moved();
  return {{"count", patches.size()}, {"worst", worst}, {"patches", patches}};
}

ordered_json certificate_json(const Certificate& certificate) {
  if (!certificate.made) return nullptr;
  ordered_json worst = ordered_json::array();
  for (const SuspectRow& row : certificate.worst) {
    worst.push_back({{"patch", row.patch},
                     {"object", row.object},
                     {"group", row.group},
                     {"centroid", {row.centroid.x, row.centroid.y, row.centroid.z}},
                     {"row_sum", row.row_sum},
                     {"deviation", row.deviation},
                     {"error", row.error},
                     {"escape", row.escape},
                     {"back", row.back},
                     {"set_aside", row.set_aside},
                     {"cause", std::string(name(row.cause))},
                     {"other", row.other}});
  }
  return {{"rows", certificate.rows}, {"off", certificate.off}, {"worst", std::move(worst)}};
}

std::string certificate_text(const Certificate& certificate) {
  if (!certificate.made) return "";
  if (certificate.off == 0) return "worst rows     none is off by more than sampling explains\n";
  constexpr std::size_t shown = 5;
  std::string out = fmt::format("worst rows     {} of {} are off by more than sampling explains\n", certificate.off,
                                certificate.rows);
  std::size_t lines = 0;
  for (const SuspectRow& row : certificate.worst) {
    if (row.cause == Cause::sampling || lines++ == shown) break;
    const std::string& surface = row.object.empty() ? row.group : row.object;
    out += fmt::format("               patch {}{} at {:.4g} {:.4g} {:.4g}: {:.5f}, {:+.5f}: {}{}\n", row.patch,
                       surface.empty() ? "" : " of " + surface, row.centroid.x, row.centroid.y, row.centroid.z,
                       row.row_sum, row.deviation, name(row.cause), row.other.empty() ? "" : ", see " + row.other);
  }
  return out;
}

}  // namespace interflect::cli
