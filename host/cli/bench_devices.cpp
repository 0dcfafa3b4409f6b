#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <span>
#include <utility>

#include "bench_rows.h"
#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/bandwidth.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/registry.h"
#include "measurement.h"

namespace interflect::cli {

namespace {

using SharedDevice = std::shared_ptr<Device>;

template <class T>
std::span<const std::byte> bytes_of(const T& block) {
  return std::as_bytes(std::span(&block, 1));
}

/// A kernel with its buffers and argument block, ready to be launched again and again.
class Launch {
 public:
  Launch(SharedDevice device, std::string_view kernel, std::vector<std::byte> arguments, std::uint32_t groups,
         std::vector<std::shared_ptr<Buffer>> buffers)
      : device_(std::move(device)),
        kernel_(device_->kernel(kernel, {})),
        arguments_(std::move(arguments)),
        groups_(groups),
        buffers_(std::move(buffers)) {
    for (const auto& buffer : buffers_) bound_.push_back(buffer.get());
  }

  /// Seconds per launch of `count` that are enqueued together.
  double seconds(int count) {
    const Timer timer;
    for (int k = 0; k < count; ++k) device_->queue().launch(*kernel_, groups_, bound_, arguments_, "Measure");
    device_->queue().wait();
    return timer.seconds() / count;
  }
  [[nodiscard]] std::vector<float> floats(std::size_t buffer, std::size_t count) {
    std::vector<float> values(count);
    device_->queue().download(*buffers_.at(buffer), 0, std::as_writable_bytes(std::span(values)));
    return values;
  }
  void put(std::size_t buffer, std::span<const float> values) {
    device_->queue().upload(*buffers_.at(buffer), 0, std::as_bytes(values));
  }

