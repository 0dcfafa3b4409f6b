// The store of a file of form factors: what it continues, repairs, closes again and refuses.
#include "interflect/formfactor/iff_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <cstring>
#include <filesystem>
#include <string>

#include "formfactor/iff_room.h"
#include "interflect/formfactor/iff_file.h"

namespace interflect {
namespace {

using namespace test;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST_F(Iff, AnInterruptedRunGoesOnAndGivesTheSameFile) {
  (void)make(file("undisturbed.iff"));
  for (const int after : {1, 2, 3}) {
    const std::string name = file("stopped" + std::to_string(after) + ".iff");
    int panels = 0;
    IffStore::Options options = saying();
    options.stop = [&] { return ++panels == after; };
    const std::string line = error_of([&] { (void)make(name, options); }, ErrorKind::interrupted);
    EXPECT_THAT(line, HasSubstr(std::to_string(after) + " of 4 panels are kept in " + name + ".partial"));
    EXPECT_FALSE(std::filesystem::exists(name));
    const FormFactors again = make(name, saying());
    EXPECT_EQ(again.report.panels_reused, static_cast<std::uint32_t>(after));
    EXPECT_THAT(said_.back(), HasSubstr("going on after " + std::to_string(after) + " of 4 panels"));
    EXPECT_EQ(content_of(name), content_of(file("undisturbed.iff")));
  }
}

/// Whatever a killed process leaves of a panel in hand: bytes without an entry, or an entry that is torn.
TEST_F(Iff, HalfWrittenPanelsDoNotCount) {
  (void)make(file("undisturbed.iff"));
  const std::string whole = content_of(file("undisturbed.iff"));
  const iff::Shape shape = IffFile::open(file("undisturbed.iff")).shape();
  for (const std::uint64_t end : {std::uint64_t{0}, std::uint64_t{100}, std::uint64_t{4096 + 64},
                                  shape.panel_offset(1) + 5, shape.closing_offset() + 8}) {
    std::string bytes = whole.substr(0, end);
    write(file("a.iff.partial"), bytes);
    (void)make(file("a.iff"));
    EXPECT_EQ(content_of(file("a.iff")), whole) << end;
    // The same end with a table that knows nothing yet of panel 2, torn in its entry.
    if (end < shape.data_offset()) continue;
    std::memset(bytes.data() + 4096 + 2 * 64 + 24, 0, 40);
    write(file("b.iff.partial"), bytes);
    (void)make(file("b.iff"));
    EXPECT_EQ(content_of(file("b.iff")), whole) << end;
  }
}

TEST_F(Iff, FinishedPanelsOfAnotherKeyAreNotThrownAway) {
  (void)make(file("undisturbed.iff"));
  const std::string partial = file() + ".partial";
  IffStore::Options options;
  options.stop = [] { return true; };
  EXPECT_NE(error_of([&] { (void)make(file(), options, 2); }, ErrorKind::interrupted), "");
  const std::string begun = content_of(partial);
  EXPECT_THAT(error_of([&] { (void)make(file()); }),
              HasSubstr("its seed is 2, 1 is asked; 1 of its 4 panels are finished: give the options that it was begun "
                        "with, or remove it"));
  EXPECT_EQ(content_of(partial), begun);
  // With nothing finished there is nothing to lose.
  std::string nothing = begun;
  std::memset(nothing.data() + iff::Shape::table_offset(), 0, 4 * sizeof(iff::EntryBytes));
  write(partial, nothing);
  (void)make(file(), saying());
  EXPECT_THAT(said_, ElementsAre(HasSubstr("its seed is 2, 1 is asked: started anew")));
  EXPECT_EQ(content_of(file()), content_of(file("undisturbed.iff")));
  // A byte of the header is not worth the panels.
  write(partial, content_of(file()));
  std::string scratched = content_of(partial);
  scratched[70] ^= 1;
  write(partial, scratched);
  EXPECT_EQ(make(file()).report.panels_reused, 4U);
  EXPECT_EQ(content_of(file()), content_of(file("undisturbed.iff")));
}

TEST_F(Iff, APartialFileThatIsSomethingElseIsLeftAlone) {
  (void)make(file("undisturbed.iff"));
  std::string newer = content_of(file("undisturbed.iff"));
  newer[8] = 2;
  for (const std::string& content : {newer, std::string("the only copy of something"), std::string(9000, 'x')}) {
    write(file() + ".partial", content);
    EXPECT_THAT(error_of([&] { (void)make(file()); }), HasSubstr("; remove it, or give another name"));
    EXPECT_EQ(content_of(file() + ".partial"), content);
  }
  write(file() + ".partial", std::string(9000, '\0'));  // the beginning of one that never reached the disk
  (void)make(file());
  EXPECT_EQ(content_of(file()), content_of(file("undisturbed.iff")));
}

TEST_F(Iff, TheBackendsAreNotMixed) {
  IffStore::Options options;
  options.stop = [] { return true; };
  EXPECT_NE(error_of([&] { (void)make(file(), options); }, ErrorKind::interrupted), "");
  const auto with_maker = [&](std::uint32_t maker) {
    iff::Shape other = shape();
    other.key.maker = maker;
    return other;
  };
  EXPECT_THAT(error_of([&] { const IffStore store(file(), with_maker(iff::maker_opencl), {}); }),
              HasSubstr("the CPU path made it (--assembly host); 1 of its 4 panels are finished"));
  for (const char* backend : {"opencl", "vulkan", "cuda"}) {
    const iff::Shape its = with_maker(iff::maker_of(backend));
    for (const auto& other : {shape(), with_maker(its.key.maker % 3 + 1)}) {
      EXPECT_THAT(difference(its, other), HasSubstr(std::string("--assembly device --device ") + backend + ":0"));
    }
    EXPECT_EQ(difference(its, its), "");
  }
  EXPECT_NE(error_of([] { (void)iff::maker_of("openmp"); }, ErrorKind::internal), "");
}

/// A header with this scene's hash and another n must not reach a matrix of the scene's size.
TEST_F(Iff, AHeaderOfAnotherSizeWithThisGeometryIsRefused) {
  (void)make(file("undisturbed.iff"));
  for (const std::uint32_t n : {200U, 256U, 320U}) {
    iff::Shape crafted = shape();
    crafted.n = n;
    const iff::HeaderBytes header = iff::header_of(crafted);
    iff::EntryBytes entry{};
    entry.state = iff::state_finished;
    std::string bytes = content_of(file("undisturbed.iff"));
    bytes.resize(crafted.closing_offset() + 100);
    const auto of = [&](std::uint64_t at, std::uint64_t count) {
      return iff::checksum(std::as_bytes(std::span(bytes.data() + at, count)));
    };
    entry.rows_checksum = of(crafted.panel_offset(0), crafted.panel_bytes(0));
    entry.variance_checksum = of(crafted.variance_offset(0), crafted.variances(0) * sizeof(float));
    entry = iff::sealed(entry, header.checksum);
    std::memcpy(bytes.data(), &header, sizeof header);
    std::memcpy(bytes.data() + iff::Shape::table_offset(), &entry, sizeof entry);
    write(file(), bytes);
    write(file() + ".partial", bytes);
    const std::string says = "its geometry is another: " + std::to_string(n) + " patches, not 240";
    for (const auto mode :
         {IffStore::Mode::make, IffStore::Mode::repair, IffStore::Mode::close, IffStore::Mode::read}) {
      EXPECT_THAT(error_of([&] { (void)make(file(), {mode, {}, {}}); }), HasSubstr(says));
    }
    EXPECT_EQ(content_of(file()), bytes);
    EXPECT_EQ(content_of(file() + ".partial"), bytes);
  }
}

TEST_F(Iff, DamagedPanelsAreComputedAgainAlone) {
  (void)make(file("undisturbed.iff"));
  const std::string whole = content_of(file("undisturbed.iff"));
  const iff::Shape shape = IffFile::open(file("undisturbed.iff")).shape();
  const auto repaired = [&](const std::vector<std::uint64_t>& places) {
    std::string bytes = whole;
    for (const std::uint64_t at : places) bytes.at(at) = static_cast<char>(~bytes[at]);
    write(file(), bytes);
    (void)make(file(), saying(IffStore::Mode::repair));
    EXPECT_EQ(content_of(file()), whole);
    return saved_;
  };
  EXPECT_THAT(repaired({}), IsEmpty());
  EXPECT_THAT(repaired({shape.panel_offset(2) + 4321}), ElementsAre(2));
  EXPECT_THAT(said_.back(), HasSubstr("panel 2 (rows 128 to 191): checksum differs: computed again"));
  EXPECT_THAT(repaired({shape.variance_offset(1)}), ElementsAre(1));
  EXPECT_THAT(repaired({4096 + 3 * 64 + 40, shape.panel_offset(0)}), ElementsAre(0, 3));
  EXPECT_THAT(repaired({shape.closing_offset() + 500}), IsEmpty());
  EXPECT_THAT(repaired({30}), IsEmpty()) << "the header; the entries prove that they belong to it";
  write(file(), whole.substr(0, shape.panel_offset(2) + 77));
  (void)make(file(), saying(IffStore::Mode::repair));
  EXPECT_EQ(content_of(file()), whole);
  EXPECT_THAT(saved_, ElementsAre(2, 3));
}

/// The twin: panels that come out otherwise are not mixed with the others, and the file does not serve afterwards.
TEST_F(Iff, ARepairByOtherArithmeticIsRefused) {
  (void)make(file());
  const std::string whole = content_of(file());
  const iff::Shape shape = this->shape();
  const auto other_arithmetic = [&] {
    IffStore store(file(), shape, {IffStore::Mode::repair, {}, {}});
    AssemblyOptions assembly;
    assembly.panels = &store;
    assembly.seed = 7;  // as another machine's arithmetic would, it gives other values
    (void)assemble(mesh_, assembly);
  };
  const std::uint64_t rows_of_1 = shape.panel_offset(1) + 400, rows_of_2 = shape.panel_offset(2) + 400;
  const std::uint64_t entry_of_1 = iff::Shape::table_offset() + sizeof(iff::EntryBytes) + 24;
  for (const auto& [at, panel] :
       {std::pair(rows_of_1, "panel 1 (rows 64 to 127)"), std::pair(rows_of_2, "panel 2 (rows 128 to 191)"),
        std::pair(entry_of_1, "panel 1 (rows 64 to 127)")}) {
    std::string bytes = whole;
    bytes[at] ^= 1;
    write(file(), bytes);
    for (int again = 0; again < 2; ++again) {  // the first try must not make the file look sound
      EXPECT_THAT(error_of(other_arithmetic), HasSubstr(std::string(panel) + " comes out otherwise")) << at;
      EXPECT_THAT(error_of([&] { (void)read_form_factors(IffFile::open(file())); }),
                  HasSubstr(std::string(panel) + ": checksum differs"));
    }
    (void)make(file(), saying(IffStore::Mode::repair));
    EXPECT_EQ(content_of(file()), whole) << "what made it can still repair it";
  }
  EXPECT_THAT(error_of([&] {
                (void)make(file(), {IffStore::Mode::repair, {}, {}}, 2);
              }),
              HasSubstr("does not fit: its seed is 1, 2 is asked"));
}

TEST_F(Iff, AnInterruptedRepairGoesOn) {
  (void)make(file());
  const std::string whole = content_of(file());
  for (const std::vector<std::uint32_t>& panels : {std::vector<std::uint32_t>{1}, {0, 2}, {2, 3}}) {
    std::string bytes = whole;
    for (const std::uint32_t panel : panels) {  // the entry and the rows
      bytes[iff::Shape::table_offset() + panel * sizeof(iff::EntryBytes) + 24] ^= 1;
      bytes[shape().panel_offset(panel) + 40] ^= 1;
    }
    write(file(), bytes);
    const IffStore::Options stopped{IffStore::Mode::repair, [] { return true; }, {}};
    EXPECT_THAT(error_of([&] { (void)make(file(), stopped); }, ErrorKind::interrupted), HasSubstr("panels are kept"));
    (void)make(file(), saying(IffStore::Mode::repair));
    EXPECT_EQ(content_of(file()), whole);
  }
}

/// Only a file that was made from this scene with these options gets its header back.
TEST_F(Iff, ARepairLeavesWhatIsSomethingElseAsItIs) {
  (void)make(file("undisturbed.iff"));
  (void)make(file("seed2.iff"), {}, 2);
  std::string of_seed_2 = content_of(file("seed2.iff")), newer = of_seed_2;
  of_seed_2[70] ^= 1;
  newer[8] = 2;
  for (const std::string& content :
       {std::string("not form factors"), std::string(100'000, 'x'), std::string(), of_seed_2, newer}) {
    write(file(), content);
    EXPECT_THAT(error_of([&] { (void)make(file(), saying(IffStore::Mode::repair)); }),
                HasSubstr("no panel in it is of this scene with these options"));
    EXPECT_EQ(content_of(file()), content);
  }
  // The twin: with the seed that it was made with.
  write(file(), of_seed_2);
  (void)make(file(), saying(IffStore::Mode::repair), 2);
  EXPECT_EQ(content_of(file()), content_of(file("seed2.iff")));
  EXPECT_THAT(said_, ElementsAre(HasSubstr("header: checksum differs: its header is written again")));
}

/// Whatever a kill, or a full disk, leaves of a closing section that is written anew: the panels serve on.
TEST_F(Iff, ABrokenClosingSectionIsWrittenAnew) {
  (void)make(file("undisturbed.iff"));
  const std::string whole = content_of(file("undisturbed.iff"));
  const std::uint64_t end = shape().closing_offset();
  // The store keeps the panels; the closing section is another one.
  const auto close = [&](Closure closure) {
    IffStore store(file(), shape(), {IffStore::Mode::close, {}, {}});
    AssemblyOptions assembly;
    assembly.panels = &store;
    assembly.closure = closure;
    const FormFactors out = assemble(mesh_, assembly);
    EXPECT_EQ(out.report.panels_reused, 4U);
    store.finish(iff_closing(mesh_, materials_, closure, out.report));
  };
  write(file(), whole);
  close(Closure::off);
  const std::string open_one = content_of(file());
  EXPECT_TRUE(IffFile::open_panels(file()).closed_as(Closure::off));
  ASSERT_NE(open_one, whole);
  for (const std::uint64_t reached : {end, end + 3, end + 16, end + 400, std::uint64_t{whole.size()} - 1}) {
    for (const bool cut : {false, true}) {  // what was there before lies behind, or nothing does
      write(file(), open_one.substr(0, reached) + (cut ? "" : whole.substr(reached)));
      if (content_of(file()) == whole || content_of(file()) == open_one) continue;
      EXPECT_THAT(error_of([&] { (void)IffFile::open(file()); }), HasSubstr("closing section: ")) << reached;
      const IffFile there = IffFile::open_panels(file());
      EXPECT_THAT(there.closing_damage(), HasSubstr("closing section: "));
      EXPECT_FALSE(there.closed_as(Closure::automatic) || there.closed_as(Closure::off));
      EXPECT_THAT(there.damaged(), IsEmpty());
      close(Closure::automatic);
      EXPECT_EQ(content_of(file()), whole) << reached;
    }
  }
  // A damaged panel is not computed behind the user's back.
  std::string damaged = open_one;
  damaged[shape().panel_offset(2)] ^= 1;
  write(file(), damaged);
  EXPECT_THAT(error_of([&] { close(Closure::automatic); }), HasSubstr("panel 2 (rows 128 to 191): checksum differs"));
  EXPECT_EQ(content_of(file()), damaged);
}

TEST_F(Iff, ASecondProcessIsKeptOut) {
  const IffStore first(file(), shape(), {});
  EXPECT_THAT(error_of([&] { const IffStore second(file(), shape(), {}); }),
              HasSubstr("another process is writing it"));
}

/// Files beyond the process's limit, as on a full disk.
TEST_F(Iff, AFullDiskLeavesWhatIsFinished) {
  (void)make(file("undisturbed.iff"));
  const iff::Shape shape = this->shape();
  struct rlimit before {};
  ::getrlimit(RLIMIT_FSIZE, &before);
  struct sigaction ignore {
  }, old{};
  ignore.sa_handler = SIG_IGN;
  ::sigaction(SIGXFSZ, &ignore, &old);
  for (const std::uint64_t room_for : {shape.panel_offset(2) + 4096, shape.closing_offset() + 20}) {
    std::filesystem::remove(file());
    struct rlimit tight = before;
    tight.rlim_cur = room_for;
    ::setrlimit(RLIMIT_FSIZE, &tight);
    const std::string line = error_of([&] { (void)make(file()); }, ErrorKind::limit);
    ::setrlimit(RLIMIT_FSIZE, &before);
    const char* kept = room_for < shape.closing_offset() ? "2 of 4 panels are kept" : "4 of 4 panels are kept";
    EXPECT_THAT(line, HasSubstr("File too large"));
    EXPECT_THAT(line, HasSubstr(kept));
    EXPECT_FALSE(std::filesystem::exists(file()));
    EXPECT_GE(make(file()).report.panels_reused, 2U);
    EXPECT_EQ(content_of(file()), content_of(file("undisturbed.iff")));
  }
  // The closing section anew, of a complete file.
  struct rlimit tight = before;
  tight.rlim_cur = shape.closing_offset() + 20;
  ::setrlimit(RLIMIT_FSIZE, &tight);
  const std::string line = error_of(
      [&] {
        IffStore store(file(), shape, {IffStore::Mode::close, {}, {}});
        AssemblyOptions assembly;
        assembly.panels = &store;
        assembly.closure = Closure::off;
        const FormFactors out = assemble(mesh_, assembly);
        store.finish(iff_closing(mesh_, materials_, assembly.closure, out.report));
      },
      ErrorKind::limit);
  ::setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_THAT(line,
              HasSubstr("File too large; 4 of 4 panels are kept in " + file() + ", and the same command goes on"));
  EXPECT_NE(error_of([&] { (void)IffFile::open(file()); }), "");
  EXPECT_EQ(make(file(), {IffStore::Mode::close, {}, {}}).report.panels_reused, 4U);
  EXPECT_EQ(content_of(file()), content_of(file("undisturbed.iff")));
  ::sigaction(SIGXFSZ, &old, nullptr);
}

TEST_F(Iff, FoldersAndReadOnlyPlacesAreRefused) {
  std::filesystem::create_directory(file("folder.iff"));
  EXPECT_THAT(error_of([&] { (void)make(file("folder.iff")); }), HasSubstr("is a folder"));
  EXPECT_THAT(error_of([&] { (void)make(file("none/room.iff")); }), HasSubstr("No such file"));
}

}  // namespace
}  // namespace interflect
