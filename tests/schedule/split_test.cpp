#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numeric>

#include "interflect/base/error.h"
#include "interflect/formfactor/patch_order.h"
#include "interflect/schedule/scheduler.h"
#include "interflect/schedule/split_product.h"
#include "interflect/schedule/worker.h"
#include "schedule/counting_device.h"
#include "schedule/failing_device.h"
#include "schedule/products.h"
#include "solver/room.h"

// y = F x over several devices, all of them OpenMP's under other names.

namespace interflect {
namespace {

using namespace test;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const Room& room() {
  static const Room made = make_room(9, 4);
  return made;
}

Columns wave(std::size_t columns) {
  return positive_wave(room().form_factors.size(), columns);
}

/// So many devices "a", "b", ...; those in `copies` do not use F in place.
std::vector<std::unique_ptr<Device>> devices(std::size_t count, const std::vector<std::shared_ptr<Counts>>& counts = {},
                                             bool share = true) {
  std::vector<std::unique_ptr<Device>> all;
  for (std::size_t k = 0; k < count; ++k) {
    const auto counting = k < counts.size() ? counts[k] : std::make_shared<Counts>();
    counting->may_share = share;
    const auto describe = counting->describe;
    counting->describe = [k, describe](DeviceInfo& info) {
      info.id = std::string(1, static_cast<char>('a' + k));
      if (describe) describe(info);
    };
    all.push_back(std::make_unique<CountingDevice>(counting));
  }
  return all;
}

template <class Matrix>
Columns product_on(const Matrix& f, std::vector<std::unique_ptr<Device>> on, const Columns& x,
                   const SplitOptions& split = {}) {
  Scheduler scheduler(f, std::move(on), static_cast<std::uint32_t>(x.size()), split);
  return applied(scheduler, x);
}

constexpr double kernel_bound = 2e-5;  // as packed_test.cpp has it

TEST(SplitProduct, AnySplitOfDense32GivesTheBitsOfOneDevice) {
  const std::uint32_t n = room().form_factors.size();
  for (const std::uint64_t panel_bytes : {std::uint64_t{1} << 30, std::uint64_t{n} * 4 * 100}) {
    FormFactorMatrix f(n, panel_bytes);
    for (std::uint32_t i = 0; i < n; ++i) {
      std::copy(room().form_factors.row(i).begin(), room().form_factors.row(i).end(), f.row(i).begin());
    }
    for (const std::size_t columns : {1U, 3U, 7U}) {
      const Columns x = wave(columns);
      const Columns alone = product_on(f, openmp(), x);
      for (const std::vector<double>& weights :
           std::vector<std::vector<double>>{{1, 1}, {1, 4}, {7, 2, 1}, {0, 1}, {1, 0}, {0, 1, 1}}) {
        for (const bool share : {true, false}) {
          const Columns y = product_on(f, devices(weights.size(), {}, share), x, {.weights = weights});
          ASSERT_EQ(y, alone) << weights[0] << ":" << weights[1] << " " << columns << " columns";
        }
      }
    }
  }
}

/// What one of several processes has: the devices share those rows, and leave the others of y as they are.
TEST(SplitProduct, SharesTheRowsThatAMatrixHas) {
  const Room& all = room();
  const std::uint32_t n = all.form_factors.size(), first = 96, end = 331;
  FormFactorMatrix rows = FormFactorMatrix::rows_only(n, first, end);
  for (std::uint32_t i = first; i < end; ++i) {
    std::copy(all.form_factors.row(i).begin(), all.form_factors.row(i).end(), rows.row(i).begin());
  }
  const Columns x = wave(3), whole = product_on(all.form_factors, openmp(), x);
  for (const bool share : {true, false}) {
    const Columns y = product_on(rows, devices(3, {}, share), x, {.weights = {2, 1, 3}});
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::uint32_t i = 0; i < n; ++i) {
        ASSERT_EQ(y[c][i], i >= first && i < end ? whole[c][i] : 0.0F) << i;
      }
    }
  }
}

