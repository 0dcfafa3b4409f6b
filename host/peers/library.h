#pragma once

#include <initializer_list>
#include <string>

namespace interflect::peers {

/// A shared library that is opened at run time and stays open: what has threads of its own does not like to be
/// unloaded.
class Library {
 public:
  /// The first of `names` that the loader finds; or what the environment variable `override_name` says, when it is set.
  /// Throws a limit Error "not installed: NAME", naming the first of `names`, or with the loader's words where it is
  /// there but does not load.
  Library(const char* override_name, std::initializer_list<const char*> names);

  /// The function `name` as a T*; throws a device Error when it has none.
  template <class T>
  [[nodiscard]] T* function(const char* name) const {
    return reinterpret_cast<T*>(find(name));
  }
  /// The same, or null.
  template <class T>
  [[nodiscard]] T* function_or_null(const char* name) const {
    return reinterpret_cast<T*>(find_or_null(name));
  }

 private:
  [[nodiscard]] void* find(const char* name) const;
  [[nodiscard]] void* find_or_null(const char* name) const;

  std::string name_;
  void* library_ = nullptr;
};

}  // namespace interflect::peers
