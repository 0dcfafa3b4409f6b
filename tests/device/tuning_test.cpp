#include "interflect/device/tuning.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "device/kernel_folder.h"
#include "device/shaped_device.h"
#include "interflect/base/error.h"
#include "interflect/device/cache_file.h"
#include "interflect/device/kernel_table.h"

namespace interflect {
namespace {

namespace fs = std::filesystem;
using test::Shaping;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr std::string_view magic = "iftuning1\n";

/// A device that says it is one of OpenCL: all three kernels have something to tune there.
class Tuning : public testing::Test {
 protected:
  Tuning() {
    shaping->describe = [](DeviceInfo& info) {
      info.backend = "opencl";
      info.name = "made up";
      info.driver = "1.0";
      info.rows_per_group = 8;
      info.max_groups = 1U << 20;
    };
  }
  [[nodiscard]] TunedShape search(std::string_view kernel, double seconds = 1e9) {
    test::ShapedDevice device(shaping);
    return search_shape(device, kernel,
                        {.seconds = seconds, .now = [this] { return shaping->clock; }, .bytes = 1U << 20});
  }
  [[nodiscard]] DeviceInfo info() const { return test::ShapedDevice(shaping).info(); }
  [[nodiscard]] fs::path folder() const { return cache.entries().parent_path() / "tuning"; }
  [[nodiscard]] std::vector<fs::path> files() const {
    std::vector<fs::path> all;
    if (!fs::exists(folder())) return all;
    for (const auto& entry : fs::directory_iterator(folder())) all.push_back(entry.path());
    return all;
  }
  /// Costs by the value of one macro; 2 for all others.
  void cost_of(const std::string& macro, std::map<int, double> costs) {
    shaping->cost = [=](const std::string&, const Macros& macros) {
      const auto value = macros.find(macro);
      if (value == macros.end()) return 0.0;  // sym16_fold
      const auto found = costs.find(value->second);
      return found == costs.end() ? 2.0 : found->second;
    };
  }
  /// Nothing happens in launches with this value.
  void break_at(const std::string& macro, int value) {
    shaping->idle = [=](const std::string&, const Macros& macros) {
      const auto found = macros.find(macro);
      return found != macros.end() && found->second == value;
    };
  }
  static TunedShape rows(int standard, int chosen) {
    return {.kernel = "matvec", .standard = {{"ROWS", standard}}, .chosen = {{"ROWS", chosen}}, .gain = 1.25};
  }

