#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "interflect/base/vec3.h"

namespace interflect {

/// How a surface reflects and emits. Colours are linear RGB; the textures hold linear RGB as well (sRGB is decoded when
/// read) and multiply the constant beside them.
struct Material {
  std::string name;
  Rgb reflectance{};           ///< diffuse reflectance per channel
  Rgb emittance{};             ///< power leaving per area and channel, in the scene's unit (W/m²)
  bool two_sided = false;      ///< a patch on each side
  int reflectance_image = -1;  ///< index into Scene::images, or -1
  int emittance_image = -1;
};

/// A texture, decoded: linear RGB, row 0 at the top (v = 0), as in glTF. Lookups wrap around.
struct Image {
  std::uint32_t width = 0, height = 0;
  std::vector<float> pixels;  ///< 3 * width * height
};

/// What a file says of where a triangle belongs. Names are as in the file and may be empty.
struct Surface {
  std::string object;
  std::string group;
  std::uint32_t material = 0;  ///< index into Scene::materials
  bool obstruction = false;    ///< only in the way: tables of factors between groups leave it out
};

/// A triangle as read; its front is the side from which the vertices run counter-clockwise.
struct Triangle {
  std::array<std::uint32_t, 3> vertex{};  ///< indices into Scene::positions
  std::uint32_t surface = 0;              ///< index into Scene::surfaces
  std::uint32_t line = 0;                 ///< line in the file, or element number where there are no lines; 0: unknown
  std::int64_t uv = -1;                   ///< index of the first of three consecutive Scene::uvs, or -1
};

/// A perspective camera.
struct Camera {
  Vec3 eye{};
  Vec3 target{};
  Vec3 up{0, 1, 0};
  double vertical_fov = 0.8;  ///< radians
};

/// A scene as read from a file: triangles in world coordinates, before it is cut into patches.
struct Scene {
  std::string name;  ///< the file's name without folder and extension
  std::string file;
  std::vector<Vec3> positions;
  std::vector<Vec2> uvs;
  std::vector<Triangle> triangles;
  std::vector<Surface> surfaces;
  std::vector<Material> materials;
  std::vector<Image> images;
  std::optional<Camera> camera;
  std::vector<std::filesystem::path> files;  ///< every file that was read: none of them may be written over
  std::vector<std::string> warnings;         ///< one line each: what the reader had to leave out

  /// Area of triangle t, ½ |(b − a) × (c − a)|, in the scene's unit squared.
  [[nodiscard]] double area(const Triangle& t) const;
};

/// Which names the groups of patches get: for tables between groups and for the CSV.
enum class GroupBy {
  automatic,  ///< the file's groups if it names more than one, else its objects, else its materials
  object,
  group,
  material,
};

/// The names of the groups, and for each Scene::surfaces entry the index of its group.
struct Grouping {
  std::vector<std::string> names;
  std::vector<std::uint32_t> of_surface;
  std::vector<bool> obstruction = {};  ///< per name: a group of obstructions alone; may be empty where there are none
};
[[nodiscard]] Grouping group_surfaces(const Scene& scene, GroupBy by = GroupBy::automatic);

/// Reads a scene by the file's extension: .xml (rrv), .obj (Wavefront, with its MTL), .gltf, .glb (glTF 2.0), .vs3
/// (NIST View3D).
/// Every coordinate is finite and every index in range afterwards; reflectances are as the file says (see check_scene).
/// Throws an input Error naming file, line or element and cause.
[[nodiscard]] Scene read_scene(const std::filesystem::path& path);

/// The readers behind read_scene(), on a text or bytes in memory. `path` names the source in messages and is where
/// relative references (MTL, textures, buffers) are looked for.
///
/// rrv's XML: scene > head > objectdef with triangleset (triangle, trianglenext), cuboid, barrel, globe, teapot, and
/// scene > body with translate, rotate, scale and object. As in rrv: missing dx, dy, dz and angle are 0 (also in
/// scale); <rotate> is in degrees and left-handed about y (see the source); colours are three numbers with commas,
/// black where missing, inherited from a triangleset by its triangles and from a triangle by the trianglenext after it;
/// emission is the emittance, reflectivity the reflectance; radiosity (an earlier result), spec, refl and refr are not
/// used; shear does nothing. Beyond rrv: an objectdef may hold objects and transformations, the body may hold shapes;
/// the shapes have an attribute `division` (see Primitive); <camera eye="x,y,z" target="x,y,z" up="x,y,z"
/// fov="degrees"/> as a child of <scene> becomes Scene::camera (up 0,1,0 and fov, vertical, as in Camera where
/// missing). Surface::object is the path of object names from the body ("table/leg"), Surface::group the `name` of the
/// shape or triangleset. An objectdef in another `file` is an error; elements that are not known are left out with a
/// warning.
[[nodiscard]] Scene read_rrv_xml(const std::string& text, const std::filesystem::path& path);
/// OBJ: `o` gives the object, `g` (all its names) the group, Kd the reflectance, Ke the emittance, map_Kd and map_Ke
/// PNG textures, relative to the MTL file. Faces may be concave, indices negative or ahead of their vertex. A material
/// that no library defines reflects 0.5 and is warned of, a missing library likewise. Normals, curves, lines and points
/// are left out. A comment line of our own gives the camera (fov: vertical, in degrees; up and fov may be missing):
///   #camera eye X Y Z target X Y Z up X Y Z fov DEGREES
[[nodiscard]] Scene read_obj(const std::string& text, const std::filesystem::path& path);

/// View3D's geometry in three dimensions: F 3 (vertices and surfaces) and F 3a (shapes in a plane each); F 2 is
/// refused. Vertices and surfaces are numbered from 1 without a gap, obstructions last, as View3D wants them. A surface
/// of four corners is convex and becomes two triangles; corners off a plane are warned of. The front is the side from
/// which the vertices run counter-clockwise. What lies on a base surface (a subsurface, or a null surface, which leaves
/// a hole) is cut out of it; a mask and what it covers see only each other and are left out with a warning. Reflectance
/// is 1 - emittance, and a surface emits its emittance, as a black body of that temperature would emit 1: in a closed
/// scene all radiosities are 1. Surface::object is the record's name (with "#NUMBER" where another surface has it
/// already), Surface::group that of the surface with which it is combined: the groups, in the file's order, are
/// View3D's rows. Obstructions (O) are two-sided, black, do not emit, and are one group apart. Control values are not
/// used; those that would change View3D's answer are warned of. Unknown records are left out with a warning.
[[nodiscard]] Scene read_vs3(const std::string& text, const std::filesystem::path& path);

/// glTF 2.0, as JSON or GLB. The default scene (else the first, else all nodes without a parent) with its nodes'
/// transformations; triangles, strips and fans; sparse and quantised accessors. Reflectance is baseColorFactor times
/// baseColorTexture, whatever the metallic factor says; emittance is emissiveFactor times emissiveTexture times
/// KHR_materials_emissive_strength; textures are sRGB, PNG or JPEG, with KHR_texture_transform, and repeat. A
/// doubleSided material is two-sided; no material means white (glTF's default). The first perspective camera becomes
/// Scene::camera. Surface::object is the node's name (else its mesh's), Surface::group that of its outermost ancestor.
/// Files are read only from the folder of `path` and below. Skins, morph targets, animations, transparency, points,
/// lines and optional extensions are left out with a warning; a required extension that is not known is an error.
/// Messages name the element ("accessor 3"), as there are no lines.
[[nodiscard]] Scene read_gltf(const std::string& bytes, const std::filesystem::path& path);

}  // namespace interflect
