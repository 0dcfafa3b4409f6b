#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "commands.h"

namespace interflect::cli {

/// A subcommand that solves a scene and writes its light.
struct SolvingCommand {
  std::string name, description;
  bool page = false;  ///< one of the outputs is a page; without any, NAME.html of the scene's name, in this folder
};

/// Adds it with all the options of `solve`.
void add_solving(CLI::App& program, Action& action, const SolvingCommand& which);

}  // namespace interflect::cli
