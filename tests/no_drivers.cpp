// In a test program that links this file the loaders of OpenCL and Vulkan find no driver, and neither do the programs
// that it runs, nor anything tuned: what it tests is the same on every machine, and LeakSanitizer is not shown what drivers leave behind.
// The programs with drivers are tests/backends.
#include <cstdlib>
#include <initializer_list>

namespace {

const bool hidden = [] {
  ::setenv("OCL_ICD_VENDORS", "/nonexistent", 1);
  for (const char* name : {"VK_ICD_FILENAMES", "VK_DRIVER_FILES"}) ::setenv(name, "/nonexistent", 1);
  ::setenv("INTERFLECT_TUNING", "off", 1);  // nor the shapes that the user's machine has been tuned to
  return true;
}();

}  // namespace
