#include "interflect/formfactor/patch_clusters.h"

#include <omp.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <limits>
#include <numeric>
#include <tuple>
#include <utility>

#include "interflect/formfactor/patch_order.h"
#include "interflect/formfactor/zero_pattern.h"

namespace interflect {

namespace {

constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();

// Measured on rooms of 1,312 to 17,128 patches: a window of all nodes with 16 neighbours stores 1 % fewer tiles in
// eight times the time; columns in groups of 4 instead of 16 store 2 % fewer at 1,312 patches and as many at 17,128;
// without the exchange of partners 1 % more are stored.
constexpr std::size_t window = 256;        // places to each side in which a node looks for partners
constexpr std::size_t neighbours = 8;      // partners that it considers
constexpr std::uint32_t most_bits = 2560;  // of a node's view
constexpr int tries = 4;                   // for nodes whose partners have all gone to others
constexpr int improvements = 3;            // runs through the neighbours to exchange partners

/// Clusters of `patches_each` patches and what they see.
struct Nodes {
  std::size_t patches_each = 1;
  std::vector<std::uint32_t> patches;  ///< node by node
  std::size_t words = 0;               ///< of a view; a multiple of 8
  std::vector<std::uint64_t> views;    ///< node by node, a bit per group of columns: a patch of the node sees one of it

