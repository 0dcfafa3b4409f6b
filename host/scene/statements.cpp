#include "interflect/scene/statements.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/scene/text.h"

namespace interflect {

namespace {

constexpr std::string_view blanks = " \t\r\v\f";

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(blanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(blanks) + 1 - first);
}

/// from_chars knows no plus sign. "+-1" stays as it is and is refused.
std::string_view without_plus(std::string_view number) {
  return number.starts_with('+') && !number.starts_with("+-") ? number.substr(1) : number;
}

}  // namespace

std::optional<double> finite_number(std::string_view word) {
  const std::string_view text = without_plus(word);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  // Too small for a double is 0; too large is not a number that we can work with.
  const std::size_t exponent = word.find_first_of("eE");
  const bool underflow =
      error == std::errc::result_out_of_range && exponent != word.npos && word.find('-', exponent) != word.npos;
  if (underflow) return 0;
  if (error != std::errc{} || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::optional<std::int64_t> whole_number(std::string_view word) {
  const std::string_view text = without_plus(word);
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

Statements::Statements(std::string_view text, std::string file) : text_(text), file_(std::move(file)) {
  if (text_.starts_with("\xef\xbb\xbf")) text_.remove_prefix(3);
  newline_ = text_.find('\n') == std::string_view::npos ? '\r' : '\n';  // lone carriage returns: a classic Mac's file
}

bool Statements::next_line(std::string_view& line) {
  if (position_ >= text_.size()) return false;
  const std::size_t end = std::min(text_.find(newline_, position_), text_.size());
  line = text_.substr(position_, end - position_);
  position_ = end + 1;
  ++lines_read_;
  if (line.find('\0') != std::string_view::npos) {
    throw input_error(file_, lines_read_, "a NUL byte: this is not a text file");
  }
  return true;
}

bool Statements::next() {
  std::string_view line;
  while (next_line(line)) {
    line_ = lines_read_;
    line = trimmed(line);
    if (line.ends_with('\\') && !line.starts_with('#')) {
      joined_.clear();
      do {
        line.remove_suffix(1);
        joined_.append(line).push_back(' ');
        if (!next_line(line)) line = {};
        line = trimmed(line);
      } while (line.ends_with('\\'));
      joined_.append(line);
      line = trimmed(joined_);
    }
    if (line.empty()) continue;
    const std::size_t end = std::min(line.find_first_of(blanks), line.size());
    keyword_ = line.substr(0, end);
    rest_ = line.substr(end);
    if (keyword_.starts_with('#') && keyword_ != "#camera") continue;
    return true;
  }
  return false;
}

std::string_view Statements::rest() const {
  return trimmed(rest_);
}

std::string_view Statements::word() {
  rest_ = trimmed(rest_);
  if (rest_.starts_with('#')) rest_ = {};
  const std::size_t end = std::min(rest_.find_first_of(blanks), rest_.size());
  const std::string_view taken = rest_.substr(0, end);
  rest_.remove_prefix(end);
  return taken;
}

double Statements::number() {
  const std::string_view text = word();
  if (text.empty()) fail(fmt::format("'{}' needs more numbers", one_line(keyword_)));
  const auto value = finite_number(text);
  if (!value) fail(fmt::format("'{}' is not a finite number", one_line(text)));
  return *value;
}

std::optional<double> Statements::optional_number() {
  const std::string_view before = rest_;
  if (word().empty()) return std::nullopt;
  rest_ = before;
  return number();
}

std::int64_t Statements::integer(std::string_view digits) const {
  const auto value = whole_number(digits);
  if (!value) fail(fmt::format("'{}' is not a whole number in range", one_line(digits)));
  return *value;
}

void Statements::fail(std::string_view cause) const {
  throw input_error(file_, line_, cause);
}

}  // namespace interflect
