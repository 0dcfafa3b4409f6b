#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/ranks.h"

// One process or several: how the program was started.

namespace interflect::cli {

/// The ranks of this job: what launch() has joined, else this process alone.
[[nodiscard]] Ranks& ranks();
/// Whether this process speaks for the job: rank 0. Before launch() by mpirun's environment.
[[nodiscard]] bool speaks();

/// agreed() for work that gives a value: what one rank cannot do ends all ranks in order, and is said once.
template <class Work>
auto together(const Work& work) {
  std::optional<decltype(work())> out;
  agreed(ranks(), [&] { out.emplace(work()); });
  return std::move(*out);
}

/// Joins the job for as long as it lives.
class Launch {
 public:
  /// Where mpirun's environment (Open MPI's, PMI's or PMIx's) says that there are several ranks: opens the MPI module.
  /// Throws a usage Error where there is none, and for a command that runs on one process only.
  explicit Launch(std::string_view command);
  Launch(const Launch&) = delete;
  Launch& operator=(const Launch&) = delete;
  ~Launch();
};

/// Says what ended the program, once for the whole job, and gives its exit status. What every rank has met alike
/// (AgreedError) is said by rank 0, and all leave in order; else this rank says it, unless another one does so within a
/// moment, and ends all of them.
[[nodiscard]] int fail_job(ErrorKind kind, std::string_view message, bool is_agreed);

/// "built in (FILE)" or "not built in": for `devices`.
[[nodiscard]] std::string mpi_state();

}  // namespace interflect::cli
