#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace interflect::cli {

/// What a subcommand leaves for main(): run() returns the exit status and may throw Error.
using Action = std::function<int()>;

// Each adds its subcommand with its options to the program and sets `action` when it was chosen.
void add_solve(CLI::App& program, Action& action);
void add_render(CLI::App& program, Action& action);
void add_formfactors(CLI::App& program, Action& action);
void add_devices(CLI::App& program, Action& action);
void add_check(CLI::App& program, Action& action);
void add_bench(CLI::App& program, Action& action);
void add_tune(CLI::App& program, Action& action);
void add_view(CLI::App& program, Action& action);
void add_serve(CLI::App& program, Action& action);

}  // namespace interflect::cli
