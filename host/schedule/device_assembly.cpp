#include "interflect/schedule/device_assembly.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <functional>
#include <map>
#include <numeric>
#include <string_view>
#include <utility>

#include "interflect/base/timer.h"
#include "interflect/device/hierarchy.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/kernel_table.h"
#include "interflect/schedule/device_tiles.h"

namespace interflect {

namespace {

constexpr double lift_of_extent = 2e-6;  // PairTile's
constexpr std::uint64_t scratch_bytes = std::uint64_t{128} << 20U;
constexpr std::uint32_t pairs_of_tile = assembly::tile_pairs;

std::uint32_t ceil_div(std::uint32_t a, std::uint32_t b) {
  return (a + b - 1) / b;
}

/// Items that are given to a device at a time, after how long the last ones took.
class Pace {
 public:
  Pace(double seconds, std::uint32_t first, std::uint32_t most) : seconds_(seconds), items_(first), most_(most) {}
  [[nodiscard]] std::uint32_t items() const { return std::min(items_, most_); }
  void took(std::uint32_t items, double seconds) {
    if (items < items_ / 2) return;  // the end of something: says little
    const double ratio = std::clamp(seconds_ / std::max(seconds, 1e-6), 0.25, 4.0);
    items_ = static_cast<std::uint32_t>(std::clamp(static_cast<double>(items) * ratio, 1.0, 1e9));
  }
  void halve(std::uint32_t items) { items_ = std::max(1U, items / 2); }

 private:
  double seconds_;
  std::uint32_t items_, most_;
};

}  // namespace

class DeviceAssembly::Impl {
 public:
  Impl(Device& device, const PatchTable& patches, const Blockers& blockers, const RayBudget& budget, std::uint64_t seed,
       const DevicePace& pace)
      : device_(device), queue_(device.queue()), table_(patches), blockers_(blockers), pace_(pace) {
    const Hierarchy hierarchy(blockers.vertices(), blockers.triangles());
    arguments_.n = static_cast<std::uint32_t>(patches.size);
    arguments_.pilot_per_factor = budget.pilot_per_factor;
    arguments_.rays_per_factor = budget.rays_per_factor;
    arguments_.most_in_pilot = budget.most_in_pilot;
    arguments_.fewest = budget.fewest_when_mixed;
    arguments_.most = budget.most;
    arguments_.split_from = budget.split_from;
    arguments_.three2 = budget.ratios.three_points * budget.ratios.three_points;
    arguments_.six2 = budget.ratios.six_points * budget.ratios.six_points;
    arguments_.three_error2 = budget.three_points_error * budget.three_points_error;
    arguments_.six_error2 = budget.six_points_error * budget.six_points_error;
    arguments_.lift = static_cast<float>(lift_of_extent * patches.extent);
    reserve();
    patches_ = uploaded<std::uint32_t>(device_patches(patches, seed));
    nodes_ = uploaded(hierarchy.nodes());
    leaves_ = uploaded(hierarchy.leaves());
    for (const char* name : {"tile_kinds", "tile_special", "tile_pilot", "tile_rays", "tile_shares", "tile_mixed",
                             "tile_pieces", "tile_finish", "tile_store"}) {
      kernels_.emplace(name, device.kernel(name, default_macros(device.info(), name)));
    }
    queue_.wait();
  }

  /// Takes the S of a batch, which the device has finished.
  using Taker = std::function<void(std::span<const DeviceTile>)>;
  [[nodiscard]] DeviceAssemblyFacts run(std::size_t first, std::size_t end, const Taker& take, ProgressSink& progress);

  /// Of the batch at hand, into the rows of the panel.
  void store(const DevicePanel& panel, std::uint32_t stride);
  void download(std::span<float> s) const {
    queue_.download(*work_, assembly::counters * sizeof(float), std::as_writable_bytes(s));
  }

 private:
  using Counters = std::array<std::uint32_t, assembly::counters>;

