#pragma once

#include <string>
#include <vector>

namespace interflect::test {

/// What a run of the program left.
struct Outcome {
  int status = -1;  ///< exit status; 128 + signal when it was killed
  std::string out, err;
  /// The lines of stderr that are errors.
  [[nodiscard]] std::vector<std::string> error_lines() const;
};

/// Runs build's interflect with these arguments; `environment` entries are NAME=VALUE and added to this process's own.
[[nodiscard]] Outcome run_program(const std::vector<std::string>& arguments,
                                  const std::vector<std::string>& environment = {});

/// A folder of this test's own, empty at first and removed by the destructor.
class Folder {
 public:
  Folder();
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  ~Folder();
  [[nodiscard]] std::string file(const std::string& name) const { return path_ + "/" + name; }
  /// Writes a file and gives its path.
  [[nodiscard]] std::string write(const std::string& name, const std::string& content) const;
  /// The names of what lies in it.
  [[nodiscard]] std::vector<std::string> names() const;

 private:
  std::string path_;
};

[[nodiscard]] std::string scene_file(const std::string& name);  ///< scenes/NAME of the source tree
[[nodiscard]] std::string content_of(const std::string& path);
[[nodiscard]] std::string glb_text(const std::string& path);  ///< the JSON chunk of a GLB file

}  // namespace interflect::test
