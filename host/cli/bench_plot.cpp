#include "bench_plot.h"

#include "interflect/base/error.h"

namespace interflect::cli {

void check_plot_name(const std::string& file) {
  if (file.ends_with(".html") || file.ends_with(".svg")) return;
  throw Error(ErrorKind::usage, "--plot: '" + file + "' ends neither in .html nor in .svg");
}

std::string plot(const BenchRun&, const std::string&) {
  return "";
}

}  // namespace interflect::cli
