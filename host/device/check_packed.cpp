#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <vector>

#include "interflect/device/check_tools.h"
#include "interflect/device/packed_reference.h"

// The kernels of the 16-bit formats: random tiles in random places against the reference, every buffer guarded.

namespace interflect::check {

namespace {

constexpr std::uint32_t most_columns = 24;

std::uint32_t ceil_div(std::uint32_t a, std::uint32_t b) {
  return (a + b - 1) / b;
}

/// The values' bits as floats, for a GuardedBuffer; halves go two by two.
template <class Value>
std::vector<float> as_floats(std::span<const Value> values) {
  std::vector<float> all((values.size_bytes() + sizeof(float) - 1) / sizeof(float));
  if (!values.empty()) std::memcpy(all.data(), values.data(), values.size_bytes());
  return all;
}

/// Halves of either sign: around 1, or of the smallest or the largest that there are.
enum class Range { normal, subnormal, large };
std::vector<Half> halves(Random& random, std::size_t count, Range range) {
  const float factor = range == Range::normal ? 1.0F : range == Range::subnormal ? 0x1p-16F : 0x1p15F;
  std::vector<Half> all(count);
  for (Half& value : all) value = to_half(random.next() * factor);
  return all;
}

std::string name_of(Range range) {
  return range == Range::normal ? "" : range == Range::subnormal ? " subnormal" : " large";
}

/// Columns of n numbers with zeros behind them up to the stride: what the kernel `scale` makes.
std::vector<float> scaled_columns(Random& random, std::uint32_t n, std::uint32_t stride, std::uint32_t columns) {
  std::vector<float> all;
  for (std::uint32_t c = 0; c < columns; ++c) {
    const std::vector<float> column = random.numbers(n);
    all.insert(all.end(), column.begin(), column.end());
    all.resize(std::size_t{c + 1} * stride);
  }
  return all;
}

std::uint32_t stride_of(std::uint32_t n) {
  return ceil_div(n, 16) * 16 + 16;
}

template <class Arguments>
void launch(Device& device, const Kernel& kernel, std::uint32_t groups, std::span<Buffer* const> buffers,
            const Arguments& arguments) {
  device.queue().launch(kernel, groups, buffers, std::as_bytes(std::span(&arguments, 1)), "Check 16 bits");
}

/// Written elements against their sums; all others must have kept their sentinel.
void compare_all(Finding& finding, const std::vector<float>& found, const std::vector<reference::Sum>& exact,
                 const std::vector<bool>& written) {
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (written[i]) {
      compare(finding, found[i], exact[i].value, exact[i].magnitude);
    } else if (!is_sentinel(found[i])) {
      finding.wrong = fmt::format("element {} is not the launch's, but was written", i);
    }
  }
}

/// Marks rows [first, end) of every column of `stride` elements.
std::vector<bool> rows_of(std::uint32_t columns, std::uint32_t stride, std::uint32_t first, std::uint32_t end) {
  std::vector<bool> marked(std::size_t{columns} * stride);
  for (std::size_t c = 0; c < columns; ++c) {
    std::fill(marked.begin() + static_cast<std::ptrdiff_t>(c * stride + first),
              marked.begin() + static_cast<std::ptrdiff_t>(c * stride + end), true);
  }
  return marked;
}

struct Shape {
  std::uint32_t n = 0, columns = 0;
  std::uint32_t first = 0, rows = 0;  ///< the panel
  std::uint32_t fill = 1;             ///< one tile in so many is there
  Range range = Range::normal;
};

Finding run_tiles16(Device& device, const Macros& macros, const Shape& s) {
  Random random(s.n * 2654435761U + s.columns + s.fill);
  TileArguments a{
      .n = s.n, .first = s.first, .strips = ceil_div(s.rows, tile_rows), .tiles = 0, .vector_stride = stride_of(s.n)};
  std::vector<std::uint32_t> index{0}, column;
  for (std::uint32_t strip = 0; strip < a.strips; ++strip) {
    for (std::uint32_t t = 0; t < ceil_div(s.n, tile_columns); ++t) {
      // The second strip stays empty; the random number's bits choose the others' tiles.
      if (s.fill > 1 && (strip == 1 || std::bit_cast<std::uint32_t>(random.next()) / 2 % s.fill != 0)) continue;
      column.push_back(t);
    }
    index.push_back(static_cast<std::uint32_t>(column.size()));
  }
  index.insert(index.end(), column.begin(), column.end());
  a.tiles = static_cast<std::uint32_t>(column.size());
  const std::vector<Half> tiles = halves(random, column.size() * tile_elements, s.range);
  const std::vector<float> x = scaled_columns(random, s.n, a.vector_stride, s.columns);
  const std::vector<float> scale = random.numbers(a.vector_stride);  // a row written past n shows
  std::vector<reference::Sum> exact(std::size_t{s.columns} * a.vector_stride);
  reference::tiles16(a, s.columns, tiles, index, x, scale, exact);
  const auto group = static_cast<std::uint32_t>(macros.at("STRIPS"));
  const auto kernel = device.kernel("tiles16", macros);
  const GuardedBuffer tiles_(device, as_floats(std::span<const Half>(tiles)));
  const GuardedBuffer index_(device, as_floats(std::span<const std::uint32_t>(index)));
  const GuardedBuffer x_(device, x), scale_(device, scale);
  const GuardedBuffer y(device, std::vector<float>(exact.size(), sentinel()));
  Buffer* const buffers[] = {tiles_.get(), index_.get(), x_.get(), scale_.get(), y.get()};
  launch(device, *kernel, ceil_div(a.strips, group), buffers, a);
  Finding finding;
  const std::uint32_t end = std::min(s.n, s.first + a.strips * tile_rows);
  compare_all(finding, y.values(device), exact, rows_of(s.columns, a.vector_stride, s.first, end));
  return finding;
}

/// A panel of blocks of F: all of the upper triangle's but every `skip`-th.
struct Symmetric {
  std::uint32_t n = 0, columns = 0, block = 0, fill = 1, skip = 1000;
  Range range = Range::normal;
};

struct SymmetricPanel {
  SymmetricArguments arguments;
  std::vector<std::uint32_t> index;
  std::vector<bool> written;  ///< of the partial sums
};

SymmetricPanel panel_of(Random& random, const Symmetric& s) {
  SymmetricPanel panel;
  SymmetricArguments& a = panel.arguments;
  a.block_rows = ceil_div(s.n, s.block);
  a.vector_stride = stride_of(s.n);
  const std::size_t slot = std::size_t{s.columns} * s.block;
  panel.written.resize(a.block_rows * a.block_rows * slot);
  std::vector<std::uint32_t> strips, begin{0}, column;
  for (std::uint32_t k = 0, i = 0; i < a.block_rows; ++i) {
    for (std::uint32_t j = i; j < a.block_rows; ++j, ++k) {
      if (k % s.skip == s.skip - 1) continue;
      const auto first = static_cast<std::uint32_t>(strips.size());
      const auto inside = [&](std::uint32_t b) { return std::min(s.block, s.n - b * s.block); };
      for (std::uint32_t strip = 0; strip < ceil_div(inside(i), tile_rows); ++strip) {
        const std::size_t before = column.size();
        for (std::uint32_t t = 0; t < ceil_div(inside(j), tile_columns); ++t) {
          if (s.fill == 1 || std::bit_cast<std::uint32_t>(random.next()) / 2 % s.fill == 0) column.push_back(t);
        }
        if (column.size() == before) continue;
        strips.push_back(strip);
        begin.push_back(static_cast<std::uint32_t>(column.size()));
      }
      panel.index.insert(panel.index.end(), {i, j, first, static_cast<std::uint32_t>(strips.size())});
      for (const std::size_t at : {std::size_t{i} * a.block_rows + j, std::size_t{j} * a.block_rows + i}) {
        std::fill_n(panel.written.begin() + static_cast<std::ptrdiff_t>(at * slot), slot, true);
      }
    }
  }
  a.blocks = static_cast<std::uint32_t>(panel.index.size() / 4);
  a.strips = static_cast<std::uint32_t>(strips.size());
  a.tiles = static_cast<std::uint32_t>(column.size());
  for (const auto* part : {&strips, &begin, &column}) panel.index.insert(panel.index.end(), part->begin(), part->end());
  return panel;
}

Finding run_sym16(Device& device, Macros macros, const Symmetric& s) {
  Random random(s.n * 2654435761U + s.columns + s.block + s.fill);
  const SymmetricPanel panel = panel_of(random, s);
  const std::vector<Half> tiles = halves(random, std::size_t{panel.arguments.tiles} * tile_elements, s.range);
  const std::vector<float> x = scaled_columns(random, s.n, panel.arguments.vector_stride, s.columns);
  std::vector<reference::Sum> exact(panel.written.size());
  reference::sym16(panel.arguments, s.columns, s.block, tiles, panel.index, x, exact);
  macros.insert_or_assign("BLOCK", static_cast<int>(s.block));
  const auto kernel = device.kernel("sym16", macros);
  const GuardedBuffer tiles_(device, as_floats(std::span<const Half>(tiles)));
  const GuardedBuffer index_(device, as_floats(std::span<const std::uint32_t>(panel.index)));
  const GuardedBuffer x_(device, x);
  const GuardedBuffer partial(device, std::vector<float>(exact.size(), sentinel()));
  Buffer* const buffers[] = {tiles_.get(), index_.get(), x_.get(), partial.get()};
  launch(device, *kernel, panel.arguments.blocks, buffers, panel.arguments);
  Finding finding;
  compare_all(finding, partial.values(device), exact, panel.written);
  return finding;
}

VectorArguments vector_arguments(const DeviceInfo& info, std::uint32_t n, std::uint32_t columns) {
  return {.n = n,
          .vector_stride = stride_of(n),
          .columns = columns,
          .blocks = ceil_div(n, reduction_block),
          .blocks_per_group = info.blocks_per_group};
}

std::uint32_t groups_of(const VectorArguments& a) {
  return ceil_div(a.columns * a.blocks, a.blocks_per_group);
}

Finding run_fold(Device& device, std::uint32_t n, std::uint32_t columns, std::uint32_t block) {
  Random random(n * 2654435761U + block);
  VectorArguments a = vector_arguments(device.info(), n, columns);
  a.option = block;
  a.slot = ceil_div(n, block);
  const std::vector<float> partial = random.numbers(std::size_t{a.slot} * a.slot * columns * block);
  const std::vector<float> scale = random.numbers(a.vector_stride);
  std::vector<reference::Sum> exact(std::size_t{columns} * a.vector_stride);
  reference::sym16_fold(a, partial, scale, exact);
  const GuardedBuffer partial_(device, partial), scale_(device, scale);
  const GuardedBuffer y(device, std::vector<float>(exact.size(), sentinel()));
  Buffer* const buffers[] = {partial_.get(), scale_.get(), y.get()};
  launch(device, *device.kernel("sym16_fold", {}), groups_of(a), buffers, a);
  Finding finding;
  compare_all(finding, y.values(device), exact, rows_of(columns, a.vector_stride, 0, n));
  return finding;
}

Finding run_scale(Device& device, std::uint32_t n, std::uint32_t columns) {
  Random random(n * 2654435761U);
  const VectorArguments a = vector_arguments(device.info(), n, columns);
  std::vector<float> x(std::size_t{columns} * a.vector_stride, sentinel());
  const std::vector<float> scale = random.numbers(a.vector_stride);
  std::vector<reference::Sum> exact(x.size());
  const std::vector<bool> written = rows_of(columns, a.vector_stride, 0, n);
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (!written[i]) continue;
    x[i] = random.next();
    const double product = static_cast<double>(x[i]) * static_cast<double>(scale[i % a.vector_stride]);
    exact[i] = {product, std::abs(product)};
  }
  const GuardedBuffer x_(device, x), scale_(device, scale);
  const GuardedBuffer out(device, std::vector<float>(x.size(), sentinel()));
  Buffer* const buffers[] = {x_.get(), scale_.get(), out.get()};
  launch(device, *device.kernel("scale", {}), groups_of(a), buffers, a);
  Finding finding;
  compare_all(finding, out.values(device), exact, written);
  return finding;
}

