// Which emitters are switched together, and what a list of names may say.
#include "interflect/scene/light_groups.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scene/build_scene.h"

namespace interflect {
namespace {

using interflect::testing::message_of;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// A patch for each of: a dark wall, a desk lamp of two materials, two windows, an emitter without any name but its
/// material's, and a second desk lamp patch.
struct Lamps {
  Lamps() {
    scene.materials = {{.name = "grey", .reflectance = {0.5, 0.5, 0.5}},
                       {.name = "bulb", .emittance = {9, 8, 7}},
                       {.name = "shade", .emittance = {0, 1, 0}},
                       {.name = "sky", .emittance = {2, 2, 3}}};
    patch("wall", "room", 0);
    patch("desk", "desk_bulb", 1);
    patch("desk", "desk_shade", 2);
    patch("window_1", "", 3);
    patch("window_2", "", 3);
    patch("", "", 1);
    patch("desk", "desk_bulb", 1);
  }
  void patch(const std::string& object, const std::string& group, std::uint32_t material) {
    mesh.corners.push_back({0, 1, 2});
    mesh.emittance.push_back(scene.materials[material].emittance);
    mesh.surface.push_back(static_cast<std::uint32_t>(mesh.surfaces.size()));
    mesh.surfaces.push_back({object, group, material});
  }
  [[nodiscard]] LightGroups by(std::string_view text) const { return light_groups(scene, mesh, text); }

  Scene scene;
  PatchMesh mesh;
};

constexpr std::uint32_t none = LightGroups::none;

TEST(LightGroups, AnObjectIsOneGroupWhateverItsMaterials) {
  const LightGroups groups = Lamps().by("object");
  EXPECT_THAT(groups.names, ElementsAre("desk", "window_1", "window_2", "bulb"));
  EXPECT_THAT(groups.of_patch, ElementsAre(none, 0, 0, 1, 2, 3, 0));
}

TEST(LightGroups, ByMaterialAndNone) {
  const LightGroups groups = Lamps().by("material");
  EXPECT_THAT(groups.names, ElementsAre("bulb", "shade", "sky"));
  EXPECT_THAT(groups.of_patch, ElementsAre(none, 0, 1, 2, 2, 0, 0));
  EXPECT_THAT(Lamps().by("none").names, IsEmpty());
  EXPECT_THAT(Lamps().by("none").of_patch, ElementsAre(none, none, none, none, none, none, none));
}

TEST(LightGroups, AListOfNamesMakesAGroupEachAndOneOfTheRest) {
  const LightGroups groups = Lamps().by("window_2,desk");
  EXPECT_THAT(groups.names, ElementsAre("window_2", "desk", "other lights"));
  EXPECT_THAT(groups.of_patch, ElementsAre(none, 1, 1, 2, 0, 2, 1));
  EXPECT_THAT(Lamps().by("*").names, ElementsAre("*"));
}

TEST(LightGroups, AListWithNamesTakesObjectsGroupsAndMaterials) {
  const LightGroups groups = Lamps().by("warm=desk_bulb,b?lb;day=window*");
  EXPECT_THAT(groups.names, ElementsAre("warm", "day", "other lights"));
  EXPECT_THAT(groups.of_patch, ElementsAre(none, 0, 2, 1, 1, 0, 0)) << "the shade is of the same object, and is left";
  // The first that takes an emitter has it.
  EXPECT_THAT(Lamps().by("a=window_1;b=window*;c=*").of_patch, ElementsAre(none, 2, 2, 0, 1, 2, 2));
}

TEST(LightGroups, APatternStandsForTheWholeName) {
  const auto takes = [](const std::string& pattern) {
    try {
      return Lamps().by("x=" + pattern).of_patch[3] == 0;
    } catch (const Error&) {
      return false;
    }
  };
  for (const char* pattern : {"window_1", "w*", "*1", "*in*_*", "window_?", "*w*w*1", "s?y", "**"}) {
    EXPECT_TRUE(takes(pattern)) << pattern;
  }
  for (const char* pattern : {"window", "indow_1", "window_1?", "w*2", "?", "Window_1", "*x*"}) {
    EXPECT_FALSE(takes(pattern)) << pattern;
  }
}

TEST(LightGroups, WhatNoEmitterIsCalledIsAUsageErrorThatNamesThem) {
  const Lamps lamps;
  const auto why = [&](const char* list) { return message_of(ErrorKind::usage, [&] { (void)lamps.by(list); }); };
  EXPECT_THAT(why("desk,ceiling"),
              AllOf(HasSubstr("no emitter is called 'ceiling'"),
                    HasSubstr("the emitters are desk (material bulb), desk (material shade), window_1 (material sky), "
                              "window_2 (material sky), bulb")));
  EXPECT_THAT(why("wall"), HasSubstr("no emitter is called 'wall'"));
  EXPECT_THAT(why("a=desk;b=desk*"), HasSubstr("all that 'b' takes is in groups before it"));
  EXPECT_THAT(why("a=desk;a=window*"), HasSubstr("'a' is there twice"));
  EXPECT_THAT(why("desk,desk"), HasSubstr("'desk' is there twice"));
  EXPECT_THAT(why(""), HasSubstr("a group without a name"));
  EXPECT_THAT(why("=desk"), HasSubstr("a group without a name"));
  EXPECT_THAT(why("a=desk,"), HasSubstr("group 'a' has an empty pattern"));
  EXPECT_THAT(why("a=desk;window"), HasSubstr("'window' is not NAME=PATTERN"));
  EXPECT_THAT(why("desk;window"), HasSubstr("NAME=PATTERN"));
  Lamps dark;
  dark.mesh.emittance.assign(dark.mesh.size(), Rgb{});
  EXPECT_THAT(message_of(ErrorKind::usage, [&] { (void)dark.by("desk"); }), HasSubstr("nothing emits in this scene"));
  EXPECT_THAT(dark.by("object").names, IsEmpty());
}

TEST(LightGroups, NamesAreUniqueAndReadable) {
  Lamps lamps;
  lamps.mesh.surfaces[3].object = "a\nb";
  lamps.mesh.surfaces[4].object = "a b";
  lamps.mesh.surfaces[5] = {"\t", "", 1};
  EXPECT_THAT(lamps.by("object").names, ElementsAre("desk", "a b", "a b (2)", "light"));
  EXPECT_THAT(Lamps().by("other lights=desk").names, ElementsAre("other lights", "other lights (2)"));
}

TEST(LightGroups, TooManyAreALimitAndAutoTakesWhatFits) {
  Lamps lamps;
  EXPECT_THAT(lamps.by("auto").names, ElementsAre("desk", "window_1", "window_2", "bulb"));
  for (int i = 0; i < 25; ++i) lamps.patch(fmt::format("lamp {}", i), "", 1);
  EXPECT_EQ(lamps.by("object").names.size(), 29U);
  EXPECT_THAT(lamps.by("auto").names, ElementsAre("bulb", "shade", "sky")) << "by material";
  for (int i = 0; i < 300; ++i) {
    lamps.scene.materials.push_back({.name = fmt::format("m{}", i), .emittance = {1, 1, 1}});
    lamps.patch(fmt::format("more {}", i), "", static_cast<std::uint32_t>(lamps.scene.materials.size() - 1));
  }
  EXPECT_THAT(lamps.by("auto").names, IsEmpty());
  for (const char* by : {"object", "material"}) {
    EXPECT_THAT(message_of(ErrorKind::limit, [&] { (void)lamps.by(by); }), HasSubstr("more than 256 groups"));
  }
}

}  // namespace
}  // namespace interflect
