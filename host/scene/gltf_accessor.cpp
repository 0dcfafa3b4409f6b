#include "interflect/scene/gltf_accessor.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <limits>

#include "interflect/base/error.h"

namespace interflect::gltf {

namespace {

template <class T>
T read_as(const unsigned char* from) {  // glTF is little-endian, as are the machines that this runs on
  T value;
  std::memcpy(&value, from, sizeof value);
  return value;
}

template <class T>
double scaled(T value, bool normalized) {
  const auto number = static_cast<double>(value);
  return normalized ? std::max(number / std::numeric_limits<T>::max(), -1.0) : number;
}

}  // namespace

Accessor::Accessor(const Document& document, int index, int type) {
  who_ = fmt::format("accessor {}", index);
  const auto fail = [&](std::string_view cause) {
    return input_error(document.file, 0, fmt::format("{} {}", who_, cause));
  };
  if (index < 0 || static_cast<std::size_t>(index) >= document.model.accessors.size()) throw fail("does not exist");
  const tinygltf::Accessor& accessor = document.model.accessors[static_cast<std::size_t>(index)];
  if (accessor.type != type) throw fail("has the wrong type (SCALAR, VEC2, VEC3 ...) for its use");
  switch (accessor.componentType) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE: component_size_ = 1; break;
    case TINYGLTF_COMPONENT_TYPE_SHORT:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT: component_size_ = 2; break;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
    case TINYGLTF_COMPONENT_TYPE_FLOAT: component_size_ = 4; break;
    default: throw fail(fmt::format("has the component type {}, which glTF does not know", accessor.componentType));
  }
  component_type_ = accessor.componentType;
  components_ = static_cast<std::size_t>(tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(accessor.type)));
  normalized_ = accessor.normalized;
  count_ = accessor.count;
  const std::size_t element = component_size_ * components_;
  if (accessor.bufferView >= 0) {
    dense_ = range(document, accessor.bufferView, accessor.byteOffset, element, count_, true);
  } else if (!accessor.sparse.isSparse) {
    throw fail("has no bufferView");
  }
  if (accessor.sparse.isSparse) read_sparse(document, accessor);
}

Accessor::Range Accessor::range(const Document& document, int view, std::size_t offset, std::size_t element,
                                std::size_t count, bool may_stride) const {
  const auto fail = [&](std::string_view cause) {
    return input_error(document.file, 0, fmt::format("{} {}", who_, cause));
  };
  if (view < 0 || static_cast<std::size_t>(view) >= document.model.bufferViews.size()) {
    throw fail(fmt::format("refers to bufferView {}, which does not exist", view));
  }
  const tinygltf::BufferView& v = document.model.bufferViews[static_cast<std::size_t>(view)];
  if (v.buffer < 0 || static_cast<std::size_t>(v.buffer) >= document.model.buffers.size()) {
    throw fail(fmt::format("refers to buffer {}, which does not exist", v.buffer));
  }
  const auto& bytes = document.model.buffers[static_cast<std::size_t>(v.buffer)].data;
  if (v.byteOffset > bytes.size() || v.byteLength > bytes.size() - v.byteOffset) {
    throw fail(fmt::format("uses bufferView {}, which reaches beyond its buffer", view));
  }
  const std::size_t stride = may_stride && v.byteStride != 0 ? v.byteStride : element;
  if (stride < element) throw fail(fmt::format("has elements longer than the stride of bufferView {}", view));
  const bool fits = count == 0 || (offset <= v.byteLength && element <= v.byteLength - offset &&
                                   (count - 1) <= (v.byteLength - offset - element) / stride);
  if (!fits) throw fail(fmt::format("with {} elements reaches beyond bufferView {}", count, view));
  return {count == 0 ? nullptr : bytes.data() + v.byteOffset + offset, stride};
}

void Accessor::read_sparse(const Document& document, const tinygltf::Accessor& accessor) {
  const auto fail = [&](std::string_view cause) {
    return input_error(document.file, 0, fmt::format("{} {}", who_, cause));
  };
  const auto& sparse = accessor.sparse;
  if (sparse.count < 0 || static_cast<std::size_t>(sparse.count) > count_ || sparse.indices.byteOffset < 0 ||
      sparse.values.byteOffset < 0) {
    throw fail("has an impossible sparse count or offset");
  }
  const auto n = static_cast<std::size_t>(sparse.count);
  const int type = sparse.indices.componentType;
  const std::size_t size = type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE    ? 1
                           : type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT ? 2
                           : type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT   ? 4
                                                                            : 0;
  if (size == 0) throw fail("has sparse indices of a type that glTF does not know");
  const Range indices =
      range(document, sparse.indices.bufferView, static_cast<std::size_t>(sparse.indices.byteOffset), size, n, false);
  const Range values = range(document, sparse.values.bufferView, static_cast<std::size_t>(sparse.values.byteOffset),
                             component_size_ * components_, n, false);
  for (std::size_t k = 0; k < n; ++k) {
    const unsigned char* at = indices.data + k * size;
    const std::size_t i = size == 1   ? read_as<std::uint8_t>(at)
                          : size == 2 ? read_as<std::uint16_t>(at)
                                      : read_as<std::uint32_t>(at);
    if (i >= count_) throw fail(fmt::format("has the sparse index {} of {} elements", i, count_));
    sparse_[i] = values.data + k * values.stride;
  }
}

const unsigned char* Accessor::element(std::size_t i) const {
  if (!sparse_.empty()) {
    const auto found = sparse_.find(i);
    if (found != sparse_.end()) return found->second;
  }
  return dense_.data == nullptr ? nullptr : dense_.data + i * dense_.stride;
}

bool Accessor::is_index() const {
  return !normalized_ && (component_type_ == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE ||
                          component_type_ == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT ||
                          component_type_ == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT);
}

std::uint32_t Accessor::integer(std::size_t i) const {
  const unsigned char* at = element(i);
  if (at == nullptr) return 0;
  if (component_size_ == 1) return read_as<std::uint8_t>(at);
  if (component_size_ == 2) return read_as<std::uint16_t>(at);
  return read_as<std::uint32_t>(at);
}

double Accessor::number(std::size_t i, std::size_t c) const {
  const unsigned char* at = element(i);
  if (at == nullptr) return 0;
  at += c * component_size_;
  switch (component_type_) {
    case TINYGLTF_COMPONENT_TYPE_BYTE: return scaled(read_as<std::int8_t>(at), normalized_);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE: return scaled(read_as<std::uint8_t>(at), normalized_);
    case TINYGLTF_COMPONENT_TYPE_SHORT: return scaled(read_as<std::int16_t>(at), normalized_);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT: return scaled(read_as<std::uint16_t>(at), normalized_);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT: return scaled(read_as<std::uint32_t>(at), normalized_);
    default: return static_cast<double>(read_as<float>(at));
  }
}

}  // namespace interflect::gltf
