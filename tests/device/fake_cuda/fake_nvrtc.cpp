#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <string>

// A fake NVRTC, for tests only: it looks no further into the source than for #error lines, and its "cubin" names the
// target and the macros, by which the fake driver finds the kernels that were built for the processor.

namespace {

struct Program {
  std::string source, name, log, binary;
};

/// "cuda/axpby.cu(3): error: ..." for an #error line.
std::string error_of(const std::string& source) {
  std::istringstream lines(source);
  std::string file = "?";
  int number = 0;
  for (std::string line; std::getline(lines, line);) {
    ++number;
    if (line.rfind("#line ", 0) == 0) {
      number = std::atoi(line.c_str() + 6) - 1;
      file = line.substr(line.find('"') + 1);
      file.pop_back();
    } else if (line.rfind("#error", 0) == 0) {
      return file + "(" + std::to_string(number) + "): error: #error directive:" + line.substr(6) +
             "\n\n1 error detected in the compilation of \"fake\".\n";
    } else if (line.rfind("#include", 0) == 0) {
      return file + "(" + std::to_string(number) + "): catastrophic error: cannot open source file\n";
    }
  }
  return "";
}

}  // namespace

extern "C" {

int nvrtcVersion(int* major, int* minor) {
  const char* asked = std::getenv("FAKE_NVRTC_VERSION");
  return std::sscanf(asked == nullptr ? "12.8" : asked, "%d.%d", major, minor) == 2 ? 0 : 3;
}
const char* nvrtcGetErrorString(int result) {
  return result == 6 ? "NVRTC_ERROR_COMPILATION" : "NVRTC_ERROR_INVALID_OPTION";
}
int nvrtcGetNumSupportedArchs(int* count) {
  *count = 3;
  return 0;
}
int nvrtcGetSupportedArchs(int* all) {
  const char* newest = std::getenv("FAKE_NVRTC_NEWEST");
  all[0] = 70;
  all[1] = 80;
  all[2] = newest == nullptr ? 90 : std::atoi(newest);
  return 0;
}
int nvrtcCreateProgram(Program** program, const char* source, const char* name, int, const char* const*,
                       const char* const*) {
  *program = new Program{source, name, "", ""};
  return 0;
}
int nvrtcDestroyProgram(Program** program) {
  delete *program;
  *program = nullptr;
  return 0;
}
int nvrtcCompileProgram(Program* program, int count, const char* const* options) {
  program->log = error_of(program->source);
  if (!program->log.empty()) return 6;
  const std::string target = "--gpu-architecture=";
  std::string macros;
  for (int i = 0; i < count; ++i) {
    const std::string option = options[i];
    if (option.rfind(target, 0) == 0) {
      const std::string name = option.substr(target.size());
      program->binary = (name.rfind("sm_", 0) == 0 ? "fake cubin " : "fake ptx ") + name + "\n";
    } else if (option.rfind("-D", 0) == 0) {
      macros += option.substr(2) + "\n";
    } else if (option != "--std=c++17") {
      program->log = "unknown option " + option;
      return 5;
    }
  }
  program->binary += macros;
  return program->binary.rfind("fake", 0) == 0 ? 0 : 5;
}
int nvrtcGetProgramLogSize(Program* program, std::size_t* bytes) {
  *bytes = program->log.size() + 1;
  return 0;
}
int nvrtcGetProgramLog(Program* program, char* text) {
  std::memcpy(text, program->log.c_str(), program->log.size() + 1);
  return 0;
}
int nvrtcGetCUBINSize(Program* program, std::size_t* bytes) {
  *bytes = program->binary.size() + 1;
  return 0;
}
int nvrtcGetCUBIN(Program* program, char* bytes) {
  std::memcpy(bytes, program->binary.c_str(), program->binary.size() + 1);
  return 0;
}
int nvrtcGetPTXSize(Program* program, std::size_t* bytes) {
  return nvrtcGetCUBINSize(program, bytes);
}
int nvrtcGetPTX(Program* program, char* text) {
  return nvrtcGetCUBIN(program, text);
}
}
