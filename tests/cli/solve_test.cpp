// The main job through the program: known answers, the report's fields, every output, the exit statuses.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <sstream>

#include "program.h"

namespace interflect::test {
namespace {

using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

json report_of(const std::vector<std::string>& arguments, int status = 0) {
  const Folder folder;
  std::vector<std::string> all{"solve"};
  all.insert(all.end(), arguments.begin(), arguments.end());
  all.insert(all.end(), {"--report", folder.file("report.json")});
  const Outcome outcome = run_program(all);
  EXPECT_EQ(outcome.status, status) << outcome.err;
  return json::parse(content_of(folder.file("report.json")));
}

/// The float32 values behind the header of a .npy file of version 1.0.
std::vector<float> npy_values(const std::string& content) {
  const std::size_t header =
      static_cast<unsigned char>(content.at(8)) + 256U * static_cast<unsigned char>(content.at(9));
  std::vector<float> values((content.size() - 10 - header) / sizeof(float));
  std::memcpy(values.data(), content.data() + 10 + header, values.size() * sizeof(float));
  return values;
}

std::vector<float> radiosities(std::vector<std::string> arguments, const std::vector<std::string>& environment = {}) {
  const Folder folder;
  arguments.insert(arguments.begin(), "solve");
  arguments.insert(arguments.end(), {"-o", folder.file("b.npy")});
  const Outcome outcome = run_program(arguments, environment);
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  return npy_values(content_of(folder.file("b.npy")));
}

TEST(Solve, TheFurnaceIsUniform) {
  const Folder folder;
  const Outcome outcome = run_program(
      {"solve", scene_file("furnace.obj"), "--divide", "0.02", "-o", folder.file("b.csv"), "--tol", "1e-6"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  std::istringstream csv(content_of(folder.file("b.csv")));
  std::string line;
  std::getline(csv, line);
  EXPECT_EQ(line, "index,group,area,cx,cy,cz,nx,ny,nz,rho_r,rho_g,rho_b,e_r,e_g,e_b,b_r,b_g,b_b,row_sum");
  int patches = 0;
  while (std::getline(csv, line)) {
    std::vector<double> numbers;
    std::istringstream cells(line);
    for (std::string cell; std::getline(cells, cell, ',');) {
      numbers.push_back(numbers.size() == 1 ? 0.0 : std::stod(cell));  // the second column is the group's name
    }
    ASSERT_EQ(numbers.size(), 19U);
    EXPECT_EQ(numbers[0], patches++);
    for (std::size_t c = 0; c < 3; ++c) {
      const double expected = numbers[12 + c] / (1 - numbers[9 + c]);
      EXPECT_NEAR(numbers[15 + c] / expected, 1, 1e-4);
    }
    EXPECT_NEAR(numbers[18], 1, 1e-4);
  }
  EXPECT_EQ(patches, 768);
}

TEST(Solve, TheReportHasWhatOtherProgramsRead) {
  const json report = report_of({scene_file("cornell-box.obj"), "--patches", "600", "--device", "openmp"});
  for (const char* key : {"scene", "patches", "method", "tolerance", "converged", "iterations", "products",
                          "relative_residual", "devices", "storage", "seconds", "closure", "energy"}) {
    EXPECT_TRUE(report.contains(key)) << key;
  }
  for (const char* key : {"read", "mesh", "form_factors", "upload", "compile", "solve", "estimate", "write", "total"}) {
    EXPECT_GE(report.at("seconds").at(key).get<double>(), 0) << key;
  }
  EXPECT_EQ(report.at("relative_residual").size(), 3U);
  for (const double residual : report.at("relative_residual")) EXPECT_LE(residual, 1e-6);
  EXPECT_EQ(report.at("devices"), json::array({"openmp"}));
  EXPECT_EQ(report.at("failures"), json::array());
  EXPECT_EQ(report.at("kernels"), json({{"compiled", 0}, {"from_cache", 0}}));  // OpenMP's come with the program
  EXPECT_EQ(report.at("storage").at("format"), "dense32");
  EXPECT_GT(report.at("storage").at("nonzero_fraction").get<double>(), 0.1);
  EXPECT_GT(report.at("energy").at("escaped").get<double>(), 0);  // the box is open in front
  EXPECT_LT(report.at("energy").at("balance_error").get<double>(), 1e-5);
  EXPECT_LE(report.at("closure").at("max").get<double>(), 1.0001);
  EXPECT_FALSE(report.at("closure").at("closed_scene").get<bool>());
}

TEST(Solve, TheReportHasTheInputChecksWarnings) {
  const Folder folder;
  const std::string scene = folder.write("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 3\n");
  const json report = report_of({scene, "--divide", "1", "--quiet"});
  EXPECT_THAT(report.at("warnings").dump(),
              ::testing::AllOf(HasSubstr("no surface emits"), HasSubstr("duplicate triangles: 1, first: line 5")));
}

TEST(Solve, EnergyBalancesInAClosedRoom) {
  const json report = report_of({scene_file("room-1312.obj"), "--divide", "1"});
  EXPECT_TRUE(report.at("closure").at("closed_scene").get<bool>());
  EXPECT_TRUE(report.at("closure").at("applied").get<bool>());
  EXPECT_NEAR(report.at("closure").at("min").get<double>(), 1, 1e-4);
  EXPECT_NEAR(report.at("closure").at("max").get<double>(), 1, 1e-4);
  const json& energy = report.at("energy");
  EXPECT_NEAR(energy.at("absorbed").get<double>() / energy.at("emitted").get<double>(), 1, 1e-3);
}

TEST(Solve, TheMethodsAgree) {
  const std::vector<std::string> scene{scene_file("cornell-box.obj"), "--patches", "600", "--method"};
  std::vector<std::vector<float>> results;
  for (const char* method : {"cg", "bicgstab", "jacobi"}) {
    auto arguments = scene;
    arguments.emplace_back(method);
    results.push_back(radiosities(arguments));
  }
  const float largest = *std::max_element(results[0].begin(), results[0].end());
  for (const auto& result : {results[1], results[2]}) {
    ASSERT_EQ(result.size(), results[0].size());
    for (std::size_t k = 0; k < result.size(); ++k) ASSERT_NEAR(result[k], results[0][k], 1e-5F * largest) << k;
  }
}

TEST(Solve, TheSameBitsWhateverTheThreads) {
  const std::vector<std::string> scene{scene_file("cornell-box.obj"), "--patches", "600"};
  const auto one = radiosities(scene, {"OMP_NUM_THREADS=1"});
  EXPECT_EQ(one, radiosities(scene, {"OMP_NUM_THREADS=3"}));
  EXPECT_EQ(one, radiosities(scene, {"INTERFLECT_MAX_PANEL_BYTES=20000"}));
}

TEST(Solve, AFixedNumberOfIterationsIsCounted) {
  const json report =
      report_of({scene_file("furnace.obj"), "--divide", "0.1", "--method", "jacobi", "--iterations", "7"});
  EXPECT_EQ(report.at("iterations"), 7);
  EXPECT_FALSE(report.at("converged").get<bool>());
}

TEST(Solve, UnconvergedIsSaidAndStillWritten) {
  const Folder folder;
  const Outcome outcome =
      run_program({"solve", scene_file("furnace.obj"), "--divide", "0.1", "--method", "jacobi", "--max-iterations", "3",
                   "-o", folder.file("b.ply"), "-o", folder.file("r.json")});
  EXPECT_EQ(outcome.status, 5);
  EXPECT_THAT(outcome.err, HasSubstr("not converged"));
  EXPECT_THAT(folder.names(), ElementsAre("b.ply", "r.json"));
  const json report = json::parse(content_of(folder.file("r.json")));
  EXPECT_FALSE(report.at("converged").get<bool>());
  EXPECT_THAT(report.at("reason").get<std::string>(), HasSubstr("limit of 3 iterations"));
}

TEST(Solve, WritesEveryFormatWhole) {
  const Folder folder;
  std::vector<std::string> arguments{"solve", scene_file("cornell-box.obj"), "--patches", "300", "--size", "64x48"};
  const std::vector<std::string> names{"a.csv", "a.exr", "a.glb", "a.json", "a.npy", "a.ply", "a.png"};
  for (const std::string& name : names) arguments.insert(arguments.end(), {"-o", folder.file(name)});
  const Outcome outcome = run_program(arguments);
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_EQ(folder.names(), names);
  for (const std::string& name : names) EXPECT_GT(content_of(folder.file(name)).size(), 100U) << name;
  EXPECT_EQ(content_of(folder.file("a.png")).substr(1, 3), "PNG");
  EXPECT_EQ(content_of(folder.file("a.glb")).substr(0, 4), "glTF");
}

TEST(FormFactors, BetweenTwoPlatesIsTheTextbookValue) {
  const Outcome outcome =
      run_program({"formfactors", scene_file("two-plates.obj"), "--between", "--json", "--divide", "0.1"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  const json table = json::parse(outcome.out);
  ASSERT_EQ(table.at("groups").size(), 2U);
  EXPECT_NEAR(table.at("areas").at(0).get<double>(), 1, 1e-12);
  EXPECT_NEAR(table.at("factors").at(0).at(1).get<double>(), 0.199824895698387, 1e-4);
  EXPECT_NEAR(table.at("factors").at(1).at(0).get<double>(), 0.199824895698387, 1e-4);
  EXPECT_EQ(table.at("factors").at(0).at(0).get<double>(), 0);
}

TEST(FormFactors, SaysWhyPatchesAreSetAside) {
  // Each wall of the furnace also gets a patch on its outside, which sees nothing: the room inside is closed all the
  // same.
  const Outcome outcome =
      run_program({"formfactors", scene_file("furnace.obj"), "--two-sided", "--divide", "0.1", "--json"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("looking out of the scene"));
  const json closure = json::parse(outcome.out).at("closure");
  EXPECT_TRUE(closure.at("closed_scene").get<bool>());
  EXPECT_EQ(closure.at("set_aside").at("count"), 192);
  EXPECT_NEAR(closure.at("min").get<double>(), 1, 1e-4);
}

TEST(Check, EveryKernelPasses) {
  const Outcome outcome = run_program({"check", "--json"});
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  const json rows = json::parse(outcome.out);
  ASSERT_GT(rows.size(), 20U);
  for (const json& row : rows) {
    // The assembly is Embree's on the processor: no kernel of that device.
    EXPECT_EQ(row.at("status"), row.at("kernel") == "assembly" ? "unsupported" : "pass") << row.dump();
    EXPECT_LE(row.at("error").get<double>(), row.at("bound").get<double>()) << row.dump();
  }
}

}  // namespace
}  // namespace interflect::test
