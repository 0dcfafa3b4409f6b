#include "interflect/serve/live_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "interflect/output/bytes.h"

namespace interflect::serve {

namespace {

constexpr std::size_t channels = 3;

bool emits(const Rgb& emittance) {
  return std::any_of(emittance.begin(), emittance.end(), [](double e) { return e != 0; });
}

/// A patch's value when its material's mean becomes `wanted`.
double changed(double own, double mean, double wanted, bool varies) {
  return varies && mean > 0 ? own * (wanted / mean) : wanted;
}

}  // namespace

LiveScene::LiveScene(const PatchMesh& mesh, LightGroups groups, const std::vector<std::string>& material_names)
    : mesh_(mesh), groups_(std::move(groups)) {
  std::map<std::uint32_t, std::uint32_t> index;  // of the materials that have patches
  std::set<std::string> taken;
  material_of_.reserve(mesh.size());
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    const std::uint32_t material = mesh.surfaces[mesh.surface[i]].material;
    const auto [found, added] = index.try_emplace(material, static_cast<std::uint32_t>(materials_.size()));
    if (added) {
      LiveMaterial& made = materials_.emplace_back();
      const bool named = material < material_names.size() && !material_names[material].empty();
      const std::string name =
          named ? printable_name(material_names[material]) : fmt::format("material {}", material + 1);
      made.name = name;
      for (int k = 2; !taken.insert(made.name).second; ++k) made.name = fmt::format("{} ({})", name, k);
    }
    material_of_.push_back(found->second);
  }
  collect();
}

void LiveScene::collect() {
  std::vector<std::size_t> first(materials_.size(), mesh_.size());
  std::vector<std::set<std::uint32_t>> surfaces(materials_.size());
  for (std::size_t i = 0; i < mesh_.size(); ++i) {
    const std::uint32_t m = material_of_[i];
    LiveMaterial& material = materials_[m];
    ++material.patches;
    surfaces[m].insert(mesh_.surface[i]);
    material.area += mesh_.area[i];
    first[m] = std::min(first[m], i);
    for (std::size_t c = 0; c < channels; ++c) {
      material.reflectance[c] += mesh_.area[i] * mesh_.reflectance[i][c];
      material.emittance[c] += mesh_.area[i] * mesh_.emittance[i][c];
    }
    material.emits = material.emits || emits(mesh_.emittance[i]);
    material.varies = material.varies || mesh_.reflectance[i] != mesh_.reflectance[first[m]] ||
                      mesh_.emittance[i] != mesh_.emittance[first[m]];
  }
  for (std::size_t m = 0; m < materials_.size(); ++m) {
    LiveMaterial& material = materials_[m];
    material.surfaces.assign(surfaces[m].begin(), surfaces[m].end());
    for (std::size_t c = 0; c < channels; ++c) {
      // The mean of equal values is that value, to the last bit.
      material.reflectance[c] =
          material.varies ? material.reflectance[c] / material.area : mesh_.reflectance[first[m]][c];
      material.emittance[c] = material.varies ? material.emittance[c] / material.area : mesh_.emittance[first[m]][c];
    }
  }
}

Columns LiveScene::reflectance(const Change& change) const {
  Columns columns(channels, std::vector<float>(mesh_.size()));
  for (std::size_t i = 0; i < mesh_.size(); ++i) {
    const LiveMaterial& material = materials_[material_of_[i]];
    const auto wanted = change.reflectance.find(material_of_[i]);
    for (std::size_t c = 0; c < channels; ++c) {
      double rho = mesh_.reflectance[i][c];
      if (wanted != change.reflectance.end()) {
        rho = std::min(1.0, changed(rho, material.reflectance[c], wanted->second[c], material.varies));
      }
      columns[c][i] = static_cast<float>(rho);
    }
  }
  return columns;
}

Columns LiveScene::emittance(const Change& change) const {
  Columns columns(channels * lamps(), std::vector<float>(mesh_.size()));
  for (std::size_t i = 0; i < mesh_.size(); ++i) {
    if (!emits(mesh_.emittance[i])) continue;
    const std::size_t group = groups_.names.empty() ? 0 : groups_.of_patch[i];
    const LiveMaterial& material = materials_[material_of_[i]];
    const auto wanted = change.emittance.find(material_of_[i]);
    for (std::size_t c = 0; c < channels; ++c) {
      double e = mesh_.emittance[i][c];
      if (wanted != change.emittance.end()) {
        e = changed(e, material.emittance[c], wanted->second[c], material.varies);
      }
      columns[channels * group + c][i] = static_cast<float>(e);
    }
  }
  return columns;
}

}  // namespace interflect::serve
