#include "interflect/device/tuning.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/device/check_tools.h"
#include "interflect/device/tuning_load.h"

// The search for launch shapes.

namespace interflect {

namespace {

constexpr double least_gain = 1.02;  // in the median; and faster in all turns but one
constexpr double hopeless = 0.9;     // two candidates that slow, one after the other, end the way in their direction
constexpr double pass_seconds = 2e-3;
constexpr int most_runs = 50;

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : (values[half - 1] + values[half]) / 2;
}

std::string text(const Macros& macros) {
  std::string out;
  for (const auto& [name, value] : macros) out += fmt::format("{}{}={}", out.empty() ? "" : " ", name, value);
  return out;
}

class Search {
 public:
  Search(Device& device, std::string_view kernel, const TuningOptions& options)
      : device_(device), kernel_(kernel), options_(options), tunable_(tunable_macros(device.info(), kernel)) {
    begin_ = now();
    result_.kernel = kernel;
    for (const TunableMacro& macro : tunable_) result_.standard.emplace(macro.name, macro.standard);
    result_.chosen = result_.standard;
  }

  TunedShape run() {
    if (tunable_.empty()) return result_;
    load_ = make_tuning_load(device_, kernel_, options_.bytes);
    const double started = now();
    standard_ = load_->product(all(result_.standard));
    best_ = standard_;
    static_cast<void>(pass(standard_));  // to warm up
    longest_ = now() - started;          // a first guess: it compiles, too
    choose_runs();
    for (const TunableMacro& macro : tunable_) {
      walk(macro, 1);
      if (result_.chosen.at(macro.name) == macro.standard) walk(macro, -1);
    }
    confirm();
    return result_;
  }

 private:
  [[nodiscard]] double now() const { return options_.now ? options_.now() : wall_.seconds(); }
  [[nodiscard]] double left() const { return options_.seconds - (now() - begin_); }

  /// With all other macros that the kernel takes.
  [[nodiscard]] Macros all(const Macros& tuned) const {
    return check::case_macros(device_.info(), kernel_, {.macros = tuned}, tuned_columns);
  }

  /// Seconds of a product.
  double pass(const std::function<void()>& product) {
    const double before = now();
    for (int k = 0; k < runs_; ++k) product();
    device_.queue().wait();
    return (now() - before) / runs_;
  }
  void choose_runs() {
    const double seconds = pass(standard_);
    if (seconds < pass_seconds) {
      runs_ = static_cast<int>(std::clamp(std::ceil(pass_seconds / std::max(seconds, 1e-9)), 1.0, double{most_runs}));
    }
  }

  struct Verdict {
    bool faster = false;
    double ratio = 1;  ///< seconds of the first / of the second
  };
  /// Two products in turns. One that is clearly slower is not timed to the end.
  Verdict compare(const std::function<void()>& first, const std::function<void()>& second, int turns) {
    std::vector<double> ratios;
    for (int k = 0; k < turns; ++k) {
      const double of_first = pass(first), of_second = pass(second);
      ratios.push_back(of_first / std::max(of_second, 1e-12));
      if (k == 1 && std::max(ratios[0], ratios[1]) < hopeless) break;
    }
    const auto lost = std::count_if(ratios.begin(), ratios.end(), [](double ratio) { return ratio <= 1; });
    const double middle = median(ratios);
    return {middle >= least_gain && lost <= 1, middle};
  }

  /// From the best value of a macro on, up or down its candidates, as long as there is hope.
  void walk(const TunableMacro& macro, int direction) {
    const auto begin =
        static_cast<int>(std::find(macro.values.begin(), macro.values.end(), macro.standard) - macro.values.begin());
    int misses = 0;
    for (int k = begin + direction; misses < 2 && k >= 0 && k < static_cast<int>(macro.values.size()); k += direction) {
      if (left() < longest_) {
        result_.done = false;
        return;
      }
      const double started = now();
      Macros candidate = result_.chosen;
      candidate[macro.name] = macro.values[static_cast<std::size_t>(k)];
      const double ratio = try_one(candidate);
      longest_ = std::max(longest_, now() - started);
      misses = ratio < hopeless ? misses + 1 : 0;
    }
  }

  /// The ratio of the best so far to the candidate, which becomes the best if it deserves it; 0 where it does not run.
  double try_one(const Macros& candidate) {
    constexpr int turns = 5;
    try {
      const auto product = load_->product(all(candidate));
      static_cast<void>(pass(product));  // to warm up
      const Verdict verdict = compare(best_, product, turns);
      if (!verdict.faster || !passes(candidate)) return verdict.ratio;
      best_ = product;
      result_.chosen = candidate;
      return verdict.ratio;
    } catch (const Error& error) {  // more than the device has of something: registers, shared memory
      if (error.kind() != ErrorKind::device && error.kind() != ErrorKind::limit) throw;
      return 0;
    }
  }

  /// All check cases of the kernel for the tuned number of columns: with its own blocks, and with a BLOCK that was
  /// chosen.
  bool passes(const Macros& candidate) {
    Macros others = candidate, standard = result_.standard;
    const bool with_block = others.erase("BLOCK") != 0;
    standard.erase("BLOCK");
    std::vector<KernelCheck> rows;
    if (others != standard || !with_block) check_with(others, rows);
    if (with_block) check_with(candidate, rows);
    for (const KernelCheck& row : rows) {
      if (row.status != CheckStatus::fail) continue;
      result_.refused.push_back(fmt::format("{}: n={} {}: {}", text(candidate), row.size, row.parameters, row.reason));
      return false;
    }
    const auto passed = [](const KernelCheck& row) { return row.status == CheckStatus::pass; };
    return std::any_of(rows.begin(), rows.end(), passed);
  }
  void check_with(const Macros& macros, std::vector<KernelCheck>& rows) {
    const check::Selection selection{.columns = tuned_columns, .kernel = kernel_, .macros = macros};
    if (kernel_ == "matvec") {
      check::check_matvec(device_, rows, selection);
    } else {
      check::check_packed(device_, rows, selection);
    }
  }

  /// The best of several looks better than it is: it must beat the default in turns of its own.
  void confirm() {
    constexpr int turns = 7;
    if (result_.chosen == result_.standard) return;
    const Verdict verdict = compare(standard_, best_, turns);
    if (verdict.faster) {
      result_.gain = verdict.ratio;
    } else {
      result_.chosen = result_.standard;
    }
  }

  Device& device_;
  std::string kernel_;
  const TuningOptions& options_;
  Timer wall_;
  double begin_ = 0, longest_ = 0;  ///< of the candidates
  int runs_ = 1;                    ///< products in a pass
  std::vector<TunableMacro> tunable_;
  std::unique_ptr<TuningLoad> load_;
  std::function<void()> standard_, best_;
  TunedShape result_;
};

}  // namespace

TunedShape search_shape(Device& device, std::string_view kernel, const TuningOptions& options) {
  return Search(device, kernel, options).run();
}

}  // namespace interflect
