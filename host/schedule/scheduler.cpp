#include "interflect/schedule/scheduler.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/memory.h"
#include "interflect/base/timer.h"

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
  const DeviceInfo& info = device_->info();
  arguments_.n = size();
  arguments_.vector_stride = rounded_up(size(), padding) * padding;
  arguments_.columns = columns;
  arguments_.blocks = rounded_up(size(), reduction_block);
  const std::uint32_t items = columns * arguments_.blocks;
  arguments_.blocks_per_group = std::max(info.blocks_per_group, rounded_up(items, info.max_groups));
  groups_ = rounded_up(items, arguments_.blocks_per_group);
  cut_panels();
  check_memory();
  const Timer compiling;
  matvec_ = device_->kernel("matvec",
                            {{"COLUMNS", static_cast<int>(columns)}, {"ROWS", static_cast<int>(info.rows_per_group)}});
  compile_seconds_ += compiling.seconds();
  upload_panels();
}

Scheduler::~Scheduler() = default;

std::uint64_t Scheduler::row_bytes() const {
  return std::uint64_t{form_factors_.stride()} * sizeof(float);
}

/// The rows of the largest panel that the device's buffers and work-groups take: whole groups of rows if it can be.
std::uint32_t Scheduler::rows_that_fit() const {
  const DeviceInfo& info = device_->info();
  std::uint64_t rows = std::min<std::uint64_t>(size(), std::uint64_t{info.max_groups} * info.rows_per_group);
  if (info.max_buffer_bytes != 0) rows = std::min(rows, info.max_buffer_bytes / row_bytes());
  if (rows < size() && rows > info.rows_per_group) rows -= rows % info.rows_per_group;
  return static_cast<std::uint32_t>(rows);
}

void Scheduler::cut_panels() {
  const DeviceInfo& info = device_->info();
  const std::uint32_t most = rows_that_fit();
  if (most == 0) {
    throw Error(ErrorKind::limit,
                fmt::format("{}: one row of the form factors has {} bytes, the device's largest buffer {}; use fewer "
                            "patches or another device",
                            info.id, row_bytes(), info.max_buffer_bytes));
  }
  for (const Panel& panel : form_factors_.panels()) {
    std::unique_ptr<Buffer> shared = panel.rows <= most ? device_->share(panel.data) : nullptr;
    if (shared != nullptr) {
      panels_.push_back({panel.first, panel.rows, panel.data->data(), std::move(shared)});
      continue;
    }
    for (std::uint32_t done = 0; done < panel.rows; done += most) {
      panels_.push_back(
          {panel.first + done, std::min(most, panel.rows - done), panel.data->data() + done * row_bytes(), nullptr});
    }
  }
}

void Scheduler::check_memory() const {
  const DeviceInfo& info = device_->info();
  const std::uint64_t vector = std::uint64_t{columns()} * stride() * sizeof(float);
  if (info.max_buffer_bytes != 0 && vector > info.max_buffer_bytes) {
    throw Error(ErrorKind::limit, fmt::format("{}: a vector of {} bytes exceeds the device's largest buffer of {}",
                                              info.id, vector, info.max_buffer_bytes));
  }
  std::uint64_t needed = vectors_of_a_solve * vector;
  for (const PlacedPanel& panel : panels_) needed += panel.buffer == nullptr ? panel.rows * row_bytes() : 0;
  // A size of 0 is unknown and cannot be compared: then the device itself must refuse.
  std::uint64_t available = info.memory_bytes;
  if (info.type == DeviceType::cpu && available != 0) available = std::min(available, available_memory());
  if (available != 0 && needed > available) {
    throw Error(ErrorKind::limit, fmt::format("{}: {} are needed, {} may be used; use fewer patches or another device",
                                              info.id, gibibytes(needed), gibibytes(available)));
  }
}

void Scheduler::upload_panels() {
  for (PlacedPanel& panel : panels_) {
    if (panel.buffer != nullptr) continue;
    const std::size_t bytes = panel.rows * row_bytes();
    panel.buffer = device_->allocate(bytes);
    device_->queue().upload(*panel.buffer, 0, {panel.data, bytes});
    uploaded_bytes_ += bytes;
  }
}

std::vector<Buffer*> Scheduler::panel_buffers() const {
  std::vector<Buffer*> buffers;
  for (const PlacedPanel& panel : panels_) buffers.push_back(panel.buffer.get());
  return buffers;
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
  auto found = kernels_.find(name);
  if (found == kernels_.end()) {
    const Timer timer;
    found = kernels_.emplace(name, device_->kernel(name, {})).first;
    compile_seconds_ += timer.seconds();
  }
  return VectorKernel(found->second);
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
