#pragma once

#include <string>
#include <vector>

#include "bench_row.h"
#include "interflect/formfactor/accuracy.h"
#include "interflect/formfactor/assembly.h"
#include "pipeline.h"

namespace interflect::cli {

struct AssemblyPlan {
  std::vector<std::string> devices;
  AssemblyOptions options;
  unsigned repetitions = 3;
  bool growth = false;  ///< rows of --growth: what "growth", storage "assembly"
};

/// "assembly" rows: the whole of F on every device in turn, from the patches to F after the closure, with the
/// hierarchy, without reading the scene. openmp is the Embree path: verified by the closed row sums, its trace_ratio
/// against the time inside Embree. The others are held against its row sums before the closure.
[[nodiscard]] std::vector<BenchRow> bench_assembly(const AssemblyPlan& plan, const SceneOptions& scene,
                                                   const std::string& label, ProgressSink& progress);

/// F of a mesh made on a device, where it stays, and thrown away. openmp: through Embree. Throws what the assembly
/// throws.
[[nodiscard]] AssemblyReport assembly_on(const std::string& id, const PatchMesh& mesh, const AssemblyOptions& options);

}  // namespace interflect::cli