TEST(SplitProduct, SixteenBitFormatsAgreeWithOneDevice) {
  const Columns x = wave(3);
  for (const Storage storage : {Storage::dense16, Storage::tiled16, Storage::sym16}) {
    PackedMatrix::Options options;
    options.order = patch_order(room().form_factors);
    options.block = 128;
    const PackedMatrix f(room().form_factors, room().area, storage, options);
    std::vector<std::vector<double>> exact;
    exact_product(f, x, exact);
    const Columns alone = product_on(f, openmp(), x);
    for (const bool share : {true, false}) {
      const SplitOptions split{.weights = {3, 1, 2}};
      const Columns y = product_on(f, devices(3, {}, share), x, split);
      EXPECT_LT(largest_error(y, exact), kernel_bound) << name(storage);
      EXPECT_EQ(product_on(f, devices(3, {}, share), x, split), y) << "the same split, the same bits";
      if (storage == Storage::sym16) continue;
      EXPECT_EQ(y, alone);  // a row's sum does not depend on who makes it
    }
    EXPECT_LT(largest_error(product_on(f, devices(2), x, {.weights = {0, 1}}), exact), kernel_bound) << name(storage);
  }
}

TEST(SplitProduct, ColumnsCanChange) {
  const Columns x = wave(7);
  Scheduler scheduler(room().form_factors, devices(3), 7, {.weights = {1, 1, 1}});
  Scheduler alone(room().form_factors, openmp(), 7);
  for (const std::uint32_t columns : {3U, 7U, 1U}) {
    scheduler.use_columns(columns);
    alone.use_columns(columns);
    const Columns some(x.begin(), x.begin() + columns);
    EXPECT_EQ(applied(scheduler, some), applied(alone, some));
  }
}

/// The partial sums of sym16 move with the number of columns; slots of blocks that are empty, or another device's, are
/// zero for every one.
TEST(SplitProduct, ColumnsOfSym16CanChange) {
  constexpr std::uint32_t n = 640;  // two rooms that do not see each other: blocks between them are empty
  FormFactorMatrix f(n);
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::uint32_t j = 0; j < n; ++j) f.row(i)[j] = (i < n / 2) == (j < n / 2) && i != j ? 2.0F / n : 0.0F;
  }
  const std::vector<double> area(n, 1.0);
  PackedMatrix::Options options;
  options.block = 128;
  const PackedMatrix packed(f, area, Storage::sym16, options);
  Columns x(7, std::vector<float>(n));
  for (std::size_t c = 0; c < x.size(); ++c) {
    for (std::uint32_t i = 0; i < n; ++i) x[c][i] = static_cast<float>(1 + (i * (c + 3)) % 17);
  }
  Scheduler one(packed, openmp(), 7), three(packed, devices(3), 7, {.weights = {1, 1, 1}});
  for (Scheduler* scheduler : {&one, &three}) {
    for (const std::uint32_t columns : {7U, 3U, 1U, 7U}) {
      scheduler->use_columns(columns);
      const Columns some(x.begin(), x.begin() + columns);
      std::vector<std::vector<double>> exact;
      exact_product(packed, some, exact);
      const Columns y = applied(*scheduler, some);
      for (std::size_t c = 0; c < columns; ++c) {
        for (std::uint32_t i = 0; i < n; ++i) {
          ASSERT_NEAR(static_cast<double>(y[c][i]), exact[c][i], 1e-4) << columns << " columns";
        }
      }
    }
  }
}

