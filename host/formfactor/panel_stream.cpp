#include "interflect/formfactor/panel_stream.h"

#include <fmt/format.h>

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"

namespace interflect {

namespace {

constexpr std::uint32_t most_buffers = 3;  // one that is worked on, two read ahead
constexpr std::uint32_t least_buffers = 2;

double mebibytes(std::uint64_t bytes) {
  return static_cast<double>(bytes) / (1 << 20);
}

}  // namespace

PanelStream::PanelStream(const ExchangePanels& panels, std::uint64_t memory) : panels_(panels) {
  const std::uint32_t count = panels.panels();
  const auto room =
      static_cast<std::uint32_t>(std::min<std::uint64_t>(count, memory / std::max<std::uint64_t>(1, panel_bytes())));
  if (room == count) {
    fitting_ = count;
  } else if (room < least_buffers) {
    throw Error(ErrorKind::limit,
                fmt::format("panels of the form factors have {:.1f} MiB, two of them must be in memory "
                            "at a time, and {:.1f} MiB may be used",
                            mebibytes(panel_bytes()), mebibytes(memory)));
  } else {
    slots_.resize(std::min(room, most_buffers));
    fitting_ = room - static_cast<std::uint32_t>(slots_.size());
  }
  stay_.resize(count);
  kept_ = fitting_;
}

std::uint64_t PanelStream::panel_bytes() const {
  return std::uint64_t{std::min(panels_.rows_per_panel(), panels_.size())} * panels_.stride() * sizeof(float);
}

std::uint64_t PanelStream::bytes() const {
  return std::uint64_t{panels_.size()} * panels_.stride() * sizeof(float);
}

void PanelStream::keep(std::uint32_t panels, std::uint32_t elsewhere) {
  elsewhere_ = elsewhere;
  kept_ = std::min(panels, fitting_);
  for (std::size_t k = kept_; k < stay_.size(); ++k) stay_[k] = nullptr;
  const std::uint32_t count = panels_.panels();
  if (fitting_ < count) return;  // there are buffers
  slots_.clear();
  slots_.resize(std::min(count - kept_, most_buffers));  // in the place of what went
}

std::uint64_t PanelStream::bytes_to_allocate() const {
  const auto missing = std::count(stay_.begin(), stay_.begin() + kept_, nullptr) +
                       std::count_if(slots_.begin(), slots_.end(), [](const Slot& s) { return s.memory == nullptr; });
  return static_cast<std::uint64_t>(missing) * panel_bytes();
}

/// Those that are in memory first, so that reading is ahead of the work from the start.
std::vector<std::uint32_t> PanelStream::order(std::uint32_t from, std::uint32_t end) {
  std::vector<std::uint32_t> all;
  for (std::uint32_t k = from; k < std::min<std::size_t>(end, stay_.size()); ++k) all.push_back(k);
  const auto streamed = std::stable_partition(all.begin(), all.end(), [&](std::uint32_t k) { return k < kept_; });
  std::stable_partition(all.begin(), streamed, [&](std::uint32_t k) { return stay_[k] != nullptr; });
  if (backwards_) std::reverse(streamed, all.end());
  backwards_ = !backwards_;
  return all;
}

/// The thread that reads, for one pass.
class PanelStream::Reader {
 public:
  Reader(PanelStream& stream, std::vector<std::uint32_t> order)
      : stream_(stream), order_(std::move(order)), thread_([this](const std::stop_token& stop) { run(stop); }) {}
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
  ~Reader() {
    thread_.request_stop();
    thread_.join();
    for (Slot& slot : stream_.slots_) slot.taken = false;
  }

  /// A panel that is there: waits for it. The number of its slot is given back by release().
  struct Found {
    std::uint32_t panel = 0;
    std::uint64_t bytes_read = 0;
    std::optional<std::size_t> slot = {};  ///< none: the panel stays
  };
  [[nodiscard]] Found next() {
    const Timer timer;
    std::unique_lock lock(mutex_);
    const bool waits = ready_.empty();
    changed_.wait(lock, [&] { return !ready_.empty() || error_ != nullptr; });
    if (waits) stream_.use_.seconds_waiting += timer.seconds();
    if (ready_.empty()) std::rethrow_exception(error_);
    const Found found = ready_.front();
    ready_.pop_front();
    stream_.use_.bytes_read += found.bytes_read;
    return found;
  }
  void release(std::size_t slot) {
    const std::lock_guard lock(mutex_);
    stream_.slots_[slot].taken = false;
    changed_.notify_all();
  }

