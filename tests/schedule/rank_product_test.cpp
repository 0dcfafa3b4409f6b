#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "base/thread_ranks.h"
#include "interflect/device/registry.h"
#include "interflect/formfactor/row_shares.h"
#include "interflect/schedule/scheduler.h"
#include "interflect/solver/solver.h"
#include "schedule/counting_device.h"
#include "schedule/failing_device.h"

namespace interflect {
namespace {

using namespace test;
using ::testing::HasSubstr;

constexpr std::uint32_t n = 211;

float element(std::uint32_t i, std::uint32_t j) {
  return i == j ? 0.0F : (1.0F + std::sin(static_cast<float>(3 * i + 7 * j))) / (2.5F * n);
}

FormFactorMatrix rows_of(const RowShare& share) {
  FormFactorMatrix f = FormFactorMatrix::rows_only(n, share.first, share.end);
  for (std::uint32_t i = share.first; i < share.end; ++i) {
    for (std::uint32_t j = 0; j < n; ++j) f.row(i)[j] = element(i, j);
  }
  return f;
}

Columns wave(std::size_t columns) {
  Columns x(columns, std::vector<float>(n));
  for (std::size_t c = 0; c < columns; ++c) {
    for (std::uint32_t i = 0; i < n; ++i) x[c][i] = std::cos(static_cast<float>(i + 11 * c));
  }
  return x;
}

struct Products {
  Columns y;
  std::vector<std::vector<double>> exact;
  bool operator==(const Products&) const = default;
};

std::vector<std::unique_ptr<Device>> only(std::unique_ptr<Device> device) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(std::move(device));
  return devices;
}

Products products(Scheduler& scheduler) {
  Products out;
  Vector x = scheduler.vector(), y = scheduler.vector();
  scheduler.upload(x, wave(scheduler.columns()));
  scheduler.apply(x, y);
  scheduler.download(y, out.y);
  scheduler.exact_product(wave(scheduler.columns()), out.exact);
  return out;
}

/// y on every rank of so many, on openmp.
std::vector<Products> by_ranks(ThreadWorld& world, std::uint32_t ranks) {
  std::vector<Products> out(ranks);
  world.run([&](Ranks& here) {
    const FormFactorMatrix rows = rows_of(row_shares(n, ranks, 32)[here.rank()]);
    Scheduler scheduler(rows, here, only(open_device("openmp")), 3);
    out[here.rank()] = products(scheduler);
  });
  return out;
}

Products by_one_process() {
  const FormFactorMatrix whole = rows_of({0, n});
  Scheduler scheduler(whole, only(open_device("openmp")), 3);
  return products(scheduler);
}

TEST(RankProduct, HasTheBitsOfOneProcessOnEveryRank) {
  const Products expected = by_one_process();
  for (const std::uint32_t ranks : {1U, 2U, 3U, 4U, 7U, 9U}) {  // of 9 some have no row
    ThreadWorld world(ranks);
    for (const Products& there : by_ranks(world, ranks)) EXPECT_TRUE(there == expected) << ranks << " ranks";
  }
}

// The twins of the test above: gathers that lose a rank's rows, or swap those of two ranks.
TEST(RankProduct, DiffersWhereAGatherLosesRows) {
  ThreadWorld world(3);
  world.spoil = [](std::span<const std::uint64_t> bytes, std::span<std::byte> all) {
    if (bytes[1] < 700) return;  // not rows
    std::memset(all.data() + bytes[0], 0, bytes[1]);
  };
  for (const Products& there : by_ranks(world, 3)) {
    EXPECT_FALSE(there.y == by_one_process().y);
    EXPECT_FALSE(there.exact == by_one_process().exact);
  }
}

TEST(RankProduct, DiffersWhereAGatherSwapsRows) {
  ThreadWorld world(4);
  world.spoil = [](std::span<const std::uint64_t> bytes, std::span<std::byte> all) {
    if (bytes[1] < 700 || bytes[1] != bytes[2]) return;
    std::swap_ranges(all.begin() + static_cast<std::ptrdiff_t>(bytes[0]),
                     all.begin() + static_cast<std::ptrdiff_t>(bytes[0] + bytes[1]),
                     all.begin() + static_cast<std::ptrdiff_t>(bytes[0] + bytes[1]));
  };
  for (const Products& there : by_ranks(world, 4)) EXPECT_FALSE(there.y == by_one_process().y);
}

/// Solves on every rank of three; where they differ rank 1's device has another name, and so another signature, and
/// another way to sum.
std::vector<Columns> solve_by_ranks(bool differ) {
  std::vector<Columns> out(3);
  ThreadWorld(3).run([&](Ranks& here) {
    const FormFactorMatrix rows = rows_of(row_shares(n, 3, 32)[here.rank()]);
    const auto counts = std::make_shared<Counts>();
    if (differ && here.rank() == 1) {
      counts->describe = [](DeviceInfo& info) {
        info.name = "another";
        info.blocks_per_group = 3;
      };
    }
    Scheduler scheduler(rows, here, counting(counts), 3);
    const std::vector<double> area(n, 1.0);
    const Columns rho(3, std::vector<float>(n, 0.6F)), e = wave(3);
    const SolveReport report = solve(scheduler, Method::bicgstab, {}, area, rho, e, out[here.rank()]);
    EXPECT_TRUE(report.converged) << report.reason;
  });
  return out;
}

TEST(RankProduct, SolvesAlikeOnEveryRankWhereDevicesDiffer) {
  for (const bool differ : {false, true}) {
    const std::vector<Columns> solved = solve_by_ranks(differ);
    EXPECT_TRUE(solved[1] == solved[0]) << differ;
    EXPECT_TRUE(solved[2] == solved[0]) << differ;
  }
}

TEST(RankProduct, ADeviceThatFailsInPlacingEndsAllRanks) {
  try {
    ThreadWorld(3).run([&](Ranks& here) {
      const FormFactorMatrix rows = rows_of(row_shares(n, 3, 32)[here.rank()]);
      const auto fate = std::make_shared<Fate>();
      if (here.rank() == 1) fate->fails_at = 0;
      const Scheduler scheduler(rows, here, only(std::make_unique<FailingDevice>(fate)), 3);
    });
    FAIL() << "no error";
  } catch (const AgreedError& error) {
    EXPECT_EQ(error.kind(), ErrorKind::device);
    EXPECT_THAT(error.what(), HasSubstr("(rank 1)"));
  }
}

TEST(RankProduct, RefusesRowsWithAGap) {
  EXPECT_THROW(ThreadWorld(2).run([](Ranks& here) {
    const FormFactorMatrix rows = rows_of(here.rank() == 0 ? RowShare{0, 96} : RowShare{128, n});
    const Scheduler scheduler(rows, here, only(open_device("openmp")), 3);
  }),
               Error);
}

}  // namespace
}  // namespace interflect
