#include "interflect/scene/gltf_document.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/scene/scene_limits.h"

namespace interflect::gltf {

namespace {

using nlohmann::json;

constexpr std::uint64_t max_bytes = std::uint64_t{1} << 31;  // of the file, and of all files it refers to

std::uint32_t little_endian(std::string_view bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) value |= std::uint32_t{static_cast<unsigned char>(bytes[at + i])} << (8 * i);
  return value;
}

bool is_glb(std::string_view bytes) {
  return bytes.substr(0, 4) == "glTF";
}

/// The JSON chunk of a GLB whose header and chunks hold together, or the whole text.
std::string_view json_text(std::string_view bytes, const std::string& file) {
  if (!is_glb(bytes)) return bytes;
  const auto fail = [&](std::string_view cause) { return input_error(file, 0, fmt::format("GLB: {}", cause)); };
  if (bytes.size() < 20) throw fail("shorter than its header");
  if (little_endian(bytes, 4) != 2) throw fail(fmt::format("version {} is not 2", little_endian(bytes, 4)));
  const std::uint64_t length = little_endian(bytes, 8), json_length = little_endian(bytes, 12);
  if (length > bytes.size()) throw fail(fmt::format("truncated: {} of {} bytes", bytes.size(), length));
  if (bytes.substr(16, 4) != "JSON") throw fail("the first chunk is not JSON");
  if (json_length % 4 != 0 || 20 + json_length > length) throw fail("the JSON chunk does not fit");
  const std::uint64_t second = 20 + json_length;
  if (second != length) {
    if (second + 8 > length) throw fail("the second chunk does not fit");
    const std::uint64_t binary = little_endian(bytes, second);
    if (binary % 4 != 0 || second + 8 + binary > length) throw fail("the BIN chunk does not fit");
  }
  return bytes.substr(20, json_length);
}

/// Counts JSON values as they are read, without keeping any, and stops when they nest too deep or are more than a scene
/// can use: tinygltf's own structures take up to a kilobyte for an empty object. (A callback of json::parse() would do,
/// but takes quadratic time in nlohmann-json 3.11.)
class Budget : public nlohmann::json_sax<json> {
 public:
  const char* broken = nullptr;  // which limit

  bool null() override { return spend(1); }
  bool boolean(bool) override { return spend(1); }
  bool number_integer(number_integer_t) override { return spend(1); }
  bool number_unsigned(number_unsigned_t) override { return spend(1); }
  bool number_float(number_float_t, const string_t&) override { return spend(1); }
  bool string(string_t&) override { return spend(1); }
  bool binary(binary_t&) override { return spend(1); }
  bool key(string_t&) override { return true; }
  bool start_object(std::size_t) override { return enter() && spend(8); }
  bool start_array(std::size_t) override { return enter() && spend(1); }
  bool end_object() override { return leave(); }
  bool end_array() override { return leave(); }
  bool parse_error(std::size_t, const std::string&, const json::exception&) override { return false; }  // comes again

 private:
  bool spend(std::uint64_t cost) {
    spent_ += cost;
    if (spent_ > std::uint64_t{1} << 24) broken = "more JSON values than a scene can use";
    return broken == nullptr;
  }
  bool enter() {
    if (++depth_ > max_scene_depth) broken = "JSON values nested too deep";
    return broken == nullptr;
  }
  bool leave() {
    --depth_;
    return true;
  }
  std::uint64_t spent_ = 0;
  int depth_ = 0;
};

json parse_json(std::string_view text, const std::string& file) {
  Budget budget;
  (void)json::sax_parse(text, &budget);
  if (budget.broken != nullptr) throw input_error(file, 0, budget.broken);
  try {
    return json::parse(text);
  } catch (const json::exception& error) {
    throw input_error(file, 0, fmt::format("not JSON: {}", error.what()));
  }
}

/// The checks that need names of elements and that tinygltf does not do.
class Checker {
 public:
  Checker(const json& root, const std::string& file, bool binary) : root_(root), file_(file), binary_(binary) {}

  void run() {
    if (!root_.is_object()) throw fail("the JSON root is not an object");
    check_version();
    check_extensions();
    check_buffers();
    check_views();
  }

 private:
  [[nodiscard]] Error fail(std::string_view cause) const { return input_error(file_, 0, cause); }

  [[nodiscard]] const json& list(const char* key) const {
    static const json none = json::array();
    const auto found = root_.find(key);
    if (found == root_.end()) return none;
    if (!found->is_array()) throw fail(fmt::format("'{}' is not an array", key));
    return *found;
  }

  [[nodiscard]] std::uint64_t whole(const json& object, const std::string& who, const char* key,
                                    std::optional<std::uint64_t> fallback = std::nullopt) const {
    if (!object.is_object()) throw fail(fmt::format("{} is not an object", who));
    const auto found = object.find(key);
    if (found == object.end() && fallback) return *fallback;
    if (found == object.end() || !found->is_number_unsigned()) {
      throw fail(
          fmt::format("{}: '{}' is {}", who, key, found == object.end() ? "missing" : "not a whole number >= 0"));
    }
    return found->get<std::uint64_t>();
  }

  void check_version() const {
    const auto asset = root_.find("asset");
    if (asset == root_.end() || !asset->is_object() || !asset->contains("version") ||
        !(*asset)["version"].is_string()) {
      throw fail("not glTF 2.0: 'asset' has no 'version'");
    }
    const std::string version = (*asset)["version"].get<std::string>();
    if (version.substr(0, 2) != "2.") throw fail(fmt::format("glTF version {} is not 2", version));
  }

