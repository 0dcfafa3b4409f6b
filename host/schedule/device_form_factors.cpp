#include "interflect/schedule/device_form_factors.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/base/memory.h"
#include "interflect/base/timer.h"
#include "interflect/device/compile_cache.h"
#include "interflect/device/kernel_arguments.h"

namespace interflect {

namespace {

constexpr std::uint64_t vectors_of_a_solve = 16 + 3;  // the Scheduler's, and those of DeviceExactProduct
constexpr std::uint64_t columns_of_a_solve = 3;
constexpr std::uint64_t scratch = std::uint64_t{256} << 20;  // of assemble_on(), at most

std::string gibibytes(std::uint64_t bytes) {
  return fmt::format("{:.2f} GiB", static_cast<double>(bytes) / static_cast<double>(std::uint64_t{1} << 30));
}

void check_memory(const DeviceInfo& info, std::uint32_t n) {
  std::uint64_t available = info.memory_bytes;  // 0: not known, then the device itself must refuse
  if (info.type == DeviceType::cpu && available != 0) available = std::min(available, available_memory());
  const std::uint64_t needed = DeviceFormFactors::predicted_bytes(info, n);
  if (available == 0 || needed <= available) return;
  throw Error(
      ErrorKind::limit,
      fmt::format("{}: the form factors of {} patches need {} there, {} may be used; use fewer patches, another "
                  "device, or --assembly host",
                  info.id, n, gibibytes(needed), gibibytes(available)));
}

DeviceAssemblyFacts assemble_all(Device& device, const PatchTable& patches, const Blockers& blockers,
                                 const AssemblyOptions& options, std::span<const DevicePanel> panels,
                                 std::uint32_t stride, ProgressSink& progress) {
  return assemble_on(device, patches, blockers, options.budget, options.seed, panels, stride, 0,
                     static_cast<std::uint32_t>(patches.blocks()), progress);
}

}  // namespace

std::uint64_t DeviceFormFactors::predicted_bytes(const DeviceInfo& device, std::uint32_t n) {
  const std::uint64_t vector = columns_of_a_solve * ((std::uint64_t{n} + 15) / 16 * 16) * sizeof(float);
  const std::uint64_t work = device.max_buffer_bytes == 0 ? scratch : std::min(scratch, 2 * device.max_buffer_bytes);
  return FormFactorMatrix::predicted_bytes(n) + std::max(vectors_of_a_solve * vector, work);
}

DeviceFormFactors::DeviceFormFactors(std::unique_ptr<Device> device, const PatchMesh& mesh,
                                     const AssemblyOptions& options, ProgressSink* progress, const Assemble& assemble)
    : device_(std::move(device)) {
  const Timer timer;
  const double compiled_before = compile_statistics().seconds;
  ProgressSink silent;
  ProgressSink& sink = progress != nullptr ? *progress : silent;
  const auto n = static_cast<std::uint32_t>(mesh.size());
  check_memory(info(), n);
  matrix_ = DeviceMatrix(*device_, n);
  const PatchTable patches(mesh);
  const Blockers blockers(mesh, patches);
  std::vector<DevicePanel> panels;
  for (const DeviceMatrix::Panel& panel : matrix_.panels()) {
    panels.push_back({panel.first, panel.rows, panel.buffer.get()});
  }
  DeviceAssemblyFacts facts =
      (assemble ? assemble : assemble_all)(*device_, patches, blockers, options, panels, matrix_.stride(), sink);
  report_.pairs_considered = facts.pairs_considered;
  report_.pairs_analytic = facts.pairs_analytic;
  report_.rays = facts.rays;
  report_.tile_variance = std::move(facts.tile_variance);

  DeviceExactProduct exact(*device_, matrix_, 1);
  const ExchangeProduct product = [&](const std::vector<float>& x) {
    std::vector<std::vector<double>> y;
    exact.apply({x}, y);
    return std::move(y.front());
  };
  Scaling scaling = judge(mesh, patches, blockers, options, product, report_);
  close(mesh, scaling, mesh.area);
  note_change(mesh, scaling, report_);
  report_.scaling = std::move(scaling.d);
  report_.seconds = timer.seconds() - (compile_statistics().seconds - compiled_before);
}

/// F_ij = S_ij (d_i / A_i) d_j, as make_form_factors() does it on the host: to the same bits.
void DeviceFormFactors::close(const PatchMesh& mesh, Scaling& scaling, const std::vector<double>& area) {
  const auto n = static_cast<std::uint32_t>(mesh.size());
  const std::size_t stride = matrix_.stride();
  std::vector<float> d(stride), factor(stride), of_rows(3 * stride);
  for (std::size_t i = 0; i < n; ++i) {
    d[i] = static_cast<float>(scaling.d[i]);
    factor[i] = area[i] > 0 ? static_cast<float>(scaling.d[i] / area[i]) : 0.0F;
  }
  const auto kernel = device_->kernel("close_rows", {});
  Queue& queue = device_->queue();
  const auto uploaded = [&](const std::vector<float>& values) {
    auto buffer = device_->allocate(values.size() * sizeof(float));
    queue.upload(*buffer, 0, std::as_bytes(std::span(values)));
    return buffer;
  };
  const auto d_there = uploaded(d), factor_there = uploaded(factor);
  const auto rows_there = device_->allocate(of_rows.size() * sizeof(float));
  for (const DeviceMatrix::Panel& panel : matrix_.panels()) {
    const MatvecArguments arguments{.n = n,
                                    .first = panel.first,
                                    .rows = panel.rows,
                                    .row_stride = matrix_.stride(),
                                    .vector_stride = matrix_.stride()};
    const std::array buffers{panel.buffer.get(), d_there.get(), factor_there.get(), rows_there.get()};
    queue.launch(*kernel, (panel.rows + panel_group - 1) / panel_group, buffers,
                 std::as_bytes(std::span(&arguments, 1)), "F = S d / A");
  }
  queue.download(*rows_there, 0, std::as_writable_bytes(std::span(of_rows)));
  double count = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const float low = of_rows[i], high = of_rows[stride + i];
    count += static_cast<double>(of_rows[2 * stride + i]);
    if (low > high) continue;  // an empty row
    for (const float there : {low, high}) {
      scaling.max_change = std::max(scaling.max_change, std::abs(scaling.d[i] * static_cast<double>(there) - 1));
    }
  }
  nonzero_fraction_ = n == 0 ? 0 : count / (static_cast<double>(n) * static_cast<double>(n));
}

std::unique_ptr<Device> DeviceFormFactors::release_device() && {
  matrix_ = {};
  return std::move(device_);
}

}  // namespace interflect
