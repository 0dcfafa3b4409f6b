#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/base/vec3.h"
#include "interflect/formfactor/patch_table.h"
#include "interflect/formfactor/surroundings.h"
#include "interflect/scene/patch_mesh.h"

namespace interflect {

/// Why a row of F does not sum to what it should.
enum class Cause {
  sampling,          ///< within certain_errors times the error that sampling leaves
  flipped_normal,    ///< a surface shows its back to where light is: turned round, or to be two-sided
  interpenetration,  ///< part of the patch lies behind or inside another surface
  open_seam,         ///< light leaves a scene that is closed but for that
  coarse_mesh,       ///< the patch is larger than its distance from much of what it sees
  unknown,           ///< none of these
};
/// "sampling error", "flipped normal", "interpenetration", "open seam", "coarse mesh", "none known".
[[nodiscard]] std::string_view name(Cause cause);

/// How many estimated errors a row may be off by without another cause being looked for.
inline constexpr double certain_errors = 4;
/// A scene that loses less than this share of its light is taken to be meant closed: its rows are to sum to 1, and what
/// escapes is a seam. In other scenes what escapes goes to the sky, and a row and its sky are to sum to 1.
inline constexpr double meant_closed = 0.05;

/// All that likely_cause() decides by.
struct RowFacts {
  double deviation = 0;  ///< row sum, and sky in an open scene, less 1
  double error = 0;      ///< estimated, of the row sum
  bool seam = true;      ///< the scene is meant closed
  bool turned = false;   ///< the patch is wound against its neighbours (MeshEdges::turned)
  Around around;
};

/// The rules, in their order; "explains" is: at least half of what is missing.
///  1. |deviation| <= certain_errors · error: sampling.
///  2. Something is missing. The patch is turned and backs and escapes explain it: flipped normal (its own). Backs of
///     turned patches explain it: flipped normal (theirs). Points inside explain it: interpenetration. Backs explain
///     it: flipped normal. Escapes explain it, or do with the backs, in a scene meant closed: open seam.
///  3. A quarter of the rays or more ends nearer than the patch's radius: coarse mesh.
///  4. Otherwise: unknown.
[[nodiscard]] Cause likely_cause(const RowFacts& facts);

/// A row of F that is off, and why.
struct SuspectRow {
  std::uint32_t patch = 0;
  std::string object, group;
  Vec3 centroid{};
  double row_sum = 0;  ///< as computed
  double deviation = 0, error = 0, escape = 0, back = 0;
  bool set_aside = false;  ///< the patch sees next to nothing and takes no part in the closure
  Cause cause = Cause::unknown;
  std::string other;  ///< the surface at fault where it is another one: object, or group where that is empty
};

/// What is wrong with F, row by row.
struct Certificate {
  bool made = false;
  std::uint64_t rows = 0;  ///< that are judged: not of buried patches, nor of those that look out of a closed scene
  std::uint64_t off = 0;   ///< of them by more than certain_errors times their error
  /// The rows that are off by |deviation|; after these, in the same order, those of patches inside other objects, which
  /// take no part in the closure; then the rest of the rows that are judged.
  std::vector<SuspectRow> worst;
};

struct CertificateInput {
  const std::vector<double>& row_sum;      ///< before the closure
  const std::vector<double>& error;        ///< of each, as estimated
  const std::vector<bool>& takes_part;     ///< not: buried patches
  const std::vector<float>&escape, &back;  ///< HemisphereShares
  std::uint32_t rays = 1;                  ///< behind each of these shares
  double escape_fraction = 0;              ///< of the scene
};

/// Names the `most` worst rows. Where one of them is off by more than its error, rays look around from it.
/// Deterministic.
[[nodiscard]] Certificate certify(const PatchMesh& mesh, const PatchTable& patches, const CertificateInput& input,
                                  std::size_t most = 20);

}  // namespace interflect
