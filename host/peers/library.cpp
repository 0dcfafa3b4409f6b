#include "interflect/peers/library.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <cstdlib>

#include "interflect/base/error.h"

namespace interflect::peers {

namespace {

/// Null, with the loader's words in `cause` when the file is there but does not load.
void* opened(const std::string& name, std::string& cause) {
  if (void* library = ::dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE)) return library;
  const char* const text = ::dlerror();
  const std::string words = text == nullptr ? "" : text;
  const bool missing = words.starts_with(name + ": cannot open shared object file: No such file");
  if (!missing && cause.empty()) cause = words;
  return nullptr;
}

}  // namespace

Library::Library(const char* override_name, std::initializer_list<const char*> names) {
  std::string cause;
  const char* const given = std::getenv(override_name);
  if (given != nullptr && *given != '\0') {
    name_ = given;
    library_ = opened(name_, cause);
  } else {
    for (const char* name : names) {
      name_ = name;
      library_ = opened(name_, cause);
      if (library_ != nullptr) return;
    }
    name_ = *names.begin();
  }
  if (library_ != nullptr) return;
  throw Error(ErrorKind::limit, cause.empty() ? "not installed: " + name_ : "does not load: " + cause);
}

void* Library::find_or_null(const char* name) const {
  return ::dlsym(library_, name);
}

void* Library::find(const char* name) const {
  if (void* found = find_or_null(name)) return found;
  throw Error(ErrorKind::device, fmt::format("{} has no function {}", name_, name));
}

}  // namespace interflect::peers
