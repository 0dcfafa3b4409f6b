// The 1,312-patch room with a quarter of the memory that its form factors need: panels stream from a file.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>

#include "backends/devices.h"
#include "interflect/formfactor/iff_panels.h"
#include "interflect/formfactor/iff_store.h"
#include "interflect/scene/patch_mesh.h"
#include "interflect/solver/solver.h"
#include "solver/light.h"

namespace interflect {
namespace {

using test::difference;

constexpr std::size_t channels = 3;

struct Kept {
  Kept() {
    static int count = 0;
    folder = testing::TempDir() + "streamed" + std::to_string(::getpid()) + "_" + std::to_string(++count);
    std::filesystem::create_directories(folder);
    mesh = subdivide(read_scene(std::string(INTERFLECT_SOURCE_DIR) + "/scenes/room-1312.obj"), {.divide = 1.0});
    memory = FormFactorMatrix::predicted_bytes(mesh.size()) / 4;
    ::setenv("INTERFLECT_MAX_PANEL_BYTES", "200000", 1);
    IffStore store(folder + "/room.iff", iff_shape(mesh, 1, false, 5e-3, 1), {});
    ::unsetenv("INTERFLECT_MAX_PANEL_BYTES");
    report = assemble_into(store, mesh, {}, memory);
    store.finish(iff_closing(mesh, std::vector<Material>(64), Closure::automatic, report));
    panels = std::make_unique<IffPanels>(IffFile::open(folder + "/room.iff"));
  }
  ~Kept() { std::filesystem::remove_all(folder); }
  std::string folder;
  PatchMesh mesh;
  std::uint64_t memory = 0;
  AssemblyReport report;
  std::unique_ptr<IffPanels> panels;
};

Columns solve_on(Scheduler& scheduler, const PatchMesh& mesh) {
  const test::MeshLight light(mesh);
  Columns radiosity;
  const SolveReport report = solve(scheduler, Method::cg, {}, mesh.area, light.reflectance, light.emittance, radiosity);
  EXPECT_TRUE(report.converged) << report.reason;
  return radiosity;
}

std::vector<std::unique_ptr<Device>> only(std::unique_ptr<Device> device) {
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(std::move(device));
  return devices;
}

class Streamed : public test::OnDevice {};

TEST_P(Streamed, ARoomInAQuarterOfItsMemory) {
  const Kept kept;
  const StreamedMatrix streamed(*kept.panels, kept.mesh.area, kept.report.scaling, kept.memory);
  Scheduler scheduler(streamed, only(std::move(device)), channels);
  const Columns radiosity = solve_on(scheduler, kept.mesh);
  const PanelStream& stream = streamed.stream();
  EXPECT_LE(stream.resident(), stream.panels().panels() / 4);
  EXPECT_GT(stream.use().bytes_read, 5 * stream.bytes()) << "a product each";
  std::uint64_t on_device = 0;
  for (const Buffer* buffer : scheduler.panel_buffers()) on_device += buffer->size();
  EXPECT_LE(on_device, kept.memory);

  const FormFactors whole = read_form_factors(kept.panels->file());
  Scheduler in_memory(whole.matrix, only(open_device(GetParam())), channels);
  const Columns expected = solve_on(in_memory, kept.mesh);
  EXPECT_LE(difference(radiosity, expected), 2e-5);

  // Twin: d forgotten, F is another matrix.
  const StreamedMatrix broken(*kept.panels, kept.mesh.area, std::vector<double>(kept.mesh.size(), 1.0), kept.memory);
  Scheduler other(broken, only(open_device(GetParam())), channels);
  EXPECT_GT(difference(solve_on(other, kept.mesh), expected), 2e-4);
}

INSTANTIATE_TEST_SUITE_P(Devices, Streamed, testing::ValuesIn(test::tested_devices), test::test_name);

}  // namespace
}  // namespace interflect
