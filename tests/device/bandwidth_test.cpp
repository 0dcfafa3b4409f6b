#include "interflect/device/bandwidth.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "device/broken_device.h"
#include "interflect/base/error.h"
#include "interflect/device/registry.h"

namespace interflect {
namespace {

constexpr std::uint64_t bytes = (std::uint64_t{5} << 20) + 192;  // two groups, the last one short

TEST(Bandwidth, RatesAreVerified) {
  const auto device = open_device("openmp");
  const std::vector<Rate> rates = measure_bandwidth(*device, bytes, 3);
  ASSERT_EQ(rates.size(), 2U);
  EXPECT_EQ(rates[0].what, "read");
  EXPECT_EQ(rates[0].bytes, bytes);
  EXPECT_EQ(rates[1].what, "copy");
  EXPECT_EQ(rates[1].bytes, 2 * bytes);
  for (const Rate& rate : rates) {
    EXPECT_TRUE(rate.verified) << rate.what << ": " << rate.reason;
    EXPECT_LE(rate.seconds_min, rate.seconds);
    EXPECT_LE(rate.seconds, rate.seconds_max);
    EXPECT_GT(rate.gb_per_s(), 0);
  }
}

TEST(Bandwidth, AReaderThatSkipsMemoryIsNotVerified) {
  test::ReplacedKernelDevice device(open_device("openmp"), "read",
                                    [](test::Launched& launch) { launch.buffers[1].assign(launch.groups, 1.0F); });
  const std::vector<Rate> rates = measure_bandwidth(device, bytes, 1);
  EXPECT_FALSE(rates.at(0).verified);
  EXPECT_THAT(rates[0].reason, testing::HasSubstr("sums"));
  EXPECT_TRUE(rates.at(1).verified);
}

TEST(Bandwidth, AReaderWhoseSumsChangeIsNotVerified) {
  float next = 0;
  test::ReplacedKernelDevice device(open_device("openmp"), "read",
                                    [&](test::Launched& launch) { launch.buffers[1].assign(launch.groups, next++); });
  const auto data = device.allocate(bytes);
  const Rate rate = read_bandwidth(device, *data, 2);
  EXPECT_FALSE(rate.verified);
  EXPECT_THAT(rate.reason, testing::HasSubstr("different sums"));
}

TEST(Bandwidth, ACopyThatLeavesSomethingOutIsNotVerified) {
  test::ReplacedKernelDevice device(open_device("openmp"), "copy", [](test::Launched& launch) {
    launch.buffers[1] = launch.buffers[0];
    launch.buffers[1].back() = 0;
  });
  const std::vector<Rate> rates = measure_bandwidth(device, bytes, 1);
  EXPECT_TRUE(rates.at(0).verified);
  EXPECT_FALSE(rates.at(1).verified);
}

TEST(Bandwidth, SeveralBuffersAreReadInOnePass) {
  const auto device = open_device("openmp");
  const auto a = device->allocate(bytes), b = device->allocate(640);
  fill(*device, *a, 1);
  fill(*device, *b, 2);
  Reader reader(*device, {a.get(), b.get()}, 2);
  EXPECT_EQ(reader.bytes(), bytes + 640);
  EXPECT_GT(reader.seconds(), 0);
  float total = 0;
  for (const float sum : reader.sums()) total += sum;
  EXPECT_EQ(total, static_cast<float>(bytes / 4 + 2 * 160));
  constexpr auto groups = (bytes / 64 + 65535) / 65536;
  EXPECT_NEAR(reader.bound(), static_cast<double>(bytes / 64 / groups + 40) * 0x1p-24, 1e-4);
}

TEST(Bandwidth, AQuickMeasurementIsVerifiedAndKeepsToTheDevicesLimits) {
  const auto device = open_device("openmp");
  const Rate rate = quick_read_bandwidth(*device);
  EXPECT_TRUE(rate.verified) << rate.reason;
  test::ReplacedKernelDevice small(open_device("openmp"), "read",
                                   [](test::Launched& launch) { launch.buffers[1].assign(launch.groups, 1.0F); });
  small.limit_buffers(100'000);
  const Rate broken = quick_read_bandwidth(small);
  EXPECT_EQ(broken.bytes, 99'968U);
  EXPECT_FALSE(broken.verified);
  DeviceInfo info;
  EXPECT_EQ(measurable_bytes(info, 1000), 960U);  // nothing is known of it
  info.memory_bytes = 1024;
  EXPECT_EQ(measurable_bytes(info, 1000), 256U);
  info.max_groups = 3;
  info.memory_bytes = std::uint64_t{1} << 40;
  EXPECT_EQ(measurable_bytes(info, std::uint64_t{1} << 40), std::uint64_t{12} << 20);
}

TEST(Bandwidth, SizesThatMeanNothingAreUsageErrors) {
  const auto device = open_device("openmp");
  EXPECT_THROW(static_cast<void>(measure_bandwidth(*device, 0, 1)), Error);
  EXPECT_THROW(static_cast<void>(measure_bandwidth(*device, 100, 1)), Error);
  EXPECT_THROW(static_cast<void>(measure_bandwidth(*device, 64, 0)), Error);
}

}  // namespace
}  // namespace interflect
