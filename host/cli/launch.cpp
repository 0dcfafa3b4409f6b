#include "launch.h"

#include <dlfcn.h>
#include <fmt/format.h>
#include <omp.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <thread>
#include <vector>

#include "console.h"

namespace interflect::cli {

namespace {

OneRank alone;
std::unique_ptr<Ranks> joined;

/// A number of mpirun's environment; `otherwise` where it is not set.
int number_of(const std::vector<const char*>& names, int otherwise) {
  for (const char* name : names) {
    const char* text = std::getenv(name);
    if (text != nullptr && *text != '\0') return std::atoi(text);
  }
  return otherwise;
}

/// How many mpirun has started; 0: it has not started us; -1: a launcher that does not say how many.
int ranks_started() {
  const int size = number_of({"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS"}, 0);
  return size != 0 ? size : std::getenv("PMIX_RANK") != nullptr ? -1 : 0;
}

int rank_started() {
  return number_of({"OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK"}, 0);
}

/// Where the module lies: beside the program, in the library folder of a build or an installation, or where
/// INTERFLECT_MPI_MODULE says. Empty: nowhere.
std::filesystem::path module_file() {
  if (const char* given = std::getenv("INTERFLECT_MPI_MODULE")) return given;
  std::error_code missing;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", missing).parent_path();
  for (const char* folder : {".", "../lib", "../" INTERFLECT_LIBDIR}) {
    const std::filesystem::path file = program / folder / "interflect_mpi.so";
    if (std::filesystem::exists(file, missing)) return file.lexically_normal();
  }
  return {};
}

using Version = const char* (*)();
using Join = Ranks* (*)();

/// The module's function that joins the job. Throws a usage Error that says what is missing.
Join open_module(const std::filesystem::path& file) {
  if (file.empty()) throw Error(ErrorKind::usage, "it has no MPI module (build it with -DINTERFLECT_MPI=ON)");
  void* const module = ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);  // stays open to the end
  if (module == nullptr) throw Error(ErrorKind::usage, fmt::format("its MPI module cannot be opened: {}", ::dlerror()));
  const auto version = reinterpret_cast<Version>(::dlsym(module, "interflect_mpi_version"));
  const auto join = reinterpret_cast<Join>(::dlsym(module, "interflect_mpi_join"));
  if (version == nullptr || join == nullptr || std::string_view(version()) != INTERFLECT_VERSION) {
    throw Error(ErrorKind::usage, fmt::format("{} is of another version", file.string()));
  }
  return join;
}

/// Ranks of one machine that are bound to no processors of their own (mpirun --bind-to none, or to a whole socket) do
/// not each start a thread for every one.
void share_processors(const Ranks& here) {
  if (std::getenv("OMP_NUM_THREADS") != nullptr) return;
  const long there = ::sysconf(_SC_NPROCESSORS_ONLN);
  const int share = std::max(1, static_cast<int>(there) / static_cast<int>(here.local_size()));
  omp_set_num_threads(std::min(omp_get_max_threads(), share));
}

}  // namespace

Ranks& ranks() {
  return joined ? *joined : alone;
}

bool speaks() {
  return joined && joined->size() > 1 ? joined->rank() == 0 : rank_started() == 0;
}

Launch::Launch(std::string_view command) {
  const int started = ranks_started();
  if (started == 0) return;
  Join join = nullptr;
  try {
    join = open_module(module_file());
  } catch (const Error& error) {
    if (started == 1) return;  // a job of one rank needs no other
    throw Error(error.kind(),
                fmt::format("mpirun has started this program as {} ranks, and {}: start it without mpirun",
                            started > 0 ? std::to_string(started) : "several", error.what()));
  }
  joined.reset(join());
  if (started > 1 && joined->size() == 1) {
    throw Error(ErrorKind::usage, fmt::format("mpirun has started {} ranks, and {} knows of one: it is another MPI",
                                              started, joined->transport()));
  }
  share_processors(*joined);
  constexpr std::array on_ranks{"solve", "view", "formfactors"};
  for (const char* known : on_ranks) {
    if (command == known || joined->size() == 1) return;
  }
  throw AgreedError(ErrorKind::usage,
                    fmt::format("'{}' does not run on several ranks: start it without mpirun", command));
}

Launch::~Launch() {
  // Where one rank alone leaves by an exception, the others would wait for it: fail_job() comes after.
  if (std::uncaught_exceptions() == 0) joined.reset();
}

int fail_job(ErrorKind kind, std::string_view message, bool is_agreed) {
  const int status = exit_status(kind);
  if (is_agreed || joined == nullptr || joined->size() == 1) {
    if (speaks()) say_error(kind, message);
    // mpirun ends all when the first one has left: rank 0 may not have spoken yet.
    if (!speaks() && joined == nullptr) std::this_thread::sleep_for(std::chrono::milliseconds(500));
    joined.reset();
    return status;
  }
  // Ranks that fail alike do so at about the same time: the first one ends the others before they speak.
  constexpr int most = 100;
  const int turn = std::min(most, static_cast<int>(joined->rank()));
  if (turn > 0) std::this_thread::sleep_for(std::chrono::milliseconds(500 + 50 * turn));
  say_error(kind, speaks() ? std::string(message) : fmt::format("{} (rank {})", message, joined->rank()));
  joined->abort(status);
  return status;  // never reached
}

std::string mpi_state() {
  const std::filesystem::path file = module_file();
  if (file.empty()) return "not built in";
  if (!std::filesystem::exists(file)) return fmt::format("no module at {}", file.string());
  return fmt::format("built in ({})", file.string());
}

}  // namespace interflect::cli
