// `bench --peers` and `bench --study` as a user meets them.
#include "cli/program.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <nlohmann/json.hpp>

namespace interflect::test {
namespace {

/// The program has no suppressions of its own for the sanitizers.
const bool told_sanitizers =
    ::setenv("LSAN_OPTIONS", "suppressions=" INTERFLECT_SOURCE_DIR "/tests/peers/viennacl.supp", 0) == 0;

using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::StartsWith;

struct Bench {
  Outcome outcome;
  json rows;
  [[nodiscard]] const json& row(const std::string& what) const {
    for (const json& row : rows) {
      if (row.at("what") == what) return row;
    }
    throw std::runtime_error("no row " + what);
  }
};

Bench bench_peers(const std::string& openblas) {
  const Folder folder;
  Bench bench;
  bench.outcome = run_program({"bench", "--peers", "--device", "openmp", "--room", "1312", "--repetitions", "1",
                               "--json", folder.file("b.json"), "--quiet"},
                              {"INTERFLECT_OPENBLAS=" + openblas});
  bench.rows = json::parse(content_of(folder.file("b.json"))).at("rows");
  return bench;
}

TEST(BenchPeers, ARightLibraryPassesBesideOurKernels) {
  const Bench bench = bench_peers(FAKE_BLAS);
  EXPECT_EQ(bench.outcome.status, 0) << bench.outcome.out << bench.outcome.err;
  for (const char* what : {"peer:openblas-sgemm", "peer:openblas-sgemv"}) {
    const json& row = bench.row(what);
    EXPECT_EQ(row.at("status"), "pass") << row.dump();
    EXPECT_EQ(row.at("device"), "host");
    EXPECT_EQ(row.at("scene"), "room-1312");
    EXPECT_EQ(row.at("n"), 1312);
    EXPECT_GT(row.at("seconds").get<double>(), 0);
    EXPECT_GT(row.at("a_ratio").get<double>(), 0);
    EXPECT_TRUE(row.at("machine_ratio").is_number());
    EXPECT_LE(row.at("error").get<double>(), row.at("bound").get<double>());
    EXPECT_THAT(row.at("reason").get<std::string>(), HasSubstr(" threads; F "));
  }
  EXPECT_EQ(bench.row("peer:openblas-sgemm").at("bytes"), bench.row("matvec").at("bytes"));
}

TEST(BenchPeers, AWrongProductIsDenied) {
  const Bench bench = bench_peers(BROKEN_BLAS);
  EXPECT_EQ(bench.outcome.status, 4) << bench.outcome.out;
  for (const char* what : {"peer:openblas-sgemm", "peer:openblas-sgemv"}) {
    const json& row = bench.row(what);
    EXPECT_EQ(row.at("status"), "fail") << row.dump();
    EXPECT_THAT(row.at("reason").get<std::string>(), StartsWith("differs from the fp64 reference"));
    EXPECT_GT(row.at("error").get<double>(), row.at("bound").get<double>());
  }
  EXPECT_EQ(bench.row("matvec").at("status"), "pass");
}

TEST(BenchPeers, AMissingLibraryIsARowWithTheReason) {
  const Bench bench = bench_peers("/nonexistent/libopenblas.so.0");
  EXPECT_EQ(bench.outcome.status, 0) << bench.outcome.out << bench.outcome.err;
  const json& row = bench.row("peer:openblas-sgemm");
  EXPECT_EQ(row.at("status"), "unsupported");
  EXPECT_EQ(row.at("reason"), "not installed: /nonexistent/libopenblas.so.0");
  EXPECT_EQ(row.at("seconds"), 0.0);
  EXPECT_EQ(row.at("a_ratio"), 0.0);
  EXPECT_THAT(bench.outcome.out, HasSubstr("unsupported: not installed: /nonexistent/libopenblas.so.0"));
}

TEST(BenchStudy, HasItsTablesAsTextAndAsData) {
  const Folder folder;
  const Outcome outcome = run_program({"bench", "--study", "--device", "openmp", "--room", "1312", "--repetitions", "1",
                                       "--json", folder.file("s.json"), "--quiet"});
  ASSERT_EQ(outcome.status, 0) << outcome.out << outcome.err;
  const json study = json::parse(content_of(folder.file("s.json")));
  EXPECT_EQ(study.at("header").at("devices").size(), 1U);
  std::vector<std::string> rows;
  for (const json& row : study.at("rows")) {
    rows.push_back(row.at("device").get<std::string>() + ' ' + row.at("what").get<std::string>());
    if (row.at("device") == "cuda:0" && row.at("status") == "unsupported") continue;
    EXPECT_EQ(row.at("status"), "pass") << row.dump();
    EXPECT_LE(row.at("error").get<double>(), row.at("bound").get<double>()) << row.dump();
    EXPECT_GT(row.at("products").get<int>(), 5) << row.dump();
  }
  EXPECT_THAT(rows, ::testing::IsSupersetOf({"openmp solve:cg", "openmp solve:jacobi", "openmp solve:bicgstab",
                                             "openmp solve:cg:dense16", "openmp solve:cg:tiled16",
                                             "openmp solve:cg:sym16", "host study:aos-serial", "host study:aos-openmp",
                                             "host study:soa-serial", "host study:soa-openmp", "cuda:0 solve:jacobi"}));
  const json& tables = study.at("tables");
  EXPECT_EQ(tables.at("methods").at(0).at("study").at("bicgstab_iterations"), 3);
  const json& jacobi = tables.at("jacobi").at(0);
  EXPECT_EQ(jacobi.at("study").at("original"), 0.028);
  EXPECT_EQ(jacobi.at("study").at("openmp"), 0.009);
  EXPECT_GT(jacobi.at("cg_over_loop_serial").get<double>(), 0);
  EXPECT_GT(tables.at("layout").at(0).at("openmp_aos_over_soa").get<double>(), 0);
  for (const char* figure : {"   1312 |", "0.028", "0.031", "0.006", "0.009"}) {
    EXPECT_THAT(outcome.out, HasSubstr(figure));
  }
  EXPECT_EQ(jacobi.at("cuda").is_null(), outcome.out.find("no device") != std::string::npos);
}

}  // namespace
}  // namespace interflect::test