class Cases {
 public:
  Cases(Device& device, std::vector<KernelCheck>& rows, const Selection& selection)
      : device_(device), rows_(rows), selection_(selection) {}

  void tiles(const Shape& s) {
    if (!wanted("tiles16", s.n, s.columns)) return;
    add("tiles16", s.n, packed_bound(s.n),
        fmt::format("COLUMNS={} first={} rows={} fill=1/{}{}", s.columns, s.first, s.rows, s.fill, name_of(s.range)),
        [&, this] { return run_tiles16(device_, macros("tiles16", s.columns), s); });
  }
  void symmetric(Symmetric s) {
    if (!wanted("sym16", s.n, s.columns)) return;
    const Macros with = macros("sym16", s.columns);
    if (const auto block = with.find("BLOCK"); block != with.end()) s.block = static_cast<std::uint32_t>(block->second);
    add("sym16", s.n, sym16_bound(s.block),
        fmt::format("COLUMNS={} BLOCK={} fill=1/{} skip={}{}", s.columns, s.block, s.fill, s.skip, name_of(s.range)),
        [&, this] { return run_sym16(device_, with, s); });
  }
  void fold(std::uint32_t n, std::uint32_t columns, std::uint32_t block) {
    if (!wanted("sym16_fold", n, 0)) return;
    add("sym16_fold", n, rounding_bound(ceil_div(n, block) + 2), fmt::format("columns={} block={}", columns, block),
        [=, this] { return run_fold(device_, n, columns, block); });
  }
  void scale(std::uint32_t n, std::uint32_t columns) {
    if (!wanted("scale", n, 0)) return;
    add("scale", n, rounding_bound(1), fmt::format("columns={}", columns),
        [=, this] { return run_scale(device_, n, columns); });
  }

