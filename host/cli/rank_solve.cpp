#include "rank_solve.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <span>
#include <sstream>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/base/timer.h"
#include "interflect/device/registry.h"
#include "interflect/formfactor/iff_format.h"
#include "interflect/formfactor/rank_assembly.h"
#include "interflect/schedule/rank_product.h"
#include "interflect/schedule/storage_choice.h"
#include "interflect/solver/rounding.h"

namespace interflect::cli {

namespace {

/// A sink whose decisions are rank 0's on every rank.
class RankProgress final : public ProgressSink {
 public:
  explicit RankProgress(ProgressSink& own) : own_(own) {}
  void begin(std::string_view stage, std::uint64_t total) override { own_.begin(stage, total); }
  void advance(std::uint64_t steps) override { own_.advance(steps); }
  void end() override { own_.end(); }
  void message(std::string_view line) override { own_.message(line); }
  void iteration(std::uint32_t number, double residual) override { own_.iteration(number, residual); }
  [[nodiscard]] bool interrupted() override { return ranks().rank_zeros(own_.interrupted()); }
  [[nodiscard]] bool decide(bool mine) override { return ranks().rank_zeros(mine); }

 private:
  ProgressSink& own_;
};

/// Where all ranks begin: at what rank 0's keeper has found. It alone keeps more.
class RankKeeper final : public IterateKeeper {
 public:
  explicit RankKeeper(IterateKeeper* own) : own_(own) {
    interval_ = own != nullptr ? own->interval() : 0;
    ranks().broadcast_values(std::span<double>(&interval_, 1));
    const Iterate* there = own != nullptr ? own->found() : nullptr;
    if (!ranks().rank_zeros(there != nullptr)) return;
    if (there != nullptr) found_ = *there;
    std::array<std::uint64_t, 5> sizes{};
    if (there != nullptr) {
      sizes = {found_->b.size(), found_->b.front().size(), found_->products, found_->passes, found_->restarts};
    }
    ranks().broadcast_values(std::span<std::uint64_t>(sizes));
    if (there == nullptr) {
      found_.emplace();
      found_->b.assign(sizes[0], std::vector<float>(sizes[1]));
      found_->made.resize(sizes[0]);
      found_->products = static_cast<std::uint32_t>(sizes[2]);
      found_->passes = static_cast<std::uint32_t>(sizes[3]);
      found_->restarts = static_cast<std::uint32_t>(sizes[4]);
    }
    ranks().broadcast_values(std::span(found_->made));
    for (std::vector<float>& column : found_->b) ranks().broadcast_values(std::span(column));
  }
  [[nodiscard]] const Iterate* found() const override { return found_ ? &*found_ : nullptr; }
  [[nodiscard]] double interval() const override { return interval_; }
  [[nodiscard]] bool due() override { return own_ != nullptr && own_->due(); }
  void keep(const Iterate& iterate) noexcept override {
    if (own_ != nullptr) own_->keep(iterate);
  }

 private:
  IterateKeeper* own_;
  double interval_ = 0;
  std::optional<Iterate> found_;
};

/// What fails on all ranks together stays an AgreedError, whoever passes it on as an Error.
class Keeping {
 public:
  template <class Work>
  auto within(const Work& work) {
    try {
      return work();
    } catch (const AgreedError& error) {
      error_.emplace(error);
      throw;
    }
  }
  template <class Work>
  auto around(const Work& work) {
    try {
      return work();
    } catch (const Error&) {
      if (error_) throw AgreedError(*error_);
      throw;
    }
  }

