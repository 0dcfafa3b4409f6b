#include "kept.h"

#include <fmt/format.h>

#include <filesystem>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/formfactor/iff_store.h"

namespace interflect::cli {

bool is_there(const std::string& file) {
  std::error_code missing;
  return !file.empty() && std::filesystem::exists(file, missing);
}

iff::Shape wanted_shape(const MeshedScene& loaded, const SceneOptions& options) {
  const AssemblyOptions assembly = assembly_options(options);
  return iff_shape(loaded.mesh, loaded.divide, options.two_sided, accuracy_asked(options).eps, assembly.seed);
}

namespace {

/// Why the file cannot serve; empty when it can. Only an accuracy and a seed that were asked for count.
std::string misfit(const IffFile& file, const iff::Shape& wanted, bool divide_asked, bool accuracy_asked,
                   bool seed_asked) {
  const iff::Shape& has = file.shape();
  if (has.key.geometry != wanted.key.geometry || has.n != wanted.n) {
    if (has.two_sided != wanted.two_sided) {
      return fmt::format("it was made {} --two-sided", has.two_sided ? "with" : "without");
    }
    if (divide_asked && has.divide != wanted.divide) {
      return fmt::format("it was cut with --divide {:.6g} into {} patches, asked is {:.6g} ({} patches)", has.divide,
                         has.n, wanted.divide, wanted.n);
    }
    return fmt::format("its geometry is another: {} patches, hash {}; the scene has {} patches, hash {}", has.n,
                       iff::hex(has.key.geometry), wanted.n, iff::hex(wanted.key.geometry));
  }
  if (accuracy_asked && has.key.eps > wanted.key.eps) {
    return fmt::format("its --accuracy is {}, asked is {}", text_of({has.key.eps}), text_of({wanted.key.eps}));
  }
  if (seed_asked && has.key.seed != wanted.key.seed) {
    return fmt::format("its --seed is {}, asked is {}", has.key.seed, wanted.key.seed);
  }
  return "";
}

}  // namespace

SceneOptions as_made(const SceneOptions& options, const iff::Shape& shape) {
  SceneOptions out = options;
  out.accuracy = text_of({shape.key.eps});
  out.seed = shape.key.seed;
  return out;
}

std::string closure_anew(const IffFile& there, std::string_view what) {
  const std::string& damage = there.closing_damage();
  return fmt::format("{}: {} are used, the closure is found anew", damage.empty() ? there.name() : damage, what);
}

namespace {

/// Puts the panels in the place of the matrix.
void leave_in_file(KeptFormFactors& out, const std::string& file, std::uint64_t memory, ProgressSink& progress) {
  out.panels = std::make_shared<IffPanels>(IffFile::open_panels(file));
  out.memory = memory;
  constexpr double mebibyte = 1 << 20;
  progress.message(
      fmt::format("{}: {:.0f} MiB of form factors, {:.0f} MiB may be in memory: the rest is read from the "
                  "file for every product",
                  file, static_cast<double>(FormFactorMatrix::predicted_bytes(out.panels->size())) / mebibyte,
                  static_cast<double>(memory) / mebibyte));
}

/// `shape` says what the file must be, but in the modes make and repair for who makes the panels: whoever does it in
/// the end, for those of Embree and of the backends' kernels are not mixed.
KeptFormFactors work_on(const std::string& file, const MeshedScene& loaded, const SceneOptions& options,
                        iff::Shape shape, IffStore::Mode mode, Assembler& assembler, ProgressSink& progress) {
  const bool computes = mode == IffStore::Mode::make || mode == IffStore::Mode::repair;
  const PatientInterrupt patient;
  std::optional<IffStore> store;
  const AssemblyOptions assembly = assembly_options(options);
  const std::optional<std::uint64_t> memory = memory_for_streaming(options, loaded.mesh.size());
  KeptFormFactors out;
  AssemblyReport& report = out.factors.report;
  const auto act = [&](AssemblyOptions with_maker) -> AssemblyReport& {
    if (computes) shape.key.maker = assembler.maker();
    store.reset();  // lets go of the lock
    store.emplace(file, shape, IffStore::Options{mode, PatientInterrupt::asked, [&](const std::string& line) {
                                                   progress.message(line);
                                                 }});
    with_maker.panels = &*store;
    if (memory) {
      report = assemble_into(*store, loaded.mesh, with_maker, *memory, &progress);
    } else {
      out.factors = assemble(loaded.mesh, with_maker, &progress);
    }
    return report;
  };
  const auto bound = [&] {
    if (!store || !store->bound_to_maker()) return std::string();
    return fmt::format("{} once the device works; without it, remove the file", store->how_to_go_on());
  };
  assembler.run(assembly, act, bound);
  report_warnings(report, loaded.scene.file, progress);
  const char* done = report.panels_reused == 0 ? "computed" : "continued";
  if (mode == IffStore::Mode::repair) done = store->saved().empty() ? "nothing was damaged" : "repaired";
  if (!computes) done = "closure found anew";
  if (mode != IffStore::Mode::read) {
    store->finish(iff_closing(loaded.mesh, loaded.scene.materials, assembly.closure, report));
  }
  if (PatientInterrupt::asked()) {
    throw Error(ErrorKind::interrupted, fmt::format("{} is complete, and serves the same command", file));
  }
  out.kept = kept_of(file, store->shape(), report.panels_reused, done);
  if (memory) leave_in_file(out, file, *memory, progress);
  return out;
}

}  // namespace

FormFactors assemble_in_memory(const MeshedScene& loaded, const SceneOptions& options, const std::string& how_to_keep,
                               Assembler& assembler, ProgressSink& progress) {
  const std::string hint =
      fmt::format("; or keep them in a file, from where they are read for every product: {}", how_to_keep);
  if (options.memory && memory_for_streaming(options, loaded.mesh.size())) {
    constexpr double mebibyte = 1 << 20;
    throw Error(
        ErrorKind::limit,
        fmt::format("the form factors of {} patches need {:.1f} MiB, and --memory allows {}{}", loaded.mesh.size(),
                    static_cast<double>(FormFactorMatrix::predicted_bytes(loaded.mesh.size())) / mebibyte,
                    *options.memory, hint));
  }
  try {
    FormFactors factors = assembler.assemble(loaded.mesh, assembly_options(options), progress);
    report_warnings(factors.report, loaded.scene.file, progress);
    return factors;
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::limit) throw;
    throw Error(ErrorKind::limit, error.what() + hint);
  }
}

