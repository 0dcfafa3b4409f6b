#include "interflect/formfactor/rank_store.h"

#include <fcntl.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace interflect {

namespace {

/// What the other ranks must know of rank 0's file.
struct Front {
  iff::HeaderBytes header;
  std::uint64_t name_length;
};

template <class T>
std::span<T> one(T& value) {
  return std::span(&value, 1);
}

}  // namespace

RankStore::RankStore(Ranks& ranks, const std::filesystem::path& file, const iff::Shape& wanted,
                     const IffStore::Options& options)
    : ranks_(ranks), options_(options) {
  Front front{};
  agreed(ranks, [&] {
    if (ranks.rank() != 0) return;
    front_.emplace(file, wanted, options);
    name_ = front_->worked_on();
    table_ = front_->table();
    front = {iff::header_of(front_->shape()), name_.size()};
  });
  ranks.broadcast_values(one(front));
  shape_ = iff::shape_of(front.header, name_);
  seed_ = iff::seed_of(shape_);
  name_.resize(front.name_length);
  ranks.broadcast_values(std::span(name_));
  table_.resize(shape_.panels());
  ranks.broadcast_values(std::span(table_));
  shares_ = row_shares(shape_.n, ranks.size(), shape_.rows_per_panel);
  kept_.assign(shape_.panels(), false);
  agreed(ranks, [&] {
    reading_ = Descriptor(::open(name_.c_str(), O_RDONLY | O_CLOEXEC));
    if (!reading_) throw file_error(name_, "open", errno);
  });
  writing_ = ranks.open(name_);
}

std::uint32_t RankStore::kept_count() const {
  return static_cast<std::uint32_t>(std::count(kept_.begin(), kept_.end(), true));
}

TileFacts RankStore::facts(std::uint32_t panel) const {
  const iff::EntryBytes& entry = table_.at(panel);
  TileFacts facts{entry.pairs, entry.analytic, entry.rays, 0, std::vector<float>(shape_.variances(panel))};
  const auto bytes = std::as_writable_bytes(std::span(facts.variance));
  if (!iff::valid(entry, panel, seed_) || !read_at(reading_, name_, shape_.variance_offset(panel), bytes) ||
      iff::checksum(bytes) != entry.variance_checksum) {
    throw input_error(name_, 0, iff::panel_name(shape_, panel) + ": checksum differs");
  }
  return facts;
}

/// Reads the own panels; those that are not sound count as not there.
void RankStore::verify(FormFactorMatrix& rows) {
  std::vector<float> panel_rows(shape_.panel_bytes(0) / sizeof(float));
  std::vector<std::byte> mine, all(shape_.panels());
  const RowShare& share = shares_[ranks_.rank()];
  for (std::uint32_t panel = share.first / shape_.rows_per_panel; shape_.first(panel) < share.end; ++panel) {
    const auto whole = std::span(panel_rows).first(shape_.panel_bytes(panel) / sizeof(float));
    bool sound = iff::valid(table_[panel], panel, seed_) &&
                 read_at(reading_, name_, shape_.panel_offset(panel), std::as_writable_bytes(whole)) &&
                 iff::checksum(std::as_bytes(whole)) == table_[panel].rows_checksum;
    try {
      if (sound) static_cast<void>(facts(panel));
    } catch (const Error&) {
      sound = false;
    }
    mine.push_back(static_cast<std::byte>(sound ? 1 : 0));
    for (std::uint32_t k = 0; sound && k < shape_.rows(panel); ++k) {
      const auto row = whole.subspan(std::size_t{k} * shape_.stride(), shape_.n);
      std::copy(row.begin(), row.end(), rows.row(shape_.first(panel) + k).begin());
    }
  }
  std::vector<std::uint64_t> counts;
  for (const RowShare& other : shares_) {
    counts.push_back((other.end - other.first + shape_.rows_per_panel - 1) / shape_.rows_per_panel);
  }
  ranks_.all_gather(mine, counts, all);
  for (std::uint32_t panel = 0; panel < kept_.size(); ++panel) kept_[panel] = all[panel] != std::byte{0};
}

/// S is symmetric to the bit: the columns of panels that lie before one's rows come from there.
void RankStore::mirror(FormFactorMatrix& rows) const {
  const RowShare& share = shares_[ranks_.rank()];
  std::vector<float> part;
  for (std::uint32_t panel = 0; panel < kept_.size(); ++panel) {
    const std::uint32_t first = shape_.first(panel), count = shape_.rows(panel);
    const std::uint32_t from = std::max(share.first, first + count);
    if (!kept_[panel] || from >= share.end) continue;
    part.resize(share.end - from);
    for (std::uint32_t k = 0; k < count; ++k) {
      const std::uint64_t offset = shape_.panel_offset(panel) + k * shape_.row_bytes() + from * sizeof(float);
      if (!read_at(reading_, name_, offset, std::as_writable_bytes(std::span(part)))) {
        throw input_error(name_, 0, "ends within " + iff::panel_name(shape_, panel));
      }
      for (std::uint32_t j = from; j < share.end; ++j) rows.row(j)[first + k] = part[j - from];
    }
  }
}

void RankStore::load(FormFactorMatrix& rows) {
  verify(rows);
  agreed(ranks_, [&] { mirror(rows); });
}

void RankStore::save(const FormFactorMatrix& rows, std::span<const Finished> panels) {
  std::vector<iff::EntryBytes> entries;
  agreed(ranks_, [&] {
    std::vector<float> whole(panels.empty() ? 0 : shape_.panel_bytes(0) / sizeof(float));
    for (const Finished& finished : panels) {
      const auto part = std::span(whole).first(shape_.panel_bytes(finished.panel) / sizeof(float));
      for (std::uint32_t k = 0; k < shape_.rows(finished.panel); ++k) {
        const auto row = rows.row(shape_.first(finished.panel) + k);
        const auto to = part.subspan(std::size_t{k} * shape_.stride(), shape_.stride());
        std::fill(std::copy(row.begin(), row.end(), to.begin()), to.end(), 0.0F);
      }
      const auto variance = std::as_bytes(std::span(finished.facts.variance));
      writing_->write_at(shape_.panel_offset(finished.panel), std::as_bytes(part));
      writing_->write_at(shape_.variance_offset(finished.panel), variance);
      entries.push_back(iff::finished_entry(finished.panel, std::as_bytes(part), finished.facts, seed_));
    }
  });
  writing_->sync();
  std::vector<std::vector<std::byte>> to(ranks_.size());
  const auto bytes = std::as_bytes(std::span(entries));
  to[0].assign(bytes.begin(), bytes.end());
  const auto from = ranks_.exchange(to);
  agreed(ranks_, [&] {
    for (std::size_t k = 0; front_ && k < from.size(); ++k) {
      std::vector<iff::EntryBytes> there(from[k].size() / sizeof(iff::EntryBytes));
      if (!there.empty()) std::memcpy(there.data(), from[k].data(), from[k].size());
      for (const iff::EntryBytes& entry : there) front_->take(entry);
    }
  });
}

bool RankStore::stop() {
  return ranks_.rank_zeros(options_.stop && options_.stop());
}

AgreedError RankStore::interrupted() {
  const std::vector<std::string> texts = ranks_.all_texts(front_ ? front_->how_to_go_on() : "");
  return {ErrorKind::interrupted, texts.front()};
}

void RankStore::finish(const IffClosing& closing) {
  writing_.reset();
  agreed(ranks_, [&] {
    if (front_) front_->finish(closing);
  });
}

}  // namespace interflect
