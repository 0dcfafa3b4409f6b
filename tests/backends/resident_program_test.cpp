// --assembly of solve and formfactors: where F is assembled, what the report says of it, and that the light is the
// same.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "backends/devices.h"
#include "cli/program.h"
#include "device/kernel_folder.h"

namespace interflect::test {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

struct SolveRun {
  Outcome outcome;
  json report;
  std::vector<double> light;  ///< b_r of every patch
};

/// A solve of the Cornell box.
SolveRun solve(const std::vector<std::string>& options) {
  const Folder folder;
  const std::string csv = folder.file("out.csv"), report = folder.file("out.json");
  std::vector<std::string> arguments = {
      "solve", scene_file("cornell-box.obj"), "--patches", "400", "-o", csv, "--report", report};
  arguments.insert(arguments.end(), options.begin(), options.end());
  SolveRun run{run_program(arguments), {}, {}};
  EXPECT_EQ(run.outcome.status, 0) << run.outcome.err;
  if (run.outcome.status != 0) return run;
  run.report = json::parse(content_of(report));
  std::istringstream lines(content_of(csv));
  std::string line;
  for (std::getline(lines, line); std::getline(lines, line);) {
    std::vector<std::string> cells;
    std::istringstream row(line);
    for (std::string cell; std::getline(row, cell, ',');) cells.push_back(cell);
    run.light.push_back(std::stod(cells.at(cells.size() - 4)));  // b_r, b_g, b_b, row_sum
  }
  return run;
}

double difference(const std::vector<double>& a, const std::vector<double>& b) {
  EXPECT_EQ(a.size(), b.size());
  double largest = 0, off = 0;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    largest = std::max(largest, std::abs(b[i]));
    off = std::max(off, std::abs(a[i] - b[i]));
  }
  return off / largest;
}

TEST(AssemblyOption, OnTheDeviceTheLightIsTheSameAndFStaysThere) {
  const SolveRun host = solve({"--device", "openmp"});
  EXPECT_EQ(host.report.at("assembly").at("device"), "host");
  EXPECT_EQ(host.report.at("assembly").at("bytes_over_bus"), 0);
  for (const char* id : {"opencl:0", "vulkan:0"}) {
    if (!why_unavailable(id).empty()) continue;
    const SolveRun there = solve({"--device", id, "--assembly", "device"});
    EXPECT_EQ(there.report.at("assembly").at("device"), id);
    EXPECT_EQ(there.report.at("assembly").at("bytes_over_bus"), 0);
    EXPECT_EQ(there.report.at("devices"), json::array({id}));
    EXPECT_LT(there.report.at("energy").at("balance_error"), 2e-6);
    EXPECT_GT(there.report.at("storage").at("nonzero_fraction"), 0.1);
    EXPECT_LT(difference(there.light, host.light), 1e-3);
    EXPECT_THAT(there.outcome.out, HasSubstr(std::string(" s on ") + id));
    // An emulated device is slower than Embree: by default the host assembles for it, and F goes over.
    const SolveRun automatic = solve({"--device", id});
    EXPECT_EQ(automatic.report.at("assembly").at("device"), "host");
    EXPECT_LT(difference(automatic.light, host.light), 5e-6);
  }
}

TEST(AssemblyOption, ASixteenBitFormatIsPackedOfWhatTheDeviceMade) {
  if (const std::string why = why_unavailable("opencl:0"); !why.empty()) GTEST_SKIP() << why;
  const SolveRun host = solve({"--device", "openmp"});
  const SolveRun packed = solve({"--device", "opencl:0", "--assembly", "device", "--storage", "tiled16"});
  EXPECT_EQ(packed.report.at("assembly").at("device"), "opencl:0");
  EXPECT_GT(packed.report.at("assembly").at("bytes_over_bus"), 400 * 400 * 2);
  EXPECT_EQ(packed.report.at("storage").at("format"), "tiled16");
  EXPECT_LT(difference(packed.light, host.light), 1e-3);
  EXPECT_THAT(packed.outcome.err, HasSubstr("the form factors came from opencl:0"));
}

