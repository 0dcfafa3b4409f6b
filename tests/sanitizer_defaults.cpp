// What the sanitizers are told in every test program.

/// LLVM's OpenMP keeps the teams that it replaces when the number of threads changes; ViennaCL's shared_ptr forgets its
/// counter when it is reset over memory that is not its own. The memory is theirs.
extern "C" const char* __lsan_default_suppressions() {
  return "leak:libomp.so\nleak:/usr/include/viennacl/";
}  // NOLINT: the name is LeakSanitizer's