 private:
  std::optional<AgreedError> error_;
};

[[noreturn]] void refuse(const std::string& what) {
  throw AgreedError(ErrorKind::usage, fmt::format("{}: not on several ranks yet: start it without mpirun", what));
}

void check(const SceneOptions& scene, const SolvingOptions& options) {
  const auto storage = storage_of(options.storage);
  if (storage == Storage::sym16) refuse("--storage " + options.storage);
  if (scene.memory) refuse("--memory");
}

/// Makes F's rows on the host, by tiles of the device where that assembles.
RankFormFactors assemble(const MeshedScene& loaded, const AssemblyOptions& options, Assembler& assembler,
                         RankStore* store, ProgressSink& progress) {
  RankFormFactors out;
  Keeping keeping;
  keeping.around([&] {
    assembler.run(options, [&](const AssemblyOptions& with_maker) -> AssemblyReport& {
      try {
        keeping.within([&] { out = assemble_rows(ranks(), loaded.mesh, with_maker, store, &progress); });
      } catch (const AgreedError& error) {
        throw Error(ErrorKind::internal, error.what());  // or the ranks would go on with what each has left
      }
      return out.own.report;
    });
  });
  report_warnings(out.own.report, loaded.scene.file, progress);
  return out;
}

struct KeptRows {
  RankFormFactors rows;
  Kept kept;
};

KeptRows keep_rows(const std::string& file, const MeshedScene& loaded, const SceneOptions& options,
                   Assembler& assembler, ProgressSink& progress) {
  iff::Shape shape = wanted_shape(loaded, options);
  shape.key.maker = assembler.maker();
  const auto makers = ranks().all_values(static_cast<double>(shape.key.maker));
  if (std::adjacent_find(makers.begin(), makers.end(), std::not_equal_to<>()) != makers.end()) {
    throw AgreedError(ErrorKind::usage, fmt::format("{}: the ranks' devices are of several kinds, whose form factors "
                                                    "are not mixed in a file: use --assembly host",
                                                    file));
  }
  const PatientInterrupt patient(speaks() ? PatientInterrupt::panel_in_hand : std::string_view());
  RankStore store(ranks(), file, shape, {IffStore::Mode::make, PatientInterrupt::asked, [&](const std::string& line) {
                                           progress.message(line);
                                         }});
  const AssemblyOptions assembly = assembly_options(options);
  KeptRows out{assemble(loaded, assembly, assembler, &store, progress), {}};
  const AssemblyReport& report = out.rows.own.report;
  const IffClosing closing =
      speaks() ? iff_closing(loaded.mesh, loaded.scene.materials, assembly.closure, report) : IffClosing{};
  store.finish(closing);
  if (ranks().rank_zeros(PatientInterrupt::asked())) {
    throw AgreedError(ErrorKind::interrupted, fmt::format("{} is complete, and serves the same command", file));
  }
  out.kept = kept_of(file, store.shape(), report.panels_reused, report.panels_reused == 0 ? "computed" : "continued");
  return out;
}

/// F's rows: from the file, computed and kept in it, or computed.
KeptRows rows_for_solve(const std::string& file, const MeshedScene& loaded, const SceneOptions& options,
                        Assembler& assembler, ProgressSink& progress) {
  const AssemblyOptions assembly = assembly_options(options);
  if (file.empty()) return {assemble(loaded, assembly, assembler, nullptr, progress), {}};
  if (!ranks().rank_zeros(is_there(file))) return keep_rows(file, loaded, options, assembler, progress);
  const IffFile there = together([&] { return open_fitting(file, loaded, options); });
  KeptRows out;
  if (there.closed_as(assembly.closure)) {
    progress.message(fmt::format("{}: its form factors are used (accuracy {}, seed {})", file,
                                 text_of({there.accuracy()}), there.seed()));
    out.rows = read_rows(ranks(), there);
    out.kept = kept_of(file, there.shape(), there.panels(), "reused");
  } else {
    progress.message(closure_anew(there, "its form factors"));
    out.rows = close_rows(ranks(), loaded.mesh, assembly_options(as_made(options, there.shape())), there, &progress);
    out.kept = kept_of(file, there.shape(), there.panels(), "closure found anew");
  }
  report_warnings(out.rows.own.report, file, progress);
  return out;
}

RanksReport report_of(const RankFormFactors& rows, const std::vector<std::string>& devices, const RanksUse& assembly,
                      const RanksUse& solve) {
  RanksReport out{
      ranks().transport(), ranks().all_texts(fmt::format("{}", fmt::join(devices, ","))), {}, assembly, solve};
  const FormFactorMatrix& own = rows.own.matrix;
  for (const double count : ranks().all_values(static_cast<double>(own.end_row() - own.first_row()))) {
    out.rows.push_back(static_cast<std::uint32_t>(count));
  }
  return out;
}

/// Collective: throws where not all ranks have read the same scene.
void check_same(const PatchMesh& mesh) {
  std::uint64_t hash = 1;
  for (const std::vector<Rgb>* values : {&mesh.reflectance, &mesh.emittance}) {
    hash = iff::checksum(std::as_bytes(std::span(*values)), hash);
  }
  const auto all = ranks().all_texts(fmt::format("{} {}", iff::hex(iff::geometry_hash(mesh)), hash));
  if (std::adjacent_find(all.begin(), all.end(), std::not_equal_to<>()) == all.end()) return;
  throw AgreedError(ErrorKind::input, "the ranks have read different scenes: the file is not the same on all machines");
}

/// Those of all ranks, by rank.
std::vector<DeviceFailure> failures_of_all(const std::vector<DeviceFailure>& own) {
  std::string text;
  for (const DeviceFailure& failure : own) text += fmt::format("{}\x1f{}\x1e", failure.device, failure.reason);
  std::vector<DeviceFailure> all;
  const std::vector<std::string> texts = ranks().all_texts(text);
  for (std::size_t rank = 0; rank < texts.size(); ++rank) {
    std::istringstream list(texts[rank]);
    for (std::string one; std::getline(list, one, '\x1e');) {
      const std::size_t cut = one.find('\x1f');
      all.push_back({one.substr(0, cut), fmt::format("{} (rank {})", one.substr(cut + 1), rank)});
    }
  }
  return all;
}

/// One solve with F's rows in one format.
class RowsSolve {
 public:
  RowsSolve(const FormFactorMatrix& rows, const MeshedScene& loaded, const SolvingOptions& options, const Lamps& lamps,
            ProgressSink& progress)
      : rows_(rows),
        mesh_(loaded.mesh),
        options_(options),
        lamps_(lamps),
        progress_(progress),
        light_(light_of(loaded.mesh, lamps.groups)) {}

