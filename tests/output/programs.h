#pragma once

#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <regex>
#include <string>

namespace interflect::test {

/// Runs a program of the system on a file: its output, or nothing when there is no such program. Fails by an empty
/// output, or one that does not say what is asked of it.
inline std::optional<std::string> run_program(const std::string& program, const std::string& arguments,
                                              const std::filesystem::path& file, const std::string& options = {}) {
  const auto run = [](const std::string& command, std::string& output) {
    struct Close {
      void operator()(FILE* f) const { pclose(f); }
    };
    const std::unique_ptr<FILE, Close> pipe(popen(command.c_str(), "r"));
    std::array<char, 4096> chunk{};
    while (pipe && fgets(chunk.data(), chunk.size(), pipe.get()) != nullptr) output += chunk.data();
  };
  std::string found, output;
  run("command -v " + program, found);
  if (found.empty()) return std::nullopt;
  run(program + " " + arguments + " '" + file.string() + "' " + options + " 2>&1", output);
  return output;
}

/// The number after "NAME:" in a program's output, or -1.
inline long number_after(const std::string& output, const std::string& name) {
  std::smatch match;
  const std::regex pattern("(^|\n)" + name + ":\\s*([0-9]+)");
  return std::regex_search(output, match, pattern) ? std::stol(match[2]) : -1;
}

}  // namespace interflect::test