  void reserve();
  [[nodiscard]] bool compute(std::span<const DeviceTile> tiles);
  [[nodiscard]] bool trace(std::uint32_t pairs);
  [[nodiscard]] bool trace_listed(std::uint32_t counter);
  void trace_items(std::uint32_t option, std::uint32_t items, Pace& pace);
  void launch(const char* name, std::uint32_t items, std::uint32_t option = 0, std::uint32_t first = 0,
              Buffer* panel = nullptr);
  [[nodiscard]] Counters counters() const {
    Counters all{};
    queue_.download(*work_, 0, std::as_writable_bytes(std::span(all)));
    return all;
  }
  template <class T>
  [[nodiscard]] std::unique_ptr<Buffer> uploaded(std::span<const T> values) {
    auto buffer = device_.allocate(values.size_bytes());
    queue_.upload(*buffer, 0, std::as_bytes(values));
    return buffer;
  }
  template <class T>
  [[nodiscard]] std::unique_ptr<Buffer> uploaded(const std::vector<T>& values) {
    return uploaded(std::span<const T>(values));
  }

  Device& device_;
  Queue& queue_;
  const PatchTable& table_;
  const Blockers& blockers_;
  DevicePace pace_;
  AssemblyArguments arguments_;
  std::map<std::string_view, std::unique_ptr<Kernel>> kernels_;
  std::unique_ptr<Buffer> patches_, nodes_, leaves_, tiles_, work_, extra_;
  std::uint32_t most_tiles_ = 0;
  Pace pilot_{0, 0, 0}, listed_{0, 0, 0}, batches_{0, 0, 0};
};

/// Scratch for batches of tiles: half for the pairs, half for lists of rays, at least what one tile may need.
void DeviceAssembly::Impl::reserve() {
  const std::uint64_t bytes = std::min(scratch_bytes, device_.info().max_buffer_bytes);
  const std::uint64_t of_tile = assembly::work_words(1) * 4;
  most_tiles_ = static_cast<std::uint32_t>(std::max<std::uint64_t>(1, bytes / of_tile));
  if (pace_.most_tiles != 0) most_tiles_ = std::min(most_tiles_, pace_.most_tiles);
  // The counter of a list goes on where there is no room, and has 32 bits for the rays of all pairs of a batch, whole
  // or in pieces that each begin a chunk.
  const std::uint64_t listed_of_pair = arguments_.most / assembly::chunk_rays + assembly::cut_pieces;
  const std::uint64_t countable = 0xFFFFFFFFU / (pairs_of_tile * listed_of_pair);
  most_tiles_ = static_cast<std::uint32_t>(std::clamp<std::uint64_t>(countable, 1, most_tiles_));
  arguments_.cuts = 4 * pairs_of_tile;
  const std::uint64_t cut_bytes = assembly::extra_words(0, arguments_.cuts) * 4;
  const std::uint64_t room = bytes > 2 * cut_bytes ? bytes - cut_bytes : 0;
  arguments_.chunks = static_cast<std::uint32_t>(room / (assembly::chunk_words * 4));
  if (arguments_.chunks < 64 * pairs_of_tile) {
    refuse(device_.info().id, "assembly", fmt::format("its largest buffer is {} bytes", bytes));
  }
  if (pace_.most_chunks != 0) arguments_.chunks = std::min(arguments_.chunks, pace_.most_chunks);
  tiles_ = device_.allocate(std::size_t{most_tiles_} * sizeof(DeviceTile));
  work_ = device_.allocate(assembly::work_words(most_tiles_) * 4);
  extra_ = device_.allocate(assembly::extra_words(arguments_.chunks, arguments_.cuts) * 4);
  pilot_ = Pace(pace_.launch_seconds, 4096, 1U << 30U);
  listed_ = Pace(pace_.launch_seconds, 1024, 1U << 30U);
  batches_ = Pace(pace_.launch_seconds, pace_.first_tiles, most_tiles_);
}

void DeviceAssembly::Impl::launch(const char* name, std::uint32_t items, std::uint32_t option, std::uint32_t first,
                                  Buffer* panel) {
  if (items == 0) return;
  const DeviceInfo& info = device_.info();
  // lavapipe ends an invocation's loops after 65,535 rounds in all, and a pair may have 8,192 chunks to list or add up.
  const bool long_lists = arguments_.most > RayBudget{}.most;
  const std::uint32_t of_group = !info.emulated() ? 256 : long_lists ? 8 : 64;
  AssemblyArguments arguments = arguments_;
  arguments.option = option;
  Buffer* const buffers[] = {patches_.get(), tiles_.get(), work_.get(), extra_.get(), panel, nullptr};
  Buffer* rays[] = {patches_.get(), tiles_.get(), work_.get(), extra_.get(), nodes_.get(), leaves_.get()};
  const bool traces = name == std::string_view("tile_rays");
  const auto bound = traces ? std::span<Buffer* const>(rays) : std::span(buffers).first(panel == nullptr ? 4 : 5);
  const std::uint64_t most = std::uint64_t{info.max_groups} * of_group;
  while (items > 0) {
    arguments.first = first;
    arguments.items = static_cast<std::uint32_t>(std::min<std::uint64_t>(items, most));
    queue_.launch(*kernels_.at(name), ceil_div(arguments.items, of_group), bound,
                  std::as_bytes(std::span(&arguments, 1)), "Assemble");
    first += arguments.items;
    items -= arguments.items;
  }
}

/// Rays in launches of a bounded time.
void DeviceAssembly::Impl::trace_items(std::uint32_t option, std::uint32_t items, Pace& pace) {
  for (std::uint32_t first = 0; first < items;) {
    const std::uint32_t count = std::min(pace.items(), items - first);
    queue_.wait();
    const Timer timer;
    launch("tile_rays", count, option, first);
    queue_.wait();
    pace.took(count, timer.seconds());
    first += count;
  }
}

bool DeviceAssembly::Impl::trace_listed(std::uint32_t counter) {
  const std::uint32_t chunks = counters()[counter];
  if (chunks > arguments_.chunks) return false;
  trace_items(1, chunks, listed_);
  return true;
}

bool DeviceAssembly::Impl::trace(std::uint32_t pairs) {
  launch("tile_pilot", pairs);
  trace_items(0, pairs, pilot_);
  if (!trace_listed(assembly::chunks)) return false;
  launch("tile_shares", arguments_.tiles * pairs_of_tile);
  launch("tile_mixed", pairs);
  const std::uint32_t cuts = counters()[assembly::cuts];
  if (cuts > arguments_.cuts) return false;
  launch("tile_pieces", cuts * assembly::cut_pieces);
  if (!trace_listed(assembly::chunks + 1)) return false;
  launch("tile_shares", pairs, 1);
  return true;
}

/// S of a batch; false: it needs more room for rays than there is.
bool DeviceAssembly::Impl::compute(std::span<const DeviceTile> tiles) {
  arguments_.tiles = static_cast<std::uint32_t>(tiles.size());
  const auto traced = static_cast<std::uint32_t>(
      std::count_if(tiles.begin(), tiles.end(), [](const DeviceTile& t) { return t.row >= assembly::traced_bit; }));
  queue_.upload(*tiles_, 0, std::as_bytes(tiles));
  const Counters zeros{};
  queue_.upload(*work_, 0, std::as_bytes(std::span(zeros)));
  launch("tile_kinds", arguments_.tiles * assembly::block);
  const Counters lists = counters();
  for (std::uint32_t list = 0; list < 3; ++list) launch("tile_special", lists[assembly::lists + list], list);
  if (traced == 0) {
    launch("tile_shares", arguments_.tiles * pairs_of_tile);
  } else if (!trace(traced * pairs_of_tile)) {
    return false;
  }
  launch("tile_finish", arguments_.tiles * assembly::block);
  return true;
}

void DeviceAssembly::Impl::store(const DevicePanel& panel, std::uint32_t stride) {
  arguments_.panel_first = panel.first;
  arguments_.panel_rows = panel.rows;
  arguments_.panel_stride = stride;
  launch("tile_store", arguments_.tiles * pairs_of_tile, 0, 0, panel.buffer);
}

DeviceAssemblyFacts DeviceAssembly::Impl::run(std::size_t first, std::size_t end, const Taker& take,
                                              ProgressSink& progress) {
  const Timer timer;
  const std::uint64_t blocks = table_.blocks(), all = tiles_in_rows(first, end, blocks);
  DeviceAssemblyFacts facts;
  facts.tile_variance.resize(all);
  const std::vector<DeviceTile> tiles =
      device_tiles(table_, blockers_, static_cast<double>(arguments_.lift), static_cast<std::uint32_t>(first),
                   static_cast<std::uint32_t>(end));
  progress.advance(all - tiles.size());
  std::vector<float> rows;
  std::vector<DeviceTile> batch;
  for (std::size_t done = 0; done < tiles.size();) {
    const std::size_t count = std::min<std::size_t>(batches_.items(), tiles.size() - done);
    const auto from = tiles.begin() + static_cast<std::ptrdiff_t>(done);
    batch.assign(from, from + static_cast<std::ptrdiff_t>(count));
    // Tiles that need rays first, so that the others' pairs are not looked at.
    std::stable_partition(batch.begin(), batch.end(),
                          [](const DeviceTile& t) { return t.row >= assembly::traced_bit; });
    const Timer of_batch;
    if (!compute(batch)) {
      if (count == 1) {
        refuse(device_.info().id, "assembly",
               "no room for the rays of a single tile: use a coarser --accuracy, or --assembly host");
      }
      batches_.halve(static_cast<std::uint32_t>(count));
      continue;
    }
    take(batch);
    rows.resize(count * assembly::block);
    const std::uint64_t behind = assembly::counters + std::uint64_t{count} * pairs_of_tile * assembly::sections;
    queue_.download(*work_, behind * sizeof(float), std::as_writable_bytes(std::span(rows)));
    const Counters found = counters();
    batches_.took(static_cast<std::uint32_t>(count), of_batch.seconds());
    facts.pairs_considered += found[assembly::considered];
    facts.pairs_analytic += found[assembly::analytic];
    facts.rays += found[assembly::rays];
    for (std::size_t t = 0; t < count; ++t) {
      const std::uint64_t r = batch[t].row & ~assembly::traced_bit, place = tiles_in_rows(first, r, blocks);
      facts.tile_variance[place + batch[t].column - r] =
          std::accumulate(rows.begin() + static_cast<std::ptrdiff_t>(t * assembly::block),
                          rows.begin() + static_cast<std::ptrdiff_t>((t + 1) * assembly::block), 0.0F);
    }
    progress.advance(count);
    done += count;
  }
  facts.seconds = timer.seconds();
  return facts;
}

DeviceAssembly::DeviceAssembly(Device& device, const PatchTable& patches, const Blockers& blockers,
                               const RayBudget& budget, std::uint64_t seed, const DevicePace& pace)
    : impl_(std::make_unique<Impl>(device, patches, blockers, budget, seed, pace)) {}

DeviceAssembly::~DeviceAssembly() = default;

TileFacts DeviceAssembly::make(std::size_t first, std::size_t end, const TileSink& sink, ProgressSink& progress) {
  std::vector<float> s;
  const auto give = [&](std::span<const DeviceTile> tiles) {
    s.resize(tiles.size() * pairs_of_tile);
    impl_->download(s);
    downloaded_bytes_ += s.size() * sizeof(float);
    std::exception_ptr failure;
    // Of few tiles by this thread alone: others would take cores from a CPU device while they wait for more.
#pragma omp parallel for schedule(dynamic, 8) if (tiles.size() >= 1024)
    for (std::size_t t = 0; t < tiles.size(); ++t) {
      const auto of_tile = std::span<const float>(s).subspan(t * pairs_of_tile, pairs_of_tile);
      if (std::all_of(of_tile.begin(), of_tile.end(), [](float x) { return x == 0; })) continue;
      try {
        sink(tiles[t].row & ~assembly::traced_bit, tiles[t].column, of_tile);
      } catch (...) {  // no exception may leave the region
#pragma omp critical(interflect_device_assembly)
        failure = std::current_exception();
      }
    }
    if (failure) std::rethrow_exception(failure);
  };
  DeviceAssemblyFacts facts = impl_->run(first, end, give, progress);
  return {.pairs_considered = facts.pairs_considered,
          .pairs_analytic = facts.pairs_analytic,
          .rays = facts.rays,
          .trace_seconds = 0,
          .variance = std::move(facts.tile_variance)};
}

DeviceAssemblyFacts DeviceAssembly::into(std::span<const DevicePanel> panels, std::uint32_t stride, std::size_t first,
                                         std::size_t end, ProgressSink& progress) {
  const auto store = [&](std::span<const DeviceTile>) {
    for (const DevicePanel& panel : panels) impl_->store(panel, stride);
  };
  return impl_->run(first, end, store, progress);
}

DeviceAssemblyFacts assemble_on(Device& device, const PatchTable& patches, const Blockers& blockers,
                                const RayBudget& budget, std::uint64_t seed, std::span<const DevicePanel> panels,
                                std::uint32_t stride, std::uint32_t first_row_block, std::uint32_t end_row_block,
                                ProgressSink& progress, const DevicePace& pace) {
  const Timer timer;
  DeviceAssembly assembly(device, patches, blockers, budget, seed, pace);
  DeviceAssemblyFacts facts = assembly.into(panels, stride, first_row_block, end_row_block, progress);
  facts.seconds = timer.seconds();
  return facts;
}

}  // namespace interflect
