#pragma once

#include <memory>
#include <string>
#include <vector>

#include "interflect/peers/peer.h"
#include "measurement.h"

namespace interflect::cli {

/// Appends a row "peer:NAME" for each of the peers, ready to be measured among the others: the product F X with that
/// matrix and those columns. The fastest of a library's calls is chosen beforehand and named in the row. Verified
/// against the product in double; a library that is not there is a row with status unsupported and the reason. What is
/// given must outlive the measurements.
void add_peers(std::vector<Measurement>& all, const BenchRow& base, const std::vector<peers::Peer>& peers,
               const std::shared_ptr<const peers::Problem>& problem);

/// The largest |y − F x| / |F x| against the product in double (of positive terms), and the bound of our own matvec:
/// no library promises an order of sums, but what is usual (√n u) stays far below. Denies what is above.
void judge_product(BenchRow& row, const FormFactorMatrix& f, const Columns& x, const Columns& y);

}  // namespace interflect::cli
