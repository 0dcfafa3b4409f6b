#include "interflect/schedule/device_tile_maker.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <exception>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/schedule/device_assembly.h"

namespace interflect {

namespace {

constexpr std::size_t block = PatchTable::block;
constexpr std::uint64_t largest_run = std::uint64_t{256} << 20;  // bytes of S on the device at a time

/// The caller's stage goes on: a run of rows neither begins nor ends one. Of `all` tiles only those that something can
/// see are counted as they are done, the rest at the end.
class PartOfStage final : public ProgressSink {
 public:
  PartOfStage(ProgressSink& outer, std::uint64_t all) : outer_(outer), left_(all) {}
  void advance(std::uint64_t steps) override {
    outer_.advance(std::min(steps, left_));
    left_ -= std::min(steps, left_);
  }
  void message(std::string_view line) override { outer_.message(line); }
  void finish() { advance(left_); }

 private:
  ProgressSink& outer_;
  std::uint64_t left_;
};

/// Hands out the tiles of rows [first, end) from S by rows, those that are not all 0.
void hand_out(const std::vector<float>& s, std::size_t stride, std::size_t n, std::size_t first, std::size_t end,
              std::size_t blocks, const TileSink& sink) {
  std::exception_ptr failure;
#pragma omp parallel for schedule(dynamic, 1)
  for (std::size_t r = first; r < end; ++r) {
    std::array<float, block * block> tile;  // NOLINT: written before it is read
    try {
      for (std::size_t c = r; c < blocks; ++c) {
        const std::size_t height = std::min(block, n - r * block), width = std::min(block, n - c * block);
        tile.fill(0);
        bool any = false;
        for (std::size_t a = 0; a < height; ++a) {
          const float* row = s.data() + ((r - first) * block + a) * stride + c * block;
          std::copy_n(row, width, tile.begin() + static_cast<std::ptrdiff_t>(a * block));
          any = any || std::any_of(row, row + width, [](float value) { return value != 0; });
        }
        if (any) sink(r, c, tile);
      }
    } catch (...) {  // no exception may leave the region
#pragma omp critical(interflect_device_tile_maker)
      failure = std::current_exception();
    }
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace

TileFacts DeviceTileMaker::make(std::size_t first, std::size_t end, const TileSink& sink, ProgressSink& progress) {
  const std::size_t n = patches_.size, stride = (n + 15) / 16 * 16, blocks = patches_.blocks();
  const std::uint64_t largest = device_.info().max_buffer_bytes, tile_row_bytes = block * stride * sizeof(float);
  const std::uint64_t most = (largest == 0 ? largest_run : std::min(largest_run, largest)) / tile_row_bytes;
  if (most == 0) {
    throw Error(ErrorKind::limit,
                fmt::format("{}: {} rows of the form factors have {} bytes, the device's largest buffer {}; use fewer "
                            "patches, another device, or --assembly host",
                            device_.info().id, block, tile_row_bytes, largest));
  }
  TileFacts facts;
  std::vector<float> s;
  for (std::size_t begin = first; begin < end; begin += most) {
    const std::size_t stop = std::min(end, begin + most), rows = std::min(n, stop * block) - begin * block;
    const auto there = device_.allocate(rows * stride * sizeof(float));
    const DevicePanel panel{static_cast<std::uint32_t>(begin * block), static_cast<std::uint32_t>(rows), there.get()};
    PartOfStage part(progress, tiles_in_rows(begin, stop, blocks));
    const DeviceAssemblyFacts made = assemble_on(device_, patches_, blockers_, budget_, seed_, std::span(&panel, 1),
                                                 static_cast<std::uint32_t>(stride), static_cast<std::uint32_t>(begin),
                                                 static_cast<std::uint32_t>(stop), part);
    s.resize(rows * stride);
    device_.queue().download(*there, 0, std::as_writable_bytes(std::span(s)));
    hand_out(s, stride, n, begin, stop, blocks, sink);
    part.finish();
    facts.pairs_considered += made.pairs_considered;
    facts.pairs_analytic += made.pairs_analytic;
    facts.rays += made.rays;
    facts.variance.insert(facts.variance.end(), made.tile_variance.begin(), made.tile_variance.end());
  }
  return facts;
}

}  // namespace interflect
