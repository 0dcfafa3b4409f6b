#include "interflect/formfactor/rank_assembly.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cstring>

#include "base/thread_ranks.h"
#include "formfactor/iff_room.h"
#include "interflect/formfactor/embree_tiles.h"
#include "interflect/formfactor/rank_fill.h"

namespace interflect {
namespace {

using namespace test;
using ::testing::HasSubstr;

class RankAssembly : public Iff {
 protected:
  /// What the ranks have, put together; rank 0's report.
  FormFactors by_ranks(ThreadWorld& world, std::uint32_t count, AssemblyOptions options = {}) {
    std::vector<RankFormFactors> parts(count);
    world.run([&](Ranks& ranks) { parts[ranks.rank()] = assemble_rows(ranks, mesh_, options); });
    return whole(parts);
  }
  [[nodiscard]] FormFactors whole(std::vector<RankFormFactors>& parts) const {
    FormFactors out{FormFactorMatrix(static_cast<std::uint32_t>(mesh_.size())), parts.front().own.report};
    for (const RankFormFactors& part : parts) {
      for (std::uint32_t i = part.own.matrix.first_row(); i < part.own.matrix.end_row(); ++i) {
        const auto row = part.own.matrix.row(i);
        std::copy(row.begin(), row.end(), out.matrix.row(i).begin());
      }
      EXPECT_EQ(part.nonzero_fraction, parts.front().nonzero_fraction);
      EXPECT_EQ(part.own.report.scaling, parts.front().own.report.scaling);
      EXPECT_EQ(part.own.report.row_sum, parts.front().own.report.row_sum);
    }
    return out;
  }
  /// As the command line does it, by ranks; `stop` ends after the first panels.
  std::string make_by_ranks(std::uint32_t count, const std::string& name, bool stop = false) {
    std::vector<RankFormFactors> parts(count);
    return error_of(
        [&] {
          ThreadWorld(count).run([&](Ranks& ranks) {
            IffStore::Options options;
            options.stop = [stop] { return stop; };
            RankStore store(ranks, name, shape(), options);
            RankFormFactors& part = parts[ranks.rank()];
            part = assemble_rows(ranks, mesh_, {}, &store);
            store.finish(iff_closing(mesh_, materials_, Closure::automatic, part.own.report));
            reused_ = part.own.report.panels_reused;
          });
        },
        ErrorKind::interrupted);
  }
  std::uint32_t reused_ = 0;
};

void expect_same_report(const AssemblyReport& a, const AssemblyReport& b) {
  EXPECT_EQ(a.row_sum, b.row_sum);
  EXPECT_EQ(a.row_sum_before, b.row_sum_before);
  EXPECT_EQ(a.scaling, b.scaling);
  EXPECT_EQ(a.tile_variance, b.tile_variance);
  EXPECT_EQ(a.closure_iterations, b.closure_iterations);
  EXPECT_EQ(a.closure_max_change, b.closure_max_change);
  EXPECT_EQ(a.escape_fraction, b.escape_fraction);
  EXPECT_EQ(a.pairs_considered, b.pairs_considered);
  EXPECT_EQ(a.pairs_analytic, b.pairs_analytic);
  EXPECT_EQ(a.rays, b.rays);
  EXPECT_EQ(a.warnings, b.warnings);
}

TEST_F(RankAssembly, HasTheBitsOfOneProcess) {
  const FormFactors expected = assemble(mesh_);
  for (const std::uint32_t count : {1U, 2U, 3U, 4U, 7U, 10U}) {  // of 10 some have no row
    ThreadWorld world(count);
    const FormFactors there = by_ranks(world, count);
    EXPECT_TRUE(equal(there.matrix, expected.matrix)) << count << " ranks";
    expect_same_report(there.report, expected.report);
  }
}

// The twin: a gather of the closure's products that loses the second rank's rows.
TEST_F(RankAssembly, DiffersWhereAGatherLosesRows) {
  ThreadWorld world(3);
  world.spoil = [](std::span<const std::uint64_t> bytes, std::span<std::byte> all) {
    if (bytes[1] < 64 * sizeof(double)) return;  // not rows
    std::memset(all.data() + bytes[0], 0, bytes[1]);
  };
  const FormFactors there = by_ranks(world, 3);
  EXPECT_FALSE(there.report.row_sum == assemble(mesh_).report.row_sum);
}

TEST_F(RankAssembly, OpenScenesAreNotClosedByRanksEither) {
  builder_ = Builder();
  builder_.part("floor")
      .plate({0, 0, 0}, {3, 0, 0}, {0, 3, 0}, 6)
      .part("wall")
      .plate({0, 0, 0}, {0, 3, 0}, {0, 0, 2}, 5);
  mesh_ = builder_.mesh();
  ThreadWorld world(3);
  const FormFactors there = by_ranks(world, 3), expected = assemble(mesh_);
  EXPECT_FALSE(there.report.closure_applied);
  EXPECT_TRUE(equal(there.matrix, expected.matrix));
  expect_same_report(there.report, expected.report);
}

TEST_F(RankAssembly, ManySmallExchangesAreOneLargeOne) {
  const auto n = static_cast<std::uint32_t>(mesh_.size());
  const PatchTable patches(mesh_);
  const Blockers blockers(mesh_, patches);
  const auto fill = [&](std::uint64_t most_bytes) {
    std::vector<std::vector<float>> rows(n);
    std::uint64_t messages = 0;
    ThreadWorld(3).run([&](Ranks& ranks) {
      const auto shares = row_shares(n, 3, 32);
      const RowShare share = shares[ranks.rank()];
      FormFactorMatrix s = FormFactorMatrix::rows_only(n, share.first, share.end);
      EmbreeTiles tiles(patches, blockers, {}, 1);
      AssemblyReport report;
      ProgressSink silent;
      RankFill(ranks, shares, s, tiles, nullptr, most_bytes).run(report, silent);
      for (std::uint32_t i = share.first; i < share.end; ++i) rows[i].assign(s.row(i).begin(), s.row(i).end());
      if (ranks.rank() == 0) messages = ranks.use().messages;
    });
    return std::pair(rows, messages);
  };
  const auto [large, few] = fill(1 << 30);
  const auto [small, many] = fill(3 * 5000);
  EXPECT_EQ(large, small);
  EXPECT_GT(many, few);
}

TEST_F(RankAssembly, AMakerThatFailsOnOneRankEndsAll) {
  struct Failing final : TileMaker {
    TileFacts make(std::size_t, std::size_t, const TileSink&, ProgressSink&) override {
      throw device_error("cuda:1", "launch tile_far", "lost");
    }
  };
  ThreadWorld world(3);
  std::atomic<int> made = 0;
  AssemblyOptions options;
  options.maker = [&](const PatchTable&, const Blockers&) -> std::unique_ptr<TileMaker> {
    return made++ == 1 ? std::make_unique<Failing>() : nullptr;
  };
  try {
    by_ranks(world, 3, options);
    FAIL() << "no error";
  } catch (const AgreedError& error) {
    EXPECT_EQ(error.kind(), ErrorKind::device);
    EXPECT_THAT(error.what(), HasSubstr("lost (rank "));
  }
}

TEST_F(RankAssembly, ARankThatHasNoRoomEndsAllBeforeTheWork) {
  AssemblyOptions options;
  options.memory_limit = 1000;
  ThreadWorld world(2);
  EXPECT_THAT(error_of([&] { by_ranks(world, 2, options); }, ErrorKind::limit), HasSubstr("a rank may use"));
}

TEST_F(RankAssembly, TheFileOfEveryNumberOfRanksHasTheBytesOfOneProcess) {
  make(file("one.iff"));
  for (const std::uint32_t count : {1U, 2U, 3U, 4U, 7U}) {
    const std::string name = file(std::to_string(count) + ".iff");
    EXPECT_EQ(make_by_ranks(count, name), "");
    EXPECT_TRUE(content_of(name) == content_of(file("one.iff"))) << count << " ranks";
    EXPECT_FALSE(std::filesystem::exists(name + ".partial"));
  }
}

TEST_F(RankAssembly, AnotherNumberOfRanksGoesOnWithAPartialFile) {
  make(file("one.iff"));
  const std::string name = file("room.iff");
  EXPECT_THAT(make_by_ranks(2, name, true), HasSubstr("panels are kept"));
  EXPECT_TRUE(std::filesystem::exists(name + ".partial"));
  EXPECT_THAT(make_by_ranks(3, name, true), HasSubstr("panels are kept"));
  EXPECT_EQ(make_by_ranks(4, name), "");
  EXPECT_GT(reused_, 0U);
  EXPECT_LT(reused_, shape().panels());
  EXPECT_TRUE(content_of(name) == content_of(file("one.iff")));
}

TEST_F(RankAssembly, APanelThatIsDamagedInThePartialFileIsMadeAgain) {
  make(file("one.iff"));
  const std::string name = file("room.iff");
  EXPECT_THAT(make_by_ranks(2, name, true), HasSubstr("panels are kept"));
  std::string content = content_of(name + ".partial");
  content[shape().panel_offset(0) + 5000] ^= 1;
  write(name + ".partial", content);
  EXPECT_EQ(make_by_ranks(3, name), "");
  EXPECT_TRUE(content_of(name) == content_of(file("one.iff")));
}

TEST_F(RankAssembly, ReadsAFileByRowsAndFindsTheClosureAnew) {
  const FormFactors expected = make(file());
  AssemblyOptions off;
  off.closure = Closure::off;
  const FormFactors unclosed = assemble(mesh_, off);
  for (const std::uint32_t count : {2U, 3U, 7U}) {
    std::vector<RankFormFactors> read(count), closed(count);
    ThreadWorld(count).run([&](Ranks& ranks) {
      const IffFile there = IffFile::open(file());
      read[ranks.rank()] = read_rows(ranks, there);
      closed[ranks.rank()] = close_rows(ranks, mesh_, off, there);
    });
    const FormFactors all = whole(read), anew = whole(closed);
    EXPECT_TRUE(equal(all.matrix, expected.matrix));
    expect_same_report(all.report, expected.report);
    EXPECT_TRUE(equal(anew.matrix, unclosed.matrix));
    expect_same_report(anew.report, unclosed.report);
  }
}

TEST_F(RankAssembly, ADamagedPanelOfAFileEndsAllRanks) {
  make(file());
  std::string content = content_of(file());
  content[shape().panel_offset(1) + 77] ^= 1;
  write(file(), content);
  const auto read = [&] {
    ThreadWorld(3).run([&](Ranks& ranks) {
      const IffFile there = IffFile::open(file());
      static_cast<void>(read_rows(ranks, there));
    });
  };
  EXPECT_THAT(error_of(read), HasSubstr("panel 1"));
}

}  // namespace
}  // namespace interflect