  void check_extensions() const {
    constexpr std::array<std::string_view, 3> known{"KHR_materials_emissive_strength", "KHR_mesh_quantization",
                                                    "KHR_texture_transform"};
    for (const json& name : list("extensionsRequired")) {
      const std::string text = name.is_string() ? name.get<std::string>() : "?";
      if (std::find(known.begin(), known.end(), text) == known.end()) {
        throw fail(fmt::format("the file requires the extension {}, which is not supported", text));
      }
    }
  }

  void check_buffers() {
    for (const json& buffer : list("buffers")) {
      const std::string who = fmt::format("buffer {}", sizes_.size());
      sizes_.push_back(whole(buffer, who, "byteLength"));
      if (sizes_.back() == 0 || sizes_.back() > max_bytes)
        throw fail(fmt::format("{}: byteLength is {}", who, sizes_.back()));
      const bool named =
          buffer.contains("uri") && buffer["uri"].is_string() && !buffer["uri"].get_ref<const std::string&>().empty();
      if (!named && (!binary_ || sizes_.size() > 1)) throw fail(fmt::format("{} has no 'uri'", who));
    }
  }

  void check_views() const {
    std::size_t index = 0;
    for (const json& view : list("bufferViews")) {
      const std::string who = fmt::format("bufferView {}", index++);
      const std::uint64_t buffer = whole(view, who, "buffer");
      if (buffer >= sizes_.size()) throw fail(fmt::format("{}: buffer {} does not exist", who, buffer));
      const std::uint64_t offset = whole(view, who, "byteOffset", 0), length = whole(view, who, "byteLength");
      if (length == 0 || offset > sizes_[buffer] || length > sizes_[buffer] - offset) {
        throw fail(fmt::format("{} reaches beyond buffer {} of {} bytes", who, buffer, sizes_[buffer]));
      }
      (void)whole(view, who, "byteStride", 0);
    }
  }

  const json& root_;
  const std::string& file_;
  bool binary_;
  std::vector<std::uint64_t> sizes_;
};

/// The only files that tinygltf gets to see.
class Folder {
 public:
  explicit Folder(const std::filesystem::path& path) : base_(path.parent_path()) {}

  // What tinygltf is told the folder is: it also looks in the working directory, which this tells apart.
  static constexpr const char* name = "\x01";

  [[nodiscard]] tinygltf::FsCallbacks callbacks() {
    return {[](const std::string& path, void*) { return path.rfind(std::string(name) + "/", 0) == 0; },
            [](const std::string& path, void*) { return path; },
            [](std::vector<unsigned char>* out, std::string* why, const std::string& path, void* self) {
              return static_cast<Folder*>(self)->read(*out, *why, path.substr(2));
            },
            [](std::string*, const std::string&, const std::vector<unsigned char>&, void*) { return false; }, this};
  }

  std::vector<std::filesystem::path> files;     // that were read
  std::map<std::string, std::string> failures;  // why a file could not be read

 private:
  bool read(std::vector<unsigned char>& out, std::string& why, const std::string& uri) {
    try {
      const std::string content = read_file(resolve(uri), budget_);
      budget_ -= content.size();
      files.push_back(resolve(uri));
      out.assign(content.begin(), content.end());
      return true;
    } catch (const Error& error) {
      why = failures[uri] = error.what();
      return false;
    }
  }

  [[nodiscard]] std::filesystem::path resolve(const std::string& uri) const {
    const std::filesystem::path relative(uri);
    const bool climbs = std::find(relative.begin(), relative.end(), "..") != relative.end();
    const bool scheme = uri.find("://") != std::string::npos || uri.rfind("data:", 0) == 0;
    if (scheme) throw input_error(uri.substr(0, 60), 0, "only files and base64 data of known types can be read");
    if (relative.is_absolute() || climbs || uri.find('\0') != std::string::npos) {
      throw input_error(uri, 0, "lies outside the folder of the glTF file, not read");
    }
    return base_ / relative;
  }

  std::filesystem::path base_;
  std::uint64_t budget_ = max_bytes;
};

/// Keeps an image as it is. tinygltf hands over the bytes of a buffer view without a check of their range, so they are
/// left where they are.
bool keep_encoded(tinygltf::Image* image, const int, std::string*, std::string*, int, int, const unsigned char* bytes,
                  int size, void*) {
  if (image->bufferView < 0 && size > 0) image->image.assign(bytes, bytes + size);
  image->as_is = true;
  return true;
}

std::string on_one_line(std::string text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  std::replace(text.begin(), text.end(), '\n', ' ');
  text.erase(std::remove(text.begin(), text.end(), '\x01'), text.end());
  return text;
}

}  // namespace

Document load(const std::string& bytes, const std::filesystem::path& path) {
  Document document;
  document.file = path.string();
  if (bytes.size() > max_bytes) throw input_error(document.file, 0, fmt::format("longer than {} bytes", max_bytes));
  const std::string_view text = json_text(bytes, document.file);
  Checker(parse_json(text, document.file), document.file, is_glb(bytes)).run();

  Folder folder(path);
  tinygltf::TinyGLTF loader;
  loader.SetFsCallbacks(folder.callbacks());
  loader.SetImageLoader(keep_encoded, nullptr);
  std::string error, warning;
  const auto size = static_cast<unsigned int>(bytes.size());
  const bool loaded =
      is_glb(bytes)
          ? loader.LoadBinaryFromMemory(&document.model, &error, &warning,
                                        reinterpret_cast<const unsigned char*>(bytes.data()), size, Folder::name)
          : loader.LoadASCIIFromString(&document.model, &error, &warning, bytes.data(), size, Folder::name);
  if (!loaded || !error.empty()) {
    throw input_error(document.file, 0, error.empty() ? "not a glTF file" : on_one_line(error));
  }
  document.files = std::move(folder.files);
  document.missing_images = std::move(folder.failures);
  return document;
}

}  // namespace interflect::gltf