TEST(SplitProduct, EachDeviceMultipliesItsOwnRowsOnly) {
  const std::vector<std::shared_ptr<Counts>> counts{std::make_shared<Counts>(), std::make_shared<Counts>()};
  Scheduler scheduler(room().form_factors, devices(2, counts, false), 3, {.weights = {1, 3}});
  const std::uint64_t rows = room().form_factors.bytes();
  EXPECT_EQ(scheduler.uploaded_bytes(), rows);
  EXPECT_NEAR(static_cast<double>(counts[0]->uploaded_bytes), 0.25 * static_cast<double>(rows),
              0.05 * static_cast<double>(rows));
  EXPECT_EQ(counts[0]->uploaded_bytes + counts[1]->uploaded_bytes, rows);
  static_cast<void>(applied(scheduler, wave(3)));
  // The other device has x and gives its rows of y; everything else is on the first.
  EXPECT_EQ(counts[1]->downloads, 1U);
  EXPECT_THAT(scheduler.device_ids(), ElementsAre("a", "b"));
  const std::vector<DeviceShare> shares = scheduler.shares();
  ASSERT_EQ(shares.size(), 2U);
  EXPECT_EQ(shares[0].bytes + shares[1].bytes, rows);
  EXPECT_NEAR(shares[1].share, 0.75, 0.05);
  EXPECT_GT(shares[1].bytes_per_second, 0);
  EXPECT_EQ(Scheduler(room().form_factors, openmp(), 3).shares().size(), 0U);
}

/// The twin: a row range that is lost, or done with another x, is seen by the test above.
TEST(SplitProduct, TwinABrokenPartIsSeen) {
  const Columns x = wave(3);
  const Columns alone = product_on(room().form_factors, openmp(), x);
  std::vector<std::vector<double>> exact;
  exact_product(room().form_factors, x, exact);
  ASSERT_LT(largest_error(alone, exact), kernel_bound);
  const auto with_fate = [&](const std::string& operation) {
    const auto fate = std::make_shared<Fate>();
    fate->way = Fate::Way::skips;
    const auto on = [&] {
      std::vector<std::unique_ptr<Device>> both = devices(1);
      both.push_back(std::make_unique<FailingDevice>(fate));
      return both;
    };
    Scheduler scheduler(room().form_factors, on(), 3, {.weights = {1, 1}});
    const std::uint64_t placed = fate->calls;
    EXPECT_EQ(applied(scheduler, x), alone);
    for (std::uint64_t k = placed; k < fate->calls; ++k) {
      if (fate->operations[k] == operation) fate->fails_at = fate->calls + (k - placed);
    }
    Columns other = x;
    for (std::vector<float>& column : other) {
      for (float& value : column) value += 1;
    }
    std::vector<std::vector<double>> expected;
    exact_product(room().form_factors, other, expected);
    return largest_error(applied(scheduler, other), expected);
  };
  EXPECT_GT(with_fate("launch matvec"), 0.1);
  EXPECT_GT(with_fate("upload"), 0.1);
}

