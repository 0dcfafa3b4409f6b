// A solve that goes on in another process: what is kept, the file, and that nothing in it is trusted.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/solver/batches.h"
#include "interflect/solver/fallback.h"
#include "interflect/solver/iterate_file.h"
#include "schedule/counting_device.h"
#include "schedule/failing_device.h"
#include "solver/lit_room.h"

namespace interflect {
namespace {

using namespace test;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::SizeIs;

const LitRoom& scene() {
  static const LitRoom made(0.95F);
  return made;
}

struct Memory final : IterateKeeper {
  [[nodiscard]] const Iterate* found() const override { return begin ? &*begin : nullptr; }
  [[nodiscard]] double interval() const override { return 0; }
  [[nodiscard]] bool due() override { return true; }
  void keep(const Iterate& iterate) noexcept override { kept.push_back(iterate); }
  std::optional<Iterate> begin;
  std::vector<Iterate> kept;
};

struct Result {
  Columns b;
  SolveReport report;
};

Result solve_with(Memory& memory, Method method, const StopTest& stop = {}, std::uint32_t columns = 3) {
  const LitRoom& s = scene();
  Scheduler scheduler(s.room.form_factors, openmp(), columns);
  BatchedSolve solve(method, stop, s.room.area, s.light.reflectance, s.light.emittance);
  solve.keep_in(memory);
  solve.run(scheduler);
  return {solve.radiosity(), solve.report()};
}

class GoingOn : public ::testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(Method, GoingOn, ::testing::Values(Method::cg, Method::bicgstab, Method::jacobi),
                         [](const auto& info) { return std::string(name(info.param)); });

TEST_P(GoingOn, EveryIterateLeadsToTheSolution) {
  Memory whole;
  const Result scratch = solve_with(whole, GetParam());
  ASSERT_TRUE(scratch.report.converged);
  ASSERT_GT(whole.kept.size(), 5U);
  EXPECT_EQ(whole.kept.back().b, scratch.b);
  EXPECT_EQ(whole.kept.back().products, scratch.report.products);
  for (std::size_t k = 0; k < whole.kept.size(); k += std::max<std::size_t>(1, whole.kept.size() / 8)) {
    Memory memory;
    memory.begin = whole.kept[k];
    EXPECT_GT(memory.begin->iterations(), 0U);
    const Result rest = solve_with(memory, GetParam(), {}, k % 2 == 0 ? 3 : 1);  // three columns, or each on its own
    EXPECT_TRUE(rest.report.converged);
    EXPECT_TRUE(right(rest.b, scene().solution, 5e-6)) << k;
    EXPECT_GE(rest.report.iterations, memory.begin->iterations());
  }
}

TEST_P(GoingOn, ColumnsThatHaveComeDifferentlyFarGoOnTogether) {
  Memory one_by_one;
  ASSERT_TRUE(solve_with(one_by_one, GetParam(), {}, 1).report.converged);
  bool different = false;
  for (std::size_t k = 0; k < one_by_one.kept.size(); k += std::max<std::size_t>(1, one_by_one.kept.size() / 8)) {
    Memory memory;
    memory.begin = one_by_one.kept[k];
    const auto& made = memory.begin->made;
    different = different || (made[0] > 0 && made[2] == 0);
    const Result rest = solve_with(memory, GetParam());
    EXPECT_TRUE(rest.report.converged);
    EXPECT_TRUE(right(rest.b, scene().solution, 5e-6)) << k;
  }
  EXPECT_TRUE(different);
}

TEST(GoingOn, CostsFewerProductsThanFromScratchAndAWrongIterateDoesNot) {
  Memory whole;
  const Result scratch = solve_with(whole, Method::jacobi);
  Memory memory;
  memory.begin = whole.kept[whole.kept.size() / 2];
  const Iterate half = *memory.begin;
  const std::uint32_t rest = solve_with(memory, Method::jacobi).report.products - half.products;
  EXPECT_LT(rest, scratch.report.products * 2 / 3);

  Memory wrong;  // what no checksum can tell: it is dropped, and its iterations do not count
  wrong.begin = half;
  for (auto& column : wrong.begin->b) {
    for (std::size_t i = 0; i < column.size(); ++i) column[i] = i % 2 == 0 ? 1e6F : -1e6F;
  }
  const Result anew = solve_with(wrong, Method::jacobi);
  EXPECT_TRUE(right(anew.b, scene().solution, 5e-6));
  EXPECT_GE(anew.report.products - half.products, scratch.report.products);
  EXPECT_FALSE(right(wrong.begin->b, scene().solution, 5e-6));
}

TEST(GoingOn, AFixedNumberOfBouncesIsThatNumber) {
  const LitRoom& s = scene();
  const StopTest stop{.iterations = 20};
  Memory whole;
  const Result straight = solve_with(whole, Method::jacobi, stop);
  const Doubles exact = reference_bounces(s.room.form_factors, s.light.reflectance, s.light.emittance, 20);
  ASSERT_TRUE(right(straight.b, exact, 5e-6));
  for (const std::size_t k : {std::size_t{1}, whole.kept.size() / 2, whole.kept.size() - 1}) {
    Memory memory;
    memory.begin = whole.kept[k];
    const Result rest = solve_with(memory, Method::jacobi, stop);
    EXPECT_TRUE(right(rest.b, exact, 5e-6)) << k;
    EXPECT_EQ(rest.report.iterations, 20U);
  }
  Memory twice;  // the twin: begun at one bounce too many
  twice.begin = whole.kept[3];
  ++twice.begin->made.front();
  for (auto& made : twice.begin->made) made = twice.begin->made.front();
  EXPECT_FALSE(right(solve_with(twice, Method::jacobi, stop).b, exact, 5e-6));
}

TEST(GoingOn, TheLastDeviceLeavesItsIterate) {
  const LitRoom& s = scene();
  const auto attempt = [&](std::uint64_t fails_at, Memory& memory) {
    auto fate = std::make_shared<Fate>();
    fate->fails_at = fails_at;
    Candidates candidates({"failing"}, [&](const std::string&) { return std::make_unique<FailingDevice>(fate); });
    candidates.keep_in(&memory);
    Columns b;
    static_cast<void>(solve_on(candidates, s.room.form_factors, Method::cg, {}, s.room.area, s.light.reflectance,
                               s.light.emittance, b));
    return fate->calls;
  };
  Memory whole;
  const std::uint64_t calls = attempt(std::numeric_limits<std::uint64_t>::max(), whole);
  bool gone_on = false;
  for (std::uint64_t k = 0; k < calls; k += 3) {
    Memory memory;
    EXPECT_THROW(static_cast<void>(attempt(k, memory)), Error) << k;
    if (memory.kept.empty()) continue;  // before the first iteration
    gone_on = true;
    Memory next;
    next.begin = memory.kept.back();
    EXPECT_TRUE(right(solve_with(next, Method::cg).b, s.solution, 5e-6)) << k;
  }
  EXPECT_TRUE(gone_on);
}

struct File {
  File() {
    std::string folder = ::testing::TempDir() + "/interflect-iterate-XXXXXX";
    if (::mkdtemp(folder.data()) == nullptr) throw std::runtime_error("no temporary folder");
    path = folder;
    name = folder + "/a.ckp";
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  ~File() {
    std::error_code ignored;
    std::filesystem::remove_all(path, ignored);
  }
  void put(const std::string& bytes) const { std::ofstream(name, std::ios::binary) << bytes; }
  std::string path, name;
};

const IterateKey key{5, 3, Method::jacobi, {11, 12}, 13, 14, 0};
Iterate small() {
  Iterate iterate{{{1, 2, 3, 4, 5}, {6, 7, 8, 9, 10}, {0, 0, 0, 0, 0}}, {4, 4, 0}, 9, 2, 1, 0.5};
  return iterate;
}

/// What reading says; empty: nothing.
std::string complaint(const std::string& file, const IterateKey& wanted = key) {
  try {
    static_cast<void>(read_iterate(file, wanted));
    return "";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::input);
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    EXPECT_THAT(error.what(), HasSubstr(file));
    return error.what();
  }
}

TEST(IterateFile, ComesBackAsItWas) {
  const File file;
  write_iterate(file.name, key, small());
  const Iterate back = read_iterate(file.name, key);
  EXPECT_EQ(back.b, small().b);
  EXPECT_EQ(back.made, small().made);
  EXPECT_EQ(back.products, 9U);
  EXPECT_EQ(back.passes, 2U);
  EXPECT_EQ(back.restarts, 1U);
  EXPECT_EQ(back.seconds, 0.5);
  EXPECT_EQ(read_file(file.name).size(), 88U + 3 * 4 + 15 * 4 + 8);
}

TEST(IterateFile, EveryFlippedByteAndEveryLengthIsRefused) {
  const File file;
  write_iterate(file.name, key, small());
  const std::string bytes = read_file(file.name);
  ASSERT_EQ(complaint(file.name), "");
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x40);
    file.put(damaged);
    EXPECT_THAT(complaint(file.name),
                ::testing::AnyOf(HasSubstr("damaged"), HasSubstr("no checkpoint"), HasSubstr("another version")))
        << at;
    file.put(bytes.substr(0, at));
    EXPECT_NE(complaint(file.name), "") << at;
  }
  file.put(bytes + "x");
  EXPECT_THAT(complaint(file.name), HasSubstr("damaged"));
}

