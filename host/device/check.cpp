#include "interflect/device/check.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "interflect/base/error.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/kernel_table.h"

namespace interflect {

std::string_view name(CheckStatus status) {
  switch (status) {
    case CheckStatus::pass: return "pass";
    case CheckStatus::fail: return "fail";
    case CheckStatus::unsupported: return "unsupported";
  }
  return "?";
}

std::vector<KernelCheck> check_device(Device& device, std::uint64_t max_size) {
  std::vector<KernelCheck> rows;
  check::check_stream(device, rows, {.max_size = max_size});
  check::check_matvec(device, rows, {.max_size = max_size});
  check::check_resident(device, rows, {.max_size = max_size});
  check::check_packed(device, rows, {.max_size = max_size});
  check::check_vectors(device, rows, {.max_size = max_size});
  check::check_rays(device, rows, {.max_size = max_size});
  for (KernelCheck& row : rows) row.device = device.info().id;
  return rows;
}

double packed_bound(std::uint64_t n) {
  return check::rounding_bound(std::min<std::uint64_t>(n, 1024) + (n + 1023) / 1024 + 24);
}

double sym16_bound(std::uint64_t block) {
  return check::rounding_bound(block + 24);
}

namespace check {

namespace {

constexpr std::size_t guard = 256;  // floats
constexpr std::uint32_t sentinel_bits = 0x7FC0DEAD;

}  // namespace

float Random::next() {
  state_ += 0x9E3779B97F4A7C15U;
  std::uint64_t z = state_;
  z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
  z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
  z ^= z >> 31U;
  const float size = 0.5F + static_cast<float>(z >> 41U) * 0x1p-23F;
  return (z & 1U) != 0 ? size : -size;
}

std::vector<float> Random::numbers(std::size_t count) {
  std::vector<float> all(count);
  for (float& value : all) value = next();
  return all;
}

float sentinel() {
  float value = 0;
  std::memcpy(&value, &sentinel_bits, sizeof value);
  return value;
}

bool is_sentinel(float value) {
  std::uint32_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  return bits == sentinel_bits;
}

GuardedBuffer::GuardedBuffer(Device& device, std::span<const float> values) : count_(values.size()) {
  const std::size_t bytes = (count_ + guard) * sizeof(float);
  if (bytes > device.info().max_buffer_bytes) {
    throw Error(ErrorKind::limit, "the case needs a larger buffer than the device has");
  }
  buffer_ = device.allocate(bytes);
  std::vector<float> all(values.begin(), values.end());
  all.insert(all.end(), guard, sentinel());
  device.queue().upload(*buffer_, 0, std::as_bytes(std::span(all)));
}

std::vector<float> GuardedBuffer::values(Device& device) const {
  std::vector<float> all(count_ + guard);
  device.queue().download(*buffer_, 0, std::as_writable_bytes(std::span(all)));
  for (std::size_t i = count_; i < all.size(); ++i) {
    if (!is_sentinel(all[i])) throw device_error(device.info().id, "check", "a kernel wrote behind a buffer's end");
  }
  all.resize(count_);
  return all;
}

double rounding_bound(std::uint64_t c) {
  const double cu = static_cast<double>(c) * 0x1p-24;
  return cu / (1 - cu);
}

Macros case_macros(const DeviceInfo& device, std::string_view kernel, const Selection& selection,
                   std::uint32_t columns) {
  Macros macros = default_macros(device, kernel);
  for (const auto& [name, value] : selection.macros) macros.insert_or_assign(name, value);
  macros.insert_or_assign("COLUMNS", static_cast<int>(columns));
  return macros;
}

void compare(Finding& finding, float result, double reference, double magnitude) {
  const double difference = std::abs(static_cast<double>(result) - reference);
  const double error = difference == 0 ? 0 : difference / magnitude;
  if (std::isnan(finding.error) || error <= finding.error) return;
  finding.error = error;
}

void add_case(std::vector<KernelCheck>& rows, KernelCheck row, const std::function<Finding()>& run) {
  try {
    Finding finding = run();
    row.error = finding.error;
    row.reason = std::move(finding.wrong);
    const bool within = row.error <= row.bound;  // false for NaN
    if (!within && row.reason.empty()) row.reason = "the error exceeds its bound";
    row.status = row.reason.empty() ? CheckStatus::pass : CheckStatus::fail;
  } catch (const Error& error) {
    row.error = std::numeric_limits<double>::quiet_NaN();
    row.status = error.kind() == ErrorKind::limit ? CheckStatus::unsupported : CheckStatus::fail;
    row.reason = error.what();
  }
  rows.push_back(std::move(row));
}

}  // namespace check

}  // namespace interflect