/// Rows in two devices' sums at once: the blocks of sym16 are added, and one that is doubled shows.
TEST(SplitProduct, TwinADoubledBlockIsSeen) {
  const Columns x = wave(3);
  PackedMatrix::Options options;
  options.block = 128;
  const PackedMatrix f(room().form_factors, room().area, Storage::sym16, options);
  std::vector<std::vector<double>> exact;
  exact_product(f, x, exact);
  /// A part that takes a block more than it is told.
  struct Greedy final : PartProduct {
    Greedy(std::unique_ptr<PartProduct> part, Device& device, const VectorArguments& shape, std::uint32_t groups)
        : PartProduct(device, shape, groups), inner(std::move(part)) {}
    bool in_place() const override { return true; }
    void take(std::uint32_t first, std::uint32_t end) override { inner->take(first == 0 ? 0 : first - 1, end); }
    std::uint64_t needed_bytes() const override { return inner->needed_bytes(); }
    void place() override { inner->place(); }
    void use(const VectorArguments& shape, std::uint32_t groups) override { inner->use(shape, groups); }
    void apply(Buffer& from, Buffer& to) override { inner->apply(from, to); }
    std::vector<Buffer*> panel_buffers() const override { return {}; }
    Storage storage() const override { return inner->storage(); }
    std::uint64_t bytes() const override { return inner->bytes(); }
    void exact(const Columns& from, std::vector<std::vector<double>>& to) const override { inner->exact(from, to); }
    std::unique_ptr<Kernel> compile_multiply() override { return nullptr; }
    std::unique_ptr<PartProduct> inner;
  };
  for (const bool greedy : {false, true}) {
    const auto owned = devices(2);
    VectorArguments shape;
    shape.n = f.size();
    shape.vector_stride = f.stride();
    shape.columns = 3;
    shape.blocks = (shape.n + reduction_block - 1) / reduction_block;
    shape.blocks_per_group = 16;
    const MakePart make = [&](Device& device, const VectorArguments& of,
                              std::uint32_t groups) -> std::unique_ptr<PartProduct> {
      auto part = make_part(f, device, of, groups);
      if (!greedy) return part;
      return std::make_unique<Greedy>(std::move(part), device, of, groups);
    };
    SplitProduct product(division_of(f), make, {owned[0].get(), owned[1].get()}, shape, 1, {.weights = {1, 1}});
    product.place();
    std::vector<float> ordered(std::size_t{3} * f.stride()), got(ordered.size());
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t k = 0; k < f.size(); ++k) ordered[c * f.stride() + k] = x[c][f.order()[k]];
    }
    const auto bytes = ordered.size() * sizeof(float);
    const auto in = owned[0]->allocate(bytes), out = owned[0]->allocate(bytes);
    owned[0]->queue().upload(*in, 0, std::as_bytes(std::span(ordered)));
    product.apply(*in, *out);
    owned[0]->queue().download(*out, 0, std::as_writable_bytes(std::span(got)));
    Columns y(3, std::vector<float>(f.size()));
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t k = 0; k < f.size(); ++k) y[c][f.order()[k]] = got[c * f.stride() + k];
    }
    if (greedy) {
      EXPECT_GT(largest_error(y, exact), 100 * kernel_bound);
    } else {
      EXPECT_LT(largest_error(y, exact), kernel_bound);
    }
  }
}

TEST(SplitProduct, RowsMoveToWhoIsFasterAndNothingElseChanges) {
  const Columns x = wave(3);
  const Columns alone = product_on(room().form_factors, openmp(), x);
  for (const bool share : {true, false}) {
    const std::vector<std::shared_ptr<Counts>> counts{std::make_shared<Counts>(), std::make_shared<Counts>()};
    SplitOptions split;
    split.said = [](std::size_t device, std::uint64_t bytes, double) {
      return static_cast<double>(bytes) * (device == 0 ? 1e-9 : 4e-9);
    };
    Scheduler scheduler(room().form_factors, devices(2, counts, share), 3, split);
    EXPECT_NEAR(scheduler.shares()[0].share, 0.5, 0.02);
    for (int k = 0; k < 8; ++k) ASSERT_EQ(applied(scheduler, x), alone) << k;
    EXPECT_NEAR(scheduler.shares()[0].share, 0.8, 0.02);
    EXPECT_EQ(scheduler.shares()[0].moves, 1U);
    if (share) {
      EXPECT_EQ(scheduler.uploaded_bytes(), 0U);
    } else {  // of the rows that moved not much more went over the bus
      EXPECT_LT(scheduler.uploaded_bytes(), room().form_factors.bytes() * 3 / 2);
    }
  }
}

