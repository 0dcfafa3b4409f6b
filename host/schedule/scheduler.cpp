#include "interflect/schedule/scheduler.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "interflect/base/error.h"

namespace interflect {

namespace {

constexpr std::uint32_t padding = 16;             // floats: a cache line
constexpr std::uint64_t vectors_of_a_solve = 16;  // more than any method needs

std::uint32_t rounded_up(std::uint32_t n, std::uint32_t step) {
  return (n + step - 1) / step;
}

std::string gibibytes(std::uint64_t bytes) {
  return fmt::format("{:.2f} GiB", static_cast<double>(bytes) / static_cast<double>(std::uint64_t{1} << 30));
}

template <class T>
std::span<const std::byte> bytes_of(const T& value) {
  return std::as_bytes(std::span(&value, 1));
}

}  // namespace

Scheduler::Scheduler(const FormFactorMatrix& form_factors, std::vector<std::unique_ptr<Device>> devices,
                     std::uint32_t columns)
    : form_factors_(form_factors), devices_(std::move(devices)) {
  if (size() == 0) throw Error(ErrorKind::usage, "there are no patches to solve for");
  if (columns == 0) throw Error(ErrorKind::usage, "there are no columns to solve for");
  if (devices_.size() != 1 || devices_.front() == nullptr) {
    throw Error(ErrorKind::usage,
                fmt::format("{} devices given: a solve runs on exactly one device so far", devices_.size()));
  }
  device_ = devices_.front().get();
  arguments_.n = size();
  arguments_.vector_stride = rounded_up(size(), padding) * padding;
  arguments_.columns = columns;
  arguments_.blocks = rounded_up(size(), reduction_block);
  arguments_.blocks_per_group = device_->info().blocks_per_group;
  groups_ = rounded_up(columns * arguments_.blocks, arguments_.blocks_per_group);
  matvec_ = device_->kernel(
      "matvec", {{"COLUMNS", static_cast<int>(columns)}, {"ROWS", static_cast<int>(device_->info().rows_per_group)}});
  place_panels();
}

Scheduler::~Scheduler() = default;

void Scheduler::place_panels() {
  const DeviceInfo& info = device_->info();
  std::uint64_t needed = vectors_of_a_solve * columns() * stride() * sizeof(float);
  std::uint64_t largest = 0;
  for (const Panel& panel : form_factors_.panels()) {
    panels_.push_back({panel.first, panel.rows, device_->share(panel.data)});
    if (panels_.back().buffer != nullptr) continue;
    needed += panel.data->size();
    largest = std::max<std::uint64_t>(largest, panel.data->size());
  }
  // An unknown size (0) cannot be compared: then the device itself must refuse.
  if (info.memory_bytes != 0 && needed > info.memory_bytes) {
    throw Error(ErrorKind::limit,
                fmt::format("{}: {} are needed, the device has {}; use fewer patches or another device", info.id,
                            gibibytes(needed), gibibytes(info.memory_bytes)));
  }
  if (info.max_buffer_bytes != 0 && largest > info.max_buffer_bytes) {
    throw Error(ErrorKind::limit, fmt::format("{}: a panel of {} bytes exceeds the device's largest buffer of {}; set "
                                              "INTERFLECT_MAX_PANEL_BYTES to at most that",
                                              info.id, largest, info.max_buffer_bytes));
  }
  for (std::size_t k = 0; k < panels_.size(); ++k) {
    if (panels_[k].buffer != nullptr) continue;
    const PageBuffer& data = *form_factors_.panels()[k].data;
    panels_[k].buffer = device_->allocate(data.size());
    device_->queue().upload(*panels_[k].buffer, 0, {data.data(), data.size()});
    uploaded_bytes_ += data.size();
  }
}

std::vector<std::string> Scheduler::device_ids() const {
  std::vector<std::string> ids;
  for (const auto& device : devices_) ids.push_back(device->info().id);
  return ids;
}

Vector Scheduler::vector() {
  return Vector(device_->allocate(std::size_t{columns()} * stride() * sizeof(float)));
}

Vector Scheduler::sums() {
  return Vector(device_->allocate(sums_size(columns(), blocks()) * sizeof(float)));
}

VectorKernel Scheduler::kernel(std::string_view name) {
  return VectorKernel(device_->kernel(name, {}));
}

void Scheduler::upload(Vector& to, const Columns& from) {
  staging_.assign(std::size_t{columns()} * stride(), 0.0F);
  if (from.size() != columns()) throw Error(ErrorKind::internal, "upload: wrong number of columns");
  for (std::size_t c = 0; c < columns(); ++c) {
    if (from[c].size() != size()) throw Error(ErrorKind::internal, "upload: a column of the wrong length");
    std::copy(from[c].begin(), from[c].end(), staging_.begin() + static_cast<std::ptrdiff_t>(c * stride()));
  }
  upload(to, staging_);
}

void Scheduler::upload(Vector& to, std::span<const float> from) {
  device_->queue().upload(*to.buffer_, 0, std::as_bytes(from));
}

void Scheduler::download(const Vector& from, Columns& to) {
  staging_.resize(std::size_t{columns()} * stride());
  download(from, staging_);
  to.resize(columns());
  for (std::size_t c = 0; c < columns(); ++c) {
    const auto first = staging_.begin() + static_cast<std::ptrdiff_t>(c * stride());
    to[c].assign(first, first + size());
  }
}

void Scheduler::download(const Vector& from, std::span<float> to) {
  device_->queue().download(*from.buffer_, 0, std::as_writable_bytes(to));
}

void Scheduler::apply(Vector& x, Vector& y) {
  for (const PlacedPanel& panel : panels_) {
    const MatvecArguments arguments{.n = size(),
                                    .first = panel.first,
                                    .rows = panel.rows,
                                    .row_stride = form_factors_.stride(),
                                    .vector_stride = stride()};
    const std::array buffers{panel.buffer.get(), x.buffer_.get(), y.buffer_.get()};
    device_->queue().launch(*matvec_, rounded_up(panel.rows, device_->info().rows_per_group), buffers,
                            bytes_of(arguments), "y = F x");
  }
  ++products_;
}

void Scheduler::run(const VectorKernel& kernel, std::initializer_list<Vector*> buffers, std::string_view label,
                    std::uint32_t option, std::uint32_t slot) {
  std::array<Buffer*, 8> bound{};  // no kernel takes more
  if (buffers.size() > bound.size()) throw Error(ErrorKind::internal, "a vector kernel with too many buffers");
  std::transform(buffers.begin(), buffers.end(), bound.begin(), [](Vector* v) { return v->buffer_.get(); });
  VectorArguments arguments = arguments_;
  arguments.option = option;
  arguments.slot = slot;
  device_->queue().launch(*kernel.kernel_, groups_, std::span(bound).first(buffers.size()), bytes_of(arguments), label);
}

void Scheduler::wait() {
  device_->queue().wait();
}

}  // namespace interflect