  /// `use` is of what all ranks have together.
  Solved run(Candidates& candidates, const PackedMatrix* packed, StorageUse use) {
    const RanksUse before = ranks().use();
    const std::uint32_t columns = columns_at_once(light_.emittance.size());
    bool placed = false;
    const Place place = [&](std::vector<std::unique_ptr<Device>> devices) {
      // The other ranks are in the middle of the solve: this one cannot begin again alone.
      if (std::exchange(placed, true)) throw Error(ErrorKind::device, candidates.failures().back().reason);
      const SplitOptions split = candidates.split();
      return keeping_.within([&] {
        return packed != nullptr
                   ? std::make_unique<Scheduler>(*packed, rows_, ranks(), std::move(devices), columns, split)
                   : std::make_unique<Scheduler>(rows_, ranks(), std::move(devices), columns, split);
      });
    };
    Columns radiosity;
    std::vector<std::vector<std::vector<Rgb>>> bounces;
    const auto after = [&](Scheduler& scheduler) {
      communication = ranks().use() - before;
      if (progress_.interrupted()) return;
      if (lamps_.bounces) bounces = bounces_of(scheduler, light_, *lamps_.bounces, &progress_);
      // A fixed number of iterations asks for that many bounces, not for a solution that could be judged.
      if (packed == nullptr || options_.stop.iterations) return;
      const auto exact = [&](const Columns& x, auto& y) { exact_product(rows_, ranks(), x, y); };
      use.rounding_error = rounding_error(scheduler, options_.chosen_method(), exact, mesh_.area, light_.reflectance,
                                          light_.emittance, radiosity);
    };
    std::optional<RankKeeper> keeper;
    IterateKeeper* const own = candidates.keeper();
    if (ranks().rank_zeros(own != nullptr)) candidates.keep_in(&keeper.emplace(own));
    // No checkpoints for another device: one that fails ends the job.
    constexpr double never = std::numeric_limits<double>::infinity();
    FallbackReport done = keeping_.around([&] {
      return solve_on(candidates, place, options_.chosen_method(), options_.stop, mesh_.area, light_.reflectance,
                      light_.emittance, radiosity, &progress_, never, after);
    });
    candidates.keep_in(own);
    Solved solved = solved_of(std::move(done), mesh_, lamps_, radiosity, use);
    solved.bounces = std::move(bounces);
    return solved;
  }

  RanksUse communication;  ///< of the solve itself

