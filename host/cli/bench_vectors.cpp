#include "bench_vectors.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "interflect/device/kernel_arguments.h"
#include "interflect/device/vector_reference.h"

namespace interflect::cli {

namespace {

/// What kernels/README.md states of a kernel, per element: values read and written; and its operations, by its loop.
struct Stated {
  std::string_view kernel;
  std::uint32_t reads, writes, flops, option;
};
constexpr std::array stated{Stated{"dot", 2, 0, 2, 0},           Stated{"axpby", 2, 1, 3, 0},
                            Stated{"bounce", 4, 2, 6, 1},        Stated{"cg_product", 4, 1, 5, 0},
                            Stated{"cg_step", 6, 4, 12, 0},      Stated{"bicgstab_product", 4, 1, 12, 0},
                            Stated{"bicgstab_half", 2, 1, 2, 0}, Stated{"bicgstab_step", 5, 3, 12, 0}};

// Columns as long as those of the largest scenes that are solved: each group adds the partial sums of its column, which
// would cost as much as the vectors themselves at a million elements.
constexpr std::uint32_t n = 32768, blocks = n / reduction_block;

/// So many columns that a vector is 50 MB on a processor and 100 MB elsewhere: no cache holds two of them.
std::uint32_t columns_for(const DeviceInfo& info) {
  return info.type == DeviceType::cpu ? 384 : 768;
}

// Columns are of so many kinds, so that few are computed by the reference and all are compared with it.
constexpr std::uint32_t kinds = 8;

/// Vector k, all columns: 0.25 to 0.75, column c and column c + kinds the same.
std::vector<float> vector_of(std::size_t k, std::uint32_t columns) {
  std::vector<float> values(std::size_t{columns} * n);
  for (std::uint32_t c = 0; c < columns; ++c) {
    const auto salt = static_cast<std::uint32_t>(k * 7919 + c % kinds * 104729 + 1);
    for (std::uint32_t i = 0; i < n; ++i) {
      const std::uint32_t mixed = (i ^ salt) * 2654435761U;
      values[std::size_t{c} * n + i] = 0.25F + static_cast<float>(mixed >> 24) / 512.0F;
    }
  }
  return values;
}

std::span<const float> column(const std::vector<float>& vector, std::uint32_t c) {
  return std::span(vector).subspan(std::size_t{c} * n, n);
}

/// The scalars and totals that lead a kernel through all of its work, with steps so small that a thousand launches in
/// place stay finite. A total is put into the set's first partial sum.
std::vector<float> sums_of(std::string_view kernel) {
  std::vector<float> one(sums_size(1, blocks));
  const auto slot = [&](std::uint32_t which, float value) { one[which] = value; };
  const auto total = [&](std::uint32_t set, float value) { one[scalar_slots + std::size_t{set} * blocks] = value; };
  if (kernel == "axpby") {
    slot(slot::axpby_a, 0.75F);
    slot(slot::axpby_b, 0.25F);
  } else if (kernel == "cg_product") {
    slot(slot::alpha, 0.5F);
    slot(slot::cg_gamma_old, 4.0F);
    total(sum::rr, 1.0F);
    total(sum::gamma, 2.0F);
  } else if (kernel == "cg_step") {  // alpha = 1 / 1024
    slot(slot::cg_gamma, 1.0F);
    slot(slot::cg_beta, 0.5F);
    total(sum::delta, 1024.0F);
  } else if (kernel == "bicgstab_half") {  // alpha = 1 / 1024
    slot(slot::bicgstab_rho, 1.0F);
    slot(slot::bicgstab_shadow, 1.0F);
    total(sum::rr, 1.0F);
    total(sum::zw, 1024.0F);
    total(sum::ww, 1.0F);
  } else if (kernel == "bicgstab_step") {  // omega = 1 / 1024, beta = 1 / 2
    slot(slot::alpha, 1.0F / 1024);
    slot(slot::bicgstab_rho_used, 2.0F);
    slot(slot::bicgstab_shadow, 1.0F);
    total(sum::xw, 1.0F);
    total(sum::ww, 1024.0F);
    total(sum::zx, 1.0F);
    total(sum::xx, 1.0F);
  }
  return one;
}

/// The same for all columns: slots and partial sums lie [..][column][..].
std::vector<float> spread(const std::vector<float>& one, std::uint32_t columns) {
  std::vector<float> all(sums_size(columns, blocks));
  for (std::uint32_t c = 0; c < columns; ++c) {
    for (std::uint32_t s = 0; s < scalar_slots; ++s) all[s * columns + c] = one[s];
    for (std::size_t set = 0; set < sum_sets; ++set) {
      const auto from = one.begin() + static_cast<std::ptrdiff_t>(scalar_slots + set * blocks);
      const std::size_t to = std::size_t{scalar_slots} * columns + (set * columns + c) * blocks;
      std::copy(from, from + blocks, all.begin() + static_cast<std::ptrdiff_t>(to));
    }
  }
  return all;
}

/// A column's part of what spread() makes.
std::vector<float> gathered(const std::vector<float>& all, std::uint32_t columns, std::uint32_t c) {
  std::vector<float> one(sums_size(1, blocks));
  for (std::uint32_t s = 0; s < scalar_slots; ++s) one[s] = all[s * columns + c];
  for (std::size_t set = 0; set < sum_sets; ++set) {
    const std::size_t from = std::size_t{scalar_slots} * columns + (set * columns + c) * blocks;
    std::copy_n(all.begin() + static_cast<std::ptrdiff_t>(from), blocks,
                one.begin() + static_cast<std::ptrdiff_t>(scalar_slots + set * blocks));
  }
  return one;
}

VectorArguments arguments_for(const DeviceInfo& info, std::uint32_t columns, std::uint32_t option) {
  VectorArguments arguments{.n = n, .vector_stride = n, .columns = columns, .blocks = blocks};
  arguments.blocks_per_group = std::max(info.blocks_per_group, columns * blocks / info.max_groups + 1);
  arguments.option = option;
  return arguments;
}

reference::Numbers numbers_of(std::span<const float> values) {
  reference::Numbers numbers;
  numbers.reserve(values.size());
  for (const float value : values) numbers.emplace_back(static_cast<double>(value));
  return numbers;
}

/// The larger of both, or the one that is no number.
double worse(double a, double b) {
  return a <= b ? b : a;
}

/// The largest error of a buffer relative to what went into each element; infinite where a value that is not to be
/// written was.
double error_of(std::span<const float> before, std::span<const float> after, const reference::Numbers& exact) {
  double error = 0;
  for (std::size_t i = 0; i < after.size(); ++i) {
    double one = std::abs(static_cast<double>(after[i]) - exact[i].value) / std::max(exact[i].magnitude, 1e-30);
    if (!exact[i].written) one = after[i] == before[i] ? 0 : INFINITY;
    error = worse(one, error);
  }
  return error;
}

/// One launch from known values, every element of every buffer against the reference: column by column, which the
/// kernels keep apart, so that the reference needs little memory.
void verify(BenchRow& row, Launch& launch, const Stated& kernel, const VectorArguments& arguments) {
  const std::size_t vectors = reference::vectors_of(kernel.kernel);
  const std::uint32_t columns = arguments.columns;
  const std::vector<float> sums = sums_of(kernel.kernel);
  std::vector<std::vector<float>> before, after;
  for (std::size_t k = 0; k < vectors; ++k) launch.put(k, before.emplace_back(vector_of(k, columns)));
  launch.put(vectors, spread(sums, columns));
  static_cast<void>(launch.seconds(1));
  for (std::size_t k = 0; k < vectors; ++k) after.push_back(launch.floats(k, before[k].size()));
  const std::vector<float> sums_after = launch.floats(vectors, sums_size(columns, blocks));
  VectorArguments single = arguments;
  single.columns = 1;
  std::vector<double> errors(kinds);
#pragma omp parallel for schedule(dynamic)
  for (std::uint32_t kind = 0; kind < kinds; ++kind) {
    std::vector<reference::Numbers> exact;
    for (const std::vector<float>& vector : before) exact.push_back(numbers_of(column(vector, kind)));
    exact.push_back(numbers_of(sums));
    reference::vector_kernel(kernel.kernel, single, exact);
    for (std::uint32_t c = kind; c < columns; c += kinds) {
      errors[kind] = worse(error_of(sums, gathered(sums_after, columns, c), exact.back()), errors[kind]);
      for (std::size_t k = 0; k < vectors; ++k) {
        errors[kind] = worse(error_of(column(before[k], c), column(after[k], c), exact[k]), errors[kind]);
      }
    }
  }
  for (const double error : errors) row.error = worse(error, row.error);
  const double rounding = static_cast<double>(reference::vector_roundings(single)) * 0x1p-24;
  row.bound = rounding / (1 - rounding);
  if (!(row.error <= row.bound)) deny(row, "differs from the fp64 reference");
}

/// The vectors of all kernels on one device: they take turns with them, since only bytes are timed.
class Pool {
 public:
  Pool(SharedDevice device, std::uint32_t columns) : device_(std::move(device)), columns_(columns) {}