 private:
  SharedDevice device_;
  std::unique_ptr<Kernel> kernel_;
  std::vector<std::byte> arguments_;
  std::uint32_t groups_;
  std::vector<std::shared_ptr<Buffer>> buffers_;
  std::vector<Buffer*> bound_;
};

template <class Arguments>
std::vector<std::byte> block_of(const Arguments& arguments) {
  const auto bytes = bytes_of(arguments);
  return {bytes.begin(), bytes.end()};
}

constexpr std::uint64_t wanted_bytes = std::uint64_t{256} << 20;  // beyond any cache

/// Read: the best of the stream counts in every pass; the sums are held against the number of ones put in.
Timed reading(const SharedDevice& device, BenchRow& row) {
  row.bytes = measurable_bytes(device->info(), wanted_bytes);
  const std::shared_ptr<Buffer> ones = device->allocate(row.bytes);
  fill(*device, *ones, 1);
  const auto readers = std::make_shared<std::vector<Reader>>();
  for (const int streams : reader_streams) readers->emplace_back(*device, std::vector{ones.get()}, streams);
  return {.pass =
              [device, ones, readers] {
                double best = std::numeric_limits<double>::infinity();
                for (Reader& reader : *readers) best = std::min(best, reader.seconds());
                return best;
              },
          .verify =
              [device, ones, readers](BenchRow& judged) {
                const std::uint64_t floats = judged.bytes / sizeof(float);
                const auto count = static_cast<double>(floats);
                for (Reader& reader : *readers) {
                  double total = 0;
                  for (const float sum : reader.sums()) total += static_cast<double>(sum);
                  const double error = std::abs(total - count) / count;
                  judged.error = error <= judged.error ? judged.error : error;  // also takes a NaN
                }
                if (judged.error != 0) deny(judged, "the sums are not those of what was put in");
              }};
}

Timed copying(const SharedDevice& device, BenchRow& row) {
  const std::uint64_t bytes = measurable_bytes(device->info(), wanted_bytes);
  row.bytes = 2 * bytes;
  const std::shared_ptr<Buffer> from = device->allocate(bytes), to = device->allocate(bytes);
  fill(*device, *from, 1);
  fill(*device, *to, 0);
  const auto lines = static_cast<std::uint32_t>(bytes / 64);
  const std::uint32_t groups = stream_groups(device->info(), lines);
  const auto launch = std::make_shared<Launch>(device, "copy", block_of(StreamArguments{lines}), groups,
                                               std::vector<std::shared_ptr<Buffer>>{from, to});
  return {.pass = [launch] { return launch->seconds(1); },
          .verify =
              [device, to, launch](BenchRow& judged) {
                if (!filled_with(*device, *to, 1)) deny(judged, "the copy differs from what was copied");
              }};
}

/// The smallest launch, of a copy of one cache line.
Timed launching(const SharedDevice& device, int batch, int batches) {
  const std::shared_ptr<Buffer> from = device->allocate(64), to = device->allocate(64);
  fill(*device, *from, 3);
  const auto launch = std::make_shared<Launch>(device, "copy", block_of(StreamArguments{1}), 1,
                                               std::vector<std::shared_ptr<Buffer>>{from, to});
  return {.pass =
              [launch, batch, batches] {
                double seconds = 0;
                for (int k = 0; k < batches; ++k) seconds += launch->seconds(batch) / batches;
                return seconds;
              },
          .verify =
              [launch](BenchRow& judged) {
                if (launch->floats(1, 16) != std::vector<float>(16, 3)) deny(judged, "the launch did not do its work");
              }};
}

// Vector kernels: three columns of 2^20 elements, x and y between 0.5 and 1.5.

constexpr std::uint32_t vector_columns = 3, vector_n = 1U << 20, vector_blocks = vector_n / reduction_block;

std::vector<float> numbers(std::uint32_t seed) {
  std::vector<float> values(std::size_t{vector_columns} * vector_n);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto mixed = static_cast<std::uint32_t>(i + seed) * 2654435761U;
    values[i] = 0.5F + static_cast<float>(mixed >> 24) / 256.0F;
  }
  return values;
}

/// kernels/README.md's bound of the vector kernels.
double vector_bound() {
  const double rounding = (80.0 + 8.0 * (vector_blocks + 4.0)) * 0x1p-24;
  return rounding / (1 - rounding);
}

std::shared_ptr<Launch> vector_launch(const SharedDevice& device, std::string_view kernel) {
  const DeviceInfo& info = device->info();
  constexpr std::uint32_t items = vector_columns * vector_blocks;
  VectorArguments arguments{
      .n = vector_n, .vector_stride = vector_n, .columns = vector_columns, .blocks = vector_blocks};
  arguments.blocks_per_group = std::max(info.blocks_per_group, items / info.max_groups + 1);
  const std::uint32_t groups = (items + arguments.blocks_per_group - 1) / arguments.blocks_per_group;
  constexpr std::size_t bytes = std::size_t{vector_columns} * vector_n * sizeof(float);
  std::vector<std::shared_ptr<Buffer>> buffers{
      device->allocate(bytes), device->allocate(bytes),
      device->allocate(sums_size(vector_columns, vector_blocks) * sizeof(float))};
  auto launch = std::make_shared<Launch>(device, kernel, block_of(arguments), groups, std::move(buffers));
  launch->put(0, numbers(0));
  launch->put(1, numbers(77));
  return launch;
}

Timed dotting(const SharedDevice& device) {
  const std::shared_ptr<Launch> launch = vector_launch(device, "dot");
  const auto verify = [launch](BenchRow& judged) {
    const std::vector<float> x = numbers(0), y = numbers(77);
    const std::vector<float> sums = launch->floats(2, std::size_t{vector_columns} * (scalar_slots + vector_blocks));
    judged.bound = vector_bound();
    for (std::size_t c = 0; c < vector_columns; ++c) {
      double exact = 0, found = 0;
      for (std::size_t i = c * vector_n; i < (c + 1) * vector_n; ++i) {
        exact += static_cast<double>(x[i]) * static_cast<double>(y[i]);
      }
      const float* partial = sums.data() + std::size_t{vector_columns} * scalar_slots + c * vector_blocks;
      for (std::size_t k = 0; k < vector_blocks; ++k) found += static_cast<double>(partial[k]);
      const double error = std::abs(found - exact) / exact;
      judged.error = error <= judged.error ? judged.error : error;
    }
    if (!(judged.error <= judged.bound)) deny(judged, "differs from the fp64 reference");
  };
  return {.pass = [launch] { return launch->seconds(1); }, .verify = verify};
}

Timed adding(const SharedDevice& device) {
  const std::shared_ptr<Launch> launch = vector_launch(device, "axpby");
  constexpr float a = 0.75F, b = 0.25F;
  std::vector<float> slots(std::size_t{vector_columns} * scalar_slots);
  for (std::size_t c = 0; c < vector_columns; ++c) {
    slots[std::size_t{slot::axpby_a} * vector_columns + c] = a;
    slots[std::size_t{slot::axpby_b} * vector_columns + c] = b;
  }
  launch->put(2, slots);
  const auto verify = [launch](BenchRow& judged) {
    const std::vector<float> x = numbers(0), y = numbers(77);
    launch->put(1, y);  // the passes have changed it
    static_cast<void>(launch->seconds(1));
    const std::vector<float> found = launch->floats(1, y.size());
    judged.bound = vector_bound();
    for (std::size_t i = 0; i < y.size(); ++i) {
      const double exact =
          static_cast<double>(a) * static_cast<double>(x[i]) + static_cast<double>(b) * static_cast<double>(y[i]);
      const double error = std::abs(static_cast<double>(found[i]) - exact) / exact;
      judged.error = error <= judged.error ? judged.error : error;
    }
    if (!(judged.error <= judged.bound)) deny(judged, "differs from the fp64 reference");
  };
  return {.pass = [launch] { return launch->seconds(1); }, .verify = verify};
}

void add_device(std::vector<Measurement>& all, const std::string& id) {
  BenchRow row;
  row.device = id;
  SharedDevice device;
  const auto named = [&](const char* what) {
    row.what = what;
    return row;
  };
  try {
    device = open_device(id);
  } catch (const Error& error) {
    add(all, named("read"), [&]() -> Timed { throw error; });
    return;
  }
  const auto with_bytes = [&](const char* what, Timed (*prepare)(const SharedDevice&, BenchRow&)) {
    BenchRow filled = named(what);
    add(all, filled, [&] { return prepare(device, filled); });
    all.back().row.bytes = filled.bytes;
  };
  with_bytes("read", &reading);
  with_bytes("copy", &copying);
  add(all, named("launch"), [&] { return launching(device, 100, 1); });
  add(all, named("launch+wait"), [&] { return launching(device, 1, 20); });
  row.n = vector_n;
  row.columns = vector_columns;
  row.bytes = std::uint64_t{2} * vector_columns * vector_n * sizeof(float);
  add(all, named("dot"), [&] { return dotting(device); });
  row.bytes = row.bytes / 2 * 3;
  add(all, named("axpby"), [&] { return adding(device); });
}

}  // namespace

std::vector<BenchRow> bench_devices(const std::vector<std::string>& devices, unsigned repetitions) {
  std::vector<Measurement> all;
  for (const std::string& id : devices) add_device(all, id);
  measure(all, repetitions);
  std::vector<BenchRow> rows;
  rows.reserve(all.size());
  for (const Measurement& one : all) rows.push_back(one.row);
  return rows;
}

}  // namespace interflect::cli
