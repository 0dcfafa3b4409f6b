#pragma once

#include "interflect/output/smooth.h"

namespace interflect {

/// Whether patch j may continue the surface of patch i: same material (or equal ρ and E), both lamps or neither,
/// normals within the crease angle.
class Continues {
 public:
  Continues(const PatchMesh& mesh, double crease);
  bool operator()(std::uint32_t i, std::uint32_t j) const;

 private:
  const PatchMesh& mesh_;
  double cosine_;
};

/// The smooth vertices that lie in the middle of an edge of a patch whose surface they continue (and, recursively, in
/// the middle of its halves), longest edges first.
[[nodiscard]] std::vector<SmoothMesh::Hanging> find_hanging(const PatchMesh& mesh, const SmoothMesh& smooth,
                                                            const Continues& continues);

}  // namespace interflect
