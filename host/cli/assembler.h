#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "interflect/formfactor/assembly.h"
#include "interflect/solver/fallback.h"

// Who assembles.

namespace interflect::cli {

/// --assembly
enum class AssemblyPlace {
  automatic,  ///< on a real GPU, else on the host
  host,       ///< by Embree
  device,     ///< on the device, also on an emulated one; OpenMP's is the host
};
void add_assembly_option(CLI::App& command, std::string& text);
[[nodiscard]] AssemblyPlace assembly_place(const std::string& text);

/// Whether this device computes S. (Whether F then stays there is a matter of room and format.)
[[nodiscard]] bool assembles(AssemblyPlace place, const DeviceInfo& device);

/// Where F was assembled, in the end: the host too where nothing had to be, all of it came from a file.
struct AssemblyUse {
  std::string device = "host";       ///< several between commas, where they shared the tiles
  std::uint64_t bytes_over_bus = 0;  ///< of F or S, between host and devices, both ways
};

/// Gives the assembly on the host its tiles: from the first candidate where that assembles, else from Embree.
/// Candidates that work together share the tiles: by their split where that is fixed, else as fast as each is. Where S
/// is kept in a file, which has one kind of maker, only those with the backend of the first that assembles.
class Assembler {
 public:
  Assembler(Candidates& candidates, AssemblyPlace place) : candidates_(candidates), place_(place) {}
  Assembler(const Assembler&) = delete;
  Assembler& operator=(const Assembler&) = delete;

  /// Calls `act` with options.maker set, and takes the compiler's time off the seconds of the report that it returns.
  /// When the device fails, the next candidate makes the tiles, all of them anew; unless `bound`, when it is given,
  /// says what has been kept that no other one may go on with: the device's Error then says that, too. Throws what
  /// `act` throws, and the last candidate's Error.
  void run(AssemblyOptions options, const std::function<AssemblyReport&(const AssemblyOptions&)>& act,
           const std::function<std::string()>& bound = {}) {
    run(std::move(options), act, bound, false);
  }
  /// assemble() by it; without panels that are kept, by makers of several kinds.
  [[nodiscard]] FormFactors assemble(const PatchMesh& mesh, const AssemblyOptions& options, ProgressSink& progress);

  /// Who makes the tiles now, as a file of form factors has it: iff::maker_embree, ...
  [[nodiscard]] std::uint32_t maker();

  [[nodiscard]] const AssemblyUse& use() const { return use_; }
  [[nodiscard]] Candidates& candidates() { return candidates_; }
  [[nodiscard]] AssemblyPlace place() const { return place_; }

 private:
  struct Member {
    Device* device = nullptr;
    bool embree = false;  ///< OpenMP's
    double share = 0;     ///< where the split is fixed
  };
  [[nodiscard]] std::vector<Member> team(bool mixed);
  void run(AssemblyOptions options, const std::function<AssemblyReport&(const AssemblyOptions&)>& act,
           const std::function<std::string()>& bound, bool mixed);
  void leave_out(const std::string& id, const Error& error);

  Candidates& candidates_;
  AssemblyPlace place_;
  AssemblyUse use_;
};

}  // namespace interflect::cli
