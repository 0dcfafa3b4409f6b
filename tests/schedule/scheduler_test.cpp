#include "interflect/schedule/scheduler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <cstdlib>
#include <functional>

#include "interflect/base/error.h"
#include "schedule/counting_device.h"
#include "schedule/failing_device.h"

namespace interflect {
namespace {

using namespace test;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

FormFactorMatrix matrix(std::uint32_t n, std::uint64_t panel_bytes = std::uint64_t{1} << 30) {
  FormFactorMatrix f(n, panel_bytes);
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::uint32_t j = 0; j < n; ++j) f.row(i)[j] = (1.0F + std::sin(static_cast<float>(3 * i + 7 * j))) / 100.0F;
  }
  return f;
}

Columns wave(std::uint32_t n, std::size_t columns) {
  Columns x(columns, std::vector<float>(n));
  for (std::size_t c = 0; c < columns; ++c) {
    for (std::uint32_t i = 0; i < n; ++i) x[c][i] = std::cos(static_cast<float>(i + 11 * c));
  }
  return x;
}

void expect_error(ErrorKind kind, const std::string& part, const std::function<void()>& act) {
  try {
    act();
    FAIL() << "no error with " << part;
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind) << error.what();
    EXPECT_THAT(error.what(), HasSubstr(part));
  }
}

/// y = F x in double: what apply() must come near and exact_product() must match.
std::vector<std::vector<double>> product(const FormFactorMatrix& f, const Columns& x) {
  std::vector<std::vector<double>> y(x.size(), std::vector<double>(f.size()));
  for (std::size_t c = 0; c < x.size(); ++c) {
    for (std::uint32_t i = 0; i < f.size(); ++i) {
      for (std::uint32_t j = 0; j < f.size(); ++j) {
        y[c][i] += static_cast<double>(f.row(i)[j]) * static_cast<double>(x[c][j]);
      }
    }
  }
  return y;
}

TEST(Scheduler, AppliesFPanelByPanel) {
  for (const std::uint32_t n : {1U, 16U, 17U, 100U, 257U}) {
    const Columns x = wave(n, 3);
    for (const std::uint64_t panel_bytes : {1ULL, 5000ULL, 1ULL << 30}) {
      if (panel_bytes == 1 && n > 100) continue;  // each panel maps 2 MiB
      for (const bool share : {true, false}) {
        const FormFactorMatrix f = matrix(n, panel_bytes);
        const auto counts = std::make_shared<Counts>();
        counts->may_share = share;
        Scheduler scheduler(f, counting(counts), 3);
        EXPECT_EQ(scheduler.uploaded_bytes(), share ? 0 : f.bytes());
        Vector in = scheduler.vector(), out = scheduler.vector();
        scheduler.upload(in, x);
        scheduler.apply(in, out);
        Columns y;
        scheduler.download(out, y);
        const auto exact = product(f, x);
        for (std::size_t c = 0; c < 3; ++c) {
          for (std::uint32_t i = 0; i < n; ++i) ASSERT_NEAR(static_cast<double>(y[c][i]), exact[c][i], 1e-5);
        }
        EXPECT_EQ(counts->launches["matvec"], f.panels().size());
        EXPECT_EQ(scheduler.products(), 1U);
      }
    }
  }
}

TEST(Scheduler, UsesFewerColumnsThanItWasMadeWith) {
  const FormFactorMatrix f = matrix(300);
  const Columns x = wave(300, 24);
  const auto counts = std::make_shared<Counts>();
  Scheduler scheduler(f, counting(counts), 24);
  EXPECT_EQ(scheduler.most_columns(), 24U);
  const auto expected = product(f, x);
  for (const std::uint32_t columns : {24U, 3U, 7U, 3U, 24U}) {
    scheduler.use_columns(columns);
    ASSERT_EQ(scheduler.columns(), columns);
    Vector in = scheduler.vector(), out = scheduler.vector();
    const Columns first(x.begin(), x.begin() + columns);
    scheduler.upload(in, first);
    scheduler.apply(in, out);
    Columns y;
    scheduler.download(out, y);
    std::vector<std::vector<double>> exact;
    scheduler.exact_product(first, exact);
    ASSERT_EQ(y.size(), columns);
    for (std::size_t c = 0; c < columns; ++c) {
      for (std::size_t i = 0; i < 300; ++i) {
        ASSERT_NEAR(static_cast<double>(y[c][i]), expected[c][i], 1e-5) << columns << " columns";
        ASSERT_NEAR(exact[c][i], expected[c][i], 1e-12);
      }
    }
  }
  expect_error(ErrorKind::internal, "1 to 24 were placed", [&] { scheduler.use_columns(25); });
  expect_error(ErrorKind::internal, "1 to 24 were placed", [&] { scheduler.use_columns(0); });
}

