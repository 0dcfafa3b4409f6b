// What `bench` says of the machine, the build and the run.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cctype>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>

#include "bench_machine.h"
#include "program.h"

namespace interflect::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Json = nlohmann::ordered_json;

void write_below(const Folder& folder, const std::string& name, const std::string& content) {
  std::filesystem::create_directories(std::filesystem::path(folder.file(name)).parent_path());
  static_cast<void>(folder.write(name, content));
}

TEST(BenchMachine, TheClockIsCpufreqsOrTheFastestCores) {
  const Folder none, cores, both;
  EXPECT_FALSE(cli::processor_clock(none.file("")).now);
  EXPECT_FALSE(cli::processor_clock(none.file("")).most);
  const std::string cpuinfo = "model name\t: X\ncpu MHz\t\t: 1800.500\ncpu MHz\t\t: 2600.250\nbogomips\t: 5000\n";
  write_below(cores, "proc/cpuinfo", cpuinfo);
  EXPECT_EQ(cli::processor_clock(cores.file("")).now, 2600.25);
  EXPECT_FALSE(cli::processor_clock(cores.file("")).most);
  write_below(both, "proc/cpuinfo", cpuinfo);
  write_below(both, "sys/devices/system/cpu/cpu0/cpufreq/scaling_cur_freq", "2100000\n");
  write_below(both, "sys/devices/system/cpu/cpu0/cpufreq/cpuinfo_max_freq", "3900000\n");
  EXPECT_EQ(cli::processor_clock(both.file("")).now, 2100.0);
  EXPECT_EQ(cli::processor_clock(both.file("")).most, 3900.0);
  write_below(both, "sys/devices/system/cpu/cpu0/cpufreq/scaling_cur_freq", "unknown\n");
  EXPECT_EQ(cli::processor_clock(both.file("")).now, 2600.25);
}

TEST(BenchHeader, SaysWhatWasMeasuredWithWhatAndRowsThatDoNotFitSayWhy) {
  const Folder folder;
  const Outcome outcome =
      run_program({"bench", "--device", "openmp", "--growth", "--growth-max", "2000", "--repetitions", "2", "--scenes",
                   scene_file(""), "--storage", "dense32,sym16", "--json", folder.file("b.json"), "--quiet"},
                  {"INTERFLECT_MEMORY=1M", "INTERFLECT_CACHE=off", "OMP_NUM_THREADS=1"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  const Json run = Json::parse(content_of(folder.file("b.json")));
  const Json& header = run.at("header");
  EXPECT_EQ("interflect " + header.at("interflect").get<std::string>() + "\n", run_program({"--version"}).out);
  EXPECT_TRUE(std::regex_match(header.at("date").get<std::string>(),
                               std::regex("20\\d\\d-\\d\\d-\\d\\dT\\d\\d:\\d\\d:\\d\\dZ")));
  EXPECT_TRUE(std::regex_match(header.at("commit").get<std::string>(), std::regex("([0-9a-f]{40}(-dirty)?)?")));
  EXPECT_TRUE(std::regex_match(header.at("compiler").get<std::string>(), std::regex("(GCC|Clang) \\d+\\.\\d+\\.\\d+")));
  const Json& settings = header.at("settings");  // there may be more in the environment of the tests
  for (const auto& [name, value] : {std::pair("INTERFLECT_CACHE", "off"), std::pair("INTERFLECT_MEMORY", "1M"),
                                    std::pair("INTERFLECT_TUNING", "off"), std::pair("OMP_NUM_THREADS", "1")}) {
    EXPECT_EQ(settings.at(name), value);
  }
  EXPECT_EQ(header.at("omp_threads"), 1);
  EXPECT_EQ(header.at("repetitions"), 2);
  EXPECT_EQ(header.at("load_average").size(), 3U);
  EXPECT_EQ(header.at("available_memory_bytes"), 1 << 20);
  EXPECT_GE(header.at("spread").at("largest"), header.at("spread").at("median"));
  ASSERT_EQ(header.at("devices").size(), 1U);
  const Json& device = header.at("devices").at(0);
  EXPECT_EQ(device.at("id"), "openmp");
  for (const char* field : {"name", "driver", "compute_units", "clock_mhz", "max_clock_mhz", "memory_bytes"}) {
    EXPECT_TRUE(device.contains(field)) << field;
  }
  EXPECT_THAT(outcome.out, HasSubstr("INTERFLECT_MEMORY=1M"));
  EXPECT_THAT(outcome.out, HasSubstr("spread of the repetitions"));

  std::vector<std::string> refused;
  for (const Json& row : run.at("rows")) {
    if (row.at("what") != "growth") {
      EXPECT_EQ(row.at("status"), "pass") << row.dump();
      EXPECT_EQ(row.at("repetitions"), 2) << row.dump();
      continue;
    }
    EXPECT_EQ(row.at("status"), "unsupported") << row.dump();
    EXPECT_THAT(row.at("reason").get<std::string>(), HasSubstr("may be used"));
    EXPECT_EQ(row.at("seconds"), 0);
    refused.push_back(row.at("storage"));
  }
  EXPECT_THAT(refused, ElementsAre("dense32", "sym16", "dense32", "sym16"));
  EXPECT_FALSE(run.contains("growth"));
}

}  // namespace
}  // namespace interflect::test
