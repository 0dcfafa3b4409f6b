#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "interflect/base/progress.h"
#include "interflect/device/device.h"
#include "interflect/formfactor/assembly.h"
#include "interflect/schedule/device_assembly.h"
#include "interflect/schedule/device_matrix.h"

namespace interflect {

/// F of a mesh on the device that assembles it, where the product will read it: F never crosses the bus. A Scheduler
/// can be made of it.
class DeviceFormFactors {
 public:
  /// Writes S of all tiles into the panels: assemble_on(), or what a test puts in its place.
  using Assemble =
      std::function<DeviceAssemblyFacts(Device&, const PatchTable&, const Blockers&, const AssemblyOptions&,
                                        std::span<const DevicePanel>, std::uint32_t stride, ProgressSink&)>;

  /// Makes S on the device, finds the closure by products there (the host sees vectors only), and turns S into F in
  /// place. Of the options `panels` and `maker` are the host's and not used. Throws a limit Error, before any work,
  /// when the device's memory will not do, and device Errors.
  DeviceFormFactors(std::unique_ptr<Device> device, const PatchMesh& mesh, const AssemblyOptions& options = {},
                    ProgressSink* progress = nullptr, const Assemble& assemble = {});

  [[nodiscard]] const DeviceInfo& info() const { return device_->info(); }
  [[nodiscard]] const DeviceMatrix& matrix() const { return matrix_; }
  [[nodiscard]] const AssemblyReport& report() const { return report_; }  ///< its seconds leave out what was compiled
  /// Share of the n² elements that are not zero.
  [[nodiscard]] double nonzero_fraction() const { return nonzero_fraction_; }
  [[nodiscard]] FormFactorMatrix download() { return matrix_.download(*device_); }

  /// Frees F and gives the device back.
  [[nodiscard]] std::unique_ptr<Device> release_device() &&;
  /// The matrix and the device, for who goes on with them; the device must live longer.
  [[nodiscard]] DeviceMatrix take_matrix() && { return std::move(matrix_); }
  [[nodiscard]] std::unique_ptr<Device> take_device() && { return std::move(device_); }

  /// Bytes on the device that n patches need for assembly and a solve of three channels.
  [[nodiscard]] static std::uint64_t predicted_bytes(const DeviceInfo& device, std::uint32_t n);

 private:
  void close(const PatchMesh& mesh, Scaling& scaling, const std::vector<double>& area);

  std::unique_ptr<Device> device_;
  DeviceMatrix matrix_;
  AssemblyReport report_;
  double nonzero_fraction_ = 0;
};

}  // namespace interflect
