#include "bench_machine.h"

#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <fstream>

namespace interflect::cli {

namespace {

std::optional<double> number_in(const std::string& file) {
  std::ifstream stream(file);
  double value = 0;
  if (stream >> value && value > 0) return value;
  return std::nullopt;
}

/// The fastest core's: one that idles says little.
std::optional<double> fastest_core(const std::string& cpuinfo) {
  std::ifstream stream(cpuinfo);
  std::optional<double> fastest;
  for (std::string line; std::getline(stream, line);) {
    const std::size_t colon = line.find(':');
    if (!line.starts_with("cpu MHz") || colon == std::string::npos) continue;
    const double value = std::strtod(line.c_str() + colon + 1, nullptr);
    if (value > 0) fastest = std::max(fastest.value_or(0), value);
  }
  return fastest;
}

}  // namespace

Clock processor_clock(const std::string& root) {
  const std::string frequencies = root + "/sys/devices/system/cpu/cpu0/cpufreq/";
  const auto megahertz = [](std::optional<double> kilohertz) {
    return kilohertz ? std::optional(*kilohertz / 1000) : std::nullopt;
  };
  Clock clock{megahertz(number_in(frequencies + "scaling_cur_freq")),
              megahertz(number_in(frequencies + "cpuinfo_max_freq"))};
  if (!clock.now) clock.now = fastest_core(root + "/proc/cpuinfo");
  return clock;
}

std::vector<double> load_average() {
  std::vector<double> loads(3);
  const int count = ::getloadavg(loads.data(), static_cast<int>(loads.size()));
  loads.resize(static_cast<std::size_t>(std::max(count, 0)));
  return loads;
}

std::vector<std::pair<std::string, std::string>> settings() {
  std::vector<std::pair<std::string, std::string>> found;
  for (char** entry = ::environ; entry != nullptr && *entry != nullptr; ++entry) {
    const std::string text = *entry;
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || !(text.starts_with("INTERFLECT_") || text.starts_with("OMP_"))) continue;
    found.emplace_back(text.substr(0, equals), text.substr(equals + 1));
  }
  std::sort(found.begin(), found.end());
  return found;
}

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  ::gmtime_r(&now, &parts);
  char text[32];
  return {text, std::strftime(text, sizeof(text), "%Y-%m-%dT%H:%M:%SZ", &parts)};
}

}  // namespace interflect::cli
