#include "interflect/formfactor/rank_fill.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "interflect/formfactor/patch_table.h"

namespace interflect {

namespace {

constexpr std::uint32_t block = PatchTable::block;
constexpr std::size_t pairs = std::size_t{block} * block;
constexpr std::uint64_t most_in_flight = std::uint64_t{32} << 20;  // bytes of tiles that a rank makes in a round
constexpr std::uint32_t rounds_at_least = 8;                       // so that the work of all ranks is about the same

/// In front of a tile (facts = 0; r, c) or of facts (facts = 1; tile rows r to c) in a message.
struct RecordHead {
  std::uint32_t facts, r, c, floats;
  std::uint64_t pairs, analytic, rays;
  double trace_seconds;
};

void append(std::vector<std::byte>& to, const RecordHead& head, std::span<const float> values) {
  const auto front = std::as_bytes(std::span(&head, 1)), body = std::as_bytes(values);
  to.insert(to.end(), front.begin(), front.end());
  to.insert(to.end(), body.begin(), body.end());
}

/// Of the first one.
std::size_t record_bytes(std::span<const std::byte> records) {
  RecordHead head{};
  std::memcpy(&head, records.data(), sizeof head);
  return sizeof head + head.floats * sizeof(float);
}

}  // namespace

RankFill::RankFill(Ranks& ranks, const std::vector<RowShare>& shares, FormFactorMatrix& rows, TileMaker& maker,
                   RankStore* store, std::uint64_t most_bytes)
    : ranks_(ranks),
      shares_(shares),
      rows_(rows),
      maker_(maker),
      store_(store),
      most_bytes_(most_bytes),
      blocks_((rows.size() + block - 1) / block),
      outbox_(ranks.size()),
      locks_(ranks.size()) {
  plan();
}

/// Runs of tile rows, none over the end of a panel of the store.
void RankFill::plan() {
  const std::uint64_t row_bytes = std::uint64_t{blocks_} * pairs * sizeof(float);
  const std::uint64_t fair = blocks_ / (std::uint64_t{rounds_at_least} * ranks_.size());
  const auto longest = static_cast<std::uint32_t>(
      std::max<std::uint64_t>(1, std::min(fair, most_in_flight / std::max<std::uint64_t>(1, row_bytes))));
  const std::uint32_t panels = store_ != nullptr ? store_->shape().panels() : 1;
  for (std::uint32_t panel = 0; panel < panels; ++panel) {
    if (store_ != nullptr && store_->kept(panel)) continue;
    const std::uint32_t first = store_ != nullptr ? store_->shape().first_tile_row(panel) : 0;
    const std::uint32_t end = store_ != nullptr ? store_->shape().end_tile_row(panel) : blocks_;
    for (std::uint32_t r = first; r < end; r += longest) runs_.push_back({r, std::min(end, r + longest)});
  }
}

std::uint64_t RankFill::tiles() const {
  std::uint64_t sum = 0;
  for (const Run& run : runs_) sum += tiles_in_rows(run.first, run.end, blocks_);
  return sum;
}

/// To the owners of its rows and of its columns.
void RankFill::send(std::uint32_t r, std::uint32_t c, std::span<const float> tile) {
  const std::uint32_t of_rows = owner_of(shares_, r * block), of_columns = owner_of(shares_, c * block);
  const RecordHead head{0, r, c, pairs, 0, 0, 0, 0};
  for (const std::uint32_t to : {of_rows, of_columns}) {
    if (to == ranks_.rank()) {
      put(r, c, tile);
    } else {
      const std::lock_guard lock(locks_[to]);
      append(outbox_[to], head, tile);
    }
    if (of_rows == of_columns) break;
  }
}

/// To rank 0, for the report, and to the panel's owner, for the store.
void RankFill::send(const Facts& facts) {
  const RecordHead head{1,
                        facts.first,
                        facts.end,
                        static_cast<std::uint32_t>(facts.facts.variance.size()),
                        facts.facts.pairs_considered,
                        facts.facts.pairs_analytic,
                        facts.facts.rays,
                        facts.facts.trace_seconds};
  const std::uint32_t owner = store_ != nullptr ? owner_of(shares_, facts.first * block) : 0;
  append(outbox_[0], head, facts.facts.variance);
  if (owner != 0) append(outbox_[owner], head, facts.facts.variance);
}

/// Writes a tile and its mirror image into the rows that are here.
void RankFill::put(std::uint32_t r, std::uint32_t c, std::span<const float> tile) {
  const std::uint32_t n = rows_.size(), i0 = r * block, j0 = c * block;
  const std::uint32_t height = std::min(block, n - i0), width = std::min(block, n - j0);
  const RowShare here{rows_.first_row(), rows_.end_row()};
  for (std::uint32_t a = 0; here.has(i0) && a < height; ++a) {
    float* row = rows_.row(i0 + a).data() + j0;
    for (std::uint32_t b = r == c ? a + 1 : 0; b < width; ++b) row[b] = tile[std::size_t{a} * block + b];
  }
  for (std::uint32_t b = 0; here.has(j0) && b < width; ++b) {
    float* row = rows_.row(j0 + b).data() + i0;
    for (std::uint32_t a = 0; a < (r == c ? b : height); ++a) row[a] = tile[std::size_t{a} * block + b];
  }
}

void RankFill::note(Facts facts) {
  facts_.push_back(std::move(facts));
}

void RankFill::take(std::span<const std::byte> records) {
  while (!records.empty()) {
    RecordHead head{};
    std::memcpy(&head, records.data(), sizeof head);
    records = records.subspan(sizeof head);
    std::vector<float> values(head.floats);
    std::memcpy(values.data(), records.data(), head.floats * sizeof(float));
    records = records.subspan(head.floats * sizeof(float));
    if (head.facts == 0) {
      put(head.r, head.c, values);
    } else {
      note({head.r, head.c, {head.pairs, head.analytic, head.rays, head.trace_seconds, std::move(values)}});
    }
  }
}

/// Empties the outboxes, whole records at a time: the tile rows of a round may all have the same owner.
void RankFill::exchange() {
  const std::uint64_t most = most_bytes_ / ranks_.size();
  std::vector<std::vector<std::size_t>> cuts(outbox_.size());
  std::size_t times = 1;
  for (std::size_t k = 0; k < outbox_.size(); ++k) {
    std::size_t at = 0, begin = 0;
    while (at < outbox_[k].size()) {
      const std::size_t next = at + record_bytes(std::span(outbox_[k]).subspan(at));
      if (at > begin && next - begin > most) {
        cuts[k].push_back(at);
        begin = at;
      }
      at = next;
    }
    cuts[k].push_back(at);
    times = std::max(times, cuts[k].size());
  }
  for (const double other : ranks_.all_values(static_cast<double>(times))) {
    times = std::max(times, static_cast<std::size_t>(other));
  }
  for (std::size_t time = 0; time < times; ++time) {
    std::vector<std::vector<std::byte>> part(outbox_.size());
    for (std::size_t k = 0; k < outbox_.size(); ++k) {
      if (time >= cuts[k].size()) continue;
      const auto begin = outbox_[k].begin();
      part[k].assign(begin + static_cast<std::ptrdiff_t>(time == 0 ? 0 : cuts[k][time - 1]),
                     begin + static_cast<std::ptrdiff_t>(cuts[k][time]));
    }
    for (const auto& records : ranks_.exchange(part)) take(records);
  }
  for (auto& box : outbox_) box.clear();
}

void RankFill::run(AssemblyReport& report, ProgressSink& progress) {
  const std::uint32_t size = ranks_.size();
  const auto count = static_cast<std::uint32_t>(runs_.size());
  const TileSink sink = [&](std::size_t r, std::size_t c, std::span<const float> tile) {
    send(static_cast<std::uint32_t>(r), static_cast<std::uint32_t>(c), tile);
  };
  ProgressSink own;  // what this rank makes is a part of what is shown, by rounds
  for (std::uint32_t begin = 0; begin < count; begin += size) {
    // Later rows are shorter: what comes last in one round comes first in the next.
    const bool forward = begin / size % 2 == 0;
    const std::uint32_t mine = begin + (forward ? ranks_.rank() : size - 1 - ranks_.rank());
    agreed(ranks_, [&] {
      if (mine >= count) return;
      const Run& run = runs_[mine];
      send({run.first, run.end, maker_.make(run.first, run.end, sink, own)});
    });
    exchange();
    const std::uint32_t end = std::min(count, begin + size);
    for (std::uint32_t k = begin; k < end; ++k) {
      progress.advance(tiles_in_rows(runs_[k].first, runs_[k].end, blocks_));
    }
    if (store_ != nullptr) save_finished(end);
  }
  add_stored(report);
}

/// The panels, not saved yet, all of whose tile rows belong to the first `runs_done` runs: the same on every rank.
std::vector<std::uint32_t> RankFill::finished(std::uint32_t runs_done) {
  std::vector<std::uint32_t> out;
  const iff::Shape& shape = store_->shape();
  const std::uint32_t all_before = runs_done < runs_.size() ? runs_[runs_done].first : blocks_;
  for (; next_panel_ < shape.panels() && shape.end_tile_row(next_panel_) <= all_before; ++next_panel_) {
    if (!store_->kept(next_panel_)) out.push_back(next_panel_);
  }
  return out;
}

void RankFill::save_finished(std::uint32_t runs_done) {
  const std::vector<std::uint32_t> panels = finished(runs_done);
  if (panels.empty()) return;
  const iff::Shape& shape = store_->shape();
  std::vector<RankStore::Finished> own;
  for (const std::uint32_t panel : panels) {
    if (!shares_[ranks_.rank()].has(shape.first(panel))) continue;
    RankStore::Finished done{panel};
    done.facts.variance.resize(shape.variances(panel));
    for (const Facts& part : facts_) {
      if (part.first < shape.first_tile_row(panel) || part.first >= shape.end_tile_row(panel)) continue;
      done.facts.pairs_considered += part.facts.pairs_considered;
      done.facts.pairs_analytic += part.facts.pairs_analytic;
      done.facts.rays += part.facts.rays;
      const auto at = static_cast<std::ptrdiff_t>(tiles_in_rows(shape.first_tile_row(panel), part.first, blocks_));
      std::copy(part.facts.variance.begin(), part.facts.variance.end(), done.facts.variance.begin() + at);
    }
    own.push_back(std::move(done));
  }
  store_->save(rows_, own);
  if (store_->stop()) throw store_->interrupted();
}

/// What rank 0 knows of all tiles.
void RankFill::add_stored(AssemblyReport& report) const {
  if (store_ != nullptr) report.panels_reused = store_->kept_count();
  if (ranks_.rank() != 0) return;
  report.tile_variance.assign(tiles_in_rows(0, blocks_, blocks_), 0.0F);
  const auto add = [&](std::uint32_t first, const TileFacts& facts) {
    report.pairs_considered += facts.pairs_considered;
    report.pairs_analytic += facts.pairs_analytic;
    report.rays += facts.rays;
    report.trace_seconds += facts.trace_seconds / ranks_.size();
    const auto at = static_cast<std::ptrdiff_t>(tiles_in_rows(0, first, blocks_));
    std::copy(facts.variance.begin(), facts.variance.end(), report.tile_variance.begin() + at);
  };
  for (const Facts& part : facts_) add(part.first, part.facts);
  for (std::uint32_t panel = 0; store_ != nullptr && panel < store_->shape().panels(); ++panel) {
    if (store_->kept(panel)) add(store_->shape().first_tile_row(panel), store_->facts(panel));
  }
}

}  // namespace interflect
