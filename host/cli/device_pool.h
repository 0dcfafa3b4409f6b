#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/device/device.h"
#include "interflect/solver/fallback.h"

namespace interflect::cli {

/// Devices that are opened once for several solves, one solve after the other, with the kernels that were compiled for
/// them. One that has failed is not lent again: it is opened anew for the next solve.
class DevicePool {
 public:
  using Choose = std::function<std::vector<std::string>(const std::string& text)>;

  DevicePool();  ///< of the machine's devices
  DevicePool(Candidates::Open open, Choose choose) : open_(std::move(open)), choose_(std::move(choose)) {}

  /// The device, to be used as if it were the caller's own; nobody else may use it meanwhile. Throws what opening
  /// throws.
  [[nodiscard]] std::unique_ptr<Device> lend(const std::string& id);
  /// What candidates_of() gives, of lent devices. The pool must outlive them.
  [[nodiscard]] Candidates candidates(const std::string& devices, ProgressSink& progress);

  /// A device with its compiled kernels, which must go before it.
  struct Shared {
    std::unique_ptr<Device> device;
    std::map<std::pair<std::string, Macros>, std::shared_ptr<Kernel>> kernels = {};
    bool failed = false;
  };

 private:
  Candidates::Open open_;
  Choose choose_;
  std::map<std::string, std::shared_ptr<Shared>> devices_;
  std::map<std::string, std::vector<std::string>> chosen_;  ///< `auto` may have to measure
};

}  // namespace interflect::cli
