#include <dlfcn.h>
#include <fmt/format.h>
#include <glob.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <mutex>

#include "interflect/base/error.h"
#include "interflect/device/cuda/api.h"
#include "interflect/device/kernel_source.h"

namespace interflect::cuda {

namespace {

struct Program;

std::string variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

/// The files that match the pattern.
std::vector<std::string> matching(const std::string& pattern) {
  glob_t found{};
  std::vector<std::string> paths;
  if (::glob(pattern.c_str(), 0, nullptr, &found) == 0) paths.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
  ::globfree(&found);
  return paths;
}

/// Where NVRTC may be, in the order in which it is looked for.
std::vector<std::string> candidates() {
  std::vector<std::string> all = {"libnvrtc.so", "libnvrtc.so.13", "libnvrtc.so.12"};  // the loader's path
  const auto add = [&](const std::string& folder) {
    for (std::string& path : matching(folder + "/libnvrtc.so*")) all.push_back(std::move(path));
  };
  for (const std::string& home : {variable("CUDA_HOME"), variable("CUDA_PATH"), std::string("/usr/local/cuda*")}) {
    if (home.empty()) continue;
    for (const char* folder : {"/lib64", "/lib", "/targets/x86_64-linux/lib"}) add(home + folder);
  }
  const std::string home = variable("HOME").empty() ? "" : variable("HOME") + "/.local";
  for (const std::string& prefix : {variable("VIRTUAL_ENV"), home, std::string("/usr/local"), std::string("/usr")}) {
    if (prefix.empty()) continue;
    for (const char* packages : {"/lib/python3*/site-packages", "/lib/python3*/dist-packages"}) {
      for (const char* package : {"/nvidia/cuda_nvrtc/lib", "/nvidia/cu1*/lib"}) add(prefix + packages + package);
    }
  }
  return all;
}

/// The first line of the log that names an error: "cuda/matvec.cu(12): error: ...".
std::string first_error(const std::string& log) {
  std::string first;
  for (std::size_t begin = 0; begin < log.size();) {
    const std::size_t end = std::min(log.find('\n', begin), log.size());
    std::string line = log.substr(begin, end - begin);
    begin = end + 1;
    if (line.find("error") != std::string::npos) return line;
    if (first.empty()) first = line;
  }
  return first.empty() ? "no reason given" : first;
}

}  // namespace

struct Nvrtc::Functions {
  Result (*version)(int* major, int* minor) = nullptr;
  const char* (*error_string)(Result) = nullptr;
  Result (*architecture_count)(int* count) = nullptr;
  Result (*architectures)(int* all) = nullptr;
  Result (*create)(Program** program, const char* source, const char* name, int headers, const char* const* texts,
                   const char* const* names) = nullptr;
  Result (*destroy)(Program** program) = nullptr;
  Result (*compile)(Program* program, int count, const char* const* options) = nullptr;
  Result (*log_size)(Program* program, std::size_t* bytes) = nullptr;
  Result (*log)(Program* program, char* text) = nullptr;
  Result (*cubin_size)(Program* program, std::size_t* bytes) = nullptr;
  Result (*cubin)(Program* program, char* bytes) = nullptr;
  Result (*ptx_size)(Program* program, std::size_t* bytes) = nullptr;
  Result (*ptx)(Program* program, char* text) = nullptr;

