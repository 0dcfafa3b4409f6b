// Loads a scene, solves it and prints the mean radiosity of each of its groups.
//   read-radiosities SCENE [PATCHES]
#include <cstdlib>
#include <exception>
#include <iostream>
#include <memory>
#include <vector>

#include <interflect/device/registry.h>
#include <interflect/formfactor/assembly.h>
#include <interflect/scene/patch_mesh.h>
#include <interflect/scene/scene.h>
#include <interflect/solver/solver.h>

namespace ifl = interflect;

int main(int argc, char** argv) try {
  if (argc < 2) {
    std::cerr << "usage: read-radiosities SCENE [PATCHES]\n";
    return 2;
  }
  // A scene in, cut into patches.
  const ifl::Scene scene = ifl::read_scene(argv[1]);
  ifl::SubdivideOptions subdivision;
  subdivision.divide = ifl::choose_divide(scene, argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1000);
  const ifl::PatchMesh mesh = ifl::subdivide(scene, subdivision);

  // Form factors: once for all channels and all lamps.
  const ifl::FormFactors factors = ifl::assemble(mesh);

  // One column per channel.
  const std::size_t n = mesh.size();
  ifl::Columns reflectance(3, std::vector<float>(n)), emittance(3, std::vector<float>(n)), radiosity;
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < n; ++i) {
      reflectance[c][i] = static_cast<float>(mesh.reflectance[i][c]);
      emittance[c][i] = static_cast<float>(mesh.emittance[i][c]);
    }
  }
  std::vector<std::unique_ptr<ifl::Device>> devices;
  devices.push_back(ifl::open_device("auto"));
  ifl::Scheduler scheduler(factors.matrix, std::move(devices), 3);
  const ifl::SolveReport report =
      ifl::solve(scheduler, ifl::Method::cg, ifl::StopTest{}, mesh.area, reflectance, emittance, radiosity);

  // Its light out: the area-weighted mean radiosity of every group.
  const ifl::Grouping grouping = ifl::group_surfaces(scene);
  std::vector<double> area(grouping.names.size());
  std::vector<ifl::Rgb> power(grouping.names.size());
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t g = grouping.of_surface[mesh.surface[i]];
    area[g] += mesh.area[i];
    for (std::size_t c = 0; c < 3; ++c) power[g][c] += mesh.area[i] * static_cast<double>(radiosity[c][i]);
  }
  std::cout << n << " patches, " << report.products << " products, "
            << (report.converged ? "converged" : "not converged") << "\n";
  for (std::size_t g = 0; g < area.size(); ++g) {
    std::cout << grouping.names[g];
    for (std::size_t c = 0; c < 3; ++c) std::cout << " " << power[g][c] / area[g];
    std::cout << "\n";
  }
  return report.converged ? 0 : 5;
} catch (const std::exception& error) {
  std::cerr << "read-radiosities: " << error.what() << "\n";
  return 1;
}