 private:
  const FormFactorMatrix& rows_;
  const PatchMesh& mesh_;
  const SolvingOptions& options_;
  const Lamps& lamps_;
  ProgressSink& progress_;
  Light light_;
  Keeping keeping_;
};

/// Why a 16-bit format's solution is not taken; empty: it is.
std::string refusal(const Solved& solved, const StopTest& stop) {
  if (solved.report.interrupted) return "";
  if (!solved.report.converged && !stop.iterations && solved.report.iterations < stop.max_iterations) {
    return "the rounded form factors have no solution within the tolerance";
  }
  const std::optional<double>& error = solved.storage.rounding_error;
  if (!error || !solved.report.converged || *error <= largest_rounding_error) return "";
  return fmt::format("its rounding moves a radiosity by {:.2e} of the largest, {:.0e} is allowed", *error,
                     largest_rounding_error);
}

/// In the format that is asked for; in dense32 where that is refused.
Solved solve_rows(RowsSolve& solve, const RankFormFactors& factors, const PatchMesh& mesh, Storage format,
                  Candidates& candidates, const StopTest& stop, ProgressSink& progress) {
  const StorageUse dense_use{Storage::dense32, factors.bytes, factors.nonzero_fraction};
  if (format == Storage::dense32) return solve.run(candidates, nullptr, dense_use);
  const Timer packing;
  std::optional<PackedMatrix> packed;
  agreed(ranks(), [&] { packed.emplace(factors.own.matrix, mesh.area, format); });
  const auto bytes = static_cast<std::uint64_t>(ranks().sum(static_cast<double>(packed->bytes())));
  const double nonzero = ranks().sum(packed->nonzero_fraction());
  Solved solved = solve.run(candidates, &*packed, {format, bytes, nonzero, {}, packing.seconds()});
  const std::string why = refusal(solved, stop);
  if (why.empty()) return solved;
  progress.message(fmt::format("warning: {} is refused: {}; solving with dense32", name(format), why));
  packed.reset();
  Solved dense = solve.run(candidates, nullptr, dense_use);
  dense.storage.refused = fmt::format("{}: {}", name(format), why);
  dense.storage.pack_seconds = solved.storage.pack_seconds;
  return dense;
}

}  // namespace

std::vector<std::string> devices_of_rank(const std::string& text) {
  if (ranks().size() == 1) return choose_devices(text);
  std::vector<std::string> ids;
  if (text == "auto") {
    const std::vector<DeviceEntry> entries = list_devices();
    std::vector<std::string> pieces;  // the hardware of those taken
    for (const std::string& id : rank_devices(entries, [](const DeviceEntry&) { return 1.0; })) {
      const auto entry = std::find_if(entries.begin(), entries.end(), [&](const auto& e) { return e.info.id == id; });
      const std::string& hardware = entry->info.hardware;
      if (!hardware.empty() && std::find(pieces.begin(), pieces.end(), hardware) != pieces.end()) continue;
      pieces.push_back(hardware);
      ids.push_back(id);
    }
    if (ids.size() > 1) std::erase(ids, "openmp");
    return {ids[ranks().local_rank() % ids.size()]};
  }
  ids = choose_devices(text);
  std::vector<std::string> own;
  for (std::size_t k = ranks().local_rank() % ids.size(); k < ids.size(); k += ranks().local_size()) {
    own.push_back(ids[k]);
  }
  return own;
}

PlacedSolve solve_on_ranks(const MeshedScene& loaded, const SceneOptions& scene, const SolvingOptions& options,
                           Candidates& candidates, ProgressSink& progress, const Lamps& lamps) {
  check(scene, options);
  const PatchMesh& mesh = loaded.mesh;
  check_same(mesh);
  Assembler assembler(candidates, assembly_place(options.assembly));
  const RanksUse at_first = ranks().use();
  KeptRows kept = rows_for_solve(options.form_factors, loaded, scene, assembler, progress);
  const RanksUse assembled = ranks().use();

  PlacedSolve out;
  out.kept = std::move(kept.kept);
  out.assembly = assembler.use();
  const FormFactorMatrix& rows = kept.rows.own.matrix;
  RankProgress rank_progress(progress);
  RowsSolve solve(rows, loaded, options, lamps, rank_progress);
  const Storage format = storage_of(options.storage).value_or(Storage::dense32);
  out.solved = solve_rows(solve, kept.rows, mesh, format, candidates, options.stop, progress);
  out.assembly.bytes_over_bus += out.solved.uploaded_bytes;
  const auto exact = [&](const Columns& x, auto& y) { exact_product(rows, ranks(), x, y); };
  out.energy = energy_balance(exact, mesh, out.solved.radiosity, kept.rows.own.report.row_sum);
  out.solved.failures = failures_of_all(out.solved.failures);
  out.ranks = report_of(kept.rows, out.solved.devices, assembled - at_first, solve.communication);
  out.factors = std::move(kept.rows.own);
  return out;
}

KeptFormFactors keep_on_ranks(const std::string& file, const MeshedScene& loaded, const SceneOptions& options,
                              Assembler& assembler, ProgressSink& progress) {
  if (options.memory) refuse("--memory");
  check_same(loaded.mesh);
  KeptRows kept = keep_rows(file, loaded, options, assembler, progress);
  KeptFormFactors out;
  out.factors.report = std::move(kept.rows.own.report);
  out.kept = std::move(kept.kept);
  return out;
}

}  // namespace interflect::cli
