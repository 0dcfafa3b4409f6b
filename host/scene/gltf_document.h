#pragma once

#include <tiny_gltf.h>

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace interflect::gltf {

/// A glTF file and the buffers it refers to. Images are kept encoded: those of a buffer view stay there, those of a
/// data URI or a file lie in tinygltf's Image::image.
struct Document {
  tinygltf::Model model;
  std::string file;                                   ///< for messages
  std::vector<std::filesystem::path> files;           ///< buffers and images that were read beside it
  std::map<std::string, std::string> missing_images;  ///< URI -> why it could not be read
};

/// Parses glTF 2.0 (JSON) or GLB. What tinygltf trusts is checked before it sees the file: the GLB chunks, the number
/// and nesting of JSON values, and that every buffer view lies inside its buffer. Other files are read only from the
/// folder of `path` and below. Throws an input Error.
[[nodiscard]] Document load(const std::string& bytes, const std::filesystem::path& path);

}  // namespace interflect::gltf
