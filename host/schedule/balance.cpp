#include "interflect/schedule/balance.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "interflect/base/error.h"

namespace interflect {

namespace {

constexpr std::size_t watched = 5;     // products whose median rate counts
constexpr double far_off = 1.5;        // a first product that shows so much waits for no second one
constexpr double enough = 1.0 - 1e-9;  // of the whole, where rooms add up to it

double sum(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

}  // namespace

Balance::Balance(double total, std::vector<double> room, std::vector<double> weights)
    : total_(std::max(total, 1.0)),
      room_(std::move(room)),
      weights_(std::move(weights)),
      lost_(room_.size()),
      seen_(room_.size()),
      known_(room_.size()) {
  if (!weights_.empty() && weights_.size() != room_.size()) {
    throw Error(ErrorKind::usage, fmt::format("{} shares for {} devices", weights_.size(), room_.size()));
  }
  const bool usable =
      std::all_of(weights_.begin(), weights_.end(), [](double w) { return std::isfinite(w) && w >= 0; });
  if (!weights_.empty() && (!usable || !(sum(weights_) > 0))) {
    throw Error(ErrorKind::usage, "the devices' shares must be numbers, none below 0 and one above");
  }
  learning_ = weights_.empty();
  shares_ = divided(weights_.empty() ? std::vector<double>(room_.size(), 1.0) : weights_);
}

/// The whole in proportion to the rates, but to each device what it has room for at most.
std::vector<double> Balance::divided(std::vector<double> rates) const {
  std::vector<double> shares(rates.size());
  double left = 1.0;
  for (std::size_t k = 0; k < rates.size(); ++k) {
    if (lost_[k]) rates[k] = 0;
  }
  while (left > 1.0 - enough) {
    const double all = sum(rates);
    if (!(all > 0)) {
      throw Error(ErrorKind::limit, fmt::format("the devices have no room for {:.1f} % of the form factors; use fewer "
                                                "patches or more devices",
                                                100 * left));
    }
    double given = 0;
    for (std::size_t k = 0; k < rates.size(); ++k) {
      const double most = room_[k] / total_ - shares[k];
      const double share = std::min(left * rates[k] / all, std::max(0.0, most));
      if (share < left * rates[k] / all) rates[k] = 0;  // full
      shares[k] += share;
      given += share;
    }
    left -= given;
  }
  return shares;
}

/// A rate for each device: of its last products the fastest (quantile 1) or the middle one (0.5); the one known from
/// before where it had no bytes.
std::vector<double> Balance::rates(std::size_t last, double quantile) const {
  std::vector<double> out = known_;
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    if (seen_[k].empty()) continue;
    std::vector<double> values(seen_[k].end() - static_cast<std::ptrdiff_t>(std::min(last, seen_[k].size())),
                               seen_[k].end());
    std::sort(values.begin(), values.end());
    out[k] = values[static_cast<std::size_t>(quantile * static_cast<double>(values.size() - 1))];
  }
  return out;
}

bool Balance::move(const std::vector<double>& rates) {
  std::vector<double> to = divided(rates);
  known_ = rates;
  reference_.clear();
  for (std::vector<double>& values : seen_) values.clear();
  products_ = 0;
  const bool moved = to != shares_;
  shares_ = std::move(to);
  moves_ += moved ? 1 : 0;
  return moved;
}

bool Balance::note(const std::vector<std::uint64_t>& bytes, const std::vector<double>& seconds) {
  for (std::size_t k = 0; k < bytes.size(); ++k) {
    if (lost_[k] || bytes[k] == 0 || !(seconds[k] > 0)) continue;
    seen_[k].push_back(static_cast<double>(bytes[k]) / seconds[k]);
    if (seen_[k].size() > watched) seen_[k].erase(seen_[k].begin());
  }
  ++products_;
  if (!weights_.empty()) return false;
  return learning_ ? learn(bytes) : watch();
}

bool Balance::learn(const std::vector<std::uint64_t>& bytes) {
  const std::vector<double> rate = rates(2, 1.0);
  // F is empty, or a rank has no rows of it: there is nothing to learn from.
  if (std::none_of(rate.begin(), rate.end(), [](double r) { return r > 0; })) return false;
  const std::vector<double> best = divided(rate);
  // Seconds of a product as it is cut now, and as it could be.
  double now = 0, then = 0;
  for (std::size_t k = 0; k < rate.size(); ++k) {
    if (!(rate[k] > 0)) continue;
    now = std::max(now, static_cast<double>(bytes[k]) / rate[k]);
    then = std::max(then, best[k] * total_ / rate[k]);
  }
  if (products_ < 2 && now < far_off * then) return false;  // one product may have been disturbed
  if (now < worth_moving * then || moves_ >= most_moves) {
    learning_ = false;
    known_ = rate;
    return false;
  }
  return move(rate);
}

bool Balance::watch() {
  if (products_ < watched) return false;
  const std::vector<double> rate = rates(watched, 0.5);
  if (reference_.empty()) {
    reference_ = rate;
    return false;
  }
  for (std::size_t k = 0; k < rate.size(); ++k) {
    if (lost_[k] || !(reference_[k] > 0)) continue;
    if (std::abs(rate[k] / reference_[k] - 1.0) > drift) return move(rate);
  }
  return false;
}

void Balance::lose(std::size_t device) {
  lost_.at(device) = true;
  // By what is known of the others, else by what they have, else alike.
  std::vector<double> rate = weights_.empty() ? rates(watched, 0.5) : weights_;
  const auto of_others = [&](const auto& count) {
    std::size_t others = 0;
    for (std::size_t k = 0; k < rate.size(); ++k) others += !lost_[k] && count(rate[k]) ? 1 : 0;
    return others;
  };
  const auto positive = [](double value) { return value > 0; };
  if (weights_.empty() && of_others(positive) < of_others([](double) { return true; })) rate = shares_;
  if (of_others(positive) == 0) rate.assign(rate.size(), 1.0);
  for (std::vector<double>& values : seen_) values.clear();
  reference_.clear();
  products_ = 0;
  shares_ = divided(std::move(rate));
}

std::vector<std::uint32_t> cut(const std::vector<std::uint64_t>& before, const std::vector<double>& shares) {
  const auto units = static_cast<std::uint32_t>(before.size() - 1);
  const auto sharing =
      static_cast<std::uint32_t>(std::count_if(shares.begin(), shares.end(), [](double s) { return s > 0; }));
  std::vector<std::uint32_t> begins{0};
  double wanted = 0;
  std::uint32_t still = sharing;  // devices that are to get a unit, with this one
  for (const double share : shares) {
    const std::uint32_t from = begins.back();
    wanted += share;
    if (!(share > 0)) {
      begins.push_back(from);
      continue;
    }
    --still;
    const double bytes = wanted * static_cast<double>(before.back());
    const auto at = std::lower_bound(before.begin(), before.end(), static_cast<std::uint64_t>(std::llround(bytes)));
    auto end = static_cast<std::uint32_t>(std::min<std::ptrdiff_t>(at - before.begin(), units));
    // The nearer of the two places between which it lies.
    if (end > 0 && bytes - static_cast<double>(before[end - 1]) < static_cast<double>(before[end]) - bytes) --end;
    if (still == 0) end = units;
    const std::uint32_t least = units >= sharing ? from + 1 : from;
    const std::uint32_t most = units >= sharing ? units - still : units;
    begins.push_back(std::clamp(end, std::min(least, most), most));
  }
  return begins;
}

}  // namespace interflect
