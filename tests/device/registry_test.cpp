#include "interflect/device/registry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "device/expect_error.h"
#include "interflect/base/error.h"

// Which devices an id, a list of ids and "auto" mean: with the backends of this build, and with made-up ones.

namespace interflect {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

using test::expect_error;

TEST(Registry, ListsOpenMPAndOpensItByNameAndAsAuto) {
  const std::vector<DeviceEntry> all = list_devices();
  ASSERT_FALSE(all.empty());
  EXPECT_EQ(std::count_if(all.begin(), all.end(),
                          [](const DeviceEntry& entry) { return entry.info.id == "openmp" && entry.available; }),
            1);
  EXPECT_EQ(open_device("openmp")->info().id, "openmp");
  EXPECT_FALSE(open_device("auto")->info().emulated());
  EXPECT_THAT(choose_devices("openmp"), ElementsAre("openmp"));
  EXPECT_EQ(choose_devices("auto").back(), "openmp");
}

TEST(Registry, AnUnknownIdIsAUsageErrorThatListsTheValidOnes) {
  for (const char* id : {"", "openmp:1", "cuda:99", "Openmp", "openmp:", "nonsense"}) {
    const auto message = AllOf(HasSubstr("'" + std::string(id) + "'"), HasSubstr("auto"), HasSubstr("openmp"));
    expect_error(ErrorKind::usage, message, [&] { static_cast<void>(open_device(id)); });
    expect_error(ErrorKind::usage, message, [&] { static_cast<void>(choose_devices(id)); });
    expect_error(ErrorKind::usage, message, [&] { static_cast<void>(choose_devices("openmp," + std::string(id))); });
  }
  expect_error(ErrorKind::usage, HasSubstr("''"), [] { static_cast<void>(choose_devices("openmp,")); });
  expect_error(ErrorKind::usage, HasSubstr("twice"), [] { static_cast<void>(choose_devices("openmp,openmp")); });
  expect_error(ErrorKind::usage, HasSubstr("stands alone"), [] { static_cast<void>(choose_devices("openmp,auto")); });
  expect_error(ErrorKind::usage, HasSubstr("stands alone"), [] { static_cast<void>(choose_devices("all,openmp")); });
}

DeviceEntry entry(const std::string& id, DeviceType type, const std::string& hardware = "", bool available = true) {
  DeviceEntry made;
  made.info.id = id;
  made.info.backend = id.substr(0, id.find(':'));
  made.info.type = type;
  made.info.hardware = hardware;
  made.available = available;
  if (!available) made.reason = "asleep";
  return made;
}

/// Rates by id that remember whom they were asked for.
struct Rates {
  std::map<std::string, double> known;
  std::vector<std::string> asked;
  double operator()(const DeviceEntry& device) {
    asked.push_back(device.info.id);
    return known[device.info.id];
  }
};

TEST(RankDevices, OneGpuThroughThreeDriversIsNotMeasured) {
  const std::vector<DeviceEntry> entries{entry("cuda:0", DeviceType::gpu, "pci 1"),
                                         entry("opencl:0", DeviceType::gpu, "pci 1"),
                                         entry("vulkan:0", DeviceType::gpu, "pci 1"), entry("openmp", DeviceType::cpu)};
  Rates rates;
  EXPECT_THAT(rank_devices(entries, std::ref(rates)), ElementsAre("cuda:0", "opencl:0", "vulkan:0", "openmp"));
  EXPECT_THAT(rates.asked, IsEmpty());
}

TEST(RankDevices, TheFasterOfSeveralGpusComesFirstAndOpenMPLast) {
  const std::vector<DeviceEntry> entries{
      entry("openmp", DeviceType::cpu),           entry("opencl:0", DeviceType::gpu, "small"),
      entry("opencl:1", DeviceType::gpu, "big"),  entry("opencl:2", DeviceType::gpu),
      entry("vulkan:0", DeviceType::gpu, "big"),  entry("vulkan:1", DeviceType::gpu, "small"),
      entry("vulkan:2", DeviceType::gpu, "dead"), entry("vulkan:3", DeviceType::other)};
  Rates rates{{{"opencl:0", 100}, {"opencl:1", 900}, {"opencl:2", 300}, {"vulkan:3", 50}}, {}};
  EXPECT_THAT(rank_devices(entries, std::ref(rates)), ElementsAre("opencl:1", "vulkan:0", "opencl:2", "opencl:0",
                                                                  "vulkan:1", "vulkan:3", "vulkan:2", "openmp"));
  EXPECT_THAT(rates.asked, ElementsAre("opencl:0", "opencl:1", "opencl:2", "vulkan:2", "vulkan:3"));
}

TEST(RankDevices, APieceIsMeasuredThroughTheFirstDriverThatCan) {
  const std::vector<DeviceEntry> entries{entry("cuda:0", DeviceType::gpu, "a"), entry("cuda:1", DeviceType::gpu, "b"),
                                         entry("opencl:0", DeviceType::gpu, "b")};
  Rates rates{{{"cuda:0", 10}, {"opencl:0", 20}}, {}};
  EXPECT_THAT(rank_devices(entries, std::ref(rates)), ElementsAre("cuda:1", "opencl:0", "cuda:0"));
}

TEST(RankDevices, EmulationsAndWhatIsNotAvailableAreLeftOut) {
  const std::vector<DeviceEntry> entries{entry("cuda:0", DeviceType::gpu, "", false),
                                         entry("opencl:0", DeviceType::cpu, "cpu"), entry("vulkan:0", DeviceType::cpu),
                                         entry("openmp", DeviceType::cpu)};
  Rates rates;
  EXPECT_THAT(rank_devices(entries, std::ref(rates)), ElementsAre("openmp"));
  EXPECT_THAT(rates.asked, IsEmpty());
  EXPECT_THAT(rank_devices({}, std::ref(rates)), IsEmpty());
}

TEST(AllDevices, AreOneForEachPieceOfHardwareAndNoEmulations) {
  const std::vector<DeviceEntry> entries{entry("cuda:0", DeviceType::gpu, "pci 1"),
                                         entry("cuda:1", DeviceType::gpu, "pci 2"),
                                         entry("cuda:2", DeviceType::gpu, "pci 3", false),
                                         entry("opencl:0", DeviceType::gpu, "pci 1"),
                                         entry("opencl:1", DeviceType::gpu, "pci 4"),
                                         entry("opencl:2", DeviceType::cpu, "cpu"),
                                         entry("vulkan:0", DeviceType::gpu, "pci 2"),
                                         entry("vulkan:1", DeviceType::other),
                                         entry("openmp", DeviceType::cpu)};
  Rates rates{{{"cuda:0", 100}, {"cuda:1", 900}, {"opencl:1", 500}}, {}};
  EXPECT_THAT(all_devices(entries, std::ref(rates)), ElementsAre("cuda:1", "opencl:1", "cuda:0", "vulkan:1", "openmp"));
  EXPECT_THAT(all_devices(std::vector{entry("openmp", DeviceType::cpu)}, std::ref(rates)), ElementsAre("openmp"));
}

/// A registry of OpenMP and a made-up backend "gpu" that counts who wakes it.
struct MadeUp {
  explicit MadeUp(std::vector<DeviceEntry> entries) : gpus(std::move(entries)) {}
  std::vector<DeviceEntry> gpus;
  int listed = 0;
  std::vector<std::uint32_t> opened;

