// Panels that memory holds a part of: every pass sees every panel once, whatever stays, fails or is broken off.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <set>
#include <stdexcept>
#include <string>

#include "formfactor/broken.h"
#include "formfactor/panels.h"
#include "interflect/formfactor/assembly.h"
#include "interflect/formfactor/streamed_matrix.h"

namespace interflect {
namespace {

using namespace test;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::Le;

/// Every element that a pass shows is the one that it should be, every row once.
testing::AssertionResult sees_all(PanelStream& stream, const MemoryPanels& panels, std::uint32_t from = 0,
                                  std::uint32_t end = PanelStream::all) {
  std::set<std::uint32_t> seen;
  std::string wrong;
  stream.pass(
      [&](const PanelStream::View& view) {
        if (!seen.insert(view.panel).second) wrong = "a panel twice";
        if (view.first != view.panel * panels.rows_per_panel() || view.rows != panels.rows(view.panel)) wrong = "rows";
        for (std::uint32_t r = 0; r < view.rows; ++r) {
          const std::span<const float> row = view.row(r, panels.stride());
          for (std::uint32_t j = 0; j < panels.size(); ++j) {
            if (row[j] != panels.at(view.first + r, j)) wrong = "element " + std::to_string(view.first + r);
          }
        }
      },
      from, end);
  const std::uint32_t expected = std::min(end, panels.panels()) - from;
  if (seen.size() != expected) wrong = std::to_string(seen.size()) + " panels";
  return wrong.empty() ? testing::AssertionSuccess() : testing::AssertionFailure() << wrong;
}

std::ptrdiff_t threads_of_this_process() {
  return std::distance(std::filesystem::directory_iterator("/proc/self/task"), {});
}

TEST(PanelStream, EveryPassSeesEveryPanelWhateverStays) {
  for (const std::uint32_t n : {1U, 32U, 70U, 333U}) {
    for (std::uint64_t fit = 2; fit <= (n + 31) / 32 + 1; ++fit) {
      const MemoryPanels panels(n, 32, wavy_element);
      PanelStream stream(panels, fit * panels.panel_bytes());
      for (int pass = 0; pass < 4; ++pass) EXPECT_TRUE(sees_all(stream, panels)) << n << " " << fit;
      for (std::uint32_t k = 0; k < stream.kept(); ++k) EXPECT_EQ(panels.reads[k], 1U);
      EXPECT_THAT(panels.reads, Each(Le(4U)));
      EXPECT_EQ(stream.use().passes, 4U);
      EXPECT_EQ(stream.bytes_to_allocate(), 0U);
    }
  }
}

TEST(PanelStream, WhatTheBuffersHoldIsNotReadAgain) {
  const MemoryPanels panels(320, 32, wavy_element);
  PanelStream stream(panels, 5 * panels.panel_bytes());  // two stay, eight go through three buffers
  EXPECT_EQ(stream.kept(), 2U);
  ASSERT_TRUE(sees_all(stream, panels));
  EXPECT_EQ(stream.use().bytes_read, stream.bytes());
  ASSERT_TRUE(sees_all(stream, panels));
  EXPECT_EQ(stream.use().bytes_read, stream.bytes() + 5 * panels.panel_bytes());
  EXPECT_THAT(panels.reads, testing::ElementsAre(1, 1, 2, 2, 2, 2, 2, 1, 1, 1));
}

TEST(PanelStream, KeepsWhatItIsToldTo) {
  const MemoryPanels panels(320, 32, wavy_element);
  for (const std::uint64_t fit : {6U, 10U}) {
    PanelStream stream(panels, fit * panels.panel_bytes());
    ASSERT_TRUE(sees_all(stream, panels));
    stream.keep(0);
    EXPECT_TRUE(sees_all(stream, panels, 4));
    EXPECT_TRUE(sees_all(stream, panels, 2, 7));
    EXPECT_TRUE(sees_all(stream, panels, 10));
    stream.keep(99);
    EXPECT_EQ(stream.kept(), stream.fitting());
    EXPECT_TRUE(sees_all(stream, panels));
    EXPECT_TRUE(sees_all(stream, panels));
  }
}

TEST(PanelStream, AFailedReadComesOutAndTheNextPassIsWhole) {
  const std::ptrdiff_t threads = threads_of_this_process();
  for (const std::uint64_t fit : {2U, 4U, 10U}) {
    for (std::uint32_t failing = 0; failing < 10; ++failing) {
      MemoryPanels panels(320, 32, wavy_element);
      PanelStream stream(panels, fit * panels.panel_bytes());
      panels.before_read = [failing](std::uint32_t panel) {
        if (panel == failing) throw Error(ErrorKind::input, "room.iff: panel " + std::to_string(panel));
      };
      std::set<std::uint32_t> seen;
      try {
        stream.pass([&](const PanelStream::View& view) { seen.insert(view.panel); });
        FAIL() << "no error";
      } catch (const Error& error) {
        EXPECT_EQ(error.kind(), ErrorKind::input);
        EXPECT_EQ(std::string(error.what()), "room.iff: panel " + std::to_string(failing));
      }
      EXPECT_FALSE(seen.contains(failing));
      EXPECT_EQ(threads_of_this_process(), threads);
      panels.before_read = {};
      EXPECT_TRUE(sees_all(stream, panels));
      EXPECT_TRUE(sees_all(stream, panels));
    }
  }
}

TEST(PanelStream, ABrokenOffPassLeavesNoThread) {
  const MemoryPanels panels(320, 32, wavy_element);
  const std::ptrdiff_t threads = threads_of_this_process();
  for (std::size_t after = 0; after < 10; ++after) {
    PanelStream stream(panels, 4 * panels.panel_bytes());
    std::size_t count = 0;
    EXPECT_THROW(stream.pass([&](const PanelStream::View&) {
      if (count++ == after) throw std::runtime_error("stop");
    }),
                 std::runtime_error);
    EXPECT_EQ(threads_of_this_process(), threads);
    EXPECT_TRUE(sees_all(stream, panels));
  }
}

TEST(PanelStream, NeedsTwoPanels) {
  const MemoryPanels panels(320, 32, wavy_element);
  try {
    PanelStream(panels, 2 * panels.panel_bytes() - 1);
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::limit);
    EXPECT_THAT(error.what(), HasSubstr("two of them"));
  }
}

/// A closed room with things in it, 9 tile rows.
Builder room() {
  Builder b;
  b.part("walls").box({0, 0, 0}, {4, 3, 2.5}, true, 4);
  b.part("box").box({1, 1, 0.2}, {2, 1.7, 1}, false, 2);
  b.part("ball").sphere({3, 2, 1.2}, 0.4, 0, false);
  return b;
}

void expect_same(const AssemblyReport& a, const AssemblyReport& b) {
  EXPECT_EQ(a.scaling, b.scaling);
  EXPECT_EQ(a.row_sum, b.row_sum);
  EXPECT_EQ(a.row_sum_before, b.row_sum_before);
  EXPECT_EQ(a.closure_max_change, b.closure_max_change);
  EXPECT_EQ(a.tile_variance, b.tile_variance);
  EXPECT_EQ(a.set_aside, b.set_aside);
  EXPECT_EQ(a.warnings, b.warnings);
  EXPECT_EQ(a.rays, b.rays);
  EXPECT_EQ(a.pairs_considered, b.pairs_considered);
}

bool same_panels(const MemoryStore& a, const MemoryStore& b) {
  if (a.panels.size() != b.panels.size()) return false;
  for (const auto& [panel, content] : a.panels) {
    if (!b.panels.contains(panel) || b.panels.at(panel).first != content.first) return false;
  }
  return true;
}

TEST(AssembleInto, GivesTheBitsOfTheAssemblyInMemoryForAnyMemory) {
  const PatchMesh mesh = room().mesh();
  const auto n = static_cast<std::uint32_t>(mesh.size());
  const std::uint64_t row_bytes = FormFactorMatrix::stride_of(n) * sizeof(float);
  for (const std::uint32_t rows : {32U, 64U}) {
    MemoryStore whole(n, rows);
    AssemblyOptions options;
    options.panels = &whole;
    const AssemblyReport expected = assemble(mesh, options).report;
    ASSERT_TRUE(expected.closure_applied);
    options.panels = nullptr;
    for (const std::uint64_t panels : {2U, 4U}) {
      MemoryStore store(n, rows);
      expect_same(assemble_into(store, mesh, options, panels * rows * row_bytes), expected);
      EXPECT_TRUE(same_panels(store, whole)) << rows << " rows, memory for " << panels;
      // Some of the panels are there already.
      for (std::uint32_t k = 0; k < store.panels.size() + 3; k += 3) store.panels.erase(k);
      const std::uint32_t left = static_cast<std::uint32_t>(store.panels.size());
      const AssemblyReport resumed = assemble_into(store, mesh, options, panels * rows * row_bytes);
      expect_same(resumed, expected);
      EXPECT_EQ(resumed.panels_reused, left);
      EXPECT_TRUE(same_panels(store, whole));
    }
    MemoryStore broken(n, rows);
    broken.broken_columns = true;
    static_cast<void>(assemble_into(broken, mesh, options, 2 * rows * row_bytes));
    EXPECT_FALSE(same_panels(broken, whole)) << "twin: columns from the wrong place";
  }
}

TEST(AssembleInto, WithoutClosureToo) {
  const PatchMesh mesh = room().mesh();
  const auto n = static_cast<std::uint32_t>(mesh.size());
  MemoryStore store(n, 64);
  const std::uint64_t memory = 192 * FormFactorMatrix::stride_of(n) * sizeof(float);
  const AssemblyReport report = assemble_into(store, mesh, raw(), memory);
  expect_same(report, assemble(mesh, raw()).report);
  EXPECT_EQ(report.closure_max_change, 0);
}

TEST(AssembleInto, SaysWhatDoesNotFit) {
  const PatchMesh mesh = room().mesh();
  const auto n = static_cast<std::uint32_t>(mesh.size());
  MemoryStore store(n, 64);
  const std::uint64_t two = 128 * FormFactorMatrix::stride_of(n) * sizeof(float);
  const auto expect_limit = [&](const AssemblyOptions& options, std::uint64_t memory, const std::string& part) {
    try {
      static_cast<void>(assemble_into(store, mesh, options, memory));
      FAIL() << "no error";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::limit);
      EXPECT_THAT(error.what(), HasSubstr(part));
    }
  };
  expect_limit(raw(), two - 1, "two panels");
  AssemblyOptions small = raw();
  small.memory_limit = two;
  expect_limit(small, two, "beside them");
  EXPECT_TRUE(store.panels.empty());
}

TEST(StreamedMatrix, RefusesAreasOfOtherPatches) {
  const MemoryPanels panels(100, 32, wavy_element);
  EXPECT_THROW(StreamedMatrix(panels, std::vector<double>(99), std::vector<double>(100), 1 << 20), Error);
  EXPECT_THROW(StreamedMatrix(panels, std::vector<double>(100), std::vector<double>(99), 1 << 20), Error);
}

}  // namespace
}  // namespace interflect
