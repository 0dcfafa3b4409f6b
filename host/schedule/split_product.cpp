#include "interflect/schedule/split_product.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/memory.h"
#include "interflect/base/timer.h"
#include "interflect/schedule/worker.h"

namespace interflect {

namespace {

constexpr double no_limit = std::numeric_limits<double>::infinity();
constexpr std::uint64_t vectors_of_a_solve = 16;  // on the first device; as the Scheduler counts them

/// Whether another device can take over: after a device's own failures and its limits.
bool helps(const Error& error) {
  return error.kind() == ErrorKind::device || error.kind() == ErrorKind::limit;
}

}  // namespace

struct SplitProduct::Part {
  Device* device = nullptr;
  std::unique_ptr<PartProduct> product;
  std::uint32_t first = 0, end = 0;  ///< units
  bool lost = false;
  bool in_place = false;  ///< uses F where the host has it
  // Where it is not the first:
  std::unique_ptr<Worker> worker;
  std::unique_ptr<Buffer> x, y;
  std::vector<float> got;  ///< y from its first place of the first column to its last of the last column
  // What it did:
  double seconds = 0;  ///< of the last product
  double busy = 0, idle = 0;
  std::uint64_t done_bytes = 0;

  [[nodiscard]] bool works() const { return !lost && first < end; }
};

SplitProduct::SplitProduct(Division division, const MakePart& make, const std::vector<Device*>& devices,
                           const VectorArguments& shape, std::uint32_t groups, const SplitOptions& options)
    : Product(*devices.front(), shape, groups), division_(std::move(division)), options_(options) {
  for (Device* device : devices) {
    Part& part = *parts_.emplace_back(std::make_unique<Part>());
    part.device = device;
    if (parts_.size() > 1) part.worker = std::make_unique<Worker>();
    try {
      part.product = make(*device, shape, groups);
      part.in_place = part.product->in_place();
    } catch (const Error& error) {
      if (part.worker == nullptr || !helps(error)) throw;
      failures_.push_back({device->info().id, error.what()});
      part.lost = true;
    }
  }
  balance_ = std::make_unique<Balance>(static_cast<double>(division_.bytes.back()), rooms(), options_.weights);
  cut_anew();
  parts_.front()->product->take(parts_.front()->first, parts_.front()->end);
}

SplitProduct::~SplitProduct() = default;

/// Bytes of F for which each device has room.
std::vector<double> SplitProduct::rooms() const {
  const std::uint64_t vector = std::uint64_t{most_columns_} * shape_.vector_stride * sizeof(float);
  std::size_t copies_on_the_host = 0;  // of processors that cannot use F in place
  for (const auto& part : parts_) {
    copies_on_the_host += part->device->info().type == DeviceType::cpu && !part->in_place ? 1 : 0;
  }
  std::vector<double> out;
  for (const auto& part : parts_) {
    const DeviceInfo& info = part->device->info();
    std::uint64_t memory = info.memory_bytes;  // 0: not known, and the device itself must refuse
    if (info.type == DeviceType::cpu && memory != 0) {
      memory = std::min(memory, available_memory() / std::max<std::size_t>(1, copies_on_the_host));
    }
    const std::uint64_t vectors = (part->worker == nullptr ? vectors_of_a_solve : 2) * vector;
    const bool limited = memory != 0 && !part->in_place;
    const double left = static_cast<double>(memory) - static_cast<double>(vectors);
    out.push_back(part->lost ? 0.0 : limited ? std::max(0.0, 0.95 * left) : no_limit);
  }
  return out;
}

std::uint64_t SplitProduct::bytes_of(const Part& part) const {
  return division_.bytes[part.end] - division_.bytes[part.first];
}

/// The ranges of the shares. What they mean for the devices, bring() does.
void SplitProduct::cut_anew() {
  const std::vector<std::uint32_t> begins = cut(division_.bytes, balance_->shares());
  for (std::size_t k = 0; k < parts_.size(); ++k) {
    parts_[k]->first = begins[k];
    parts_[k]->end = begins[k + 1];
  }
  due_ = true;
}

std::uint64_t SplitProduct::needed_bytes() const {
  return parts_.front()->product->needed_bytes();
}

void SplitProduct::lose(std::size_t part, const Error& error) {
  Part& gone = *parts_[part];
  failures_.push_back({gone.device->info().id, error.what()});
  gone.lost = true;
  gone.product.reset();
  gone.x.reset();
  gone.y.reset();
  balance_->lose(part);
  cut_anew();
}

/// Acts for a part. False where that is not the first and was lost by it; an Error of the first is thrown.
template <class Act>
bool SplitProduct::survives(std::size_t part, const Act& act) {
  try {
    act();
    return true;
  } catch (const Error& error) {
    if (part == 0 || !helps(error)) throw;
    lose(part, error);
    return false;
  }
}

/// Brings to every device what it needs for its range. Again, where one is lost by it: then the others have more.
void SplitProduct::bring() {
  while (due_) {
    due_ = false;
    for (std::size_t k = 0; k < parts_.size() && !due_; ++k) {
      Part& part = *parts_[k];
      if (part.lost) continue;
      survives(k, [&] {
        part.product->take(part.first, part.end);
        if (!part.works()) return;
        const std::size_t vector = std::size_t{most_columns_} * shape_.vector_stride * sizeof(float);
        part.product->place();
        if (k == 0 || part.x != nullptr) return;
        part.x = part.device->allocate(vector);
        part.y = part.device->allocate(vector);
      });
    }
  }
  uploaded_bytes_ = 0;
  compile_seconds_ = 0;
  for (const auto& part : parts_) {
    if (part->lost) continue;
    uploaded_bytes_ += part->product->uploaded_bytes();
    compile_seconds_ += part->product->compile_seconds();
  }
}

void SplitProduct::place() {
  bring();
}

void SplitProduct::use(const VectorArguments& shape, std::uint32_t groups) {
  shape_ = shape;
  groups_ = groups;
  for (std::size_t k = 0; k < parts_.size(); ++k) {
    if (parts_[k]->lost) continue;
    survives(k, [&] { parts_[k]->product->use(shape, groups); });
  }
  bring();
}

void SplitProduct::apply(Buffer& x, Buffer& y) {
  bring();
  x_.resize(std::size_t{shape_.columns} * shape_.vector_stride);
  y_.resize(x_.size());
  device_.queue().download(x, 0, std::as_writable_bytes(std::span(x_)));  // waits for what makes x
  while (!run(x, y)) bring();
  collect(y);
  note();
}

/// The parts of y on their devices, and the others' on the host. False where a device was lost.
bool SplitProduct::run(Buffer& x, Buffer& y) {
  for (const auto& part : parts_) {
    if (part->worker != nullptr && part->works()) part->worker->start([this, &part = *part] { work(part); });
  }
  const Timer timer;
  std::exception_ptr own;
  try {
    work_on_own(x, y);
  } catch (...) {
    own = std::current_exception();  // but the others still use x
  }
  // All are waited for before one is lost: that cuts the ranges anew, by which the others still work.
  std::vector<std::exception_ptr> ends(parts_.size());
  for (std::size_t k = 1; k < parts_.size(); ++k) {
    try {
      if (!parts_[k]->lost) parts_[k]->worker->wait();
    } catch (...) {
      ends[k] = std::current_exception();
    }
  }
  bool all = true;
  std::exception_ptr other;
  for (std::size_t k = 1; k < parts_.size(); ++k) {
    if (ends[k] == nullptr) continue;
    try {
      all = survives(k, [&] { std::rethrow_exception(ends[k]); }) && all;
    } catch (...) {
      other = std::current_exception();
    }
  }
  if (own != nullptr) std::rethrow_exception(own);
  if (other != nullptr) std::rethrow_exception(other);
  const double whole = timer.seconds();
  for (const auto& part : parts_) {
    if (!all || part->lost) continue;
    if (!part->works()) part->seconds = 0;
    part->busy += part->seconds;
    part->idle += std::max(0.0, whole - part->seconds);
    part->done_bytes += bytes_of(*part);
  }
  return all;
}

/// In the part's own thread.
void SplitProduct::work(Part& part) {
  const Timer timer;
  Queue& queue = part.device->queue();
  queue.upload(*part.x, 0, std::as_bytes(std::span(x_)));
  part.product->apply(*part.x, *part.y);
  const std::size_t stride = shape_.vector_stride, columns = shape_.columns;
  const std::size_t begin = division_.added ? 0 : division_.places[part.first];
  const std::size_t end = (columns - 1) * stride + (division_.added ? shape_.n : division_.places[part.end]);
  part.got.resize(end - begin);
  queue.download(*part.y, begin * sizeof(float), std::as_writable_bytes(std::span(part.got)));
  part.seconds = timer.seconds();
}

void SplitProduct::work_on_own(Buffer& x, Buffer& y) {
  Part& part = *parts_.front();
  const Timer timer;
  if (part.works()) part.product->apply(x, y);
  device_.queue().wait();
  part.seconds = timer.seconds();
}

/// The others' places of y to the first device: neighbours together.
void SplitProduct::collect(Buffer& y) {
  const Part& own = *parts_.front();
  const std::size_t stride = shape_.vector_stride;
  if (division_.added) {
    if (own.works()) {
      device_.queue().download(y, 0, std::as_writable_bytes(std::span(y_)));
    } else {
      std::fill(y_.begin(), y_.end(), 0.0F);
    }
  }
  std::uint32_t begin = shape_.n, end = 0;  // places that come from others
  for (const auto& part : parts_) {
    if (part->worker == nullptr || !part->works()) continue;
    const std::uint32_t first = division_.added ? 0 : division_.places[part->first];
    const std::uint32_t last = division_.added ? shape_.n : division_.places[part->end];
    begin = std::min(begin, first);
    end = std::max(end, last);
    for (std::size_t c = 0; c < shape_.columns; ++c) {
      const float* from = part->got.data() + c * stride;
      float* to = y_.data() + c * stride + first;
      for (std::uint32_t i = 0; i < last - first; ++i) to[i] = division_.added ? to[i] + from[i] : from[i];
    }
  }
  for (std::size_t c = 0; c < shape_.columns && begin < end; ++c) {
    device_.queue().upload(y, (c * stride + begin) * sizeof(float),
                           std::as_bytes(std::span(y_).subspan(c * stride + begin, end - begin)));
  }
}

void SplitProduct::note() {
  std::vector<std::uint64_t> bytes;
  std::vector<double> seconds;
  for (std::size_t k = 0; k < parts_.size(); ++k) {
    const Part& part = *parts_[k];
    bytes.push_back(part.works() ? bytes_of(part) : 0);
    seconds.push_back(options_.said ? options_.said(k, bytes.back(), part.seconds) : part.seconds);
  }
  if (balance_->note(bytes, seconds)) cut_anew();
}

std::vector<Buffer*> SplitProduct::panel_buffers() const {
  std::vector<Buffer*> all;
  for (const auto& part : parts_) {
    if (part->lost) continue;
    const std::vector<Buffer*> more = part->product->panel_buffers();
    all.insert(all.end(), more.begin(), more.end());
  }
  return all;
}

Storage SplitProduct::storage() const {
  return parts_.front()->product->storage();
}

std::uint64_t SplitProduct::bytes() const {
  return parts_.front()->product->bytes();
}

std::span<const std::uint32_t> SplitProduct::order() const {
  return parts_.front()->product->order();
}

void SplitProduct::exact(const Columns& x, std::vector<std::vector<double>>& y) const {
  parts_.front()->product->exact(x, y);  // from the host's F, the whole of it
}

std::vector<DeviceShare> SplitProduct::device_shares() const {
  std::vector<DeviceShare> out;
  const auto total = static_cast<double>(division_.bytes.back());
  for (const auto& part : parts_) {
    DeviceShare share;
    share.device = part->device->info().id;
    share.bytes = part->lost ? 0 : bytes_of(*part);
    share.share = total > 0 ? static_cast<double>(share.bytes) / total : 0;
    share.bytes_per_second = part->busy > 0 ? static_cast<double>(part->done_bytes) / part->busy : 0;
    share.busy_seconds = part->busy;
    share.idle_seconds = part->idle;
    share.moves = balance_->moves();
    out.push_back(std::move(share));
  }
  return out;
}

std::unique_ptr<Product> make_split_product(const FormFactorMatrix& form_factors, const std::vector<Device*>& devices,
                                            const VectorArguments& shape, std::uint32_t groups,
                                            const SplitOptions& options) {
  const MakePart make = [&](Device& device, const VectorArguments& of, std::uint32_t launch_groups) {
    return make_part(form_factors, device, of, launch_groups);
  };
  return std::make_unique<SplitProduct>(division_of(form_factors), make, devices, shape, groups, options);
}

std::unique_ptr<Product> make_split_product(const PackedMatrix& form_factors, const std::vector<Device*>& devices,
                                            const VectorArguments& shape, std::uint32_t groups,
                                            const SplitOptions& options) {
  const MakePart make = [&](Device& device, const VectorArguments& of, std::uint32_t launch_groups) {
    return make_part(form_factors, device, of, launch_groups);
  };
  return std::make_unique<SplitProduct>(division_of(form_factors), make, devices, shape, groups, options);
}

}  // namespace interflect