 private:
  void run(const std::stop_token& stop) {
    try {
      for (const std::uint32_t panel : order_) {
        if (stop.stop_requested()) return;
        Found found{.panel = panel};
        if (panel < stream_.kept_) {
          found.bytes_read = fill_to_stay(panel);
        } else {
          found.slot = free_slot(stop, panel);
          if (!found.slot) return;
          found.bytes_read = fill(stream_.slots_[*found.slot], panel);
        }
        const std::lock_guard lock(mutex_);
        ready_.push_back(found);
        changed_.notify_all();
      }
    } catch (...) {
      const std::lock_guard lock(mutex_);
      error_ = std::current_exception();
      changed_.notify_all();
    }
  }

  /// Returns the bytes that were read, as the two below.
  std::uint64_t read(std::uint32_t panel, PageBuffer& to) {
    const std::size_t count = std::size_t{stream_.panels_.rows(panel)} * stream_.panels_.stride();
    stream_.panels_.read(panel, {reinterpret_cast<float*>(to.data()), count});
    return count * sizeof(float);
  }

  std::uint64_t fill_to_stay(std::uint32_t panel) {
    auto memory = std::make_shared<PageBuffer>(stream_.panel_bytes());
    const std::uint64_t bytes = read(panel, *memory);
    stream_.stay_[panel] = std::move(memory);
    return bytes;
  }

  /// Waits for a slot that nobody works on: the one that holds the panel already, or that was filled first.
  [[nodiscard]] std::optional<std::size_t> free_slot(const std::stop_token& stop, std::uint32_t panel) {
    const auto rank = [&](const Slot& slot) { return slot.panel == panel ? 0 : slot.filled + 1; };
    std::optional<std::size_t> found;
    std::unique_lock lock(mutex_);
    changed_.wait(lock, stop, [&] {
      for (std::size_t k = 0; k < stream_.slots_.size(); ++k) {
        const Slot& slot = stream_.slots_[k];
        if (!slot.taken && (!found || rank(slot) < rank(stream_.slots_[*found]))) found = k;
      }
      return found.has_value();
    });
    if (found) stream_.slots_[*found].taken = true;
    return found;
  }

  std::uint64_t fill(Slot& slot, std::uint32_t panel) {
    slot.filled = ++stream_.fillings_;
    if (slot.panel == panel) return 0;
    if (slot.memory == nullptr) slot.memory = std::make_shared<PageBuffer>(stream_.panel_bytes());
    slot.panel.reset();  // until it is read
    const std::uint64_t bytes = read(panel, *slot.memory);
    slot.panel = panel;
    return bytes;
  }

  PanelStream& stream_;
  std::vector<std::uint32_t> order_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<Found> ready_;
  std::exception_ptr error_;
  std::jthread thread_;  ///< goes first
};

void PanelStream::pass(const std::function<void(const View&)>& visit, std::uint32_t from, std::uint32_t end) {
  const std::vector<std::uint32_t> panels = order(from, end);
  const auto view = [&](std::uint32_t panel, std::shared_ptr<const PageBuffer> memory, bool stays) {
    return View{panel, panel * panels_.rows_per_panel(), panels_.rows(panel), std::move(memory), stays};
  };
  const auto in_memory = [&](std::uint32_t k) { return k < kept_ && stay_[k] != nullptr; };
  const auto to_read = std::find_if_not(panels.begin(), panels.end(), in_memory);
  ++use_.passes;
  if (to_read == panels.end()) {
    for (const std::uint32_t k : panels) visit(view(k, stay_[k], true));
    return;
  }
  Reader reader(*this, {to_read, panels.end()});
  for (auto k = panels.begin(); k != to_read; ++k) visit(view(*k, stay_[*k], true));
  for (auto k = to_read; k != panels.end(); ++k) {
    const Reader::Found found = reader.next();
    visit(view(found.panel, found.slot ? slots_[*found.slot].memory : stay_[found.panel], !found.slot));
    if (found.slot) reader.release(*found.slot);
  }
}

}  // namespace interflect
