#include "interflect/formfactor/team_tiles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <map>
#include <mutex>

// Who makes which tile must not show. The makers here write numbers that say which tile it is.

namespace interflect {
namespace {

using ::testing::HasSubstr;

constexpr std::size_t blocks = 40;

struct Numbers final : TileMaker {
  /// Fails in its k-th call; `wrong`: leaves the last row of each run out.
  explicit Numbers(int fails_at = -1, ErrorKind how = ErrorKind::device, bool skips = false)
      : fails(fails_at), kind(how), wrong(skips) {}
  TileFacts make(std::size_t first, std::size_t end, const TileSink& sink, ProgressSink& progress) override {
    const int call = calls++;
    TileFacts facts;
    for (std::size_t r = first; r < end - (wrong ? 1 : 0); ++r) {
      for (std::size_t c = r; c < blocks; ++c) {
        const float value[] = {static_cast<float>(100 * r + c)};
        sink(r, c, value);
        facts.variance.push_back(value[0]);
        ++facts.rays;
      }
      if (call == fails) throw Error(kind, "gone");  // with a row done
    }
    progress.advance(tiles_in_rows(first, end, blocks));
    return facts;
  }
  int fails, calls = 0;
  ErrorKind kind;
  bool wrong;
};

struct Result {
  std::map<std::pair<std::size_t, std::size_t>, float> tiles;
  TileFacts facts;
  std::vector<std::size_t> lost;
  std::uint64_t progress = 0;
};

Result made(std::vector<std::unique_ptr<TileMaker>> makers, std::size_t first = 0, std::size_t end = blocks) {
  Result result;
  std::mutex mutex;
  const TileSink sink = [&](std::size_t r, std::size_t c, std::span<const float> s) {
    const std::lock_guard lock(mutex);
    result.tiles[{r, c}] = s[0];
  };
  struct Sum final : ProgressSink {
    void advance(std::uint64_t steps) override { sum += steps; }
    std::atomic<std::uint64_t> sum = 0;
  } sum;
  TeamTiles team(std::move(makers), blocks, [&](std::size_t k, const Error&) { result.lost.push_back(k); });
  result.facts = team.make(first, end, sink, sum);
  result.progress = sum.sum;
  return result;
}

std::vector<std::unique_ptr<TileMaker>> makers(std::vector<std::unique_ptr<Numbers>> given) {
  std::vector<std::unique_ptr<TileMaker>> all;
  for (auto& one : given) all.push_back(std::move(one));
  return all;
}

std::vector<std::unique_ptr<TileMaker>> team(std::size_t count, int first_fails = -1) {
  std::vector<std::unique_ptr<Numbers>> all;
  for (std::size_t k = 0; k < count; ++k) all.push_back(std::make_unique<Numbers>(k == 0 ? first_fails : -1));
  return makers(std::move(all));
}

bool equal(const Result& a, const Result& b) {
  return a.tiles == b.tiles && a.facts.variance == b.facts.variance && a.facts.rays == b.facts.rays;
}

TEST(TeamTiles, ManyMakeWhatOneMakes) {
  for (const auto& [first, end] : {std::pair<std::size_t, std::size_t>{0, blocks}, {7, 8}, {3, 30}, {39, 40}}) {
    const Result one = made(team(1), first, end);
    EXPECT_EQ(one.facts.rays, tiles_in_rows(first, end, blocks));
    for (const std::size_t count : {2U, 3U, 5U}) {
      const Result many = made(team(count), first, end);
      EXPECT_TRUE(equal(one, many)) << count << " from " << first;
      EXPECT_EQ(many.progress, one.progress);
    }
  }
}

TEST(TeamTiles, OneThatIsLostIsReplaced) {
  const Result one = made(team(1));
  for (const int call : {0, 1, 4}) {
    const Result rest = made(team(3, call));
    EXPECT_TRUE(equal(one, rest)) << call;
    EXPECT_LE(rest.lost.size(), 1U);
    EXPECT_EQ(rest.progress, one.progress);
  }
  EXPECT_THAT(made(team(2, 0)).lost, ::testing::AnyOf(::testing::ElementsAre(0U), ::testing::IsEmpty()));
}

TEST(TeamTiles, TheLastOnesErrorAndAnyOtherErrorEndIt) {
  const auto failing = [](ErrorKind first, ErrorKind second) {
    std::vector<std::unique_ptr<Numbers>> both;
    both.push_back(std::make_unique<Numbers>(0, first));
    both.push_back(std::make_unique<Numbers>(0, second));
    try {
      static_cast<void>(made(makers(std::move(both))));
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr("gone"));
      return error.kind();
    }
    return ErrorKind::usage;
  };
  EXPECT_EQ(failing(ErrorKind::device, ErrorKind::device), ErrorKind::device);
  EXPECT_EQ(failing(ErrorKind::limit, ErrorKind::limit), ErrorKind::limit);
}

/// Says of every tile who made it.
class Signing final : public TileMaker {
 public:
  Signing(float name, int fails_at = -1) : name_(name), fails_at_(fails_at) {}
  TileFacts make(std::size_t first, std::size_t end, const TileSink& sink, ProgressSink&) override {
    if (calls_++ == fails_at_) throw Error(ErrorKind::device, "gone");
    TileFacts facts;
    for (std::size_t r = first; r < end; ++r) {
      for (std::size_t c = r; c < blocks; ++c) sink(r, c, std::vector<float>(1, name_));
    }
    return facts;
  }

