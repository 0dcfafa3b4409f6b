#include "interflect/base/memory.h"

#include <fmt/format.h>
#include <sys/mman.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <string>
#include <utility>

#include "interflect/base/error.h"

namespace interflect {

namespace {

constexpr std::uint64_t unlimited = std::numeric_limits<std::uint64_t>::max();

std::uint64_t meminfo_available() {
  std::ifstream file("/proc/meminfo");
  std::string key;
  std::uint64_t kib = 0;
  std::string unit;
  while (file >> key >> kib >> unit) {
    if (key == "MemAvailable:") return kib * 1024;
  }
  return unlimited;
}

std::uint64_t number_in(const char* path) {
  std::ifstream file(path);
  std::uint64_t value = 0;
  return file >> value ? value : unlimited;
}

std::uint64_t cgroup_available() {
  const std::uint64_t limit = number_in("/sys/fs/cgroup/memory.max");
  const std::uint64_t used = number_in("/sys/fs/cgroup/memory.current");
  if (limit == unlimited || used == unlimited) return unlimited;
  return limit > used ? limit - used : 0;
}

}  // namespace

std::uint64_t parse_bytes(const std::string& text, std::string_view name) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  const bool has_number = end != text.c_str();
  double unit = 1;
  switch (*end) {
    case 'K':
    case 'k':
      unit = 1024;
      ++end;
      break;
    case 'M':
    case 'm':
      unit = 1024.0 * 1024;
      ++end;
      break;
    case 'G':
    case 'g':
      unit = 1024.0 * 1024 * 1024;
      ++end;
      break;
    default: break;
  }
  if (!has_number || *end != '\0' || !(value >= 0) || value * unit >= 1e19) {
    throw Error(ErrorKind::usage, fmt::format("{}: '{}' is not a size such as 4G", name, text));
  }
  return static_cast<std::uint64_t>(value * unit);
}

std::uint64_t available_memory() {
  if (const char* forced = std::getenv("INTERFLECT_MEMORY")) return parse_bytes(forced, "INTERFLECT_MEMORY");
  return std::min(meminfo_available(), cgroup_available());
}

void PageBuffer::Unmap::operator()(std::byte* p) const noexcept {
  if (mapped > 0) ::munmap(p, mapped);
}

std::shared_ptr<const PageBuffer> PageBuffer::part(std::shared_ptr<const PageBuffer> whole, std::size_t offset,
                                                   std::size_t bytes) {
  if (offset > whole->size() || bytes > whole->size() - offset) {
    throw Error(ErrorKind::internal,
                fmt::format("bytes {} to {} of a buffer of {}", offset, offset + bytes, whole->size()));
  }
  auto made = std::make_shared<PageBuffer>();
  made->data_ = std::unique_ptr<std::byte, Unmap>(whole->data() + offset, Unmap(0));
  made->size_ = bytes;
  made->whole_ = std::move(whole);
  return made;
}

PageBuffer::PageBuffer(std::size_t bytes) : size_(bytes) {
  if (bytes == 0) return;
  constexpr std::size_t huge = std::size_t{2} << 20;
  const std::size_t rounded = (bytes + huge - 1) / huge * huge;
  const std::size_t mapped = rounded + huge;
  void* raw = rounded < bytes ? MAP_FAILED
                              : ::mmap(nullptr, mapped, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (raw == MAP_FAILED) throw Error(ErrorKind::limit, fmt::format("the system refuses {} bytes of memory", bytes));
  // Give back what lies before and after the aligned part, so that the mapping starts on a huge page.
  auto* first = static_cast<std::byte*>(raw);
  const std::size_t misaligned = reinterpret_cast<std::uintptr_t>(first) % huge;
  const std::size_t before = misaligned == 0 ? 0 : huge - misaligned;
  if (before > 0) ::munmap(first, before);
  if (huge > before) ::munmap(first + before + rounded, huge - before);
  ::madvise(first + before, rounded, MADV_HUGEPAGE);  // a hint: without it the matrix is slower, not wrong
  data_ = std::unique_ptr<std::byte, Unmap>(first + before, Unmap(rounded));
}

}  // namespace interflect
