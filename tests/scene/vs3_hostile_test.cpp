#include <gmock/gmock.h>

#include <random>

#include "scene/build_scene.h"

namespace interflect {
namespace {

using ::testing::HasSubstr;
using testing::message_of;
using ::testing::StartsWith;

const std::string square = "V 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\n";
const std::string wall = square + "S 1 1 2 3 4 0 0 .5 wall\n";  // five lines

void expect_refused(const std::string& text, const std::string& place, const std::string& cause) {
  const std::string message = message_of(ErrorKind::input, [&] { (void)read_vs3(text, "bad.vs3"); });
  EXPECT_THAT(message, StartsWith(place + ": ")) << text.substr(0, 200);
  EXPECT_THAT(message, HasSubstr(cause)) << text.substr(0, 200);
  EXPECT_LT(message.size(), 600u);
}

TEST(Vs3Hostile, EmptyAndWithoutSurfaces) {
  expect_refused("", "bad.vs3", "no radiating surface");
  expect_refused("T nothing\nF 3\n" + square + "E\n", "bad.vs3", "no radiating surface");
  expect_refused(square + "O 1 1 2 3 4\n", "bad.vs3", "no radiating surface");
  expect_refused("E\n" + wall, "bad.vs3", "no radiating surface");
  expect_refused("a letter to a friend\n", "bad.vs3", "no radiating surface");
}

TEST(Vs3Hostile, TheTwoDimensionalFormatIsRefused) {
  expect_refused("T\nF 2\nV 1 0 0\n", "bad.vs3:2", "two-dimensional");
  expect_refused("F 1\n", "bad.vs3:1", "'1' is not a geometry format");
  expect_refused("F\n", "bad.vs3:1", "not a geometry format");
  expect_refused("F 3b\n", "bad.vs3:1", "not a geometry format");
  expect_refused("F 3\nF 3a\n", "bad.vs3:2", "one F record");
  expect_refused(square + "F 3\n", "bad.vs3:5", "one F record");
}

TEST(Vs3Hostile, EveryTruncationIsReadOrRefused) {
  const std::string whole = "T x\nC encl=1\nF 3\n" + square +
                            "V 5 .2 .2 0\nV 6 .8 .2 0\nV 7 .8 .8 0\nS 1 1 2 3 4 0 0 0.5 a\n" +
                            "S 2 5 6 7 0 1 0 .25 b\nS 3 1 2 3 0 0 1 .5 c\nO 4 1 2 3 4\nE\n";
  const std::string shapes = "F 3a\nS 1 R 0 0 .9 a\n 3 0 0 0 90 3 3\nS 2 T 0 1 .9 b\n 3 1 0 270 90\n 0 0 1 0 0 1\nE\n";
  std::size_t read = 0;
  for (const std::string& text : {whole, shapes}) {
    for (std::size_t n = 0; n < text.size(); ++n) {
      try {
        EXPECT_FALSE(read_vs3(text.substr(0, n), "bad.vs3").triangles.empty());
        ++read;
      } catch (const Error& error) {
        EXPECT_EQ(error.kind(), ErrorKind::input);
        EXPECT_THAT(error.what(), StartsWith("bad.vs3:"));
      }
    }
  }
  EXPECT_GT(read, 20u);
}

TEST(Vs3Hostile, RecordsThatEndTooSoon) {
  expect_refused("V 1 0 0\nV 2 0 0 0\n", "bad.vs3:1", "ends before its coordinate");
  expect_refused("V 1 0", "bad.vs3:1", "ends before its coordinate");
  expect_refused("V\n\n\n", "bad.vs3:1", "ends before its vertex number");
  expect_refused(square + "S 1 1 2 3 4 0 0\nS 2 1 2 3 0 0 0 .5\n", "bad.vs3:5", "ends before its emittance");
  expect_refused(square + "S 1 1 2 3 ! 4 0 0 .5", "bad.vs3:5", "ends before its fourth vertex");
  expect_refused("F 3a\nS 1 R 0 0 .5 a\n1 2 3 0 90 1\nE\n", "bad.vs3:2", "ends before its height");
  expect_refused("F 3a\nS 1 R 0 0 .5 a\nS 2 R 0 0 .5 b\n", "bad.vs3:2", "ends before its origin");
}

TEST(Vs3Hostile, NumbersThatAreNone) {
  for (const char* bad : {"nan", "inf", "-inf", "1e999", "1.5x", "0x10", "--1", "+-1", "."}) {
    const bool letter = std::isalpha(static_cast<unsigned char>(bad[0]));
    expect_refused(std::string("V 1 0 ") + bad + " 1\n", "bad.vs3:1", "is not a finite number");
    expect_refused(std::string("V 1 0\n") + bad + " 1\n", letter ? "bad.vs3:1" : "bad.vs3:2",
                   letter ? "ends before" : "not a finite");
    expect_refused(square + "S 1 1 2 3 4 0 0 " + bad + "\n", "bad.vs3:5", "is not a finite number");
  }
  for (const char* bad : {"1.5", "x", "99999999999999999999", "1e3", ""}) {
    expect_refused(std::string("V ") + bad + "x 0 0 0\n", "bad.vs3:1", "is not a whole number");
  }
  for (const char* bad : {"eps=", "eps=x", "eps", "encl=nan", "list=1.5", "row=1e3", "col=99999999999999999999"}) {
    expect_refused(std::string("C ") + bad + "\n" + wall, "bad.vs3:1", "is not a");
  }
  expect_refused("V 1 0 0 1e16\n", "bad.vs3:1", "further out");
  expect_refused("F 3a\nS 1 R 0 0 .5 a\n1e15 0 0 180 90 1e15 1\n", "bad.vs3:2", "further out");
  expect_refused("F 3a\nS 1 R 0 0 .5 a\n0 0 0 90 90 -1 1\n", "bad.vs3:2", "above 0");
  expect_refused("F 3a\nS 1 X 0 0 .5 a\n0 0 0 90 90 1 1\n", "bad.vs3:2", "'X' is not a shape");
  for (const char* bad : {"1.01", "-0.01", "1e300"}) {
    expect_refused(square + "S 1 1 2 3 4 0 0 " + bad + " a\n", "bad.vs3:5", "between 0 and 1");
  }
}

TEST(Vs3Hostile, NumbersOutOfSequence) {
  expect_refused("V 2 0 0 0\n", "bad.vs3:1", "vertex 2 is out of sequence: the next one is 1");
  expect_refused(square + "V 4 0 0 0\n", "bad.vs3:5", "vertex 4 is out of sequence: the next one is 5");
  expect_refused(square + "V -1 0 0 0\n", "bad.vs3:5", "out of sequence");
  expect_refused(square + "S 2 1 2 3 4 0 0 .5 a\n", "bad.vs3:5", "surface 2 is out of sequence: the next one is 1");
  expect_refused(wall + "S 1 1 2 3 4 0 0 .5 a\n", "bad.vs3:6", "surface 1 is out of sequence: the next one is 2");
  expect_refused(wall + "O 2 1 2 3 4\nS 3 1 2 3 4 0 0 .5 a\n", "bad.vs3:7", "obstructions (O) come after");
  for (const char* corners : {"1 2 3 5", "0 1 2 3", "1 0 2 3", "1 2 0 3", "1 2 -3 4", "1 2 3 4294967297"}) {
    expect_refused(square + "S 1 " + corners + " 0 0 .5 a\nV 5 2 2 0\n", "bad.vs3:5", "there is no vertex");
  }
}

TEST(Vs3Hostile, BasesAndCombinationsThatMakeNoSense) {
  const auto second = [](const std::string& record, const std::string& cause) {
    expect_refused(wall + record, "bad.vs3:6", cause);
  };
  second("S 2 1 2 3 0 2 0 .5 a\n", "must come after its base surface 2");
  second("S 2 1 2 3 0 3 0 .5 a\nS 3 1 2 3 0 2 0 .5 b\n", "must come after its base surface 3");
  second("S 2 1 2 3 0 9 0 .5 a\n", "no base surface 9: the last one is 2");
  second("S 2 1 2 3 0 -1 0 .5 a\n", "no base surface -1");
  second("S 2 1 2 3 0 99999999 0 .5 a\n", "no base surface 99999999");
  second("S 2 1 2 3 0 0 2 .5 a\n", "must come after 2, which it is combined with");
  second("S 2 1 2 3 0 0 3 .5 a\nS 3 1 2 3 0 0 2 .5 b\n", "must come after 3, which");
  second("S 2 1 2 3 0 0 -1 .5 a\n", "no surface -1 to combine with");
  second("M 2 3 2 1 0 0 0 .5 a\n", "needs a base");
  second("N 2 3 2 1 0 1 1 .5 a\n", "cannot be combined");
  second("N 2 3 2 1 0 3 0 .5 a\nO 3 1 2 3 4\n", "is an obstruction");
  expect_refused(wall + "S 2 1 2 3 0 0 1 .5 a\nS 3 1 2 3 0 0 2 .5 b\n", "bad.vs3:7", "itself combined with 1");
  expect_refused(wall + "N 2 3 2 1 0 1 0 .5 a\nS 3 1 2 3 0 2 0 .5 b\n", "bad.vs3:7", "is a mask or null surface");
  expect_refused(wall + "N 2 3 2 1 0 1 0 .5 a\nS 3 1 2 3 0 0 2 .5 b\n", "bad.vs3:7", "is a mask or null surface");
}

TEST(Vs3Hostile, SurfacesThatDoNotFitTheirBase) {
  const auto sixth = [](const std::string& z, const std::string& x, const std::string& record,
                        const std::string& cause) {
    expect_refused(
        square + "V 5 .2 .2 0\nV 6 " + x + " .2 " + z + "\nV 7 .5 .8 0\nS 1 1 2 3 4 0 0 .5 wall\n" + record + "\n",
        "bad.vs3:9", cause);
  };
  sixth("0.1", ".8", "S 2 5 6 7 0 1 0 .5 a", "does not lie in the plane");
  sixth("0", "1.1", "S 2 5 6 7 0 1 0 .5 a", "does not lie within");
  sixth("0", ".8", "S 2 7 6 5 0 1 0 .5 a", "does not face the same way");
  sixth("0", ".8", "N 2 5 6 7 0 1 0 .5 a", "does not face its base surface 1");
}

TEST(Vs3Hostile, OutlinesThatAreNotConvex) {
  expect_refused(square + "S 1 1 3 2 4 0 0 .5 bow\n", "bad.vs3:5", "not convex");
  expect_refused(square + "V 5 .2 .2 0\nS 1 1 2 5 4 0 0 .5 dart\n", "bad.vs3:6", "not convex");
  // Corners in one place: a triangle, or nothing at all.
  EXPECT_EQ(read_vs3(square + "S 1 1 2 2 3 0 0 .5 a\n", "a.vs3").triangles.size(), 1u);
  const Scene flat = read_vs3(wall + "S 2 1 1 1 1 0 0 .5 a\nS 3 1 2 2 0 0 0 .5 b\n", "a.vs3");
  EXPECT_EQ(subdivide(flat, {}).size(), 2u);
}

TEST(Vs3Hostile, BinaryGarbageAndLongLines) {
  std::mt19937 random(7);
  std::string bytes(100000, '\0');
  for (char& c : bytes) c = static_cast<char>(random());
  expect_refused("V 1 0 0 0\n" + std::string("a\0b", 3), "bad.vs3:2", "NUL byte");
  message_of(ErrorKind::input, [&] { (void)read_vs3(bytes, "bad.vs3"); });
  const std::string many(1 << 20, 'x');
  expect_refused("V 1 0 0 1" + many, "bad.vs3:1", "not a finite number");
  const Scene scene = read_vs3("C " + many + "=1\n" + square + "S 1 1 2 3 4 0 0 .5 " + many + "\n", "a.vs3");
  EXPECT_LT(scene.surfaces[0].object.size(), 300u);
  for (const std::string& warning : scene.warnings) EXPECT_LT(warning.size(), 400u);
}

TEST(Vs3Hostile, ManySurfacesOnOneBase) {
  std::string text = wall;
  for (int i = 2; i < 4000; ++i) text += "S " + std::to_string(i) + " 1 2 3 4 1 0 .5 a" + std::to_string(i) + "\n";
  expect_refused(text, "bad.vs3:" + std::to_string(5 + 2049), "more than 2048 surfaces on base surface 1");
}

}  // namespace
}  // namespace interflect
