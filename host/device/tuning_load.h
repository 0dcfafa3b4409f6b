#pragma once

#include <functional>
#include <memory>
#include <string_view>

#include "interflect/device/device.h"

namespace interflect {

/// A product kernel with something to work on, for tuning: a matrix of ones of `bytes` (elements of any format), full
/// vectors, and a launch for any of its shapes.
class TuningLoad {
 public:
  TuningLoad() = default;
  TuningLoad(const TuningLoad&) = delete;
  TuningLoad& operator=(const TuningLoad&) = delete;
  virtual ~TuningLoad() = default;

  /// Compiles the kernel with these macros, and returns what enqueues one product. Throws the device's Errors.
  [[nodiscard]] virtual std::function<void()> product(const Macros& macros) = 0;
};

/// The load of matvec, tiles16 or sym16. bytes = 0: 128 MiB for a processor, 512 MiB for others, within the device's
/// limits. Throws a limit Error where the device has no room for 1 KiB, an internal one for another kernel.
[[nodiscard]] std::unique_ptr<TuningLoad> make_tuning_load(Device& device, std::string_view kernel,
                                                           std::uint64_t bytes);

}  // namespace interflect
