#include <fcntl.h>
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <exception>
#include <new>

#include "commands.h"
#include "console.h"
#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "launch.h"

namespace {

using interflect::Error;
using interflect::ErrorKind;

int fail(ErrorKind kind, std::string_view message, bool agreed = false) {
  return interflect::cli::fail_job(kind, message, agreed);
}

/// CLI11's errors in one line, with the status that this program promises for usage errors.
int usage(const CLI::App& program, const CLI::ParseError& error) {
  if (error.get_exit_code() == 0) return interflect::cli::speaks() ? program.exit(error) : 0;  // --help, --version
  const auto chosen = program.get_subcommands();
  const std::string command = chosen.empty() ? "interflect" : "interflect " + chosen.front()->get_name();
  std::string message = error.what();
  if (chosen.empty() && !program.remaining().empty()) {
    message = fmt::format("'{}' is not a command", program.remaining().front());
  }
  for (char& c : message) c = c == '\n' ? ' ' : c;
  return fail(ErrorKind::usage, fmt::format("{} (see '{} --help')", message, command));
}

/// Where the caller has closed stdin, stdout or stderr, the next file that is opened would get its number, and what is
/// printed would go into that file. A stdout like that is an error when something is printed; a stderr is not.
void open_standard_streams() {
  for (int stream = 0; stream <= 2; ++stream) {
    if (::fcntl(stream, F_GETFD) != -1) continue;
    (void)::open("/dev/null", stream == 2 ? O_WRONLY : O_RDONLY);  // takes the lowest free number
  }
}

int run(int argc, char** argv) {
  CLI::App program("Radiosity on whatever computes: a scene in, its light out.", "interflect");
  program.set_version_flag("--version", std::string("interflect ") + INTERFLECT_VERSION);
  program.require_subcommand(1);
  interflect::cli::Action action;
  interflect::cli::add_solve(program, action);
  interflect::cli::add_view(program, action);
  interflect::cli::add_render(program, action);
  interflect::cli::add_serve(program, action);
  interflect::cli::add_formfactors(program, action);
  interflect::cli::add_devices(program, action);
  interflect::cli::add_check(program, action);
  interflect::cli::add_bench(program, action);
  interflect::cli::add_tune(program, action);
  try {
    program.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return usage(program, error);
  }
  interflect::remove_temporaries_on_signals();
  interflect::file_limit_is_an_error();
  const interflect::cli::Launch launch(program.get_subcommands().front()->get_name());
  const int status = action();
  // A full disk or a closed pipe shows when the results are flushed.
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) return fail(ErrorKind::input, "cannot write to stdout");
  return status;
}

}  // namespace

int main(int argc, char** argv) {
  open_standard_streams();
  try {
    return run(argc, argv);
  } catch (const interflect::AgreedError& error) {
    return fail(error.kind(), error.what(), true);
  } catch (const Error& error) {
    return fail(error.kind(), error.what());
  } catch (const std::bad_alloc&) {
    return fail(ErrorKind::limit, "out of memory");
  } catch (const std::exception& error) {
    return fail(ErrorKind::internal, error.what());
  }
}
