#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace interflect {

/// What a compiled kernel depends on.
struct CompileKey {
  std::string backend;  ///< opencl, vulkan, cuda
  std::string device;   ///< name or architecture, whatever the binary is made for
  std::string driver;   ///< driver or compiler and its version
  std::string options;  ///< macros and compiler options
  std::string source;
};

/// The binary for `key`: from the disk, or from compile(), then kept on the disk. A damaged entry, or one of another
/// key, is compiled anew. The folder is $XDG_CACHE_HOME/interflect/kernels (else ~/.cache/...); where it cannot be
/// written, or INTERFLECT_CACHE is "off", nothing is kept and nobody is told: the cache is a convenience. Entries are
/// written to a temporary name and renamed. Counts into compile_statistics(). Throws what compile() throws.
[[nodiscard]] std::vector<std::byte> cached_compile(const CompileKey& key,
                                                    const std::function<std::vector<std::byte>()>& compile);

/// Forgets the entry of `key`, for a binary that its driver refused to load.
void forget_compiled(const CompileKey& key);

/// What kernels have cost this process so far.
struct CompileStatistics {
  std::uint32_t compiled = 0;    ///< by a compiler
  std::uint32_t from_cache = 0;  ///< read from the disk
  double seconds = 0;            ///< in cached_compile(), and in what add_compile_seconds() was told of
};
[[nodiscard]] CompileStatistics compile_statistics();
/// For what a driver does with a binary before its kernels can run.
void add_compile_seconds(double seconds);

}  // namespace interflect
