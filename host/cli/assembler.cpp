#include "assembler.h"

#include <algorithm>
#include <memory>

#include "interflect/base/error.h"
#include "interflect/device/compile_cache.h"
#include "interflect/formfactor/iff_format.h"
#include "interflect/schedule/device_tile_maker.h"

namespace interflect::cli {

void add_assembly_option(CLI::App& command, std::string& text) {
  command
      .add_option(
          "--assembly", text,
          "where the form factors are computed: host; device (OpenMP's is the host); auto: on a GPU, else on the "
          "host")
      ->check(CLI::IsMember({"auto", "host", "device"}))
      ->capture_default_str();
}

AssemblyPlace assembly_place(const std::string& text) {
  return text == "host" ? AssemblyPlace::host : text == "device" ? AssemblyPlace::device : AssemblyPlace::automatic;
}

bool assembles(AssemblyPlace place, const DeviceInfo& device) {
  if (place == AssemblyPlace::host || device.backend == "openmp") return false;
  return place == AssemblyPlace::device || device.type != DeviceType::cpu;  // there Embree does it faster
}

void Assembler::run(AssemblyOptions options, const std::function<AssemblyReport&(const AssemblyOptions&)>& act,
                    const std::function<std::string()>& bound) {
  while (assembles(place_, candidates_.info())) {
    try {
      Device& device = candidates_.device();
      options.maker = [&](const PatchTable& patches, const Blockers& blockers) {
        return std::make_unique<DeviceTileMaker>(device, patches, blockers, options.budget, options.seed);
      };
      const double compiled_before = compile_statistics().seconds;
      AssemblyReport& report = act(options);
      report.seconds -= compile_statistics().seconds - compiled_before;
      use_ = {candidates_.id(), FormFactorMatrix::predicted_bytes(report.row_sum.size())};
      return;
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::device) throw;  // also the host's limits, which no device can help with
      const std::string kept = bound ? bound() : "";
      if (!kept.empty()) {
        std::string text = error.what();  // behind its first line may be a compiler's log
        text.insert(std::min(text.find('\n'), text.size()), "; " + kept);
        throw Error(error.kind(), text);
      }
      candidates_.take().reset();
      candidates_.give_up(error);
    }
  }
  options.maker = {};
  use_ = {};
  static_cast<void>(act(options));
}

std::uint32_t Assembler::maker() {
  const DeviceInfo& device = candidates_.info();
  return assembles(place_, device) ? iff::maker_of(device.backend) : iff::maker_embree;
}

FormFactors Assembler::assemble(const PatchMesh& mesh, const AssemblyOptions& options, ProgressSink& progress) {
  FormFactors factors;
  run(options, [&](const AssemblyOptions& with_maker) -> AssemblyReport& {
    factors = interflect::assemble(mesh, with_maker, &progress);
    return factors.report;
  });
  return factors;
}

}  // namespace interflect::cli
