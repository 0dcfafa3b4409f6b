#include "interflect/formfactor/iff_closing.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>
#include <vector>

#include "interflect/base/error.h"

namespace interflect::iff {

namespace {

/// Appends values as they lie in memory.
class Writer {
 public:
  template <typename T>
  void value(const T& v) {
    static_assert(std::is_arithmetic_v<T>);
    out.append(reinterpret_cast<const char*>(&v), sizeof v);
  }
  void value(const std::string& text) {
    value(static_cast<std::uint32_t>(text.size()));
    out += text;
  }
  template <typename T>
  void all(const std::vector<T>& values) {
    out.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  }
  std::string out;
};

/// Takes values from the front; whatever would lie beyond the end is an Error.
class Reader {
 public:
  Reader(std::span<const std::byte> bytes, std::string_view file) : left_(bytes), file_(file) {}

  template <typename T>
  void value(T& v) {
    static_assert(std::is_arithmetic_v<T>);
    std::memcpy(&v, take(1, sizeof v), sizeof v);
  }
  void value(std::string& text) {
    std::uint32_t length = 0;
    value(length);
    const auto* begin = reinterpret_cast<const char*>(take(length, 1));
    text.assign(begin, length);
  }
  template <typename T>
  void all(std::vector<T>& values, std::uint64_t count) {
    const std::byte* begin = take(count, sizeof(T));
    values.resize(count);
    if (count > 0) std::memcpy(values.data(), begin, count * sizeof(T));
  }
  /// A count of things that take at least `least` bytes each.
  [[nodiscard]] std::uint64_t count(std::uint64_t least) {
    std::uint64_t n = 0;
    value(n);
    if (n > left_.size() / least) throw senseless();
    return n;
  }
  [[nodiscard]] bool empty() const { return left_.empty(); }
  [[nodiscard]] Error senseless() const { return input_error(file_, 0, "closing section: its content makes no sense"); }

 private:
  const std::byte* take(std::uint64_t count, std::uint64_t size) {
    if (count > left_.size() / size) throw senseless();
    const std::byte* begin = left_.data();
    left_ = left_.subspan(count * size);
    return begin;
  }
  std::span<const std::byte> left_;
  std::string_view file_;
};

/// The numbers of fixed count, in their order.
template <typename Stream, typename Report>
void numbers(Stream& stream, Report& report, std::uint32_t& closed, std::uint32_t& applied) {
  stream.value(closed);
  stream.value(applied);
  stream.value(report.closure_iterations);
  stream.value(report.escape_fraction);
  stream.value(report.back_fraction);
  stream.value(report.closure_max_change);
  for (auto* sums : {&report.before, &report.after}) {
    stream.value(sums->min);
    stream.value(sums->mean);
    stream.value(sums->max);
  }
}

/// A row of the certificate: the numbers of fixed count, then the names.
template <typename Stream, typename Row>
void suspect(Stream& stream, Row& row, std::uint32_t& set_aside, std::uint32_t& cause) {
  stream.value(row.patch);
  stream.value(set_aside);
  stream.value(cause);
  for (auto* number : {&row.centroid.x, &row.centroid.y, &row.centroid.z, &row.row_sum, &row.deviation, &row.error,
                       &row.escape, &row.back}) {
    stream.value(*number);
  }
  for (auto* text : {&row.object, &row.group, &row.other}) stream.value(*text);
}

void encode(Writer& to, Certificate certificate) {
  to.value(std::uint32_t{certificate.made ? 1U : 0U});
  to.value(certificate.rows);
  to.value(certificate.off);
  to.value(std::uint64_t{certificate.worst.size()});
  for (SuspectRow& row : certificate.worst) {
    std::uint32_t set_aside = row.set_aside ? 1 : 0, cause = static_cast<std::uint32_t>(row.cause);
    suspect(to, row, set_aside, cause);
  }
}

Certificate decode_certificate(Reader& from, std::uint32_t n) {
  constexpr std::uint64_t least = 3 * sizeof(std::uint32_t) + 8 * sizeof(double) + 3 * sizeof(std::uint32_t);
  Certificate out;
  std::uint32_t made = 0;
  from.value(made);
  from.value(out.rows);
  from.value(out.off);
  out.worst.resize(from.count(least));
  for (SuspectRow& row : out.worst) {
    std::uint32_t set_aside = 0, cause = 0;
    suspect(from, row, set_aside, cause);
    if (row.patch >= n || set_aside > 1 || cause > static_cast<std::uint32_t>(Cause::unknown)) throw from.senseless();
    row.set_aside = set_aside == 1;
    row.cause = static_cast<Cause>(cause);
  }
  if (made > 1) throw from.senseless();
  out.made = made == 1;
  return out;
}

bool all_at_least(double least, const std::vector<double>& values) {
  return std::all_of(values.begin(), values.end(), [least](double x) { return std::isfinite(x) && x >= least; });
}

constexpr std::uint64_t least_string = sizeof(std::uint32_t);

}  // namespace

std::string encode(const IffClosing& closing) {
  AssemblyReport report = closing.report;
  Writer to;
  to.value(static_cast<std::uint32_t>(closing.closure));
  std::uint32_t closed = report.closed_scene ? 1 : 0, applied = report.closure_applied ? 1 : 0;
  numbers(to, report, closed, applied);
  to.all(closing.area);
  to.all(report.scaling);
  to.all(report.row_sum);
  to.all(report.row_sum_before);
  to.all(closing.surface);
  to.value(std::uint64_t{report.set_aside.size()});
  to.all(report.set_aside);
  to.value(std::uint64_t{closing.surfaces.size()});
  for (const SurfaceNames& surface : closing.surfaces) {
    for (const std::string* name : {&surface.object, &surface.group, &surface.material}) to.value(*name);
  }
  to.value(std::uint64_t{report.warnings.size()});
  for (const std::string& warning : report.warnings) to.value(warning);
  encode(to, report.certificate);
  return to.out;
}

IffClosing decode(std::span<const std::byte> body, std::uint32_t n, std::string_view file) {
  Reader from(body, file);
  IffClosing closing;
  AssemblyReport& report = closing.report;
  std::uint32_t closure = 0, closed = 0, applied = 0;
  from.value(closure);
  numbers(from, report, closed, applied);
  if (closure > static_cast<std::uint32_t>(Closure::off) || closed > 1 || applied > 1) throw from.senseless();
  closing.closure = static_cast<Closure>(closure);
  report.closed_scene = closed == 1;
  report.closure_applied = applied == 1;
  from.all(closing.area, n);
  from.all(report.scaling, n);
  from.all(report.row_sum, n);
  from.all(report.row_sum_before, n);
  from.all(closing.surface, n);
  from.all(report.set_aside, from.count(sizeof(std::uint32_t)));
  closing.surfaces.resize(from.count(3 * least_string));
  for (SurfaceNames& surface : closing.surfaces) {
    for (std::string* name : {&surface.object, &surface.group, &surface.material}) from.value(*name);
  }
  report.warnings.resize(from.count(least_string));
  for (std::string& warning : report.warnings) from.value(warning);
  report.certificate = decode_certificate(from, n);

  const auto below = [](const std::vector<std::uint32_t>& indices, std::size_t end) {
    return std::all_of(indices.begin(), indices.end(), [end](std::uint32_t i) { return i < end; });
  };
  if (!from.empty() || !below(closing.surface, closing.surfaces.size()) || !below(report.set_aside, n) ||
      !all_at_least(0, closing.area) || !all_at_least(std::numeric_limits<double>::min(), report.scaling)) {
    throw from.senseless();
  }
  return closing;
}

}  // namespace interflect::iff
