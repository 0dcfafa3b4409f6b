#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "interflect/scene/vs3_words.h"

namespace interflect::vs3 {

/// The control records (C) of a View3D file: name = value pairs. Interflect integrates in its own way and prints its
/// own tables, so that none of them changes what is computed; those that would change View3D's answer are named in
/// warnings.
class Control {
 public:
  explicit Control(std::string file) : file_(std::move(file)) {}

  /// Reads the record that `in` is at. Throws an input Error for a value that is not a number.
  void read(Words& in);
  /// Adds the warnings.
  void report(std::vector<std::string>& warnings) const;

 private:
  std::string file_;
  bool enclosure_ = false, script_f_ = false, part_ = false;
  std::set<std::string> accuracy_, unknown_;
};

}  // namespace interflect::vs3