TEST(SplitProduct, KeepsToEachDevicesMemory) {
  const std::uint64_t all = room().form_factors.bytes();
  const std::vector<std::shared_ptr<Counts>> counts{std::make_shared<Counts>(), std::make_shared<Counts>()};
  const auto limited = [](std::uint64_t bytes) {
    return [bytes](DeviceInfo& info) {
      info.type = DeviceType::gpu;
      info.memory_bytes = bytes;
    };
  };
  const std::uint64_t vectors = 16 * 3 * 4 * (room().form_factors.size() + 16);
  counts[0]->describe = limited(vectors + all / 5);
  counts[1]->describe = limited(all * 2);
  Scheduler scheduler(room().form_factors, devices(2, counts, false), 3);
  EXPECT_LT(scheduler.shares()[0].share, 0.2);
  EXPECT_GT(scheduler.shares()[0].share, 0.1);
  counts[0]->describe = limited(vectors + all / 5);
  counts[1]->describe = limited(all / 3);
  try {
    Scheduler(room().form_factors, devices(2, counts, false), 3);
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::limit);
    EXPECT_THAT(error.what(), HasSubstr("no room for"));
  }
}

/// A device beside the first that is lost at any of its calls: the product comes out all the same.
TEST(SplitProduct, TheOthersTakeWhatALostDeviceHad) {
  const Columns x = wave(2), one(x.begin(), x.begin() + 1);
  const Columns alone = product_on(room().form_factors, openmp(), x);
  const auto run = [&](const std::shared_ptr<Fate>& fate) {
    std::vector<std::unique_ptr<Device>> on = devices(3);
    on[1] = std::make_unique<FailingDevice>(fate);
    auto scheduler =
        std::make_unique<Scheduler>(room().form_factors, std::move(on), 2, SplitOptions{.weights = {1, 1, 1}});
    EXPECT_EQ(applied(*scheduler, x), alone) << fate->fails_at;
    scheduler->use_columns(1);
    EXPECT_EQ(applied(*scheduler, one)[0], alone[0]) << fate->fails_at;
    return scheduler;
  };
  const auto whole = std::make_shared<Fate>();
  EXPECT_THAT(run(whole)->failures(), IsEmpty());
  ASSERT_GT(whole->calls, 8U);
  for (std::uint64_t k = 0; k < whole->calls; ++k) {
    const auto fate = std::make_shared<Fate>();
    fate->fails_at = k;
    const auto scheduler = run(fate);
    ASSERT_EQ(scheduler->failures().size(), 1U) << k;
    EXPECT_EQ(scheduler->failures()[0].device, "failing");
    EXPECT_THAT(scheduler->failures()[0].reason, HasSubstr("lost (-4)"));
    EXPECT_THAT(scheduler->device_ids(), ElementsAre("a", "c"));
    EXPECT_EQ(scheduler->shares()[1].share, 0.0);
    EXPECT_EQ(fate->live_buffers, 0);
    EXPECT_EQ(fate->live_kernels, 0);
  }
}

TEST(SplitProduct, ALimitOfOneDeviceLeavesItOut) {
  const std::vector<std::shared_ptr<Counts>> counts{std::make_shared<Counts>(), std::make_shared<Counts>()};
  counts[1]->describe = [](DeviceInfo& info) { info.max_buffer_bytes = 100; };
  Scheduler scheduler(room().form_factors, devices(2, counts, false), 3);
  EXPECT_THAT(scheduler.device_ids(), ElementsAre("a"));
  ASSERT_EQ(scheduler.failures().size(), 1U);
  EXPECT_THAT(scheduler.failures()[0].reason, HasSubstr("one row"));
  EXPECT_EQ(applied(scheduler, wave(3)), product_on(room().form_factors, openmp(), wave(3)));
}

TEST(Worker, CarriesWhatAJobThrows) {
  int done = 0;  // outlives the worker, whose last job it is in
  Worker worker;
  worker.wait();
  for (int k = 0; k < 100; ++k) {
    worker.start([&] { ++done; });
    worker.wait();
  }
  EXPECT_EQ(done, 100);
  worker.start([] { throw Error(ErrorKind::device, "gone"); });
  EXPECT_THROW(worker.wait(), Error);
  EXPECT_NO_THROW(worker.wait());
  worker.start([&] { ++done; });  // and ends with a job in hand
}

}  // namespace
}  // namespace interflect
