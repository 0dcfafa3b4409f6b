#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <unordered_map>

#include "interflect/base/vec3.h"
#include "interflect/scene/gltf_document.h"

namespace interflect::gltf {

/// The elements of an accessor, read one at a time where they lie. Everything that it can touch is checked when it is
/// made: buffer view and buffer exist, the last element lies inside, sparse indices are in range.
class Accessor {
 public:
  /// Throws an input Error naming the accessor. `type` is tinygltf's TINYGLTF_TYPE_..., what the caller needs.
  Accessor(const Document& document, int index, int type);

  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] bool is_index() const;  ///< unsigned integers, not normalised
  [[nodiscard]] std::uint32_t integer(std::size_t i) const;
  /// Component c of element i. Normalised integers become [0, 1] or [-1, 1] (KHR_mesh_quantization), others keep their
  /// value.
  [[nodiscard]] double number(std::size_t i, std::size_t c) const;
  [[nodiscard]] Vec3 vec3(std::size_t i) const { return {number(i, 0), number(i, 1), number(i, 2)}; }
  [[nodiscard]] Vec2 vec2(std::size_t i) const { return {number(i, 0), number(i, 1)}; }

 private:
  struct Range {
    const unsigned char* data = nullptr;
    std::size_t stride = 0;
  };
  [[nodiscard]] Range range(const Document& document, int view, std::size_t offset, std::size_t element,
                            std::size_t count, bool may_stride) const;
  void read_sparse(const Document& document, const tinygltf::Accessor& accessor);
  [[nodiscard]] const unsigned char* element(std::size_t i) const;

  std::string who_;
  Range dense_;
  std::size_t count_ = 0;
  std::size_t component_size_ = 0;
  std::size_t components_ = 0;
  int component_type_ = 0;
  bool normalized_ = false;
  std::unordered_map<std::size_t, const unsigned char*> sparse_;
};

}  // namespace interflect::gltf