  test::FreshCache cache;
  test::ShapeSources sources;
  test::Variable allowed{"INTERFLECT_TUNING", "on"};
  std::shared_ptr<Shaping> shaping = std::make_shared<Shaping>();
};

TEST_F(Tuning, TheFastestShapeIsChosen) {
  cost_of("ROWS", {{12, 1.9}, {32, 1.0}});
  const TunedShape shape = search("matvec");
  EXPECT_EQ(shape.standard, (Macros{{"ROWS", 8}}));
  EXPECT_EQ(shape.chosen, (Macros{{"ROWS", 32}}));
  EXPECT_DOUBLE_EQ(shape.gain, 2.0);
  EXPECT_TRUE(shape.done);
  EXPECT_THAT(shape.refused, IsEmpty());
  cost_of("ROWS", {{4, 1.0}});
  EXPECT_EQ(search("matvec").chosen, (Macros{{"ROWS", 4}})) << "below the default, too";
}

TEST_F(Tuning, AShapeThatIsWrongIsNeverChosenHoweverFast) {
  cost_of("ROWS", {{16, 1.0}, {32, 0.1}});
  break_at("ROWS", 32);
  const TunedShape shape = search("matvec");
  EXPECT_EQ(shape.chosen, (Macros{{"ROWS", 16}}));
  EXPECT_THAT(shape.refused, ElementsAre(HasSubstr("ROWS=32: n=1 ")));

  cost_of("STRIPS", {{4, 0.1}, {8, 1.0}});
  break_at("STRIPS", 4);
  const TunedShape tiles = search("tiles16");
  EXPECT_EQ(tiles.chosen.at("STRIPS"), 8);
  EXPECT_THAT(tiles.refused, ElementsAre(HasSubstr("STRIPS=4: n=1 ")));

  cost_of("BLOCK", {{256, 0.1}, {512, 1.0}});
  break_at("BLOCK", 256);
  const TunedShape symmetric = search("sym16");
  EXPECT_EQ(symmetric.chosen.at("BLOCK"), 512);
  EXPECT_THAT(symmetric.refused, ElementsAre(HasSubstr("BLOCK=256")));
}

TEST_F(Tuning, ThatShapeIsChosenWhereItIsRight) {  // the twin of the test above
  cost_of("ROWS", {{16, 1.0}, {32, 0.1}});
  EXPECT_EQ(search("matvec").chosen, (Macros{{"ROWS", 32}}));
  cost_of("STRIPS", {{4, 0.1}, {8, 1.0}});
  EXPECT_EQ(search("tiles16").chosen.at("STRIPS"), 4);
  cost_of("BLOCK", {{256, 0.1}, {512, 1.0}});
  EXPECT_EQ(search("sym16").chosen.at("BLOCK"), 256);
}

TEST_F(Tuning, WhatIsNoFasterThanNoiseIsNotChosen) {
  EXPECT_EQ(search("matvec").chosen, (Macros{{"ROWS", 8}}));
  cost_of("ROWS", {{16, 1.97}});
  EXPECT_EQ(search("matvec").chosen, (Macros{{"ROWS", 8}})) << "1.5 %";
  int launches = 0;  // fast now and then
  shaping->cost = [&](const std::string&, const Macros& macros) {
    return macros.at("ROWS") == 16 && ++launches % 3 != 0 ? 1.0 : 2.0;
  };
  EXPECT_EQ(search("matvec").chosen, (Macros{{"ROWS", 8}}));
}

TEST_F(Tuning, ALuckyCandidateMustWinAgain) {
  int launches = 0;
  shaping->cost = [&](const std::string&, const Macros& macros) {
    return macros.at("ROWS") == 16 && ++launches < 8 ? 1.0 : 2.0;  // as long as it is tried, not in the end
  };
  const TunedShape shape = search("matvec");
  EXPECT_EQ(shape.chosen, shape.standard);
  EXPECT_EQ(shape.gain, 1);
  EXPECT_GT(launches, 8);
}

TEST_F(Tuning, TimeEndsTheSearch) {
  cost_of("ROWS", {{32, 0.1}});
  const TunedShape shape = search("matvec", 1);
  EXPECT_FALSE(shape.done);
  EXPECT_EQ(shape.chosen, shape.standard);
}

TEST_F(Tuning, AShapeThatDoesNotCompileIsPassedOver) {
  cost_of("ROWS", {{12, 0.1}, {4, 1.0}});
  shaping->refused = [](const std::string&, const Macros& macros) { return macros.at("ROWS") == 12; };
  EXPECT_EQ(search("matvec").chosen, (Macros{{"ROWS", 4}}));
  shaping->refused = [](const std::string&, const Macros&) { return true; };
  EXPECT_THROW(static_cast<void>(search("matvec")), Error);
}

TEST_F(Tuning, OnlyWhatTheLanguageUsesIsTuned) {
  const DeviceInfo openmp = open_device("openmp")->info();
  EXPECT_THAT(tunable_kernels(openmp), ElementsAre("tiles16", "sym16"));
  for (const TunableMacro& macro : tunable_macros(openmp, "tiles16")) EXPECT_EQ(macro.name, "PREFETCH");
  ASSERT_EQ(tunable_macros(info(), "matvec").size(), 1U);
  EXPECT_EQ(tunable_macros(info(), "matvec").front().name, "ROWS");
  EXPECT_THAT(tunable_macros(info(), "dot"), IsEmpty());
}

TEST_F(Tuning, WhatIsKeptIsUsed) {
  EXPECT_FALSE(kept_shape(info(), "matvec"));
  EXPECT_EQ(launch_macros(info(), "matvec", 3), (Macros{{"COLUMNS", 3}, {"ROWS", 8}}));
  ASSERT_EQ(keep_shape(info(), rows(8, 32)), "");
  const auto kept = kept_shape(info(), "matvec");
  ASSERT_TRUE(kept);
  EXPECT_EQ(kept->chosen, (Macros{{"ROWS", 32}}));
  EXPECT_EQ(kept->gain, 1.25);
  EXPECT_EQ(launch_macros(info(), "matvec", 3), (Macros{{"COLUMNS", 3}, {"ROWS", 32}}));
  EXPECT_EQ(launch_macros(info(), "matvec", 4), (Macros{{"COLUMNS", 4}, {"ROWS", 8}})) << "not what was tuned";
  EXPECT_FALSE(kept_shape(info(), "tiles16"));
  const test::Variable off("INTERFLECT_TUNING", "off");
  EXPECT_FALSE(kept_shape(info(), "matvec"));
  EXPECT_EQ(launch_macros(info(), "matvec", 3), (Macros{{"COLUMNS", 3}, {"ROWS", 8}}));
}

TEST_F(Tuning, TheBlockOfLargeMatricesOnly) {
  const DeviceInfo device = info();
  EXPECT_EQ(preferred_block(nullptr, 17128), 0U);
  EXPECT_EQ(preferred_block(&device, 17128), 0U);
  TunedShape shape{.kernel = "sym16"};
  for (const TunableMacro& macro : tunable_macros(device, "sym16")) shape.standard[macro.name] = macro.standard;
  shape.chosen = shape.standard;
  ASSERT_EQ(keep_shape(device, shape), "");
  EXPECT_EQ(preferred_block(&device, 17128), 0U) << "the default is the matrix's to choose";
  shape.chosen["BLOCK"] = 512;
  ASSERT_EQ(keep_shape(device, shape), "");
  EXPECT_EQ(preferred_block(&device, 17128), 512U);
  EXPECT_EQ(preferred_block(&device, 4096), 512U);
  EXPECT_EQ(preferred_block(&device, 4095), 0U);
  EXPECT_FALSE(launch_macros(device, "sym16", 3).contains("BLOCK"));
}

TEST_F(Tuning, AnotherDeviceDriverOrSourceHasNoEntry) {
  ASSERT_EQ(keep_shape(info(), rows(8, 32)), "");
  DeviceInfo other = info();
  other.driver = "1.1";
  EXPECT_FALSE(kept_shape(other, "matvec"));
  other = info();
  other.name = "made up too";
  EXPECT_FALSE(kept_shape(other, "matvec"));
  other = info();
  other.compute_units += 1;
  EXPECT_FALSE(kept_shape(other, "matvec"));
  other = info();
  other.backend = "vulkan";
  EXPECT_FALSE(kept_shape(other, "matvec"));
  EXPECT_TRUE(kept_shape(info(), "matvec"));
  sources.write("matvec", "ROWS // changed");
  EXPECT_FALSE(kept_shape(info(), "matvec"));
  std::filesystem::remove(sources.path("matvec"));
  EXPECT_FALSE(kept_shape(info(), "matvec")) << "and no source at all is no error here";
  EXPECT_THAT(tunable_kernels(info()), ElementsAre("tiles16", "sym16"));
}

TEST_F(Tuning, DamageIsNoticedWhereverItIs) {
  ASSERT_EQ(keep_shape(info(), rows(8, 32)), "");
  ASSERT_EQ(files().size(), 1U);
  const fs::path file = files().front();
  std::ifstream in(file, std::ios::binary);
  const std::string whole{std::istreambuf_iterator<char>(in), {}};
  const auto write = [&](const std::string& text) { std::ofstream(file, std::ios::binary) << text; };
  for (std::size_t at = 0; at < whole.size(); ++at) {
    std::string text = whole;
    text[at] = static_cast<char>(text[at] ^ 1);
    write(text);
    EXPECT_FALSE(kept_shape(info(), "matvec")) << "byte " << at;
    write(whole.substr(0, at));
    EXPECT_FALSE(kept_shape(info(), "matvec")) << "cut to " << at;
    EXPECT_THAT(kept_shapes(), IsEmpty());
  }
  write(whole);
  EXPECT_TRUE(kept_shape(info(), "matvec"));
  fs::remove(file);
  fs::create_directory(file);
  EXPECT_FALSE(kept_shape(info(), "matvec")) << "a folder";
  EXPECT_NE(keep_shape(info(), rows(8, 32)), "");
}

TEST_F(Tuning, ValuesThatNoSearchFindsAreNotTrusted) {
  for (const int value : {0, -8, 5, 65, 1 << 30}) {
    ASSERT_EQ(keep_shape(info(), rows(8, value)), "");
    EXPECT_FALSE(kept_shape(info(), "matvec")) << value;
  }
  ASSERT_EQ(keep_shape(info(), rows(16, 32)), "");
  EXPECT_FALSE(kept_shape(info(), "matvec")) << "another default";
  ASSERT_EQ(keep_shape(info(), {.kernel = "matvec"}), "");
  EXPECT_FALSE(kept_shape(info(), "matvec")) << "a macro is missing";
  TunedShape more = rows(8, 32);
  more.standard["COLUMNS"] = more.chosen["COLUMNS"] = 3;
  ASSERT_EQ(keep_shape(info(), more), "");
  EXPECT_FALSE(kept_shape(info(), "matvec")) << "one too many";

  ASSERT_EQ(keep_shape(info(), rows(8, 32)), "");
  const fs::path file = files().front();
  const auto entry = read_cache_entry(file, magic, 1 << 16);
  ASSERT_TRUE(entry);
  for (const char* content :
       {"", "1.2 1", "nan 1\nROWS 8 32\n", "1e999 1\nROWS 8 32\n", "1.2 1\nROWS 8 99999999999999999999\n",
        "1.2 1\nROWS 8 32", "1.2 1\nROWS 8\n", "1.2 1\n\n\n", "1.2 1\nROWS 8 32\nROWS 8 5\n"}) {
    write_cache_entry(file, magic, entry->key, content);
    EXPECT_FALSE(kept_shape(info(), "matvec")) << content;
    static_cast<void>(kept_shapes());
  }
  write_cache_entry(file, magic, entry->key + " ", entry->content);
  EXPECT_FALSE(kept_shape(info(), "matvec")) << "another key's";
  write_cache_entry(file, magic, "99999999999\nx", entry->content);
  EXPECT_THAT(kept_shapes(), IsEmpty());
  write_cache_entry(file, magic, entry->key, entry->content);
  EXPECT_TRUE(kept_shape(info(), "matvec"));
}

TEST_F(Tuning, WithoutAPlaceNothingIsKept) {
  EXPECT_TRUE(shapes_can_be_kept());
  {
    const test::Variable off("INTERFLECT_CACHE", "off");
    EXPECT_FALSE(shapes_can_be_kept());
    EXPECT_THAT(keep_shape(info(), rows(8, 32)), HasSubstr("INTERFLECT_CACHE"));
    EXPECT_THAT(kept_shapes(), IsEmpty());
  }
  const test::TemporaryFolder other("tuning");
  const fs::path file = other.path() / "file";
  std::ofstream(file) << "not a folder";
  const test::Variable nowhere("XDG_CACHE_HOME", file.string());
  EXPECT_FALSE(shapes_can_be_kept());
  EXPECT_THAT(keep_shape(info(), rows(8, 32)), HasSubstr(file.string()));
  EXPECT_FALSE(kept_shape(info(), "matvec"));
  EXPECT_EQ(forget_shapes(), 0U);
}

TEST_F(Tuning, EntriesAreListedAndForgotten) {
  DeviceInfo other = info();
  other.name = "another";
  ASSERT_EQ(keep_shape(info(), rows(8, 32)), "");
  ASSERT_EQ(keep_shape(other, rows(8, 16)), "");
  std::ofstream(folder() / "opencl-matvec-0") << "damaged";
  std::vector<KeptShape> all = kept_shapes();
  ASSERT_EQ(all.size(), 2U);
  const KeptShape& mine = all[0].of(info()) ? all[0] : all[1];
  EXPECT_TRUE(mine.of(info()));
  EXPECT_EQ(mine.backend, "opencl");
  EXPECT_EQ(mine.driver, "1.0");
  EXPECT_EQ(mine.shape.kernel, "matvec");
  EXPECT_EQ(mine.shape.chosen, (Macros{{"ROWS", 32}}));
  const std::vector<DeviceInfo> one{info()};
  EXPECT_EQ(forget_shapes(&one), 1U);
  EXPECT_FALSE(kept_shape(info(), "matvec"));
  EXPECT_TRUE(kept_shape(other, "matvec"));
  EXPECT_EQ(forget_shapes(), 2U) << "the damaged one, too";
  EXPECT_THAT(files(), IsEmpty());
}

TEST_F(Tuning, TheRealClockOnTheRealDevice) {
  const auto device = open_device("openmp");
  for (const std::string& kernel : tunable_kernels(device->info())) {
    const TunedShape shape = search_shape(*device, kernel, {.seconds = 0.2, .bytes = 1U << 20});
    ASSERT_EQ(keep_shape(device->info(), shape), "");
    const auto kept = kept_shape(device->info(), kernel);
    ASSERT_TRUE(kept) << "whatever was found can be read again";
    EXPECT_EQ(kept->chosen, shape.chosen);
    EXPECT_THAT(shape.refused, IsEmpty());
  }
}

}  // namespace
}  // namespace interflect
