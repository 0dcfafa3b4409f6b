#include "interflect/device/openmp/simd.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <hwy/highway.h>

#include <cstdlib>

#include "interflect/base/error.h"

namespace interflect::openmp {

namespace {

/// What machine and build have, whatever was asked for later.
const std::vector<std::int64_t>& targets() {
  static const std::vector<std::int64_t> found = hwy::SupportedAndGeneratedTargets();
  return found;
}

void use(std::string_view name, std::string_view option) {
  std::int64_t mask = 0;  // none forced: Highway takes the best
  for (const std::int64_t target : targets()) {
    if (name == hwy::TargetName(target)) mask = target;
  }
  if (mask == 0 && !name.empty()) {
    throw Error(ErrorKind::usage, fmt::format("{}: '{}' is none of {}", option, name, fmt::join(simd_targets(), ", ")));
  }
  hwy::SetSupportedTargetsForTest(mask);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

/// INTERFLECT_SIMD, once per process.
void obey_environment() {
  static const bool done = [] {
    if (const char* name = std::getenv("INTERFLECT_SIMD")) use(name, "INTERFLECT_SIMD");
    return true;
  }();
  static_cast<void>(done);
}

}  // namespace

std::vector<std::string> simd_targets() {
  std::vector<std::string> names;
  for (const std::int64_t target : targets()) names.emplace_back(hwy::TargetName(target));
  return names;
}

std::string simd_target() {
  obey_environment();
  const std::int64_t usable = hwy::SupportedTargets() & HWY_TARGETS;
  return hwy::TargetName(usable & -usable);
}

void use_simd_target(std::string_view name) {
  obey_environment();
  use(name, "SIMD target");
}

}  // namespace interflect::openmp
