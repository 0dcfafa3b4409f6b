#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "assembler.h"
#include "interflect/formfactor/assembly.h"
#include "interflect/formfactor/iff_file.h"
#include "interflect/formfactor/iff_panels.h"
#include "pipeline.h"

namespace interflect::cli {

/// The file of form factors that a command used.
struct Kept {
  std::string file;  ///< empty: none
  std::string done;  ///< "reused", "computed", "continued", "repaired", "closure anew"
  std::uint32_t panels = 0, reused = 0;
  double eps = 0;
  std::uint64_t seed = 0;
  std::string geometry;  ///< 32 hexadecimal digits
};
[[nodiscard]] Kept kept_of(const std::string& file, const iff::Shape& shape, std::uint32_t reused, std::string done);

struct KeptFormFactors {
  FormFactors factors;  ///< no matrix where the panels stay in the file
  Kept kept;
  std::shared_ptr<const IffPanels> panels = {};  ///< of the file, when F exceeds the memory
  std::uint64_t memory = 0;                      ///< bytes that they may take then
};

[[nodiscard]] bool is_there(const std::string& file);
/// What a file for the scene and the options would be, but for who makes its panels.
[[nodiscard]] iff::Shape wanted_shape(const MeshedScene& loaded, const SceneOptions& options);
/// FILE, which is there, if it fits the scene and what is asked of accuracy and seed. Throws an input Error else.
[[nodiscard]] IffFile open_fitting(const std::string& file, const MeshedScene& loaded, const SceneOptions& options);
/// The options as the file was made, so that its panels can be computed again or continued.
[[nodiscard]] SceneOptions as_made(const SceneOptions& options, const iff::Shape& shape);
/// A line that says why the closure is found anew.
[[nodiscard]] std::string closure_anew(const IffFile& there, std::string_view what);

/// `solve --form-factors FILE` without --divide and --patches takes the file's, where it is there.
[[nodiscard]] SceneOptions with_the_files_divide(const SceneOptions& options, const std::string& file);

/// Without a file. A limit Error also says how to keep them in one.
[[nodiscard]] FormFactors assemble_in_memory(const MeshedScene& loaded, const SceneOptions& options,
                                             const std::string& how_to_keep, Assembler& assembler,
                                             ProgressSink& progress);

/// `solve --form-factors FILE`: from the file where it is there, else computed and kept in it; without a name,
/// computed. Throws an input Error that says what differs when the file does not fit the scene and the options: another
/// geometry, a coarser accuracy than the one given, another seed than the one given.
[[nodiscard]] KeptFormFactors form_factors_for_solve(const std::string& file, const MeshedScene& loaded,
                                                     const SceneOptions& options, Assembler& assembler,
                                                     ProgressSink& progress);

/// `formfactors SCENE -o FILE`: whether FILE is there and fits; says what does not.
[[nodiscard]] bool fits(const std::string& file, const MeshedScene& loaded, const SceneOptions& options,
                        ProgressSink& progress);
/// Computes the form factors and keeps them in FILE, going on from what FILE.partial has. While it works the first
/// Ctrl-C ends it after the panel in hand, as an interrupted Error.
[[nodiscard]] KeptFormFactors keep(const std::string& file, const MeshedScene& loaded, const SceneOptions& options,
                                   Assembler& assembler, ProgressSink& progress);
/// `formfactors SCENE -o FILE --repair`: computes again what is damaged in FILE.
[[nodiscard]] KeptFormFactors repair(const std::string& file, const MeshedScene& loaded, const SceneOptions& options,
                                     Assembler& assembler, ProgressSink& progress);
/// Whether FILE, which fits, ends with the closure that is asked for.
[[nodiscard]] bool is_closed(const std::string& file, const SceneOptions& options);
/// FILE, which fits, with another closure or a damaged end, as a kill leaves it that interrupts this: its panels are
/// used and its end is written again.
[[nodiscard]] KeptFormFactors close_again(const std::string& file, const MeshedScene& loaded,
                                          const SceneOptions& options, Assembler& assembler, ProgressSink& progress);

}  // namespace interflect::cli