TEST(IterateFile, SaysWhatDoesNotFit) {
  const File file;
  write_iterate(file.name, key, small());
  const auto with = [&](const std::function<void(IterateKey&)>& change) {
    IterateKey other = key;
    change(other);
    return complaint(file.name, other);
  };
  EXPECT_EQ(with([](IterateKey&) {}), "");
  EXPECT_THAT(with([](IterateKey& k) { k.patches = 6; }), HasSubstr("5 patches, and there are 6"));
  EXPECT_THAT(with([](IterateKey& k) { k.geometry[1] = 1; }), HasSubstr("geometry is another"));
  EXPECT_THAT(with([](IterateKey& k) { k.columns = 6; }), HasSubstr("light groups are others"));
  EXPECT_THAT(with([](IterateKey& k) { k.reflectance = 1; }), HasSubstr("reflectances are others"));
  EXPECT_THAT(with([](IterateKey& k) { k.emittance = 1; }), HasSubstr("lights are others"));
  EXPECT_THAT(with([](IterateKey& k) { k.method = Method::cg; }), HasSubstr("--method jacobi"));
  EXPECT_THAT(with([](IterateKey& k) { k.exactly = 1; }), HasSubstr("--iterations"));
}

TEST(IterateFile, NumbersThatAreNoneAreRefused) {
  const File file;
  Iterate iterate = small();
  iterate.b[1][2] = std::numeric_limits<float>::quiet_NaN();
  write_iterate(file.name, key, iterate);
  EXPECT_THAT(complaint(file.name), HasSubstr("damaged"));
}

TEST(IterateFile, AFullDiskLeavesTheOneFromBefore) {
  const File file;
  write_iterate(file.name, key, small());
  const std::string before = read_file(file.name);
  struct rlimit old {};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &old), 0);
  const struct rlimit tight { 100, old.rlim_max };
  file_limit_is_an_error();
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &tight), 0);
  Iterate newer = small();
  newer.made.front() = 5;
  EXPECT_THROW(write_iterate(file.name, key, newer), Error);
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &old), 0);
  EXPECT_EQ(read_file(file.name), before);
  write_iterate(file.name, key, newer);  // the twin: there is room again
  EXPECT_NE(read_file(file.name), before);
  std::size_t files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(file.path)) ++files;
  EXPECT_EQ(files, 1U);
}

}  // namespace
}  // namespace interflect