  std::vector<std::shared_ptr<Buffer>> take(std::size_t vectors) {
    while (vectors_.size() < vectors) {
      const std::vector<float> values = vector_of(vectors_.size(), columns_);
      vectors_.push_back(device_->allocate(values.size() * sizeof(float)));
      device_->queue().upload(*vectors_.back(), 0, std::as_bytes(std::span(values)));
    }
    std::vector<std::shared_ptr<Buffer>> taken(vectors_.begin(),
                                               vectors_.begin() + static_cast<std::ptrdiff_t>(vectors));
    taken.push_back(device_->allocate(sums_size(columns_, blocks) * sizeof(float)));
    return taken;
  }

 private:
  SharedDevice device_;
  std::uint32_t columns_;
  std::vector<std::shared_ptr<Buffer>> vectors_;
};

Timed prepared(const SharedDevice& device, Pool& pool, const Stated& kernel, std::uint32_t columns) {
  const VectorArguments arguments = arguments_for(device->info(), columns, kernel.option);
  const std::uint32_t groups = (columns * blocks + arguments.blocks_per_group - 1) / arguments.blocks_per_group;
  const std::size_t vectors = reference::vectors_of(kernel.kernel);
  const auto launch = std::make_shared<Launch>(device, kernel.kernel, block_of(arguments), groups, pool.take(vectors));
  launch->put(vectors, spread(sums_of(kernel.kernel), columns));
  return {.pass = [launch] { return launch->seconds(1); },
          .verify = [launch, kernel, arguments](BenchRow& row) { verify(row, *launch, kernel, arguments); }};
}

}  // namespace

void add_vector_kernels(std::vector<Measurement>& all, const SharedDevice& device) {
  const std::uint32_t columns = columns_for(device->info());
  const auto pool = std::make_shared<Pool>(device, columns);
  const std::uint64_t values = std::uint64_t{columns} * n;
  for (const Stated& kernel : stated) {
    BenchRow row;
    row.device = device->info().id;
    row.what = kernel.kernel;
    row.n = n;
    row.columns = columns;
    row.bytes = (kernel.reads + kernel.writes) * values * sizeof(float);
    row.bytes_written = kernel.writes * values * sizeof(float);
    row.flops = kernel.flops * values;
    add(all, row, [&] { return prepared(device, *pool, kernel, columns); });
  }
}

}  // namespace interflect::cli
