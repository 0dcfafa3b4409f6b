#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "interflect/base/progress.h"
#include "interflect/base/timer.h"
#include "interflect/solver/iterate_file.h"
#include "pipeline.h"
#include "solving_options.h"

namespace interflect::cli {

/// --checkpoint and --every, as given.
struct CheckpointOptions {
  std::string file;  ///< empty: none is kept
  std::string every = "30s";
};
void add_checkpoint_options(CLI::App& command, CheckpointOptions& options);
/// "30s", "2min", "1h", "0.5": seconds where no unit is given. Throws a usage Error.
[[nodiscard]] double parse_duration(const std::string& text, const std::string& option);

/// What a report says of a checkpoint.
struct CheckpointUse {
  std::string file;
  std::uint32_t iterations = 0, products = 0;  ///< that were in it when this run began
  bool removed = false;                        ///< the solve is done; else it is there for the next run
};

/// The problem of a solve, as a checkpoint knows it: nothing of devices, storage or ranks.
[[nodiscard]] IterateKey key_of(const MeshedScene& loaded, const Lamps& lamps, const SceneOptions& scene,
                                const SolvingOptions& solving);

/// The iterate of a solve in a file, for the same command to go on from.
class CheckpointFile final : public IterateKeeper {
 public:
  /// Reads the file where it is there, and says that the solve goes on from it. Throws what read_iterate() throws, and
  /// an input Error for one that has more iterations than --iterations asks for.
  CheckpointFile(const CheckpointOptions& options, const IterateKey& key, const StopTest& stop, ProgressSink& progress);

  [[nodiscard]] const Iterate* found() const override { return found_ ? &*found_ : nullptr; }
  [[nodiscard]] double interval() const override { return every_; }
  [[nodiscard]] bool due() override { return since_.seconds() >= every_; }
  /// Writes the file. Where that fails (a full disk), says so once; the one from before stays.
  void keep(const Iterate& iterate) noexcept override;
  /// The solve is done, and what was asked for is written: removes the file.
  void remove();
  [[nodiscard]] const CheckpointUse& use() const { return use_; }

 private:
  IterateKey key_;
  double every_;
  ProgressSink& progress_;
  std::optional<Iterate> found_;
  CheckpointUse use_;
  Timer since_;
  bool told_ = false;  ///< that it cannot be written
};

/// The report's "checkpoint", null without one; and its line in the summary, or nothing.
[[nodiscard]] nlohmann::ordered_json checkpoint_json(const std::optional<CheckpointUse>& use);
[[nodiscard]] std::string checkpoint_text(const std::optional<CheckpointUse>& use);

}  // namespace interflect::cli
