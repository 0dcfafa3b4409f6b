#include "commands.h"
#include "solve.h"

namespace interflect::cli {

void add_view(CLI::App& program, Action& action) {
  add_solving(program, action, {"view", "solve a scene and write a page with its room to walk through", true});
}

}  // namespace interflect::cli
