#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

namespace interflect {

/// How F is cut for several devices.
struct SplitOptions {
  /// The devices' shares of F, in proportion, which then stay; empty: learnt from the rates that are measured.
  std::vector<double> weights = {};
  /// Tests: what device k is said to have taken for so many bytes of F, when it took `seconds`.
  std::function<double(std::size_t device, std::uint64_t bytes, double seconds)> said = {};
};

/// Which share of F each device has, from the rates at which they go through it.
///
/// It learns in the first products: the shares become proportional to the rates, as often as that promises a product in
/// 1 / 1.05 of the time and at most most_moves times. From then on they stay until a device's rate, the median of five
/// products, is off by more than 10 % from what it was.
class Balance {
 public:
  static constexpr std::uint32_t most_moves = 6;  ///< while it learns
  static constexpr double worth_moving = 1.05, drift = 0.10;

  /// `total`: bytes of F. `room`: those for which each device has room (infinity: all). Equal shares to begin with, as
  /// far as there is room. Throws a usage Error for weights of another number or none above 0, a limit Error where all
  /// rooms together are too small.
  Balance(double total, std::vector<double> room, std::vector<double> weights);

  /// Of each device, together 1. A device that is lost has 0.
  [[nodiscard]] const std::vector<double>& shares() const { return shares_; }
  /// A product in which device k went through bytes[k] in seconds[k]; 0 bytes say nothing. True when the shares are
  /// others from now on.
  bool note(const std::vector<std::uint64_t>& bytes, const std::vector<double>& seconds);
  /// The device has no share any more. Throws a limit Error where the others have no room for it.
  void lose(std::size_t device);
  /// How often note() has moved.
  [[nodiscard]] std::uint32_t moves() const { return moves_; }
  [[nodiscard]] bool learning() const { return learning_; }

 private:
  [[nodiscard]] std::vector<double> divided(std::vector<double> rates) const;
  [[nodiscard]] std::vector<double> rates(std::size_t last, double quantile) const;
  bool move(const std::vector<double>& rates);
  bool learn(const std::vector<std::uint64_t>& bytes);
  bool watch();

  double total_;
  std::vector<double> room_, weights_, shares_;
  std::vector<bool> lost_;
  std::vector<std::vector<double>> seen_;  ///< rates of each device, bytes a second, since the last move
  std::vector<double> known_;              ///< the last rate that is known of each device; 0: none
  std::vector<double> reference_;          ///< against which drift counts; empty: not known yet
  std::uint32_t products_ = 0;             ///< since the last move
  std::uint32_t moves_ = 0;
  bool learning_ = true;
};

/// The units at which each device's range begins, and the last one's end, for these shares: `before` as
/// Division::bytes. Each device with a share above 0 has a unit at least, as far as there are enough.
[[nodiscard]] std::vector<std::uint32_t> cut(const std::vector<std::uint64_t>& before,
                                             const std::vector<double>& shares);

}  // namespace interflect
