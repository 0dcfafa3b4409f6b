#include "program.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace interflect::test {

namespace {

std::string quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) {
    if (c == '\'') out.append("'\\'");
    out.push_back(c);
    if (c == '\'') out.push_back('\'');
  }
  out.push_back('\'');
  return out;
}

}  // namespace

std::vector<std::string> Outcome::error_lines() const {
  std::vector<std::string> lines;
  std::istringstream stream(err);
  for (std::string line; std::getline(stream, line);) {
    if (line.starts_with("interflect: error: ")) lines.push_back(line);
  }
  return lines;
}

Outcome run_program(const std::vector<std::string>& arguments, const std::vector<std::string>& environment) {
  const Folder folder;
  std::string command = "env";
  for (const std::string& variable : environment) command += fmt::format(" {}", quoted(variable));
  command += fmt::format(" {}", quoted(INTERFLECT_PROGRAM));
  for (const std::string& argument : arguments) command += fmt::format(" {}", quoted(argument));
  command += fmt::format(" >{} 2>{} </dev/null", quoted(folder.file("out")), quoted(folder.file("err")));
  const int status = std::system(command.c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), content_of(folder.file("out")),
          content_of(folder.file("err"))};
}

Folder::Folder() {
  std::string name = ::testing::TempDir() + "/interflect-cli-XXXXXX";
  if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
  path_ = name;
}

Folder::~Folder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

std::string Folder::write(const std::string& name, const std::string& content) const {
  std::ofstream(file(name), std::ios::binary) << content;
  return file(name);
}

std::vector<std::string> Folder::names() const {
  std::vector<std::string> out;
  for (const auto& entry : std::filesystem::directory_iterator(path_)) out.push_back(entry.path().filename().string());
  std::sort(out.begin(), out.end());
  return out;
}

std::string scene_file(const std::string& name) {
  return std::string(INTERFLECT_SOURCE_DIR) + "/scenes/" + name;
}

std::string content_of(const std::string& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

std::string glb_text(const std::string& path) {
  const std::string bytes = content_of(path);
  std::size_t length = 0;
  for (std::size_t b = 4; b-- > 0;) length = 256 * length + static_cast<unsigned char>(bytes.at(12 + b));
  return bytes.substr(20, length);
}

}  // namespace interflect::test
