#include "interflect/formfactor/certificate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <utility>

namespace interflect {

namespace {

constexpr double explains = 0.5, much = 0.25;
constexpr float looks_out = 0.5F;  // the share of a patch's rays that leave a closed scene from there on

const std::string& shown(const Surface& surface) {
  return surface.object.empty() ? surface.group : surface.object;
}

/// The first are the most suspect. Outward: looks out of a scene that is closed (the other side of its walls), which is
/// no defect of F.
enum class Rank { off, buried, sound, outward };

/// The rows in the order in which they are suspect.
class Ranking {
 public:
  Ranking(const PatchMesh& mesh, const CertificateInput& input)
      : in_(input), closed_(input.escape_fraction < meant_closed), rank_(mesh.size()), deviation_(mesh.size()) {
    for (std::uint32_t i = 0; i < mesh.size(); ++i) {
      const double sky = closed_ ? 0 : static_cast<double>(in_.escape[i]);
      deviation_[i] = in_.row_sum[i] + sky - 1;
      const bool beyond = std::abs(deviation_[i]) > certain_errors * error(i, in_.rays);
      const bool buried = !in_.takes_part[i];
      const bool out = closed_ && (buried ? in_.escape[i] >= in_.back[i] : in_.escape[i] > looks_out);
      rank_[i] = out ? Rank::outward : buried ? Rank::buried : beyond ? Rank::off : Rank::sound;
    }
  }

  [[nodiscard]] bool meant_to_be_closed() const { return closed_; }
  /// Of a row sum and, in an open scene, of a sky that `rays` rays have found.
  [[nodiscard]] double error(std::uint32_t i, double rays) const {
    if (closed_) return in_.error[i];
    const auto e = static_cast<double>(in_.escape[i]);
    return std::hypot(in_.error[i], std::sqrt(std::max(e * (1 - e), 1 / rays) / rays));
  }
  [[nodiscard]] std::uint64_t count(Rank rank) const {
    return static_cast<std::uint64_t>(std::count(rank_.begin(), rank_.end(), rank));
  }
  [[nodiscard]] std::vector<std::uint32_t> first(std::size_t most) const {
    std::vector<std::uint32_t> order;
    for (std::uint32_t i = 0; i < rank_.size(); ++i) {
      if (rank_[i] != Rank::outward) order.push_back(i);
    }
    const std::size_t kept = std::min(most, order.size());
    std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(kept), order.end(),
                      [&](std::uint32_t a, std::uint32_t b) {
                        if (rank_[a] != rank_[b]) return rank_[a] < rank_[b];
                        const double x = std::abs(deviation_[a]), y = std::abs(deviation_[b]);
                        return x != y ? x > y : a < b;
                      });
    order.resize(kept);
    return order;
  }
  [[nodiscard]] double deviation(std::uint32_t i) const { return deviation_[i]; }
  [[nodiscard]] bool within_error(std::uint32_t i) const { return rank_[i] == Rank::sound; }

 private:
  const CertificateInput& in_;
  bool closed_;
  std::vector<Rank> rank_;
  std::vector<double> deviation_;
};

/// Whose fault it is, where it is another surface's.
std::string other_surface(const PatchMesh& mesh, std::uint32_t patch, Cause cause, const RowFacts& facts) {
  std::optional<std::uint32_t> surface;
  if ((cause == Cause::flipped_normal && !facts.turned) || cause == Cause::interpenetration) {
    surface = facts.around.back_surface;
  } else if (cause == Cause::open_seam) {
    surface = facts.around.edge_surface;
  }
  if (!surface || (*surface == mesh.surface[patch] && cause != Cause::open_seam)) return {};
  return shown(mesh.surfaces[*surface]);
}

}  // namespace

std::string_view name(Cause cause) {
  constexpr std::array<std::string_view, 6> names{"sampling error", "flipped normal", "interpenetration",
                                                  "open seam",      "coarse mesh",    "none known"};
  return names[static_cast<std::size_t>(cause)];
}

Cause likely_cause(const RowFacts& facts) {
  if (std::abs(facts.deviation) <= certain_errors * facts.error) return Cause::sampling;
  const Around& a = facts.around;
  const double wanted = explains * -facts.deviation;
  if (facts.deviation < 0) {
    const double lost = facts.seam ? a.escape : 0;
    if (facts.turned && a.back + a.escape >= wanted) return Cause::flipped_normal;
    if (a.back_of_turned >= wanted) return Cause::flipped_normal;
    if (a.inside >= wanted) return Cause::interpenetration;
    if (a.back >= wanted) return Cause::flipped_normal;
    if (lost >= wanted) return Cause::open_seam;
    if (lost > 0 && a.back + lost >= wanted) return a.back > lost ? Cause::flipped_normal : Cause::open_seam;
  }
  return a.near >= much ? Cause::coarse_mesh : Cause::unknown;
}

Certificate certify(const PatchMesh& mesh, const PatchTable& patches, const CertificateInput& input, std::size_t most) {
  const Ranking ranking(mesh, input);
  Certificate out;
  out.made = true;
  out.off = ranking.count(Rank::off);
  out.rows = out.off + ranking.count(Rank::sound);
  std::unique_ptr<Surroundings> surroundings;
  for (const std::uint32_t i : ranking.first(most)) {
    const Surface& surface = mesh.surfaces[mesh.surface[i]];
    SuspectRow row{i,
                   surface.object,
                   surface.group,
                   mesh.centroid[i],
                   input.row_sum[i],
                   ranking.deviation(i),
                   ranking.error(i, input.rays),
                   static_cast<double>(input.escape[i]),
                   static_cast<double>(input.back[i]),
                   !input.takes_part[i],
                   Cause::sampling,
                   {}};
    if (!ranking.within_error(i)) {
      if (!surroundings) surroundings = std::make_unique<Surroundings>(mesh, patches);
      RowFacts facts{row.deviation, row.error, ranking.meant_to_be_closed(), surroundings->edges().turned[i],
                     surroundings->look(i)};
      row.escape = facts.around.escape;
      row.back = facts.around.back;
      if (!facts.seam) {
        constexpr double rays = Surroundings::points * Surroundings::directions;
        facts.deviation = row.deviation = row.row_sum + row.escape - 1;
        facts.error = row.error = ranking.error(i, rays);
      }
      row.cause = likely_cause(facts);
      row.other = other_surface(mesh, i, row.cause, facts);
    }
    out.worst.push_back(std::move(row));
  }
  return out;
}

}  // namespace interflect
