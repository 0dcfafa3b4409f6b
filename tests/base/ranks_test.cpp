#include "interflect/base/ranks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <new>

#include "base/thread_ranks.h"

namespace interflect {
namespace {

using test::ThreadWorld;
using ::testing::ElementsAre;

TEST(Ranks, GatherWhatEachHasInTheirOrder) {
  ThreadWorld(3).run([](Ranks& ranks) {
    const auto texts = ranks.all_texts(std::string(ranks.rank(), 'a' + static_cast<char>(ranks.rank())));
    EXPECT_THAT(texts, ElementsAre("", "b", "cc"));
    EXPECT_THAT(ranks.all_values(1.5 * ranks.rank()), ElementsAre(0, 1.5, 3));
    EXPECT_EQ(ranks.sum(1.0 + ranks.rank()), 6);
    EXPECT_EQ(ranks.rank_zeros(ranks.rank() == 0), true);
    EXPECT_EQ(ranks.rank_zeros(ranks.rank() != 0), false);
  });
}

TEST(Ranks, ExchangeAndCountWhatComesFromOthers) {
  ThreadWorld(3).run([](Ranks& ranks) {
    std::vector<std::vector<std::byte>> to(3);
    for (std::uint32_t k = 0; k < 3; ++k) to[k].assign(ranks.rank() + 1, static_cast<std::byte>(10 * ranks.rank() + k));
    const auto from = ranks.exchange(to);
    for (std::uint32_t k = 0; k < 3; ++k) {
      ASSERT_EQ(from[k].size(), k + 1);
      EXPECT_EQ(from[k].front(), static_cast<std::byte>(10 * k + ranks.rank()));
    }
    EXPECT_EQ(ranks.use().messages, 1U);
    EXPECT_EQ(ranks.use().bytes_exchanged, 6U - (ranks.rank() + 1));
    const RanksUse before = ranks.use();
    static_cast<void>(ranks.all_values(0));
    EXPECT_EQ((ranks.use() - before).bytes_gathered, 2 * sizeof(double));
    EXPECT_EQ((ranks.use() - before).bytes_exchanged, 0U);
  });
}

TEST(Ranks, RefuseAGatherOfAnotherShape) {
  OneRank one;
  std::array<std::byte, 3> all{};
  const std::array<std::uint64_t, 1> bytes{2};
  EXPECT_THROW(one.all_gather(std::span(all).first(2), bytes, all), Error);
}

/// What every rank throws; kind and text of all are the same.
std::pair<ErrorKind, std::string> failure_of(const std::function<void(Ranks&)>& work) {
  std::atomic<int> agreed_errors = 0;
  std::pair<ErrorKind, std::string> first{ErrorKind::internal, ""};
  ThreadWorld(4).run([&](Ranks& ranks) {
    try {
      agreed(ranks, [&] { work(ranks); });
    } catch (const AgreedError& error) {
      ++agreed_errors;
      if (ranks.rank() == 0) first = {error.kind(), error.what()};
    }
  });
  EXPECT_TRUE(agreed_errors == 4 || agreed_errors == 0) << agreed_errors;
  return first;
}

TEST(Agreed, EndsAllRanksWithTheFirstOnesError) {
  const auto [kind, text] = failure_of([](Ranks& ranks) {
    if (ranks.rank() == 2) throw Error(ErrorKind::device, "cuda:0: lost");
    if (ranks.rank() == 3) throw std::bad_alloc();
  });
  EXPECT_EQ(kind, ErrorKind::device);
  EXPECT_EQ(text, "cuda:0: lost (rank 2)");
}

TEST(Agreed, SaysNoRankWhereAllFailAlike) {
  const auto [kind, text] = failure_of([](Ranks&) { throw Error(ErrorKind::input, "room.obj:3: no number"); });
  EXPECT_EQ(kind, ErrorKind::input);
  EXPECT_EQ(text, "room.obj:3: no number");
}

TEST(Agreed, LetsGoOnWhereNobodyFails) {
  EXPECT_EQ(failure_of([](Ranks&) {}).second, "");
}

}  // namespace
}  // namespace interflect
