// Devices as a user meets them: the list, the benchmark over several, a solve whose device fails.
#include "cli/program.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

namespace interflect::test {
namespace {

using nlohmann::json;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

json listed() {
  const Outcome outcome = run_program({"devices", "--json"});
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  return json::parse(outcome.out);
}

const json& record_of(const json& devices, const std::string& id) {
  const auto found = std::find_if(devices.begin(), devices.end(), [&](const json& d) { return d.at("id") == id; });
  if (found == devices.end()) throw std::runtime_error("no device " + id);
  return *found;
}

/// The ids of devices that run kernels compiled at run time; empty where the machine has none.
std::vector<std::string> compiled_devices(const json& devices) {
  std::vector<std::string> ids;
  for (const json& device : devices) {
    if (device.at("backend") != "openmp" && device.at("available")) ids.push_back(device.at("id"));
  }
  return ids;
}

TEST(Devices, OpenMPIsThereAndPassesItsSelftest) {
  const Folder folder;
  const Outcome outcome = run_program({"devices", "--json", "--selftest"});
  ASSERT_EQ(outcome.status, 0) << outcome.err << outcome.out;
  const json device = record_of(json::parse(outcome.out), "openmp");
  EXPECT_EQ(device.at("type"), "cpu");
  EXPECT_FALSE(device.at("emulated").get<bool>());
  EXPECT_TRUE(device.at("available").get<bool>());
  EXPECT_EQ(device.at("selftest"), "PASS");
  EXPECT_GT(device.at("read_gb_per_s").get<double>(), 0);
  EXPECT_EQ(device.at("read_reason"), "");
  EXPECT_GT(device.at("memory_bytes").get<std::uint64_t>(), 0U);
  EXPECT_FALSE(device.at("driver").get<std::string>().empty());
}

TEST(Devices, EveryRecordIsWhole) {
  const Folder folder;
  const json devices = listed();
  std::set<std::string> ids;
  for (const json& device : devices) {
    const std::string id = device.at("id");
    EXPECT_TRUE(ids.insert(id).second) << id << " twice";
    if (device.at("available")) {
      EXPECT_TRUE(device.at("read_gb_per_s").is_number()) << device.dump();
      EXPECT_EQ(device.at("reason"), "") << id;
    } else {
      EXPECT_FALSE(device.at("reason").get<std::string>().empty()) << id;
      EXPECT_TRUE(device.at("read_gb_per_s").is_null()) << id;
      EXPECT_FALSE(device.at("read_reason").get<std::string>().empty()) << id;
    }
    EXPECT_TRUE(device.at("selftest").is_null()) << id;
    for (const json& other : device.at("same_device_as")) {
      const json& twin = record_of(devices, other);
      EXPECT_EQ(twin.at("hardware"), device.at("hardware"));
      EXPECT_THAT(twin.at("same_device_as").get<std::vector<std::string>>(), Contains(id));
    }
  }
}

TEST(Devices, TheTextNamesEveryIdOnce) {
  const Folder folder;
  const Outcome outcome = run_program({"devices"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  std::vector<std::string> shown, expected;
  std::istringstream lines(outcome.out);
  for (std::string line; std::getline(lines, line);) {
    if (line.size() > 2 && line.starts_with("  ") && line[2] != ' ')
      shown.push_back(line.substr(2, line.find(' ', 2) - 2));
  }
  for (const json& device : listed()) expected.push_back(device.at("id"));
  EXPECT_THAT(shown, ::testing::UnorderedElementsAreArray(expected)) << outcome.out;
}

std::vector<std::string> cells(const std::string& line) {
  std::vector<std::string> out(1);
  bool quoted = false;
  for (const char c : line) {
    if (c == '"') quoted = !quoted;
    if (c == ',' && !quoted) {
      out.emplace_back();
    } else {
      out.back() += c;
    }
  }
  return out;
}

TEST(Bench, EveryDeviceHasEveryRowInOneRun) {
  const Folder folder;
  std::vector<std::string> ids{"openmp"};
  for (const std::string& id : compiled_devices(listed())) ids.push_back(id);
  std::string list;
  for (const std::string& id : ids) list += (list.empty() ? "" : ",") + id;
  const Outcome outcome =
      run_program({"bench", "--device", list, "--room", "1312", "--storage", "dense32", "--repetitions", "2", "--json",
                   folder.file("b.json"), "--csv", folder.file("b.csv"), "--quiet"});
  ASSERT_EQ(outcome.status, 0) << outcome.err << outcome.out;
  const json bench = json::parse(content_of(folder.file("b.json")));
  EXPECT_EQ(bench.at("header").at("devices").size(), ids.size());
  const json& rows = bench.at("rows");
  for (const std::string& id : ids) {
    std::vector<std::string> found;
    for (const json& row : rows) {
      if (row.at("device") == id)
        found.push_back(row.at("scene").get<std::string>() + ":" + row.at("what").get<std::string>());
    }
    std::vector<std::string> expected{
        ":read",          ":copy",          ":launch",         ":launch+wait", ":dot",
        ":axpby",         ":bounce",        ":cg_product",     ":cg_step",     ":bicgstab_product",
        ":bicgstab_half", ":bicgstab_step", "room-1312:upload"};
    if (id != "openmp") expected.emplace_back("room-1312:compile");  // it has no compiler
    for (const char* what : {"read", "matvec", "solve:cg", "solve:bicgstab", "solve:jacobi"}) {
      expected.push_back(std::string("room-1312:") + what);
    }
    EXPECT_EQ(found, expected);
  }
  for (const json& row : rows) {
    EXPECT_EQ(row.at("status"), "pass") << row.dump();
    EXPECT_LE(row.at("error").get<double>(), row.at("bound").get<double>()) << row.dump();
    EXPECT_GT(row.at("seconds").get<double>(), 0) << row.dump();
    const bool matvec = row.at("what") == "matvec", solve = row.at("what").get<std::string>().starts_with("solve:");
    EXPECT_EQ(row.at("launch_share").is_number(), solve) << row.dump();
    if (solve) {  // a product and what goes with it, each iteration, and no more than a handful of launches
      EXPECT_GE(row.at("launches"), row.at("products")) << row.dump();
      EXPECT_LE(row.at("launches"), 5 * row.at("products").get<int>() + 10) << row.dump();
    }
    EXPECT_EQ(row.at("a_ratio").get<double>() > 0, matvec) << row.dump();
    if (row.at("device") == "openmp") {
      EXPECT_EQ(row.at("machine_ratio").is_number(), matvec || (row.at("what") == "read" && row.at("n") != 0));
    }
  }
  std::istringstream csv(content_of(folder.file("b.csv")));
  std::string line;
  std::getline(csv, line);
  const std::size_t columns = cells(line).size();
  std::size_t count = 0;
  for (; std::getline(csv, line); ++count) EXPECT_EQ(cells(line).size(), columns) << line;
  EXPECT_EQ(count, rows.size());
}

/// The source tree's kernels with a `matvec` that no compiler takes.
void write_broken_kernels(const std::string& folder) {
  std::filesystem::copy(std::string(INTERFLECT_SOURCE_DIR) + "/kernels", folder,
                        std::filesystem::copy_options::recursive);
  for (const char* name : {"cl/matvec.cl", "glsl/matvec.comp", "cuda/matvec.cu"}) {
    if (std::filesystem::exists(folder + "/" + name)) std::ofstream(folder + "/" + name) << "this is no kernel\n";
  }
}

TEST(SolveFallback, GoesOnWithTheNextDeviceAndSaysSo) {
  const Folder folder;
  const std::vector<std::string> ids = compiled_devices(listed());
  if (ids.empty()) GTEST_SKIP() << "this machine has only OpenMP";
  write_broken_kernels(folder.file("kernels"));
  std::vector<std::string> environment;
  environment.push_back("INTERFLECT_KERNEL_DIR=" + folder.file("kernels"));
  for (const std::string& id : ids) {
    const std::vector<std::string> solve{"solve", scene_file("furnace.obj"), "--divide", "0.1", "--device"};
    std::vector<std::string> alone = solve, behind = solve;
    alone.push_back(id);
    behind.insert(behind.end(), {id + ",openmp", "--report", folder.file("r.json")});

    const Outcome error = run_program(alone, environment);
    EXPECT_EQ(error.status, 4) << id;
    EXPECT_THAT(error.error_lines(), ElementsAre(HasSubstr(id + ": "))) << error.err;

    const Outcome outcome = run_program(behind, environment);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr("; going on with openmp"));
    EXPECT_THAT(outcome.out, HasSubstr("failed         " + id + ": "));
    const json report = json::parse(content_of(folder.file("r.json")));
    EXPECT_TRUE(report.at("converged").get<bool>());
    EXPECT_EQ(report.at("devices"), json::array({"openmp"}));
    ASSERT_EQ(report.at("failures").size(), 1U);
    EXPECT_EQ(report.at("failures").at(0).at("device"), id);
    EXPECT_THAT(report.at("failures").at(0).at("reason").get<std::string>(), HasSubstr("matvec"));
  }
}

TEST(SolveTogether, UsesAllDevicesAndSaysWhatEachDid) {
  const Folder folder;
  std::vector<std::string> ids = compiled_devices(listed());
  ids.emplace_back("openmp");
  std::string list;
  for (const std::string& id : ids) list += (list.empty() ? "" : ",") + id;
  const Outcome outcome = run_program(
      {"solve", scene_file("furnace.obj"), "--divide", "0.1", "--device", list, "--report", folder.file("r.json")});
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_EQ(outcome.err, "");
  const json report = json::parse(content_of(folder.file("r.json")));
  EXPECT_EQ(report.at("devices"), json(ids));
  if (ids.size() > 1) {
    ASSERT_EQ(report.at("shares").size(), ids.size());
    double shares = 0;
    for (std::size_t k = 0; k < ids.size(); ++k) {
      EXPECT_EQ(report.at("shares").at(k).at("device"), ids[k]);
      EXPECT_GT(report.at("shares").at(k).at("bytes_per_second").get<double>(), 0);
      shares += report.at("shares").at(k).at("share").get<double>();
    }
    EXPECT_NEAR(shares, 1, 1e-9);
    EXPECT_THAT(outcome.out, HasSubstr("\nshares "));
  }
  EXPECT_THAT(report.at("failures"), IsEmpty());
  const bool compiled =
      report.at("kernels").at("compiled").get<int>() + report.at("kernels").at("from_cache").get<int>() > 0;
  EXPECT_EQ(compiled, ids.size() > 1);
  EXPECT_EQ(outcome.out.find("\nkernels ") != std::string::npos, compiled);
}

}  // namespace
}  // namespace interflect::test
