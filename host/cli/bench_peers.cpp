#include "bench_peers.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "interflect/base/timer.h"

namespace interflect::cli {

namespace {

Timed timed(const peers::Peer& peer, const std::shared_ptr<const peers::Problem>& problem) {
  const auto ready = std::make_shared<peers::Ready>(peer.prepare(*problem));
  const std::size_t best = peers::fastest(ready->calls);
  if (ready->rest) ready->rest();
  return {.pass =
              [ready, best, problem] {
                const Timer timer;
                ready->calls[best].run();
                return timer.seconds();
              },
          .verify =
              [ready, best, problem](BenchRow& judged) {
                const peers::Call& call = ready->calls[best];
                const Columns x = peers::from_columns(problem->x_by_columns(), problem->n());
                judged.error = peers::product_error(problem->f(), x, call.result());
                judged.bound = peers::product_bound(problem->n());
                if (!(judged.error <= judged.bound)) deny(judged, "differs from the fp64 reference");
                const std::string choice =
                    ready->calls.size() > 1 ? fmt::format(" (fastest of {} calls)", ready->calls.size()) : "";
                const std::string how = fmt::format("{}; {}{}", ready->about, call.how, choice);
                judged.reason = judged.reason.empty() ? how : judged.reason + "; " + how;
              },
          .rest = ready->rest};
}

/// What a product moves: F as that storage has it, X and Y.
std::uint64_t bytes_of(const peers::Peer& peer, const FormFactorMatrix& f) {
  const std::uint64_t n = f.size(), vectors = 2 * peers::columns * n * sizeof(float);
  if (peer.storage != "csr32") return f.bytes() + vectors;
  const auto non_zeros =
      static_cast<std::uint64_t>(std::llround(f.nonzero_fraction() * static_cast<double>(n) * static_cast<double>(n)));
  return non_zeros * (sizeof(float) + sizeof(std::int32_t)) + (n + 1) * sizeof(std::int32_t) + vectors;
}

}  // namespace

void add_peers(std::vector<Measurement>& all, const BenchRow& base, const std::vector<peers::Peer>& peers,
               const std::shared_ptr<const peers::Problem>& problem) {
  for (const peers::Peer& peer : peers) {
    BenchRow row = base;
    row.device = peer.device;
    row.what = "peer:" + peer.name;
    row.storage = peer.storage;
    row.bytes = bytes_of(peer, problem->f());
    row.products = 1;
    add(all, row, [&] { return timed(peer, problem); });
  }
}

}  // namespace interflect::cli
