#pragma once

#include <memory>
#include <string>
#include <vector>

#include "interflect/peers/peer.h"
#include "measurement.h"

namespace interflect::cli {

/// Appends a row "peer:NAME" for each of the peers, ready to be measured among the others: the product F X with that
/// matrix and those columns. The fastest of a library's calls is chosen beforehand and named in the row. Verified
/// against the product in double (peers::product_bound); a library that is not there is a row with status unsupported
/// and the reason. What is given must outlive the measurements.
void add_peers(std::vector<Measurement>& all, const BenchRow& base, const std::vector<peers::Peer>& peers,
               const std::shared_ptr<const peers::Problem>& problem);

}  // namespace interflect::cli