Kept kept_of(const std::string& file, const iff::Shape& shape, std::uint32_t reused, std::string done) {
  return {file, std::move(done), shape.panels(), reused, shape.key.eps, shape.key.seed, iff::hex(shape.key.geometry)};
}

SceneOptions with_the_files_divide(const SceneOptions& options, const std::string& file) {
  SceneOptions out = options;
  if (!options.divide && !options.patches && is_there(file)) out.divide = IffFile::open_panels(file).divide();
  return out;
}

bool fits(const std::string& file, const MeshedScene& loaded, const SceneOptions& options, ProgressSink& progress) {
  if (!is_there(file)) return false;
  const std::string why =
      misfit(IffFile::open_panels(file), wanted_shape(loaded, options), true, true, options.seed.has_value());
  if (!why.empty()) progress.message(fmt::format("{}: does not fit and will be replaced: {}", file, why));
  return why.empty();
}

bool is_closed(const std::string& file, const SceneOptions& options) {
  return IffFile::open_panels(file).closed_as(assembly_options(options).closure);
}

KeptFormFactors keep(const std::string& file, const MeshedScene& loaded, const SceneOptions& options,
                     Assembler& assembler, ProgressSink& progress) {
  return work_on(file, loaded, options, wanted_shape(loaded, options), IffStore::Mode::make, assembler, progress);
}

KeptFormFactors repair(const std::string& file, const MeshedScene& loaded, const SceneOptions& options,
                       Assembler& assembler, ProgressSink& progress) {
  return work_on(file, loaded, options, wanted_shape(loaded, options), IffStore::Mode::repair, assembler, progress);
}

KeptFormFactors close_again(const std::string& file, const MeshedScene& loaded, const SceneOptions& options,
                            Assembler& assembler, ProgressSink& progress) {
  const IffFile there = IffFile::open_panels(file);
  progress.message(closure_anew(there, "its panels"));
  const iff::Shape& shape = there.shape();
  return work_on(file, loaded, as_made(options, shape), shape, IffStore::Mode::close, assembler, progress);
}

IffFile open_fitting(const std::string& file, const MeshedScene& loaded, const SceneOptions& options) {
  IffFile there = IffFile::open_panels(file);
  // A divide that came from the file is not one that was asked for.
  const bool divide_asked = options.patches || (options.divide && *options.divide != there.shape().divide);
  const std::string why = misfit(there, wanted_shape(loaded, options), divide_asked, options.accuracy.has_value(),
                                 options.seed.has_value());
  if (!why.empty()) throw input_error(file, 0, fmt::format("does not fit {}: {}", loaded.scene.file, why));
  return there;
}

KeptFormFactors form_factors_for_solve(const std::string& file, const MeshedScene& loaded, const SceneOptions& options,
                                       Assembler& assembler, ProgressSink& progress) {
  if (file.empty()) return {assemble_in_memory(loaded, options, "--form-factors FILE.iff", assembler, progress), {}};
  if (!is_there(file)) return keep(file, loaded, options, assembler, progress);
  const IffFile there = open_fitting(file, loaded, options);
  const iff::Shape& shape = there.shape();
  if (!there.closed_as(assembly_options(options).closure)) {
    progress.message(closure_anew(there, "its form factors"));
    return work_on(file, loaded, as_made(options, shape), shape, IffStore::Mode::read, assembler, progress);
  }
  progress.message(fmt::format("{}: its form factors are used (accuracy {}, seed {})", file,
                               text_of({there.accuracy()}), there.seed()));
  KeptFormFactors out;
  out.kept = kept_of(file, shape, there.panels(), "reused");
  if (const std::optional<std::uint64_t> memory = memory_for_streaming(options, loaded.mesh.size())) {
    out.factors.report = there.report();
    leave_in_file(out, file, *memory, progress);
  } else {
    out.factors = read_form_factors(there);
  }
  report_warnings(out.factors.report, file, progress);
  return out;
}

}  // namespace interflect::cli