  [[nodiscard]] bool find_all(void* library) {
    const auto find = [&](auto& function, const char* name) {
      function = reinterpret_cast<std::remove_reference_t<decltype(function)>>(::dlsym(library, name));
      return function != nullptr;
    };
    return find(version, "nvrtcVersion") && find(error_string, "nvrtcGetErrorString") &&
           find(architecture_count, "nvrtcGetNumSupportedArchs") && find(architectures, "nvrtcGetSupportedArchs") &&
           find(create, "nvrtcCreateProgram") && find(destroy, "nvrtcDestroyProgram") &&
           find(compile, "nvrtcCompileProgram") && find(log_size, "nvrtcGetProgramLogSize") &&
           find(log, "nvrtcGetProgramLog") && find(cubin_size, "nvrtcGetCUBINSize") && find(cubin, "nvrtcGetCUBIN") &&
           find(ptx_size, "nvrtcGetPTXSize") && find(ptx, "nvrtcGetPTX");
  }
};

std::shared_ptr<const Nvrtc> Nvrtc::load(const std::string& path, std::string& reason) {
  static std::map<std::string, std::shared_ptr<const Nvrtc>> loaded;  // under the lock of open()
  if (const auto known = loaded.find(path); known != loaded.end()) return known->second;
  void* library = ::dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  if (library == nullptr) {
    reason = ::dlerror();
    return nullptr;
  }
  auto functions = std::make_shared<Functions>();
  auto nvrtc = std::make_shared<Nvrtc>();
  if (!functions->find_all(library) || functions->version(&nvrtc->major_, &nvrtc->minor_) != 0 || nvrtc->major_ < 12) {
    reason = fmt::format("{} is {}, 12 or newer is needed", path,
                         nvrtc->major_ == 0 ? "not a usable NVRTC" : "NVRTC " + nvrtc->version());
    return nullptr;
  }
  int count = 0;
  if (functions->architecture_count(&count) == 0 && count > 0) {
    nvrtc->architectures_.resize(static_cast<std::size_t>(count));
    if (functions->architectures(nvrtc->architectures_.data()) != 0) nvrtc->architectures_.clear();
  }
  std::sort(nvrtc->architectures_.begin(), nvrtc->architectures_.end());
  nvrtc->functions_ = std::move(functions);
  return loaded[path] = std::move(nvrtc);
}

const Nvrtc* Nvrtc::open(int driver_major, std::string& reason) {
  static std::mutex mutex;
  const std::lock_guard lock(mutex);
  std::string cause;
  if (const std::string named = variable("INTERFLECT_NVRTC"); !named.empty()) {
    const auto found = load(named, cause);
    if (found == nullptr) reason = "INTERFLECT_NVRTC: " + cause;
    return found.get();
  }
  std::shared_ptr<const Nvrtc> newer;
  std::string unfit;
  for (const std::string& path : candidates()) {
    const auto found = load(path, cause);
    if (found != nullptr && found->major_ <= driver_major) return found.get();
    if (found != nullptr && newer == nullptr) newer = found;
    if (found == nullptr && cause.ends_with("is needed")) unfit = cause + "; ";
  }
  if (newer == nullptr) {
    reason = fmt::format(
        "NVRTC 12 or newer not found ({}looked in the loader's path, CUDA_HOME, CUDA_PATH, /usr/local/cuda* and pip's "
        "nvidia packages; INTERFLECT_NVRTC can name the library)",
        unfit);
  }
  return newer.get();
}

std::string Nvrtc::version() const {
  return fmt::format("{}.{}", major_, minor_);
}

std::string Nvrtc::target(int capability) const {
  const auto after = std::upper_bound(architectures_.begin(), architectures_.end(), capability);
  if (after == architectures_.begin()) return "";
  const int newest = *(after - 1);
  return fmt::format("{}_{}", newest == capability ? "sm" : "compute", newest);
}

Nvrtc::Compiled Nvrtc::compile(const std::string& source, const std::string& file,
                               const std::vector<std::string>& options) const {
  const Functions& f = *functions_;
  Program* raw = nullptr;
  if (const Result result = f.create(&raw, source.c_str(), file.c_str(), 0, nullptr, nullptr); result != 0) {
    return {{}, fmt::format("nvrtcCreateProgram: error: {} ({})", f.error_string(result), result)};
  }
  const auto destroy = [&f](Program* program) { f.destroy(&program); };
  const std::unique_ptr<Program, decltype(destroy)> program(raw, destroy);
  std::vector<const char*> texts;
  bool cubin = false;
  for (const std::string& option : options) {
    texts.push_back(option.c_str());
    cubin = cubin || option.find("=sm_") != std::string::npos;
  }
  Result result = f.compile(raw, static_cast<int>(texts.size()), texts.data());
  Compiled compiled;
  std::size_t bytes = 0;
  if (f.log_size(raw, &bytes) == 0 && bytes > 1) {
    compiled.log.resize(bytes);
    if (f.log(raw, compiled.log.data()) != 0) compiled.log.clear();
    while (!compiled.log.empty() && (compiled.log.back() == '\0' || compiled.log.back() == '\n')) {
      compiled.log.pop_back();
    }
  }
  bytes = 0;
  if (result == 0) result = (cubin ? f.cubin_size : f.ptx_size)(raw, &bytes);
  if (result == 0) {
    compiled.binary.resize(bytes);
    result = (cubin ? f.cubin : f.ptx)(raw, reinterpret_cast<char*>(compiled.binary.data()));
  }
  if (result != 0) {
    compiled.binary.clear();
    compiled.log += fmt::format("\nnvrtcCompileProgram: error: {} ({})", f.error_string(result), result);
  }
  return compiled;
}

CompileKey compile_key(const Nvrtc& nvrtc, const std::string& target, std::string_view file, const Macros& macros) {
  std::string options = "--gpu-architecture=" + target + "\n--std=c++17";
  for (const auto& [name, value] : macros) options += fmt::format("\n-D{}={}", name, value);
  return {.backend = "cuda",
          .device = target,
          .driver = "NVRTC " + nvrtc.version(),
          .options = std::move(options),
          .source = kernel_source("cuda", fmt::format("{}.cu", file))};
}

std::vector<std::byte> compile(const Nvrtc& nvrtc, const CompileKey& key, std::string_view device,
                               std::string_view file) {
  std::vector<std::string> options;
  for (std::size_t begin = 0; begin < key.options.size();) {
    const std::size_t end = std::min(key.options.find('\n', begin), key.options.size());
    options.push_back(key.options.substr(begin, end - begin));
    begin = end + 1;
  }
  const std::string path = fmt::format("cuda/{}.cu", file);
  Nvrtc::Compiled compiled = nvrtc.compile(key.source, path, options);
  if (compiled.binary.empty()) {
    const Error line = device_error(device, "compile " + path, first_error(compiled.log));
    throw Error(ErrorKind::device, fmt::format("{}\n{}", line.what(), compiled.log));
  }
  return std::move(compiled.binary);
}

}  // namespace interflect::cuda