  Registry registry() {
    return Registry({{"gpu",
                      [this] {
                        ++listed;
                        return gpus;
                      },
                      [this](std::uint32_t index) -> std::unique_ptr<Device> {
                        opened.push_back(index);
                        throw device_error(gpus.at(index).info.id, "open", "lost");
                      }},
                     {"openmp", [] { return std::vector{entry("openmp", DeviceType::cpu)}; },
                      [](std::uint32_t) { return open_device("openmp"); }}});
  }
};

TEST(MadeUpRegistry, NamingADeviceLeavesOtherDriversAsleep) {
  MadeUp made{{entry("gpu:0", DeviceType::gpu)}};
  const Registry registry = made.registry();
  EXPECT_EQ(registry.open("openmp")->info().id, "openmp");
  EXPECT_THAT(registry.choose("openmp"), ElementsAre("openmp"));
  EXPECT_EQ(made.listed, 0);
  EXPECT_THAT(registry.choose("gpu:0,openmp"), ElementsAre("gpu:0", "openmp"));
  EXPECT_EQ(made.listed, 1);
  EXPECT_THAT(made.opened, IsEmpty());
}

TEST(MadeUpRegistry, AutoGoesOnToWhatCanBeOpened) {
  MadeUp made{{entry("gpu:0", DeviceType::gpu, "", false), entry("gpu:1", DeviceType::gpu, "a"),
               entry("gpu:2", DeviceType::gpu, "a")}};
  EXPECT_EQ(made.registry().open("auto")->info().id, "openmp");
  EXPECT_THAT(made.opened, ElementsAre(1, 2));
}

TEST(MadeUpRegistry, AGpuThatCannotBeMeasuredIsACandidateAllTheSame) {
  MadeUp made{{entry("gpu:0", DeviceType::gpu), entry("gpu:1", DeviceType::gpu)}};
  EXPECT_THAT(made.registry().choose("auto"), ElementsAre("gpu:0", "gpu:1", "openmp"));
  EXPECT_THAT(made.opened, ElementsAre(0, 1));
}

TEST(MadeUpRegistry, SaysWhyADeviceIsNotAvailable) {
  MadeUp made{{entry("gpu:0", DeviceType::gpu, "", false)}};
  const Registry registry = made.registry();
  expect_error(ErrorKind::device, HasSubstr("gpu:0: open: asleep"), [&] { static_cast<void>(registry.open("gpu:0")); });
  expect_error(ErrorKind::usage, AllOf(HasSubstr("there are auto, all, openmp"), HasSubstr("gpu:0: asleep")),
               [&] { static_cast<void>(registry.open("gpu:1")); });
  EXPECT_THAT(registry.choose("gpu:0,openmp"), ElementsAre("gpu:0", "openmp"));
}

TEST(MadeUpRegistry, ABackendThatFailsIsAnEntryThatSaysWhy) {
  const Registry registry({{"gpu", []() -> std::vector<DeviceEntry> { throw device_error("gpu", "load", "no driver"); },
                            [](std::uint32_t) -> std::unique_ptr<Device> { return nullptr; }}});
  const std::vector<DeviceEntry> all = registry.list();
  ASSERT_EQ(all.size(), 1U);
  EXPECT_FALSE(all[0].available);
  EXPECT_EQ(all[0].info.id, "gpu");
  EXPECT_THAT(all[0].reason, HasSubstr("no driver"));
  expect_error(ErrorKind::device, HasSubstr("no device is available"),
               [&] { static_cast<void>(registry.choose("auto")); });
}

TEST(MadeUpRegistry, AMistakeOfTheUsersIsNotTakenForAMissingDriver) {
  const Registry registry({{"gpu", []() -> std::vector<DeviceEntry> { throw Error(ErrorKind::usage, "no such thing"); },
                            [](std::uint32_t) -> std::unique_ptr<Device> { return nullptr; }}});
  expect_error(ErrorKind::usage, HasSubstr("no such thing"), [&] { static_cast<void>(registry.list()); });
}

}  // namespace
}  // namespace interflect