  [[nodiscard]] std::size_t size() const { return patches.size() / patches_each; }
  [[nodiscard]] std::uint32_t distance(std::uint32_t a, std::uint32_t b) const {
    std::uint32_t bits = 0;
    simd::differing_bits(views, words, a, {&b, 1}, {&bits, 1});
    return bits;
  }
};

Nodes single_patches(const FormFactorMatrix& form_factors, std::span<const std::uint32_t> order) {
  const std::uint32_t n = form_factors.size();
  std::uint32_t columns = 1;  // that share a bit
  while (n / columns > most_bits) columns *= 2;
  std::vector<std::uint32_t> bit_of(n);
  for (std::uint32_t k = 0; k < n; ++k) bit_of[order[k]] = k / columns;

  Nodes nodes;
  nodes.patches.assign(order.begin(), order.end());
  nodes.words = (std::size_t{n} / columns / 64 + 8) / 8 * 8;
  nodes.views.resize(n * nodes.words);
  const std::size_t row_words = (std::size_t{n} + 63) / 64;
  std::vector<std::uint64_t> rows(row_words * static_cast<std::size_t>(omp_get_max_threads()));
#pragma omp parallel for schedule(static)
  for (std::uint32_t k = 0; k < n; ++k) {
    const std::span row(rows.data() + row_words * static_cast<std::size_t>(omp_get_thread_num()), row_words);
    std::fill(row.begin(), row.end(), 0);
    simd::mark_nonzeros(form_factors.row(order[k]), row);
    std::uint64_t* view = nodes.views.data() + k * nodes.words;
    for (std::size_t w = 0; w < row_words; ++w) {
      for (std::uint64_t left = row[w]; left != 0; left &= left - 1) {
        const std::uint32_t bit = bit_of[w * 64 + static_cast<std::size_t>(std::countr_zero(left))];
        view[bit / 64] |= std::uint64_t{1} << (bit % 64);
      }
    }
  }
  return nodes;
}

/// Two nodes, a < b, and in how many bits their views differ. Joined, they see (|a| + |b| + distance) / 2: the least
/// sum of distances is the least sum of what the pairs see.
struct Edge {
  std::uint32_t distance = none, a = none, b = none;
  bool operator==(const Edge&) const = default;
  bool operator<(const Edge& e) const { return std::tie(distance, a, b) < std::tie(e.distance, e.a, e.b); }
};

/// The edges from each of `among` to its nearest within the window, by distance.
std::vector<Edge> nearest(const Nodes& nodes, std::span<const std::uint32_t> among) {
  std::vector<Edge> edges(among.size() * neighbours);
#pragma omp parallel for schedule(dynamic, 64)
  for (std::size_t i = 0; i < among.size(); ++i) {
    const std::size_t first = i > window ? i - window : 0, end = std::min(among.size(), i + window + 1);
    std::array<std::uint32_t, 2 * window + 1> bits;
    simd::differing_bits(nodes.views, nodes.words, among[i], among.subspan(first, end - first),
                         std::span(bits).first(end - first));
    std::array<std::uint64_t, 2 * window> keys;  // distance, then places between; its lowest bit says on which side
    std::size_t count = 0;
    for (std::size_t j = first; j < end; ++j) {
      if (j == i) continue;
      keys[count++] = std::uint64_t{bits[j - first]} << 32 | (j < i ? (i - j) * 2 : (j - i) * 2 + 1);
    }
    const std::size_t kept = std::min(neighbours, count);
    std::partial_sort(keys.begin(), keys.begin() + static_cast<std::ptrdiff_t>(kept),
                      keys.begin() + static_cast<std::ptrdiff_t>(count));
    for (std::size_t k = 0; k < kept; ++k) {
      const std::size_t away = (keys[k] & 0xffffffff) / 2, j = (keys[k] & 1) == 0 ? i - away : i + away;
      edges[i * neighbours + k] = {static_cast<std::uint32_t>(keys[k] >> 32), std::min(among[i], among[j]),
                                   std::max(among[i], among[j])};
    }
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  if (!edges.empty() && edges.back().a == none) edges.pop_back();  // places of nodes with fewer neighbours
  return edges;
}

/// Pairs of nodes with a small sum of distances.
class Matching {
 public:
  explicit Matching(const Nodes& nodes);
  /// none for one node, if their number is odd.
  [[nodiscard]] std::uint32_t mate(std::uint32_t a) const { return mate_[a]; }

 private:
  void join(std::uint32_t a, std::uint32_t b, std::uint32_t distance);
  void take_nearest(const std::vector<Edge>& edges);
  bool exchange(const std::vector<Edge>& edges);

  const Nodes& nodes_;
  std::vector<std::uint32_t> mate_, distance_;  ///< of each node, distance_ to its mate
};

Matching::Matching(const Nodes& nodes) : nodes_(nodes), mate_(nodes.size(), none), distance_(nodes.size(), 0) {
  std::vector<std::uint32_t> alone(nodes.size());
  std::iota(alone.begin(), alone.end(), 0);
  const std::vector<Edge> edges = nearest(nodes, alone);
  take_nearest(edges);
  const auto drop_joined = [&] { std::erase_if(alone, [&](std::uint32_t a) { return mate_[a] != none; }); };
  drop_joined();
  for (int k = 1; k < tries && alone.size() > 1; ++k) {
    take_nearest(nearest(nodes, alone));
    drop_joined();
  }
  for (std::size_t k = 0; k + 1 < alone.size(); k += 2) {
    join(alone[k], alone[k + 1], nodes.distance(alone[k], alone[k + 1]));
  }
  for (int k = 0; k < improvements && exchange(edges); ++k) {
  }
}

void Matching::join(std::uint32_t a, std::uint32_t b, std::uint32_t distance) {
  mate_[a] = b;
  mate_[b] = a;
  distance_[a] = distance_[b] = distance;
}

/// `edges` by distance: each that finds both of its nodes alone joins them.
void Matching::take_nearest(const std::vector<Edge>& edges) {
  for (const Edge& edge : edges) {
    if (mate_[edge.a] == none && mate_[edge.b] == none) join(edge.a, edge.b, edge.distance);
  }
}

/// (a, x), (b, y) become (a, b), (x, y) where that makes the sum of distances less. Returns whether it ever did.
bool Matching::exchange(const std::vector<Edge>& edges) {
  bool better = false;
  for (const auto& [distance, a, b] : edges) {
    const std::uint32_t x = mate_[a], y = mate_[b];
    if (x == b || x == none || y == none) continue;
    const std::uint32_t now = distance_[a] + distance_[b];
    if (distance >= now) continue;
    const std::uint32_t other = nodes_.distance(x, y);
    if (distance + other >= now) continue;
    join(a, b, distance);
    join(x, y, other);
    better = true;
  }
  return better;
}

/// The pairs as nodes, each in the place of its first; the patches of a node without mate go to the front of `rest`.
Nodes joined(const Nodes& nodes, const Matching& matching, std::vector<std::uint32_t>& rest) {
  Nodes pairs;
  pairs.patches_each = 2 * nodes.patches_each;
  pairs.words = nodes.words;
  pairs.patches.reserve(nodes.patches.size());
  pairs.views.reserve(nodes.views.size() / 2);
  const auto patches = [&](std::size_t a) {
    return std::span(nodes.patches).subspan(a * nodes.patches_each, nodes.patches_each);
  };
  for (std::uint32_t a = 0; a < nodes.size(); ++a) {
    const std::uint32_t b = matching.mate(a);
    if (b == none) rest.insert(rest.begin(), patches(a).begin(), patches(a).end());
    if (b == none || b < a) continue;
    pairs.patches.insert(pairs.patches.end(), patches(a).begin(), patches(a).end());
    pairs.patches.insert(pairs.patches.end(), patches(b).begin(), patches(b).end());
    const std::uint64_t *view_a = nodes.views.data() + a * nodes.words, *view_b = nodes.views.data() + b * nodes.words;
    for (std::size_t w = 0; w < nodes.words; ++w) pairs.views.push_back(view_a[w] | view_b[w]);
  }
  return pairs;
}

}  // namespace

std::vector<std::uint32_t> joined_by_view(const FormFactorMatrix& form_factors, std::span<const std::uint32_t> order) {
  Nodes nodes = single_patches(form_factors, order);
  std::vector<std::uint32_t> rest;
  while (nodes.patches_each < tile_columns) nodes = joined(nodes, Matching(nodes), rest);
  std::vector<std::uint32_t> out = std::move(nodes.patches);
  out.insert(out.end(), rest.begin(), rest.end());
  return out;
}

}  // namespace interflect
