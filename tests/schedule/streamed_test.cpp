// F x over panels that memory holds a part of, against the matrix in memory.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <limits>

#include "formfactor/panels.h"
#include "interflect/device/check.h"
#include "interflect/schedule/scheduler.h"
#include "schedule/counting_device.h"

namespace interflect {
namespace {

using namespace test;
using ::testing::HasSubstr;

struct System {
  explicit System(std::uint32_t n, std::uint32_t rows = 32)
      : panels(n, rows, wavy_element), area(n), d(n), x(3, std::vector<float>(n)) {
    for (std::uint32_t i = 0; i < n; ++i) {
      area[i] = 0.3 + 0.2 * std::cos(i);
      d[i] = 1 + 0.3 * std::sin(5 * i);
      for (std::size_t c = 0; c < x.size(); ++c) x[c][i] = std::cos(static_cast<float>(i + 11 * c));
    }
  }
  [[nodiscard]] StreamedMatrix streamed(std::uint64_t panels_in_memory) const {
    return {panels, area, d, panels_in_memory * panels.panel_bytes()};
  }
  /// F_ij = S_ij (d_i / A_i) d_j as a matrix.
  [[nodiscard]] FormFactorMatrix dense() const {
    FormFactorMatrix f(panels.size());
    for (std::uint32_t i = 0; i < panels.size(); ++i) {
      for (std::uint32_t j = 0; j < panels.size(); ++j) f.row(i)[j] = panels.at(i, j);
    }
    Scaling scaling;
    scaling.d = d;
    make_form_factors(f, area, scaling);
    return f;
  }
  MemoryPanels panels;
  std::vector<double> area, d;
  Columns x;
};

Columns product_of(Scheduler& scheduler, const Columns& x, int times = 1) {
  Vector in = scheduler.vector(), out = scheduler.vector();
  scheduler.upload(in, x);
  for (int k = 0; k < times; ++k) scheduler.apply(in, out);
  Columns y;
  scheduler.download(out, y);
  return y;
}

/// The largest |y - F x| / Σ_j |F_ij x_j|, F formed in double.
double error_of(const System& system, const Columns& y) {
  double largest = 0;
  for (std::size_t c = 0; c < y.size(); ++c) {
    for (std::uint32_t i = 0; i < system.panels.size(); ++i) {
      double sum = 0, magnitude = 0;
      for (std::uint32_t j = 0; j < system.panels.size(); ++j) {
        const double term = static_cast<double>(system.panels.at(i, j)) * system.d[i] / system.area[i] * system.d[j] *
                            static_cast<double>(system.x[c][j]);
        sum += term;
        magnitude += std::abs(term);
      }
      const double error = std::abs(static_cast<double>(y[c][i]) - sum) / magnitude;
      largest = error <= largest ? largest : error;  // takes a NaN
    }
  }
  return largest;
}

/// Those of matvec, and four more: d, d / A, d x and the multiplication by d / A.
double bound(std::uint32_t n) {
  const std::uint64_t c = std::min(n, 256U) + (n + 255) / 256 + 5 + 5;
  return static_cast<double>(c) * std::ldexp(1.0, -24) / (1 - static_cast<double>(c) * std::ldexp(1.0, -24));
}

/// Devices of every sort: sharing the host's memory, with copies in it, with memory of their own, with small buffers.
struct Sort {
  std::string name;
  bool share = true;
  std::function<void(DeviceInfo&)> describe;
};
std::vector<Sort> sorts(const System& system) {
  const std::uint64_t panel = system.panels.panel_bytes();
  return {{"sharing", true, {}},
          {"copying", false, {}},
          {"GPU", false, [](DeviceInfo& info) { info.type = DeviceType::gpu; }},
          {"small GPU", false,
           [=](DeviceInfo& info) {
             info.type = DeviceType::gpu;
             info.memory_bytes = 6 * panel + 70'000;
           }},
          {"small buffers", true, [=](DeviceInfo& info) { info.max_buffer_bytes = panel / 2 + 400; }}};
}

TEST(StreamedProduct, EqualsTheMatrixInMemoryAndTheSameBitsForAnyResidency) {
  for (const std::uint32_t n : {2U, 33U, 333U, 600U}) {
    const System system(n);
    for (const Sort& sort : sorts(system)) {
      Columns first;
      for (const std::uint64_t fit : {2U, 3U, 7U, 30U}) {
        const auto counts = std::make_shared<Counts>();
        counts->may_share = sort.share;
        counts->describe = sort.describe;
        const StreamedMatrix f = system.streamed(fit);
        Scheduler scheduler(f, counting(counts), 3);
        for (int k = 0; k < 3; ++k) {
          const Columns y = product_of(scheduler, system.x, 2);
          EXPECT_LE(error_of(system, y), bound(n)) << sort.name << " " << n << " " << fit;
          if (first.empty()) first = y;
          EXPECT_EQ(y, first) << sort.name << " " << n << " " << fit;
        }
        EXPECT_EQ(scheduler.bytes(), f.bytes());
        EXPECT_EQ(scheduler.storage(), Storage::dense32);
        EXPECT_EQ(scheduler.products(), 6U);
      }
    }
  }
}

TEST(StreamedProduct, TheFileAloneDoesNotExceedTheMemory) {
  const System system(600);
  for (const Sort& sort : sorts(system)) {
    const auto counts = std::make_shared<Counts>();
    counts->may_share = sort.share;
    counts->describe = sort.describe;
    const StreamedMatrix f = system.streamed(7);
    Scheduler scheduler(f, counting(counts), 3);
    static_cast<void>(product_of(scheduler, system.x));
    std::uint64_t on_device = 0;
    for (const Buffer* buffer : scheduler.panel_buffers()) on_device += buffer->size();
    EXPECT_LE(on_device, 7 * system.panels.panel_bytes()) << sort.name;
    EXPECT_LE(f.stream().kept(), 4U) << sort.name;
  }
}

TEST(StreamedProduct, TwinAPanelSwappedOrSkippedFails) {
  System system(333);
  system.panels.instead = [](std::uint32_t panel) { return panel == 4 ? 5 : panel == 5 ? 4 : panel; };
  for (const std::uint64_t fit : {2U, 30U}) {
    const StreamedMatrix f = system.streamed(fit);
    Scheduler scheduler(f, openmp(), 3);
    EXPECT_GT(error_of(system, product_of(scheduler, system.x)), 100 * bound(333));
  }
  system.panels.instead = {};
  const auto counts = std::make_shared<Counts>();
  std::uint64_t launched = 0;
  counts->before_launch = [&](const std::string& kernel) {  // the scale behind the seventh panel comes in its place
    if (kernel == "matvec" && ++launched == 7) throw Error(ErrorKind::device, "skipped");
  };
  const StreamedMatrix f = system.streamed(2);
  Scheduler scheduler(f, counting(counts), 3);
  Vector in = scheduler.vector(), out = scheduler.vector();
  scheduler.upload(in, system.x);
  EXPECT_THROW(scheduler.apply(in, out), Error);
  Columns y;
  scheduler.download(out, y);
  EXPECT_GT(error_of(system, y), 100 * bound(333)) << "a product that was broken off";
  scheduler.apply(in, out);
  scheduler.download(out, y);
  EXPECT_LE(error_of(system, y), bound(333));
}

TEST(StreamedProduct, ExactInDouble) {
  for (const std::uint32_t n : {1U, 33U, 333U}) {
    const System system(n);
    std::vector<std::vector<double>> first;
    for (const std::uint64_t fit : {2U, 5U, 30U}) {
      const StreamedMatrix f = system.streamed(fit);
      Scheduler scheduler(f, openmp(), 3);
      std::vector<std::vector<double>> y;
      scheduler.exact_product(system.x, y);
      for (std::size_t c = 0; c < 3; ++c) {
        for (std::uint32_t i = 0; i < n; ++i) {
          double sum = 0, magnitude = 0;
          for (std::uint32_t j = 0; j < n; ++j) {
            const double term = static_cast<double>(system.panels.at(i, j)) * static_cast<double>(f.scale_out()[i]) *
                                static_cast<double>(f.scale_in()[j]) * static_cast<double>(system.x[c][j]);
            sum += term;
            magnitude += std::abs(term);
          }
          EXPECT_NEAR(y[c][i], sum, 1e-14 * magnitude);
        }
      }
      if (first.empty()) first = y;
      EXPECT_EQ(y, first);
      // The matrix in memory has rounded F: a few units of fp32.
      std::vector<std::vector<double>> dense;
      exact_product(system.dense(), system.x, dense);
      for (std::uint32_t i = 0; i < n; ++i) EXPECT_NEAR(y[0][i], dense[0][i], 4e-7 * static_cast<double>(n) / 20);
    }
  }
}

TEST(StreamedProduct, AFailedReadComesOutOfApply) {
  for (std::uint32_t failing = 0; failing < 11; ++failing) {
    for (const bool share : {true, false}) {
      System system(333);
      const auto counts = std::make_shared<Counts>();
      counts->may_share = share;
      const StreamedMatrix f = system.streamed(3);  // none stays: every panel is read by apply
      Scheduler scheduler(f, counting(counts), 3);
      Vector in = scheduler.vector(), out = scheduler.vector();
      scheduler.upload(in, system.x);
      for (int k = 0; k < 2; ++k) {
        const std::uint32_t read_before = system.panels.reads[failing];
        bool failed = false;
        system.panels.before_read = [&](std::uint32_t panel) {
          if (panel == failing)
            throw Error(ErrorKind::input, "room.iff: panel " + std::to_string(panel) + ": checksum");
        };
        try {
          scheduler.apply(in, out);
        } catch (const Error& error) {
          failed = true;
          EXPECT_EQ(error.kind(), ErrorKind::input);
          EXPECT_EQ(std::string(error.what()), "room.iff: panel " + std::to_string(failing) + ": checksum");
        }
        // The second time a buffer may hold the panel still, which is then not read.
        EXPECT_EQ(failed, system.panels.reads[failing] > read_before) << failing << (share ? " shared" : " copied");
        EXPECT_TRUE(failed || k == 1) << failing << (share ? " shared" : " copied");
        system.panels.before_read = {};
        scheduler.apply(in, out);
        Columns y;
        scheduler.download(out, y);
        EXPECT_LE(error_of(system, y), bound(333)) << "afterwards";
      }
    }
  }
}

TEST(StreamedProduct, OnlyWhatIsResidentAndTheBuffersCount) {
  const System system(600);
  const StreamedMatrix f = system.streamed(5);
  const std::uint64_t five = 5 * system.panels.panel_bytes();
  const auto limited = [&](std::uint64_t bytes, bool share) {
    const auto counts = std::make_shared<Counts>();
    counts->may_share = share;
    counts->describe = [=](DeviceInfo& info) { info.memory_bytes = bytes; };
    return Scheduler(f, counting(counts), 3).bytes();
  };
  const std::uint64_t vectors = 25 * 3 * 608 * sizeof(float);
  for (const bool share : {true, false}) {
    EXPECT_NO_THROW(limited(five + 3 * system.panels.panel_bytes() + vectors, share));
    EXPECT_LT(five + 3 * system.panels.panel_bytes() + vectors, f.bytes());
    try {
      limited(five, share);
      FAIL() << "no error";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::limit);
      EXPECT_THAT(error.what(), HasSubstr("may be used"));
    }
  }
}

}  // namespace
}  // namespace interflect
