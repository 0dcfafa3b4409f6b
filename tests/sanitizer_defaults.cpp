// What the sanitizers are told in every test program.

/// LLVM's OpenMP keeps the teams that it replaces when the number of threads changes; the memory is its own.
extern "C" const char* __lsan_default_suppressions() {
  return "leak:libomp.so";
}  // NOLINT: the name is LeakSanitizer's
