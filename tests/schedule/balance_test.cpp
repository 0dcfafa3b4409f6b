#include "interflect/schedule/balance.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "interflect/base/error.h"

// Shares from rates that are given: nothing is timed.

namespace interflect {
namespace {

using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double no_limit = std::numeric_limits<double>::infinity();
constexpr double total = 1e6;  // bytes

Balance balance(std::size_t devices, std::vector<double> room = {}, std::vector<double> weights = {}) {
  if (room.empty()) room.assign(devices, no_limit);
  return Balance(total, std::move(room), std::move(weights));
}

/// A product in which device k goes through rates[k] bytes a second, and takes `latency` besides.
bool product(Balance& shares, const std::vector<double>& rates, double latency = 0) {
  std::vector<std::uint64_t> bytes;
  std::vector<double> seconds;
  for (std::size_t k = 0; k < rates.size(); ++k) {
    bytes.push_back(static_cast<std::uint64_t>(shares.shares()[k] * total));
    seconds.push_back(bytes[k] == 0 ? 0 : static_cast<double>(bytes[k]) / rates[k] + latency);
  }
  return shares.note(bytes, seconds);
}

TEST(Balance, WithoutAnythingToMultiplyThereIsNothingToLearn) {
  Balance shares = balance(3);
  for (int k = 0; k < 3; ++k) EXPECT_FALSE(shares.note({0, 0, 0}, {0, 0, 0}));
  EXPECT_EQ(shares.moves(), 0U);
}

/// Seconds of a product, relative to the least possible.
double over_ideal(const Balance& shares, const std::vector<double>& rates) {
  double longest = 0, together = 0;
  for (std::size_t k = 0; k < rates.size(); ++k) {
    longest = std::max(longest, shares.shares()[k] * total / rates[k]);
    together += rates[k];
  }
  return longest * together / total;
}

TEST(Balance, BeginsWithEqualSharesAndLearnsAOneToFourPair) {
  Balance shares = balance(2);
  EXPECT_THAT(shares.shares(), ElementsAre(0.5, 0.5));
  const std::vector<double> rates{4e6, 1e6};
  EXPECT_GT(over_ideal(shares, rates), 2);
  for (int k = 0; k < 5; ++k) static_cast<void>(product(shares, rates));
  EXPECT_LT(over_ideal(shares, rates), 1.001);
  EXPECT_FALSE(shares.learning());
  EXPECT_EQ(shares.moves(), 1U);
}

TEST(Balance, ReachesTheIdealOfManyPairsAlsoWhereAProductTakesTimeOfItsOwn) {
  for (const double ratio : {1.2, 2.0, 10.0, 60.0}) {
    for (const double latency : {0.0, 0.001, 0.01}) {
      Balance shares = balance(3);
      const std::vector<double> rates{1e6, 1e6 * ratio, 3e6};
      for (int k = 0; k < 20; ++k) static_cast<void>(product(shares, rates, latency));
      EXPECT_FALSE(shares.learning());
      EXPECT_LE(shares.moves(), Balance::most_moves);
      double longest = 0, shortest = no_limit;
      for (std::size_t k = 0; k < 3; ++k) {
        const double seconds = shares.shares()[k] * total / rates[k] + latency;
        longest = std::max(longest, seconds);
        shortest = std::min(shortest, seconds);
      }
      EXPECT_LT(longest / shortest, 1.12) << ratio << " " << latency;
    }
  }
}

TEST(Balance, OneDisturbedProductMovesNothingAndDriftDoes) {
  Balance shares = balance(2);
  const std::vector<double> rates{2e6, 1e6};
  for (int k = 0; k < 20; ++k) static_cast<void>(product(shares, rates));
  const std::uint32_t learnt = shares.moves();
  EXPECT_FALSE(product(shares, {2e6, 0.2e6}));
  for (int k = 0; k < 20; ++k) EXPECT_FALSE(product(shares, {2e6, 1.08e6})) << "8 % are no drift";
  for (int k = 0; k < 20; ++k) static_cast<void>(product(shares, {2e6, 1.3e6}));
  EXPECT_EQ(shares.moves(), learnt + 1);
  EXPECT_LT(over_ideal(shares, {2e6, 1.3e6}), 1.01);
}

TEST(Balance, KeepsToTheRoom) {
  Balance shares = balance(3, {0.1 * total, no_limit, 0.3 * total});
  EXPECT_THAT(shares.shares(), ElementsAre(DoubleNear(0.1, 1e-9), DoubleNear(0.6, 1e-9), DoubleNear(0.3, 1e-9)));
  for (int k = 0; k < 10; ++k) static_cast<void>(product(shares, {9e6, 1e6, 2e6}));
  EXPECT_THAT(shares.shares(), ElementsAre(DoubleNear(0.1, 1e-9), DoubleNear(0.6, 1e-9), DoubleNear(0.3, 1e-9)));
  try {
    static_cast<void>(balance(2, {0.1 * total, 0.3 * total}));
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::limit);
    EXPECT_THAT(error.what(), HasSubstr("no room for 60.0 %"));
  }
}

TEST(Balance, WhatALostDeviceHadGoesToTheOthersByTheirRates) {
  Balance shares = balance(3);
  for (int k = 0; k < 8; ++k) static_cast<void>(product(shares, {3e6, 1e6, 2e6}));
  shares.lose(2);
  EXPECT_THAT(shares.shares(), ElementsAre(DoubleNear(0.75, 0.01), DoubleNear(0.25, 0.01), 0.0));
  for (int k = 0; k < 8; ++k) static_cast<void>(product(shares, {1e6, 1e6, 2e6}));
  EXPECT_EQ(shares.shares()[2], 0.0);
  shares.lose(0);
  EXPECT_THAT(shares.shares(), ElementsAre(0.0, DoubleNear(1.0, 1e-9), 0.0));
  EXPECT_THROW(shares.lose(1), Error);
  Balance before = balance(3);  // before anything is known
  before.lose(0);
  EXPECT_THAT(before.shares(), ElementsAre(0.0, 0.5, 0.5));
}

TEST(Balance, FixedWeightsStay) {
  Balance shares = balance(2, {}, {1, 4});
  EXPECT_THAT(shares.shares(), ElementsAre(DoubleNear(0.2, 1e-12), DoubleNear(0.8, 1e-12)));
  for (int k = 0; k < 20; ++k) EXPECT_FALSE(product(shares, {4e6, 1e6}));
  EXPECT_EQ(shares.moves(), 0U);
  for (const std::vector<double>& wrong :
       std::vector<std::vector<double>>{{1}, {0, 0}, {-1, 2}, {1, std::numeric_limits<double>::quiet_NaN()}}) {
    EXPECT_THROW(static_cast<void>(balance(2, {}, wrong)), Error);
  }
}

TEST(Cut, CutsAtTheNearestUnitAndGivesEachDeviceOne) {
  const std::vector<std::uint64_t> even{0, 10, 20, 30, 40, 50, 60, 70, 80, 90, 100};
  EXPECT_THAT(cut(even, {0.5, 0.5}), ElementsAre(0, 5, 10));
  EXPECT_THAT(cut(even, {0.24, 0.0, 0.76}), ElementsAre(0, 2, 2, 10));
  EXPECT_THAT(cut(even, {0.001, 0.998, 0.001}), ElementsAre(0, 1, 9, 10));
  EXPECT_THAT(cut(even, {0.0, 1.0, 0.0}), ElementsAre(0, 0, 10, 10));
  EXPECT_THAT(cut({0, 90, 100}, {0.5, 0.5}), ElementsAre(0, 1, 2));
  EXPECT_THAT(cut({0, 7}, {0.4, 0.3, 0.3}), ElementsAre(0, 0, 1, 1));
  const std::vector<std::uint64_t> empty_strips{0, 0, 0, 40, 40, 80};
  EXPECT_THAT(cut(empty_strips, {0.5, 0.5}).front(), 0U);
  EXPECT_THAT(cut(empty_strips, {0.5, 0.5}).back(), 5U);
}

}  // namespace
}  // namespace interflect
