#pragma once

#include <string>

#include "interflect/scene/affine.h"
#include "interflect/scene/gltf_document.h"

namespace interflect::gltf {

/// "node 3 ('lamp')", for messages.
[[nodiscard]] std::string node_name(const Document& document, int index);

/// The transformation of node `index` (which exists) to its parent: its matrix, or translation * rotation * scale.
/// Throws an input Error naming the node for lists of the wrong length, a matrix that is not affine, a quaternion of 0.
[[nodiscard]] Affine transformation(const Document& document, int index);

}  // namespace interflect::gltf
