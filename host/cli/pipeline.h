#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "console.h"
#include "interflect/base/error.h"
#include "interflect/device/device.h"
#include "interflect/formfactor/accuracy.h"
#include "interflect/formfactor/assembly.h"
#include "interflect/formfactor/packed_matrix.h"
#include "interflect/output/output.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/solver/fallback.h"
#include "interflect/solver/solver.h"
#include "lights.h"

namespace interflect::cli {

/// The options that every command with a scene shares.
struct SceneOptions {
  std::string file;
  std::optional<double> divide;
  std::optional<std::uint64_t> patches;
  bool two_sided = false;
  std::string closure = "auto";
  std::string group_by = "auto";
  std::optional<std::string> accuracy;  ///< as given
  std::optional<std::uint64_t> seed;
  std::optional<std::string> memory;  ///< as given
  bool quiet = false;
  bool json_progress = false;
};
/// How --quiet and --json-progress want stderr used; of several ranks only rank 0 speaks.
[[nodiscard]] Voice voice_of(const SceneOptions& options);
void add_scene_options(CLI::App& command, SceneOptions& options,
                       const std::string& what = "scene: .xml (rrv), .obj, .gltf, .glb or .vs3 (View3D)");

struct MeshedScene {
  Scene scene;
  PatchMesh mesh;
  Grouping grouping;
  std::vector<std::string> warnings;  ///< the reader's and the input check's, one line each
  double divide = 0;
  double read_seconds = 0, mesh_seconds = 0;
};

/// Reads, checks and cuts the scene. Warnings go to the progress sink; an error among the findings is thrown.
[[nodiscard]] MeshedScene load(const SceneOptions& options, ProgressSink& progress);

/// What the options say of the assembly. Throws a usage Error for an accuracy that is none.
[[nodiscard]] AssemblyOptions assembly_options(const SceneOptions& options);
[[nodiscard]] Accuracy accuracy_asked(const SceneOptions& options);  ///< medium where none was given
[[nodiscard]] GroupBy group_by(const std::string& name);
void report_warnings(const AssemblyReport& report, const std::string& name, ProgressSink& progress);

/// The bytes of S that may be in memory when F exceeds the memory, so that its panels must stay in a file; nothing when
/// F fits: --memory, or what is available. Throws a usage Error for a --memory that is no size.
[[nodiscard]] std::optional<std::uint64_t> memory_for_streaming(const SceneOptions& options, std::size_t patches);

/// Throws a limit Error when F exceeds --memory where no file may keep it; `how_to_keep` says how one would.
void check_memory_asked(const SceneOptions& options, std::size_t patches, const std::string& how_to_keep);

/// Assembles F; the assembly's warnings go to the progress sink.
[[nodiscard]] FormFactors assemble_checked(const MeshedScene& loaded, const SceneOptions& options,
                                           ProgressSink& progress);

/// F in a 16-bit format: the tiled ones in patch_order(), sym16 with that block. Throws what PackedMatrix throws.
[[nodiscard]] PackedMatrix pack(const FormFactorMatrix& matrix, const PatchMesh& mesh, Storage storage,
                                std::uint32_t block);

/// What a solve with panels in a file took.
struct StreamUse {
  std::uint32_t panels = 0, resident = 0;  ///< of the file, and those that stayed in memory
  std::uint64_t bytes_read = 0;            ///< from the file
  std::uint64_t passes = 0;                ///< over the panels: a product each
  double seconds_waiting = 0;              ///< for the disk
};

/// How F was stored for a solve.
struct StorageUse {
  Storage format = Storage::dense32;
  std::uint64_t bytes = 0;
  double nonzero_fraction = 0;                ///< of the n² elements
  std::optional<double> rounding_error = {};  ///< of the radiosities, see rounding_error(); none for dense32
  double pack_seconds = 0;                    ///< order of the patches and packing
  std::string refused = {};                   ///< the format that dense32 took the place of, and why
  std::optional<StreamUse> streamed = {};     ///< panels of S came from a file
};

/// Radiosity and what it took.
struct Solved {
  std::vector<Rgb> radiosity;
  SolveReport report;                ///< with light groups its residuals are the worst group's, per channel
  std::vector<std::string> devices;  ///< that did the work
  std::vector<DeviceFailure> failures;
  double upload_seconds = 0;
  StorageUse storage = {};
  std::uint64_t uploaded_bytes = 0;  ///< of F
  // As in Solution, and what there is to say of each group.
  LightGroups lights = {};
  std::vector<std::vector<Rgb>> lit = {};
  std::vector<std::vector<std::vector<Rgb>>> bounces = {};
  std::vector<GroupResidual> groups = {};
  std::vector<DeviceShare> shares = {};  ///< of devices that worked together
  std::optional<Error> lost = {};        ///< see FallbackReport: the radiosity is the last iterate
};
/// Of the columns of all groups.
[[nodiscard]] Solved solved_of(FallbackReport done, const PatchMesh& mesh, const Lamps& lamps, const Columns& radiosity,
                               StorageUse storage);
/// Columns for one pass over the matrix: columns_at_once(), or fewer where sym16's partial sums of all of them are too
/// large for the device. BatchedSolve takes the rest in further passes.
[[nodiscard]] std::uint32_t columns_of_packed(const PackedMatrix& packed, const DeviceInfo& device,
                                              std::size_t columns);
/// On the first candidate, and on the next ones when it fails, or on all of them together, with F in the storage
/// format, or, without one, in that of choose_storage(). A 16-bit format whose rounding moves a radiosity by more than
/// largest_rounding_error is refused with a warning, and dense32 takes its place. All light groups of `lamps` are
/// columns of the same products. When the last device fails, the last iterate is the result, if there is one:
/// Solved::lost.
[[nodiscard]] Solved solve_scene(const FormFactorMatrix& matrix, const PatchMesh& mesh, Candidates& candidates,
                                 std::optional<Storage> storage, Method method, const StopTest& stop,
                                 ProgressSink& progress, const Lamps& lamps = {});
/// The same with panels that stay in a file: for one device at a time. Throws a limit Error for a 16-bit format, which
/// would be packed from the whole of F.
[[nodiscard]] Solved solve_streamed(const StreamedMatrix& matrix, const PatchMesh& mesh, Candidates& candidates,
                                    std::optional<Storage> storage, Method method, const StopTest& stop,
                                    ProgressSink& progress, const Lamps& lamps = {});
/// Where F has been placed already; columns_at_once(3 * groups) are the columns that a Scheduler needs for one pass.
[[nodiscard]] Solved solve_placed(Scheduler& scheduler, const PatchMesh& mesh, Method method, const StopTest& stop,
                                  const Lamps& lamps = {});

/// y = F x in double, wherever F lies: see exact_product().
using ExactProduct = std::function<void(const Columns& x, std::vector<std::vector<double>>& y)>;

/// Where the light goes, per channel, in the scene's power unit: emitted = absorbed + escaped when all is right.
struct Energy {
  Rgb emitted{}, absorbed{}, escaped{};
  /// |emitted − absorbed − escaped| / emitted, over all channels; 0 without light.
  [[nodiscard]] double balance_error() const;
};
/// emitted = Σ A E, absorbed = Σ A (1 − ρ)(F B), escaped = Σ A B (1 − Σ_j F_ij): F B is computed anew in double, so
/// that the balance checks reciprocity and the solution.
[[nodiscard]] Energy energy_balance(const ExactProduct& exact, const PatchMesh& mesh, const std::vector<Rgb>& radiosity,
                                    const std::vector<double>& row_sum);

}  // namespace interflect::cli