 private:
  [[nodiscard]] bool wanted(std::string_view kernel, std::uint32_t n, std::uint32_t columns) const {
    return n <= selection_.max_size && (selection_.kernel.empty() || selection_.kernel == kernel) &&
           (selection_.columns == 0 || columns == 0 || columns == selection_.columns);
  }
  [[nodiscard]] Macros macros(std::string_view kernel, std::uint32_t columns) const {
    return case_macros(device_.info(), kernel, selection_, columns);
  }
  void add(std::string_view kernel, std::uint64_t n, double bound, std::string parameters,
           const std::function<Finding()>& run) {
    KernelCheck row;
    row.kernel = kernel;
    row.size = n;
    row.bound = bound;
    row.parameters = std::move(parameters);
    add_case(rows_, std::move(row), run);
  }

  Device& device_;
  std::vector<KernelCheck>& rows_;
  const Selection& selection_;
};

void add_tiles(Cases& cases) {
  constexpr std::uint32_t fill = 3;
  for (const std::uint32_t n : {1U, 7U, 8U, 9U, 15U, 16U, 17U, 31U, 33U, 64U, 65U, 255U, 257U, 1025U, 1312U}) {
    for (const std::uint32_t columns : {1U, 3U, 4U, 5U, 7U, most_columns}) {
      if (n > 257 && columns != 3 && columns != 7 && n != 1025) continue;
      cases.tiles({.n = n, .columns = columns, .first = 0, .rows = n, .fill = 1});
      cases.tiles({.n = n, .columns = columns, .first = 0, .rows = n, .fill = fill});
    }
    // A panel from the middle to somewhere before the end.
    if (n > 16) cases.tiles({.n = n, .columns = 3, .first = 8, .rows = 8, .fill = fill});
    if (n > 40) cases.tiles({.n = n, .columns = 3, .first = 16, .rows = 24, .fill = fill});
  }
  for (const Range range : {Range::subnormal, Range::large}) {
    cases.tiles({.n = 100, .columns = 3, .first = 0, .rows = 100, .fill = 1, .range = range});
  }
  // Long rows, few of them: past the chunks into which a kernel cuts a row.
  for (const std::uint32_t n : {5791U, 17128U, 40000U}) {
    cases.tiles({.n = n, .columns = 3, .first = 0, .rows = 24, .fill = 1});
    cases.tiles({.n = n, .columns = 7, .first = 8, .rows = 8, .fill = fill});
    if (n == 5791) cases.tiles({.n = n, .columns = most_columns, .first = 8, .rows = 40, .fill = fill});
  }
}

}  // namespace

