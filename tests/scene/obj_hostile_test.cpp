#include <gmock/gmock.h>
#include <sys/stat.h>

#include <random>

#include "scene/build_scene.h"
#include "scene/png_bytes.h"

namespace interflect {
namespace {

using ::testing::HasSubstr;
using testing::message_of;
using testing::PngBytes;
using ::testing::StartsWith;
using testing::TestFolder;

constexpr const char* square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

void expect_refused(const std::string& text, const std::string& place, const std::string& cause) {
  const std::string message = message_of(ErrorKind::input, [&] { (void)read_obj(text, "bad.obj"); });
  EXPECT_THAT(message, StartsWith(place + ": ")) << text.substr(0, 100);
  EXPECT_THAT(message, HasSubstr(cause)) << text.substr(0, 100);
  EXPECT_LT(message.size(), 600u);
}

TEST(ObjHostile, EmptyAndFaceless) {
  expect_refused("", "bad.obj", "no faces");
  expect_refused("\n\n# nothing\n", "bad.obj", "no faces");
  expect_refused(square, "bad.obj", "no faces");
  expect_refused("this is a letter, not a scene\n", "bad.obj", "no faces");
}

TEST(ObjHostile, EveryTruncationIsReadOrRefused) {
  const std::string whole = std::string("#camera eye 0 0 1 target 0 0 0 up 0 1 0 fov 60\nmtllib x.mtl\no a\ng b\n") +
                            square + "vt 0.5 0.25\nvn 0 0 1\nusemtl m\nf 1/1/1 2/1/1 3/1/1 4/1/1\nf -1 -2 -3\n";
  std::size_t read = 0;
  for (std::size_t n = 0; n < whole.size(); ++n) {
    try {
      const Scene scene = read_obj(whole.substr(0, n), "bad.obj");
      EXPECT_FALSE(scene.triangles.empty());
      ++read;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::input);
      EXPECT_THAT(error.what(), StartsWith("bad.obj:"));
    }
  }
  EXPECT_GT(read, 0u);
}

TEST(ObjHostile, NumbersThatAreNone) {
  for (const char* bad :
       {"nan", "NaN", "inf", "-inf", "infinity", "1e999", "-1e400", "1.5x", "abc", "0x10", "1,5", "--1", "+-1", "."}) {
    expect_refused(std::string("v 0 0 0\nv 0 ") + bad + " 1\nf 1 1 2\n", "bad.obj:2", "is not a finite number");
    expect_refused(std::string("vt ") + bad + " 1\n", "bad.obj:1", "is not a finite number");
  }
  expect_refused("v 0 0\n", "bad.obj:1", "needs more numbers");
  expect_refused("v\n", "bad.obj:1", "needs more numbers");
  expect_refused("v 0 0 # 0\n", "bad.obj:1", "needs more numbers");
}

TEST(ObjHostile, IndicesOutOfRange) {
  const auto face = [](const std::string& corners, const std::string& cause) {
    expect_refused(std::string(square) + "vt 0 0\nf " + corners + "\n", "bad.obj:6", cause);
  };
  face("0 1 2", "index 0");
  face("1 2 5", "vertex 5 does not exist");
  face("1 2 -5", "before the first");
  face("1 2 2147483648", "does not exist");
  face("1 2 4294967295", "out of range");
  face("1 2 4294967297", "out of range");
  face("1 2 -4294967295", "before the first");
  face("1 2 99999999999999999999", "not a whole number");
  face("1 2 -9223372036854775808", "before the first");
  face("1 2 -99999999999999999999", "not a whole number");
  face("1 2 1.5", "not a whole number");
  face("1 2 x", "not a whole number");
  face("1 2 /1", "not a whole number");
  face("1/2 2/1 3/1", "texture coordinate 2 does not exist");
  face("1/0 2/1 3/1", "index 0");
  face("1/-2 2/1 3/1", "before the first");
  face("1/1/x 2/1/1 3/1/1", "not a whole number");
  face("1//0 2//0 3//0", "normal index 0");
  face("1//  2 3", "not a whole number");
}

TEST(ObjHostile, FacesWithTooFewCorners) {
  expect_refused(std::string(square) + "f\n", "bad.obj:5", "0 corners");
  expect_refused(std::string(square) + "f 1 2", "bad.obj:5", "2 corners");
  expect_refused(std::string(square) + "f 1 2 # 3", "bad.obj:5", "2 corners");
}

TEST(ObjHostile, BinaryGarbage) {
  std::mt19937 random(7);
  std::string bytes(100000, '\0');
  for (char& c : bytes) c = static_cast<char>(random());
  expect_refused("v 0 0 0\n" + std::string("a\0b", 3), "bad.obj:2", "NUL byte");
  message_of(ErrorKind::input, [&] { (void)read_obj(bytes, "bad.obj"); });
  for (char& c : bytes) c = c == '\0' ? 'x' : c;
  message_of(ErrorKind::input, [&] { (void)read_obj(bytes, "bad.obj"); });
}

TEST(ObjHostile, VeryLongLines) {
  const std::string many(1 << 20, 'x');
  expect_refused("v 0 0 " + many, "bad.obj:1", "is not a finite number");
  expect_refused(std::string(square) + "f 1 2 " + many, "bad.obj:5", "not a whole number");
  const Scene scene =
      read_obj("o " + many + "\n" + many + " 1\n" + square + "mtllib " + many + "\nf 1 2 3\n", "bad.obj");
  EXPECT_EQ(scene.surfaces[0].object.size(), many.size());
  for (const std::string& warning : scene.warnings) EXPECT_LT(warning.size(), 400u);
  std::string backslashes;
  for (int i = 0; i < 100000; ++i) backslashes += "\\\n";
  expect_refused(backslashes, "bad.obj", "no faces");
  std::string corners = "f";
  for (int i = 0; i < 100000; ++i) corners += " 1 2 3";
  expect_refused(square + corners, "bad.obj:5", "corners");
}

TEST(ObjHostile, TooManyWarningsAreCut) {
  std::string text = square;
  for (int i = 0; i < 10000; ++i) text += "mtllib no" + std::to_string(i) + "\nword" + std::to_string(i) + " 1\n";
  EXPECT_LE(read_obj(text + "f 1 2 3\n", "bad.obj").warnings.size(), 51u);
}

TEST(ObjHostile, CamerasWithoutSense) {
  const auto camera = [](const std::string& words, const std::string& cause) {
    expect_refused("\n#camera " + words + "\n", "bad.obj:2", cause);
  };
  camera("", "needs 'eye X Y Z'");
  camera("eye 1 2 3", "needs 'eye X Y Z'");
  camera("eye 1 2", "needs more numbers");
  camera("eye 1 2 nan target 0 0 0", "finite");
  camera("eye 1 2 3 target 1 2 3", "must differ");
  camera("eye 0 0 0 target 0 5 0", "up");
  camera("eye 0 0 0 target 0 0 1 up 0 0 0", "up");
  camera("eye 0 0 0 target 0 0 1 fov 180", "fov");
  camera("eye 0 0 0 target 0 0 1 fov -5", "fov");
  camera("eye 0 0 0 target 0 0 1 zoom 3", "'zoom'");
}

TEST(ObjHostile, MaterialFilesThatAreNone) {
  const TestFolder folder;
  std::filesystem::create_directory(folder.path() / "folder");
  ASSERT_EQ(::mkfifo((folder.path() / "fifo").c_str(), 0600), 0);
  std::filesystem::create_symlink("loop", folder.path() / "loop");
  // A FIFO that nobody writes to would block for ever; the file itself is no material file, and not an endless loop.
  const std::string text = std::string(
                               "mtllib folder\nmtllib fifo\nmtllib loop\nmtllib .\nmtllib ..\nmtllib a.obj a.obj\n"
                               "mtllib a.obj\nmtllib /dev/zero /dev/stdin\n") +
                           square + "f 1 2 3\n";
  const Scene scene = read_scene(folder.file("a.obj", text));
  EXPECT_EQ(scene.triangles.size(), 1u);
  EXPECT_THAT(scene.warnings, ::testing::Contains(HasSubstr("there is no material file 'fifo'")));
  EXPECT_THAT(scene.warnings, ::testing::Contains(HasSubstr("there is no material file '/dev/zero'")));
}

TEST(ObjHostile, MaterialFilesWithErrorsNameThemselvesAndTheLine) {
  const TestFolder folder;
  const auto path = folder.file("a.obj", std::string("mtllib a.mtl\n") + square + "usemtl m\nf 1 2 3\n");
  const std::vector<std::pair<std::string, std::string>> bad{
      {"newmtl m\nKd 1 nan 1\n", "a.mtl:2: 'nan' is not a finite number"},
      {"newmtl m\nKe 1 1 1e999\n", "a.mtl:2: '1e999' is not"},
      {"newmtl m\n\nKd\n", "a.mtl:3: 'Kd' needs more numbers"},
      {"newmtl m\nKd 1 1\n", "a.mtl:2: 'Kd' needs more numbers"},
      {"newmtl m\nKd spectral lamp.rfl\n", "a.mtl:2: 'spectral' is not"},
      {"newmtl m\nmap_Kd\n", "a.mtl:2: 'map_Kd' needs a file name"},
      {"newmtl m\nmap_Kd -s 1 1 1\n", "a.mtl:2: 'map_Kd' needs a file name"},
      {std::string("newmtl m\nKd\0", 12), "a.mtl:2: a NUL byte"}};
  for (const auto& [content, cause] : bad) {
    (void)folder.file("a.mtl", content);
    EXPECT_THAT(message_of(ErrorKind::input, [&] { (void)read_scene(path); }), HasSubstr(cause));
  }
  // Values that are numbers but not physical are the check's business.
  (void)folder.file("a.mtl", "newmtl m\nKd 1.5 -1 0\n");
  const Scene scene = read_scene(path);
  bool error = false;
  for (const Finding& f : check_scene(scene)) error = error || f.severity == Finding::Severity::error;
  EXPECT_TRUE(error);
}

TEST(ObjHostile, DamagedTextures) {
  const TestFolder folder;
  (void)folder.file("a.mtl", "newmtl m\nmap_Kd t.png\n");
  const auto path = folder.file("a.obj", std::string("mtllib a.mtl\n") + square + "vt 0 0\nusemtl m\nf 1/1 2/1 3/1\n");
  const std::string good = PngBytes::make(2, 1, "abcdef");
  (void)folder.file("t.png", good);
  EXPECT_EQ(read_scene(path).images.size(), 1u);
  for (std::size_t n = 8; n + 12 < good.size(); ++n) {  // the 12 bytes of the end chunk may be missing
    (void)folder.file("t.png", good.substr(0, n));
    EXPECT_THAT(message_of(ErrorKind::input, [&] { (void)read_scene(path); }), HasSubstr("t.png: ")) << n;
  }
  // Headers that claim 12 GB, 48 TB and nothing, over six bytes of pixels.
  for (const auto& [w, h] : {std::pair{65536u, 65536u}, {4000000u, 4000000u}, {8192u, 8192u}, {0u, 1u}}) {
    (void)folder.file("t.png", PngBytes::make(w, h, "abcdef"));
    EXPECT_THAT(message_of(ErrorKind::input, [&] { (void)read_scene(path); }), HasSubstr("t.png: ")) << w;
  }
}

TEST(ObjHostile, CoordinatesWhoseAreaOverflows) {
  const Scene scene = read_obj("v 0 0 0\nv 1e300 0 0\nv 0 1e300 0\nf 1 2 3\n", "bad.obj");
  EXPECT_THAT(message_of(ErrorKind::input, [&] { (void)subdivide(scene, {}); }), StartsWith("bad.obj:4: "));
  EXPECT_EQ(check_scene(scene).at(0).severity, Finding::Severity::error);
}

TEST(ReadScene, UnknownExtensionsAndMissingFiles) {
  const TestFolder folder;
  EXPECT_THAT(message_of(ErrorKind::input, [&] { (void)read_scene(folder.file("a.stl", "solid")); }),
              HasSubstr(".stl"));
  EXPECT_THAT(message_of(ErrorKind::input, [&] { (void)read_scene(folder.path() / "none.obj"); }),
              HasSubstr("none.obj"));
  std::filesystem::create_directory(folder.path() / "folder.obj");
  EXPECT_THAT(message_of(ErrorKind::input, [&] { (void)read_scene(folder.path() / "folder.obj"); }),
              HasSubstr("folder"));
}

}  // namespace
}  // namespace interflect
