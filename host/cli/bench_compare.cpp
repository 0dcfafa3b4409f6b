#include "bench_compare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

namespace interflect::cli {

namespace {

using Key = std::tuple<std::string, std::string, std::string, std::string, std::uint32_t, std::uint32_t>;

Key key_of(const BenchRow& row) {
  return {row.device, row.what, row.scene, row.storage, row.n, row.columns};
}

bool judgeable(const BenchRow& row) {
  return row.status == "pass" && row.seconds > 0 && row.repetitions >= 2;
}

std::string time_of(const BenchRow* row) {
  if (row == nullptr) return "-";
  return row->status == "pass" ? fmt::format("{:.7f}", row->seconds) : row->status;
}

}  // namespace

std::string_view name(Change change) {
  switch (change) {
    case Change::same: return "same";
    case Change::slower: return "SLOWER";
    case Change::faster: return "faster";
    case Change::only_old: return "only in the old file";
    case Change::only_new: return "new";
    case Change::not_judged: break;
  }
  return "not judged";
}

double Compared::ratio() const {
  const bool both = before != nullptr && after != nullptr && before->seconds > 0;
  return both ? after->seconds / before->seconds : 0;
}

Change judge(const BenchRow& before, const BenchRow& after) {
  if (!judgeable(before) || !judgeable(after)) return Change::not_judged;
  const double noise = std::max(before.seconds_iqr + after.seconds_iqr, least_change * before.seconds);
  const double difference = after.seconds - before.seconds;
  if (difference > noise) return Change::slower;
  return difference < -noise ? Change::faster : Change::same;
}

std::vector<Compared> compare(const std::vector<BenchRow>& before, const std::vector<BenchRow>& after) {
  std::multimap<Key, const BenchRow*> old;  // equal keys keep their order: the first is the partner of the first
  for (const BenchRow& row : before) old.emplace(key_of(row), &row);
  std::vector<Compared> rows;
  for (const BenchRow& row : after) {
    const auto found = old.lower_bound(key_of(row));
    if (found == old.end() || found->first != key_of(row)) {
      rows.push_back({nullptr, &row, Change::only_new});
      continue;
    }
    rows.push_back({found->second, &row, judge(*found->second, row)});
    old.erase(found);
  }
  for (const BenchRow& row : before) {
    const auto [first, last] = old.equal_range(key_of(row));
    if (std::any_of(first, last, [&](const auto& entry) { return entry.second == &row; })) {
      rows.push_back({&row, nullptr, Change::only_old});
    }
  }
  return rows;
}

std::string compare_text(const std::vector<Compared>& rows) {
  std::string out = fmt::format("{:<10} {:<19} {:<11} {:<8} {:>7} {:>4} {:>12} {:>12} {:>6}  {}\n", "device", "what",
                                "scene", "storage", "n", "cols", "old", "new", "ratio", "");
  std::map<Change, unsigned> counts;
  for (const Compared& one : rows) {
    const BenchRow& row = one.after != nullptr ? *one.after : *one.before;
    ++counts[one.change];
    out += fmt::format("{:<10} {:<19} {:<11} {:<8} {:>7} {:>4} {:>12} {:>12} {:>6}  {}\n", row.device, row.what,
                       row.scene, row.storage, row.n, row.columns, time_of(one.before), time_of(one.after),
                       one.ratio() > 0 ? fmt::format("{:.3f}", one.ratio()) : "", name(one.change));
  }
  return out + fmt::format("{} slower, {} faster, {} the same, {} not judged, {} new, {} only in the old file\n",
                           counts[Change::slower], counts[Change::faster], counts[Change::same],
                           counts[Change::not_judged], counts[Change::only_new], counts[Change::only_old]);
}

nlohmann::ordered_json compare_json(const std::vector<Compared>& rows) {
  auto out = nlohmann::ordered_json::array();
  const auto seconds = [](const BenchRow* row) {
    return row == nullptr ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(row->seconds);
  };
  for (const Compared& one : rows) {
    const BenchRow& row = one.after != nullptr ? *one.after : *one.before;
    out.push_back({{"device", row.device},
                   {"what", row.what},
                   {"scene", row.scene},
                   {"storage", row.storage},
                   {"n", row.n},
                   {"columns", row.columns},
                   {"old_seconds", seconds(one.before)},
                   {"new_seconds", seconds(one.after)},
                   {"ratio", one.ratio()},
                   {"change", std::string(name(one.change))}});
  }
  return out;
}

}  // namespace interflect::cli
