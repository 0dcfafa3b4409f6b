#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>

#include "pipeline.h"

// Where F is assembled and where it then lies.

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

/// Where F was assembled, in the end.
struct AssemblyUse {
  std::string device = "host";
  std::uint64_t bytes_over_bus = 0;  ///< of F or S, between host and devices, both ways
};

/// The assembly's warnings, to the progress sink.
void say(const AssemblyReport& report, const Scene& scene, ProgressSink& progress);

/// F on the host, its tiles by the first candidate where that assembles, else by Embree. When that device fails, the
/// next candidate makes them, and all of them anew (but panels that options.panels has). Throws what assemble() throws,
/// and the last candidate's Error.
[[nodiscard]] FormFactors assemble_by(Candidates& candidates, AssemblyPlace place, const PatchMesh& mesh,
                                      AssemblyOptions options, AssemblyUse& use, ProgressSink& progress);

/// A solve from the mesh on.
struct PlacedSolve {
  FormFactors factors;  ///< without the matrix, where F has stayed on a device
  Solved solved;
  Energy energy;
  AssemblyUse assembly;
};
/// Assembles F and solves. In dense32 on a device that assembles, F stays there; a device that fails is followed by the
/// next candidate, which assembles F again in its own way and goes on from the last good iterate. A 16-bit format is
/// packed on the host: S then comes down from the device that made it. Warnings go to the progress sink.
[[nodiscard]] PlacedSolve assemble_and_solve(const MeshedScene& loaded, const SceneOptions& options,
                                             AssemblyPlace place, Candidates& candidates,
                                             std::optional<Storage> storage, Method method, const StopTest& stop,
                                             ProgressSink& progress);

}  // namespace interflect::cli