TEST(Scheduler, ANumberOfColumnsThatCannotBeCompiledChangesNothing) {
  const FormFactorMatrix f = matrix(50);
  const Columns x = wave(50, 3);
  const auto fate = std::make_shared<Fate>();
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(std::make_unique<FailingDevice>(fate));
  Scheduler scheduler(f, std::move(devices), 24);
  fate->fails_at = fate->calls;
  expect_error(ErrorKind::device, "kernel: lost", [&] { scheduler.use_columns(3); });
  fate->fails_at = Fate{}.fails_at;
  EXPECT_EQ(scheduler.columns(), 24U);
  scheduler.use_columns(3);
  Vector in = scheduler.vector(), out = scheduler.vector();
  scheduler.upload(in, x);
  scheduler.apply(in, out);
  Columns y;
  scheduler.download(out, y);
  const auto expected = product(f, x);
  ASSERT_EQ(y.size(), 3U);
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < 50; ++i) ASSERT_NEAR(static_cast<double>(y[c][i]), expected[c][i], 1e-5);
  }
}

TEST(Scheduler, ExactProductIsInDoubleAndIndependentOfThreads) {
  for (const std::uint32_t n : {1U, 7U, 16U, 33U, 300U}) {
    const FormFactorMatrix f = matrix(n, 10'000);
    for (const std::size_t columns : {1U, 2U, 3U, 4U, 7U}) {
      const Columns x = wave(n, columns);
      Scheduler scheduler(f, openmp(), static_cast<std::uint32_t>(columns));
      std::vector<std::vector<double>> y, again;
      scheduler.exact_product(x, y);
      const auto exact = product(f, x);
      ASSERT_EQ(y.size(), columns);
      for (std::size_t c = 0; c < columns; ++c) {
        for (std::uint32_t i = 0; i < n; ++i) ASSERT_NEAR(y[c][i], exact[c][i], 1e-14) << "n " << n;
      }
      const int before = ::omp_get_max_threads();
      ::omp_set_num_threads(3);
      scheduler.exact_product(x, again);
      ::omp_set_num_threads(before);
      EXPECT_EQ(y, again);
      EXPECT_EQ(scheduler.products(), 2U);
    }
  }
}

TEST(Scheduler, VectorsComeBackAsTheyWent) {
  const FormFactorMatrix f = matrix(37);
  Scheduler scheduler(f, openmp(), 2);
  EXPECT_EQ(scheduler.stride(), 48U);
  EXPECT_EQ(scheduler.blocks(), 1U);
  Vector v = scheduler.vector();
  Columns back;
  scheduler.download(v, back);
  EXPECT_EQ(back, Columns(2, std::vector<float>(37)));  // zeroed
  const Columns x = wave(37, 2);
  scheduler.upload(v, x);
  scheduler.download(v, back);
  EXPECT_EQ(back, x);
}

TEST(Scheduler, DotReduceAndAxpbyByScalarsThatStayOnTheDevice) {
  const std::uint32_t n = 2500;
  const FormFactorMatrix f(n, 1 << 20);
  Scheduler scheduler(f, openmp(), 2);
  const Columns x = wave(n, 2);
  Vector a = scheduler.vector(), b = scheduler.vector(), sums = scheduler.sums();
  scheduler.upload(a, x);
  scheduler.upload(b, Columns(2, std::vector<float>(n, 1.0F)));
  scheduler.run(scheduler.kernel("dot"), {&a, &a, &sums}, "x x", 3);
  scheduler.run(scheduler.kernel("reduce"), {&sums}, "sum", 3, slot::axpby_a);
  scheduler.run(scheduler.kernel("axpby"), {&a, &b, &sums}, "b = (x, x) x + 0 b");
  Columns y;
  scheduler.download(b, y);
  for (std::size_t c = 0; c < 2; ++c) {
    double xx = 0;
    for (const float v : x[c]) xx += static_cast<double>(v) * static_cast<double>(v);
    for (std::uint32_t i = 0; i < n; ++i) {
      ASSERT_NEAR(static_cast<double>(y[c][i]), xx * static_cast<double>(x[c][i]), 1e-5 * xx);
    }
  }
}

TEST(Scheduler, RefusesWhatItCannotPlaceBeforeItAllocates) {
  const FormFactorMatrix f = matrix(200, 20'000);  // 832 bytes a row
  const auto counts = std::make_shared<Counts>();
  counts->may_share = false;
  counts->describe = [](DeviceInfo& info) { info.memory_bytes = 100'000; };
  expect_error(ErrorKind::limit, "openmp: ", [&] { Scheduler(f, counting(counts), 3); });
  counts->describe = [](DeviceInfo& info) { info.max_buffer_bytes = 831; };
  expect_error(ErrorKind::limit, "one row", [&] { Scheduler(f, counting(counts), 3); });
  counts->describe = [](DeviceInfo& info) { info.max_buffer_bytes = 2400; };
  expect_error(ErrorKind::limit, "a vector of 2496 bytes", [&] { Scheduler(f, counting(counts), 3); });
  EXPECT_EQ(counts->allocations, 0U);
  EXPECT_EQ(counts->uploads, 0U);
  counts->describe = [](DeviceInfo& info) { info.memory_bytes = info.max_buffer_bytes = 0; };  // unknown
  EXPECT_NO_THROW(Scheduler(f, counting(counts), 3));
}

TEST(Scheduler, AProcessorThatCopiesFNeedsTheHostsMemoryToo) {
  const FormFactorMatrix f = matrix(300);
  const auto counts = std::make_shared<Counts>();
  counts->may_share = false;
  ASSERT_EQ(::setenv("INTERFLECT_MEMORY", "300K", 1), 0);
  expect_error(ErrorKind::limit, "may be used", [&] { Scheduler(f, counting(counts), 3); });
  counts->describe = [](DeviceInfo& info) { info.type = DeviceType::gpu; };
  EXPECT_NO_THROW(Scheduler(f, counting(counts), 3));
  ASSERT_EQ(::unsetenv("INTERFLECT_MEMORY"), 0);
}

/// What a device with limits makes of F: the buffers' sizes, and whether y = F x is right.
struct Cut {
  std::vector<std::size_t> bytes;
  std::uint64_t launches = 0, shares = 0;
};

Cut cut(const FormFactorMatrix& f, bool share, const std::function<void(DeviceInfo&)>& describe) {
  const auto counts = std::make_shared<Counts>();
  counts->may_share = share;
  counts->describe = describe;
  Scheduler scheduler(f, counting(counts), 2);
  const Columns x = wave(f.size(), 2);
  Vector in = scheduler.vector(), out = scheduler.vector();
  scheduler.upload(in, x);
  scheduler.apply(in, out);
  Columns y;
  scheduler.download(out, y);
  const auto exact = product(f, x);
  for (std::size_t c = 0; c < 2; ++c) {
    for (std::uint32_t i = 0; i < f.size(); ++i) EXPECT_NEAR(static_cast<double>(y[c][i]), exact[c][i], 1e-5) << i;
  }
  Cut result;
  for (const Buffer* buffer : scheduler.panel_buffers()) result.bytes.push_back(buffer->size());
  result.launches = counts->launches["matvec"];
  result.shares = counts->shares;
  return result;
}

TEST(Scheduler, CutsPanelsThatExceedTheLargestBuffer) {
  const FormFactorMatrix f = matrix(200);   // one panel of 200 rows of 832 bytes
  for (const bool share : {true, false}) {  // what may not be so large is not shared either
    const Cut found = cut(f, share, [](DeviceInfo& info) { info.max_buffer_bytes = 832 * 70 + 5; });
    EXPECT_THAT(found.bytes, ElementsAre(832 * 64, 832 * 64, 832 * 64, 832 * 8));  // whole groups of 16 rows
    EXPECT_EQ(found.launches, 4U);
    EXPECT_EQ(found.shares, 0U);
  }
  const Cut few = cut(matrix(100), false, [](DeviceInfo& info) { info.max_buffer_bytes = 448 * 9; });
  EXPECT_EQ(few.bytes.size(), 12U);  // nine rows each, fewer than a group's
  EXPECT_EQ(few.bytes.back(), 448U);
}

TEST(Scheduler, CutsPanelsThatExceedTheWorkGroupsOfALaunch) {
  const FormFactorMatrix f = matrix(200, 832 * 90);  // panels of 90, 90 and 20 rows
  const auto limited = [](DeviceInfo& info) {
    info.max_groups = 3;
    info.rows_per_group = 8;
  };
  const Cut found = cut(f, true, limited);
  EXPECT_EQ(found.shares, 1U);  // the last panel
  EXPECT_THAT(found.bytes,
              ElementsAre(832 * 24, 832 * 24, 832 * 24, 832 * 18, 832 * 24, 832 * 24, 832 * 24, 832 * 18, 832 * 20));
}

TEST(Scheduler, VectorKernelsKeepToTheWorkGroupsOfALaunch) {
  const FormFactorMatrix f(5000, 1 << 20);
  const auto counts = std::make_shared<Counts>();
  counts->describe = [](DeviceInfo& info) {
    info.blocks_per_group = 1;
    info.max_groups = 400;
  };
  Scheduler many(f, counting(counts), 3);
  Vector a = many.vector(), sums = many.sums();
  many.run(many.kernel("dot"), {&a, &a, &sums}, "x x", 0);
  EXPECT_EQ(counts->groups, 15U);
  counts->describe = [](DeviceInfo& info) {
    info.blocks_per_group = 1;
    info.max_groups = 7;
    info.rows_per_group = 64;
  };
  Scheduler few(f, counting(counts), 3);
  few.run(few.kernel("dot"), {&a, &a, &sums}, "x x", 0);
  EXPECT_EQ(counts->groups, 5U);
}

TEST(Scheduler, RefusesOtherThanOneDeviceAndEmptySystems) {
  const FormFactorMatrix f = matrix(5);
  expect_error(ErrorKind::usage, "0 devices", [&] { Scheduler(f, {}, 3); });
  auto two = openmp();
  two.push_back(open_device("openmp"));
  expect_error(ErrorKind::usage, "2 devices", [&] { Scheduler(f, std::move(two), 3); });
  expect_error(ErrorKind::usage, "no columns", [&] { Scheduler(f, openmp(), 0); });
  const FormFactorMatrix none;
  expect_error(ErrorKind::usage, "no patches", [&] { Scheduler(none, openmp(), 3); });
  EXPECT_THAT(Scheduler(f, openmp(), 3).device_ids(), ElementsAre("openmp"));
}

TEST(Scheduler, RefusesColumnsOfAnotherShape) {
  const FormFactorMatrix f = matrix(5);
  Scheduler scheduler(f, openmp(), 2);
  Vector v = scheduler.vector();
  std::vector<std::vector<double>> y;
  expect_error(ErrorKind::internal, "number of columns", [&] { scheduler.upload(v, wave(5, 3)); });
  expect_error(ErrorKind::internal, "length", [&] { scheduler.upload(v, wave(4, 2)); });
  expect_error(ErrorKind::internal, "number of columns", [&] { scheduler.exact_product(wave(5, 1), y); });
  expect_error(ErrorKind::internal, "length", [&] { scheduler.exact_product(wave(6, 2), y); });
  expect_error(ErrorKind::device, "unknown kernel", [&] { static_cast<void>(scheduler.kernel("nonsense")); });
}

TEST(Scheduler, LaunchesInTheShapeThatTheDeviceNames) {
  const FormFactorMatrix f(5000, 1 << 20);
  for (const std::uint32_t blocks : {16U, 1U}) {
    const auto counts = std::make_shared<Counts>();
    counts->describe = [&](DeviceInfo& info) { info.blocks_per_group = blocks; };
    Scheduler scheduler(f, counting(counts), 3);
    Vector a = scheduler.vector(), sums = scheduler.sums();
    scheduler.upload(a, wave(5000, 3));
    scheduler.run(scheduler.kernel("dot"), {&a, &a, &sums}, "x x", 0);
    std::vector<float> head(sums_size(3, scheduler.blocks()));
    scheduler.download(sums, head);
    static std::vector<float> first = head;
    EXPECT_EQ(head, first);  // the same bits in any shape
    EXPECT_EQ(counts->groups, blocks == 1 ? 15U : 1U);
  }
}

}  // namespace
}  // namespace interflect
