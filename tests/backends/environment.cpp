// What a test process that opens GPU drivers needs of its surroundings, before any of them is loaded.

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <string>

namespace {

/// Compiled kernels are kept between test processes, but two processes never share a folder at the same time: PoCL's
/// cache does not stand that. The first free one of a few is taken, and its lock held until the process ends.
struct Environment {
  Environment() {
    const std::filesystem::path base = INTERFLECT_TEST_CACHE;
    for (int k = 0; k < 64; ++k) {
      const std::filesystem::path folder = base / std::to_string(k);
      std::error_code ignored;
      std::filesystem::create_directories(folder / "pocl", ignored);
      lock = ::open((folder / "lock").c_str(), O_CREAT | O_RDWR, 0644);
      if (lock < 0) continue;
      if (::flock(lock, LOCK_EX | LOCK_NB) != 0) {
        ::close(lock);
        continue;
      }
      ::setenv("POCL_CACHE_DIR", (folder / "pocl").c_str(), 1);
      ::setenv("XDG_CACHE_HOME", folder.c_str(), 1);
      return;
    }
  }
  int lock = -1;  // open until the process ends; children inherit it
};

const Environment environment;

/// Tests run with the default launch shapes, and search none.
const bool untuned = ::setenv("INTERFLECT_TUNING", "off", 1) == 0;

/// Vulkan under the validation layers, unless the caller has said otherwise.
const bool validated = ::setenv("INTERFLECT_VULKAN_VALIDATION", "1", 0) == 0;

// Leaks are not looked for here: PoCL, Mesa and LLVM leave memory behind and are unloaded before the end, so that no
// suppression knows them. Ours are found by the other programs, by the validation layers (Vulkan objects:
// Leftovers of tests/device/vulkan_test.cpp fails any test that they say something in) and by the fake CUDA driver
// (every object).
const bool leaks_ignored = ::setenv("ASAN_OPTIONS", "detect_leaks=0", 0) == 0;  // in programs that a test runs

}  // namespace

extern "C" const char* __asan_default_options() {
  return "detect_leaks=0";
}  // NOLINT: AddressSanitizer's name