 private:
  float name_;
  int fails_at_, calls_ = 0;
};

std::map<std::pair<std::size_t, std::size_t>, float> signed_by(const std::vector<double>& shares, int first_fails) {
  std::map<std::pair<std::size_t, std::size_t>, float> tiles;
  std::mutex mutex;
  const TileSink sink = [&](std::size_t r, std::size_t c, std::span<const float> s) {
    const std::lock_guard lock(mutex);
    tiles[{r, c}] = s[0];
  };
  std::vector<std::unique_ptr<TileMaker>> all;
  for (std::size_t k = 0; k < shares.size(); ++k) {
    all.push_back(std::make_unique<Signing>(static_cast<float>(k), k == 0 ? first_fails : -1));
  }
  TeamTiles team(
      std::move(all), blocks, [](std::size_t, const Error&) {}, shares);
  ProgressSink silent;
  static_cast<void>(team.make(0, blocks, sink, silent));
  return tiles;
}

TEST(TeamTiles, WithSharesEachMakesItsOwn) {
  const auto tiles = signed_by({1, 4, 3}, -1);
  ASSERT_EQ(tiles.size(), tiles_in_rows(0, blocks, blocks));
  std::array<double, 3> made{};
  for (const auto& [place, maker] : tiles) ++made.at(static_cast<std::size_t>(maker));
  const auto all = static_cast<double>(tiles.size());
  EXPECT_NEAR(made[0] / all, 0.125, 0.06);
  EXPECT_NEAR(made[1] / all, 0.5, 0.06);
  EXPECT_NEAR(made[2] / all, 0.375, 0.06);
  for (int again = 0; again < 20; ++again) EXPECT_EQ(signed_by({1, 4, 3}, -1), tiles);
  EXPECT_NE(signed_by({4, 1, 3}, -1), tiles);
}

TEST(TeamTiles, WithSharesWhatIsLostGoesToTheNext) {
  for (const int call : {0, 2}) {
    const auto tiles = signed_by({4, 1, 3}, call), again = signed_by({4, 1, 3}, call);
    EXPECT_EQ(tiles.size(), tiles_in_rows(0, blocks, blocks));
    EXPECT_EQ(tiles, again);
    EXPECT_NE(tiles, signed_by({4, 1, 3}, -1));
  }
}

/// The twin: tiles that a maker leaves out are seen.
TEST(TeamTiles, TwinAMakerThatSkipsARowIsSeen) {
  const Result one = made(team(1));
  std::vector<std::unique_ptr<Numbers>> both;
  for (int k = 0; k < 2; ++k) both.push_back(std::make_unique<Numbers>(-1, ErrorKind::device, true));
  EXPECT_FALSE(equal(one, made(makers(std::move(both)))));
}

}  // namespace
}  // namespace interflect
