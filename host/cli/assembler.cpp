#include "assembler.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/device/compile_cache.h"
#include "interflect/formfactor/embree_tiles.h"
#include "interflect/formfactor/iff_format.h"
#include "interflect/formfactor/team_tiles.h"
#include "interflect/schedule/device_assembly.h"

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

namespace {

/// Tiles from a device, which is given patches, hierarchy and scratch once, when the first tiles are wanted.
class DeviceTiles final : public TileMaker {
 public:
  DeviceTiles(Device& device, const PatchTable& patches, const Blockers& blockers, const AssemblyOptions& options,
              AssemblyUse& use)
      : device_(device), patches_(patches), blockers_(blockers), options_(options), use_(use) {}
  [[nodiscard]] TileFacts make(std::size_t first, std::size_t end, const TileSink& sink,
                               ProgressSink& progress) override {
    if (!assembly_) assembly_.emplace(device_, patches_, blockers_, options_.budget, options_.seed);
    TileFacts facts = assembly_->make(first, end, sink, progress);
    use_ = {device_.info().id, assembly_->downloaded_bytes()};
    return facts;
  }

 private:
  Device& device_;
  const PatchTable& patches_;
  const Blockers& blockers_;
  const AssemblyOptions& options_;
  AssemblyUse& use_;
  std::optional<DeviceAssembly> assembly_;
};

}  // namespace

std::vector<Assembler::Member> Assembler::team(bool mixed) {
  const std::vector<Device*> devices = candidates_.devices();
  const std::vector<double> weights = candidates_.split().weights;
  std::vector<Member> team;
  std::size_t assembling = 0;
  for (std::size_t k = 0; k < devices.size(); ++k) {
    const DeviceInfo& info = devices[k]->info();
    const Member member{devices[k], mixed && info.backend == "openmp", weights.empty() ? 0 : weights.at(k)};
    if (!member.embree && !assembles(place_, info)) continue;
    // Tiles of several kinds differ in rays that graze an edge.
    const auto kind = [](const DeviceInfo& of) { return std::tie(of.backend, of.name, of.driver); };
    const bool alike = team.empty() || kind(info) == kind(team.front().device->info());
    if (!mixed && !alike) continue;
    team.push_back(member);
    assembling += member.embree ? 0 : 1;
  }
  if (assembling == 0) return {};  // Embree alone needs no team
  if (mixed && !weights.empty()) std::erase_if(team, [](const Member& member) { return member.share <= 0; });
  return team;
}

void Assembler::leave_out(const std::string& id, const Error& error) {
  if (id != candidates_.id()) {
    candidates_.lose({id, error.what()});
    return;
  }
  candidates_.take().reset();
  candidates_.give_up(error);
}

void Assembler::run(AssemblyOptions options, const std::function<AssemblyReport&(const AssemblyOptions&)>& act,
                    const std::function<std::string()>& bound, bool mixed) {
  for (std::vector<Member> team = this->team(mixed); !team.empty(); team = this->team(mixed)) {
    use_ = {};
    std::vector<AssemblyUse> uses(team.size());
    std::vector<std::pair<std::string, Error>> lost;
    const auto settle = [&] {
      for (const auto& [id, error] : lost) leave_out(id, error);
    };
    try {
      options.maker = [&](const PatchTable& patches, const Blockers& blockers) -> std::unique_ptr<TileMaker> {
        std::vector<std::unique_ptr<TileMaker>> makers;
        std::vector<double> shares;
        for (std::size_t k = 0; k < team.size(); ++k) {
          Device& device = *team[k].device;
          if (team[k].embree) {
            uses[k].device = device.info().id;
            makers.push_back(std::make_unique<EmbreeTiles>(patches, blockers, options.budget, options.seed));
          } else {
            makers.push_back(std::make_unique<DeviceTiles>(device, patches, blockers, options, uses[k]));
          }
          if (team[k].share > 0) shares.push_back(team[k].share);
        }
        if (makers.size() == 1) return std::move(makers.front());
        if (shares.size() != makers.size()) shares.clear();
        const auto lose = [&](std::size_t k, const Error& error) {
          lost.emplace_back(team[k].device->info().id, error);
        };
        return std::make_unique<TeamTiles>(std::move(makers), patches.blocks(), lose, std::move(shares));
      };
      const double compiled_before = compile_statistics().seconds;
      AssemblyReport& report = act(options);
      report.seconds = std::max(0.0, report.seconds - (compile_statistics().seconds - compiled_before));
      for (const AssemblyUse& use : uses) {
        if (use.bytes_over_bus == 0 && use.device == AssemblyUse{}.device) continue;
        use_.device = use_.device == AssemblyUse{}.device ? use.device : use_.device + "," + use.device;
        use_.bytes_over_bus += use.bytes_over_bus;
      }
      settle();
      return;
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::device) throw;  // also the host's limits, which no device can help with
      const std::string kept = bound ? bound() : "";
      if (!kept.empty()) {
        std::string text = error.what();  // behind its first line may be a compiler's log
        text.insert(std::min(text.find('\n'), text.size()), "; " + kept);
        throw Error(error.kind(), text);
      }
      if (lost.empty()) lost.emplace_back(team.front().device->info().id, error);
      settle();
    }
  }
  options.maker = {};
  use_ = {};
  static_cast<void>(act(options));
}

std::uint32_t Assembler::maker() {
  const std::vector<Member> makers = team(false);
  return makers.empty() ? iff::maker_embree : iff::maker_of(makers.front().device->info().backend);
}

FormFactors Assembler::assemble(const PatchMesh& mesh, const AssemblyOptions& options, ProgressSink& progress) {
  FormFactors factors;
  const auto act = [&](const AssemblyOptions& with_maker) -> AssemblyReport& {
    factors = interflect::assemble(mesh, with_maker, &progress);
    return factors.report;
  };
  run(options, act, {}, options.panels == nullptr);
  return factors;
}

}  // namespace interflect::cli
