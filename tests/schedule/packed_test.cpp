// F in 16 bits through the Scheduler: the product against fp64, panels, order of the patches, bits that repeat.
#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <numeric>

#include "interflect/base/error.h"
#include "interflect/formfactor/patch_order.h"
#include "interflect/schedule/scheduler.h"
#include "interflect/schedule/storage_choice.h"
#include "schedule/counting_device.h"
#include "schedule/products.h"
#include "solver/room.h"

namespace interflect {
namespace {

using namespace test;

constexpr Storage formats[] = {Storage::dense16, Storage::tiled16, Storage::sym16};

const Room& room() {
  static const Room made = make_room(9, 4);
  return made;
}

std::uint32_t patches() {
  return room().form_factors.size();
}

Columns wave(std::size_t columns) {
  Columns x(columns, std::vector<float>(patches()));
  for (std::size_t c = 0; c < columns; ++c) {
    for (std::uint32_t i = 0; i < patches(); ++i) x[c][i] = 1.5F + std::cos(static_cast<float>(i + 11 * c));
  }
  return x;
}

PackedMatrix packed(Storage storage, std::uint64_t panel_bytes = std::uint64_t{1} << 30, std::uint32_t block = 128) {
  PackedMatrix::Options options;
  options.order = patch_order(room().form_factors);
  options.block = block;
  options.max_panel_bytes = panel_bytes;
  return {room().form_factors, room().area, storage, std::move(options)};
}

Columns product_of(const PackedMatrix& f, const Columns& x) {
  Scheduler scheduler(f, openmp(), static_cast<std::uint32_t>(x.size()));
  return applied(scheduler, x);
}

constexpr double kernel_bound = 2e-5;           // fp32 sums of a few hundred positive terms, far from it
constexpr double rounding_bound = 0x1p-11 * 2;  // of one element; a sum's is smaller

TEST(PackedScheduler, EveryFormatGivesTheProduct) {
  for (const std::size_t columns : {1U, 3U, 4U, 7U}) {
    const Columns x = wave(columns);
    std::vector<std::vector<double>> exact;
    exact_product(room().form_factors, x, exact);
    for (const Storage storage : formats) {
      const PackedMatrix f = packed(storage);
      const Columns y = product_of(f, x);
      std::vector<std::vector<double>> rounded;
      exact_product(f, x, rounded);
      EXPECT_LT(largest_error(y, rounded), kernel_bound) << name(storage);
      EXPECT_LT(largest_error(y, exact), rounding_bound) << name(storage);
      EXPECT_GT(largest_error(y, exact), 1e-7) << name(storage) << " rounds, and that must show";
    }
  }
}

/// The twin: the bounds see a single form factor of 1,300,000 that is not there.
TEST(PackedScheduler, ALostElementIsSeen) {
  const Columns x = wave(3);
  std::vector<std::vector<double>> exact;
  exact_product(room().form_factors, x, exact);
  FormFactorMatrix damaged = repanelled(room().form_factors, std::uint64_t{1} << 30);
  const auto row = damaged.row(5);
  const auto largest = static_cast<std::uint32_t>(std::max_element(row.begin(), row.end()) - row.begin());
  row[largest] = 0;
  damaged.row(largest)[5] = 0;
  for (const Storage storage : formats) {
    EXPECT_GT(largest_error(product_of(PackedMatrix(damaged, room().area, storage), x), exact), rounding_bound);
  }
}

TEST(PackedScheduler, PanelsBlocksAndThreadsChangeNothingButRounding) {
  const Columns x = wave(3);
  for (const Storage storage : formats) {
    const Columns whole = product_of(packed(storage), x);
    EXPECT_EQ(product_of(packed(storage, 50'000), x), whole) << name(storage);
    const int before = ::omp_get_max_threads();
    for (const int threads : {1, 3}) {
      ::omp_set_num_threads(threads);
      EXPECT_EQ(product_of(packed(storage), x), whole) << name(storage) << " with " << threads << " threads";
    }
    ::omp_set_num_threads(before);
  }
  std::vector<std::vector<double>> exact;
  exact_product(packed(Storage::sym16), x, exact);
  for (const std::uint32_t block : {16U, 32U, 256U, 1024U}) {
    EXPECT_LT(largest_error(product_of(packed(Storage::sym16, 1 << 30, block), x), exact), kernel_bound) << block;
  }
}

TEST(PackedScheduler, TheExactProductIsIndependentOfThreads) {
  const Columns x = wave(5);
  const int before = ::omp_get_max_threads();
  for (const Storage storage : formats) {
    const PackedMatrix f = packed(storage, 50'000);
    std::vector<std::vector<double>> one, three;
    ::omp_set_num_threads(1);
    exact_product(f, x, one);
    ::omp_set_num_threads(3);
    exact_product(f, x, three);
    EXPECT_EQ(one, three) << name(storage);
  }
  ::omp_set_num_threads(before);
}

TEST(PackedScheduler, PanelsAreSharedOrCutAndUploaded) {
  for (const Storage storage : formats) {
    const PackedMatrix f = packed(storage);
    const auto counts = std::make_shared<Counts>();
    counts->may_share = false;
    const Scheduler scheduler(f, counting(counts), 3);
    EXPECT_GE(scheduler.uploaded_bytes(), f.bytes()) << name(storage);
    EXPECT_EQ(scheduler.storage(), storage);
    const auto sharing = std::make_shared<Counts>();
    sharing->may_share = true;
    const Scheduler in_place(f, counting(sharing), 3);
    EXPECT_LT(in_place.uploaded_bytes(), f.bytes() / 4) << name(storage) << ": index and scales only";
  }
}

TEST(StorageChoice, BySizeDeviceAndMemory) {
  DeviceInfo host;
  host.backend = "openmp";
  host.type = DeviceType::cpu;
  EXPECT_EQ(choose_storage(1312, host), Storage::dense32);
  EXPECT_EQ(choose_storage(17128, host), Storage::dense32) << "in place, and packing takes longer than one solve saves";
  DeviceInfo emulated = host;
  emulated.backend = "vulkan";
  EXPECT_EQ(choose_storage(1312, emulated), Storage::dense32);
  EXPECT_EQ(choose_storage(17128, emulated), Storage::sym16);
  DeviceInfo gpu;
  gpu.backend = "cuda";
  gpu.type = DeviceType::gpu;
  gpu.memory_bytes = std::uint64_t{8} << 30;
  EXPECT_EQ(choose_storage(17128, gpu), Storage::dense32);
  EXPECT_EQ(choose_storage(60000, gpu), Storage::sym16) << "14 GB do not fit";
  gpu.max_buffer_bytes = 100 << 20;
  EXPECT_EQ(choose_storage(60000, gpu), Storage::tiled16) << "and sym16's partial sums do not fit a buffer";
  gpu.max_buffer_bytes = 0;
  gpu.memory_bytes = 0;
  EXPECT_EQ(choose_storage(60000, gpu), Storage::dense32) << "not known: the device must refuse";
  EXPECT_EQ(storage_of("auto"), std::nullopt);
  EXPECT_EQ(storage_of("tiled16"), Storage::tiled16);
  EXPECT_THROW(static_cast<void>(storage_of("sym8")), Error);
}

}  // namespace
}  // namespace interflect