TEST(AssemblyOption, OfFormfactorsMakesTheSameTable) {
  if (const std::string why = why_unavailable("opencl:0"); !why.empty()) GTEST_SKIP() << why;
  const auto table = [](const std::vector<std::string>& options) {
    std::vector<std::string> arguments = {"formfactors", scene_file("cornell-box.obj"), "--patches", "400", "--json"};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const Outcome outcome = run_program(arguments);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return json::parse(outcome.out);
  };
  const json host = table({"--between"}), there = table({"--between", "--device", "opencl:0", "--assembly", "device"});
  ASSERT_EQ(host.at("groups"), there.at("groups"));
  for (std::size_t a = 0; a < host.at("factors").size(); ++a) {
    for (std::size_t b = 0; b < host.at("factors").size(); ++b) {
      EXPECT_NEAR(there.at("factors")[a][b].get<double>(), host.at("factors")[a][b].get<double>(), 1e-3);
    }
  }
  EXPECT_EQ(table({"--device", "opencl:0", "--assembly", "device"}).at("assembly").at("device"), "opencl:0");
  EXPECT_EQ(table({"--device", "opencl:0"}).at("assembly").at("device"), "host");
}

/// --memory holds for F on a device as well, and is looked at before any work.
TEST(AssemblyOption, WhatExceedsTheMemoryAskedForDoesNotStayOnTheDevice) {
  if (const std::string why = why_unavailable("opencl:0"); !why.empty()) GTEST_SKIP() << why;
  const auto with = [](const std::string& memory) {
    return run_program({"solve", scene_file("cornell-box.obj"), "--patches", "400", "--device", "opencl:0",
                        "--assembly", "device", "--memory", memory});
  };
  const Outcome small = with("100K");  // F takes 400 x 400 x 4 = 625 KiB or so
  EXPECT_EQ(small.status, 6) << small.err;
  EXPECT_THAT(small.error_lines(), testing::ElementsAre(testing::AllOf(HasSubstr("--memory allows 100K"),
                                                                       HasSubstr("--form-factors FILE.iff"))));
  EXPECT_THAT(small.out, testing::IsEmpty());
  EXPECT_EQ(with("much").status, 2);
  const Outcome enough = with("4M");
  EXPECT_EQ(enough.status, 0) << enough.err;
  EXPECT_THAT(enough.out, HasSubstr(" s on opencl:0"));
}

TEST(AssemblyOption, AWrongOneIsAUsageError) {
  const Outcome outcome = run_program({"solve", scene_file("cornell-box.obj"), "--assembly", "moon"});
  EXPECT_EQ(outcome.status, 2);
  EXPECT_THAT(outcome.err, HasSubstr("--assembly"));
}

/// Rows of `bench --assembly`, of a small scene: Embree's and a device's.
json assembly_rows(const std::vector<std::string>& environment, int status) {
  const Folder folder;
  const Outcome outcome =
      run_program({"bench", "--assembly", "--device", "openmp,opencl:0", "--scene", scene_file("furnace.obj"),
                   "--repetitions", "1", "--json", folder.file("b.json")},
                  environment);
  EXPECT_EQ(outcome.status, status) << outcome.out << outcome.err;
  return json::parse(content_of(folder.file("b.json"))).at("rows");
}

TEST(BenchAssembly, HoldsADeviceAgainstTheEmbreePath) {
  if (const std::string why = why_unavailable("opencl:0"); !why.empty()) GTEST_SKIP() << why;
  const json rows = assembly_rows({}, 0);
  ASSERT_EQ(rows.size(), 2U);
  for (const json& row : rows) {
    EXPECT_EQ(row.at("what"), "assembly");
    EXPECT_EQ(row.at("scene"), "furnace");
    EXPECT_EQ(row.at("status"), "pass") << row.dump();
    EXPECT_GT(row.at("seconds").get<double>(), 0);
  }
  EXPECT_TRUE(rows.at(1).at("embree_ratio").is_number());
  EXPECT_TRUE(rows.at(0).at("embree_ratio").is_null());
}

/// The twin: a kernel that forgets the mirrored half makes other row sums.
TEST(BenchAssembly, SeesAWrongAssembly) {
  if (const std::string why = why_unavailable("opencl:0"); !why.empty()) GTEST_SKIP() << why;
  KernelFolder kernels;
  kernels.replace("shared/tile_store.h", "PANEL_AT(row_j, i) = s;", "PANEL_AT(row_j, i) = 0.0f;");
  const json rows = assembly_rows({"INTERFLECT_KERNEL_DIR=" + kernels.path().string()}, 4);
  ASSERT_EQ(rows.size(), 2U);
  EXPECT_EQ(rows.at(0).at("status"), "pass");
  EXPECT_EQ(rows.at(1).at("status"), "fail");
  EXPECT_EQ(rows.at(1).at("reason"), "row sums differ");
}

}  // namespace
}  // namespace interflect::test
