#include "interflect/schedule/scheduler.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/memory.h"
#include "interflect/base/timer.h"
#include "interflect/schedule/device_form_factors.h"
#include "interflect/schedule/product.h"
#include "interflect/schedule/rank_product.h"

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

template <class Matrix>
std::unique_ptr<Product> product_over(const Matrix& form_factors, const std::vector<std::unique_ptr<Device>>& devices,
                                      const VectorArguments& shape, std::uint32_t groups, const SplitOptions& split) {
  if (devices.size() == 1) return make_product(form_factors, *devices.front(), shape, groups);
  std::vector<Device*> all;
  for (const auto& device : devices) all.push_back(device.get());
  return make_split_product(form_factors, all, shape, groups, split);
}

}  // namespace

Scheduler::Scheduler(std::vector<std::unique_ptr<Device>> devices, std::uint32_t size, std::uint32_t columns)
    : devices_(std::move(devices)) {
  if (size == 0) throw Error(ErrorKind::usage, "there are no patches to solve for");
  if (columns == 0) throw Error(ErrorKind::usage, "there are no columns to solve for");
  if (devices_.empty() || devices_.front() == nullptr) {
    throw Error(ErrorKind::usage, fmt::format("{} devices given: a solve needs one", devices_.size()));
  }
  device_ = devices_.front().get();
  arguments_.n = size;
  arguments_.vector_stride = rounded_up(size, padding) * padding;
  arguments_.blocks = rounded_up(size, reduction_block);
  most_columns_ = columns;
  shape(columns);
}

/// How launches of the vector kernels lie over so many columns.
void Scheduler::shape(std::uint32_t columns) {
  const DeviceInfo& info = device_->info();
  arguments_.columns = columns;
  const std::uint32_t items = columns * arguments_.blocks;
  arguments_.blocks_per_group = std::max(info.blocks_per_group, rounded_up(items, info.max_groups));
  groups_ = rounded_up(items, arguments_.blocks_per_group);
}

Scheduler::Scheduler(const FormFactorMatrix& form_factors, std::vector<std::unique_ptr<Device>> devices,
                     std::uint32_t columns, const SplitOptions& split)
    : Scheduler(std::move(devices), form_factors.size(), columns) {
  product_ = product_over(form_factors, devices_, arguments_, groups_, split);
  place();
}

Scheduler::Scheduler(const FormFactorMatrix& rows, Ranks& ranks, std::vector<std::unique_ptr<Device>> devices,
                     std::uint32_t columns, const SplitOptions& split)
    : Scheduler(std::move(devices), rows.size(), columns) {
  auto local = product_over(rows, devices_, arguments_, groups_, split);
  product_ = make_rank_product(std::move(local), RankRows(ranks, rows), ranks, *device_, arguments_, groups_);
  place();
}

Scheduler::Scheduler(const PackedMatrix& packed, const FormFactorMatrix& rows, Ranks& ranks,
                     std::vector<std::unique_ptr<Device>> devices, std::uint32_t columns, const SplitOptions& split)
    : Scheduler(std::move(devices), packed.size(), columns) {
  auto local = product_over(packed, devices_, arguments_, groups_, split);
  product_ = make_rank_product(std::move(local), RankRows(ranks, rows), ranks, *device_, arguments_, groups_);
  place();
}

Scheduler::Scheduler(const PackedMatrix& form_factors, std::vector<std::unique_ptr<Device>> devices,
                     std::uint32_t columns, const SplitOptions& split)
    : Scheduler(std::move(devices), form_factors.size(), columns) {
  product_ = product_over(form_factors, devices_, arguments_, groups_, split);
  place();
}

namespace {

std::vector<std::unique_ptr<Device>> only(std::unique_ptr<Device> device) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(std::move(device));
  return devices;
}

}  // namespace

// The base takes the device; the matrix, which has gone before it into the Product, is destroyed before it.
Scheduler::Scheduler(DeviceFormFactors form_factors, std::uint32_t columns)
    : Scheduler(only(std::move(form_factors).take_device()), form_factors.matrix().size(), columns) {
  product_ = make_product(std::move(form_factors).take_matrix(), *device_, arguments_, groups_);
  place();
}