void check_packed(Device& device, std::vector<KernelCheck>& rows, const Selection& selection) {
  Cases cases(device, rows, selection);
  add_tiles(cases);
  for (const std::uint32_t n : {1U, 8U, 9U, 16U, 17U, 48U, 127U, 129U, 300U, 513U}) {
    for (const std::uint32_t columns : {1U, 3U, 7U}) {
      cases.symmetric({.n = n, .columns = columns, .block = 128, .fill = 1});
      cases.symmetric({.n = n, .columns = columns, .block = 128, .fill = 4, .skip = 2});
    }
    if (n <= 129) cases.symmetric({.n = n, .columns = 3, .block = 16, .fill = 2, .skip = 3});
    cases.symmetric({.n = n, .columns = 3, .block = 256, .fill = 3});
    if (n == 129 || n == 513) cases.symmetric({.n = n, .columns = most_columns, .block = 128, .fill = 4, .skip = 2});
  }
  for (const std::uint32_t columns : {3U, 4U, most_columns}) {
    cases.symmetric({.n = 1500, .columns = columns, .block = 1024, .fill = 5});
  }
  cases.symmetric({.n = 1030, .columns = 3, .block = 1024, .fill = 1});
  for (const Range range : {Range::subnormal, Range::large}) {
    cases.symmetric({.n = 200, .columns = 3, .block = 128, .fill = 2, .range = range});
  }
  for (const std::uint32_t n : {1U, 15U, 17U, 300U, 1024U, 1025U, 5791U}) {
    cases.scale(n, 3);
    for (const std::uint32_t block : {16U, 128U, 1024U}) {
      if (n < 100 * block) cases.fold(n, block == 128 ? 7 : 3, block);
    }
  }
}

}  // namespace interflect::check
