#include "bench_launch.h"

#include <utility>

#include "interflect/base/timer.h"

namespace interflect::cli {

Launch::Launch(SharedDevice device, std::string_view kernel, std::vector<std::byte> arguments, std::uint32_t groups,
               std::vector<std::shared_ptr<Buffer>> buffers)
    : device_(std::move(device)),
      kernel_(device_->kernel(kernel, {})),
      arguments_(std::move(arguments)),
      groups_(groups),
      buffers_(std::move(buffers)) {
  for (const auto& buffer : buffers_) bound_.push_back(buffer.get());
}

double Launch::seconds(int count) {
  const Timer timer;
  for (int k = 0; k < count; ++k) device_->queue().launch(*kernel_, groups_, bound_, arguments_, "Measure");
  device_->queue().wait();
  return timer.seconds() / count;
}

std::vector<float> Launch::floats(std::size_t buffer, std::size_t count) {
  std::vector<float> values(count);
  device_->queue().download(*buffers_.at(buffer), 0, std::as_writable_bytes(std::span(values)));
  return values;
}

void Launch::put(std::size_t buffer, std::span<const float> values) {
  device_->queue().upload(*buffers_.at(buffer), 0, std::as_bytes(values));
}

}  // namespace interflect::cli