Scheduler::Scheduler(const StreamedMatrix& form_factors, std::vector<std::unique_ptr<Device>> devices,
                     std::uint32_t columns)
    : Scheduler(std::move(devices), form_factors.size(), columns) {
  if (devices_.size() > 1) {
    throw Error(ErrorKind::usage, "form factors that stay in a file are read for one device, not for several");
  }
  product_ = make_product(form_factors, *device_, arguments_, groups_);
  place();
}

Scheduler::~Scheduler() = default;

void Scheduler::place() {
  check_memory();
  product_->place();
}

double Scheduler::compile_seconds() const {
  return compile_seconds_ + product_->compile_seconds();
}

void Scheduler::use_columns(std::uint32_t columns) {
  if (columns == 0 || columns > most_columns_) {
    throw Error(ErrorKind::internal, fmt::format("{} columns: 1 to {} were placed", columns, most_columns_));
  }
  const std::uint32_t before = arguments_.columns;
  if (columns == before) return;
  shape(columns);
  try {
    product_->use(arguments_, groups_);
  } catch (...) {
    shape(before);  // or the next call would take the kernel for compiled
    product_->use(arguments_, groups_);
    throw;
  }
}

void Scheduler::check_memory() const {
  const DeviceInfo& info = device_->info();
  const std::uint64_t vector = std::uint64_t{columns()} * stride() * sizeof(float);
  if (info.max_buffer_bytes != 0 && vector > info.max_buffer_bytes) {
    throw Error(ErrorKind::limit, fmt::format("{}: a vector of {} bytes exceeds the device's largest buffer of {}",
                                              info.id, vector, info.max_buffer_bytes));
  }
  const std::uint64_t needed = vectors_of_a_solve * vector + product_->needed_bytes();
  // A size of 0 is unknown and cannot be compared: then the device itself must refuse.
  std::uint64_t available = info.memory_bytes;
  if (info.type == DeviceType::cpu && available != 0) available = std::min(available, available_memory());
  if (available != 0 && needed > available) {
    throw Error(ErrorKind::limit, fmt::format("{}: {} are needed, {} may be used; use fewer patches or another device",
                                              info.id, gibibytes(needed), gibibytes(available)));
  }
}

Storage Scheduler::storage() const {
  return product_->storage();
}

std::uint64_t Scheduler::bytes() const {
  return product_->bytes();
}

std::uint64_t Scheduler::uploaded_bytes() const {
  return product_->uploaded_bytes();
}

std::vector<Buffer*> Scheduler::panel_buffers() const {
  return product_->panel_buffers();
}

std::vector<std::string> Scheduler::device_ids() const {
  std::vector<std::string> ids;
  const std::vector<DeviceFailure> lost = failures();
  for (const auto& device : devices_) {
    const std::string& id = device->info().id;
    const auto is_it = [&](const DeviceFailure& failure) { return failure.device == id; };
    if (std::none_of(lost.begin(), lost.end(), is_it)) ids.push_back(id);
  }
  return ids;
}

std::vector<DeviceShare> Scheduler::shares() const {
  return product_->device_shares();
}

std::vector<DeviceFailure> Scheduler::failures() const {
  return product_->failures();
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
  const std::span<const std::uint32_t> order = product_->order();
  for (std::size_t c = 0; c < columns(); ++c) {
    if (from[c].size() != size()) throw Error(ErrorKind::internal, "upload: a column of the wrong length");
    float* to_column = staging_.data() + c * stride();
    if (order.empty()) std::copy(from[c].begin(), from[c].end(), to_column);
    for (std::size_t k = 0; k < order.size(); ++k) to_column[k] = from[c][order[k]];
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
  const std::span<const std::uint32_t> order = product_->order();
  for (std::size_t c = 0; c < columns(); ++c) {
    const float* column = staging_.data() + c * stride();
    to[c].assign(column, column + size());
    for (std::size_t k = 0; k < order.size(); ++k) to[c][order[k]] = column[k];
  }
}

void Scheduler::download(const Vector& from, std::span<float> to) {
  device_->queue().download(*from.buffer_, 0, std::as_writable_bytes(to));
  product_->agree(to);
}

void Scheduler::apply(Vector& x, Vector& y) {
  product_->apply(*x.buffer_, *y.buffer_);
  ++products_;
}

void Scheduler::exact_product(const Columns& x, std::vector<std::vector<double>>& y) {
  if (x.size() != columns()) throw Error(ErrorKind::internal, "exact product: wrong number of columns");
  product_->exact(x, y);
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
