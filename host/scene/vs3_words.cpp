#include "interflect/scene/vs3_words.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/scene/statements.h"
#include "interflect/scene/text.h"

namespace interflect::vs3 {

namespace {
constexpr std::string_view separators = " ,\t\r\v\f";
}

Words::Words(std::string_view text, std::string file) : text_(text), file_(std::move(file)) {
  if (text_.starts_with("\xef\xbb\xbf")) text_.remove_prefix(3);
  newline_ = text_.find('\n') == std::string_view::npos ? '\r' : '\n';
}

bool Words::next_line() {
  if (position_ >= text_.size()) return false;
  const std::size_t end = std::min(text_.find(newline_, position_), text_.size());
  rest_ = text_.substr(position_, end - position_);
  position_ = end + 1;
  ++line_;
  if (rest_.find('\0') != std::string_view::npos) fail_here("a NUL byte: this is not a text file");
  return true;
}

bool Words::next_record() {
  do {
    if (!next_line()) return false;
    keyword_ = word();
  } while (keyword_.empty());
  record_line_ = line_;
  letter_ = static_cast<char>(std::toupper(static_cast<unsigned char>(keyword_.front())));
  return true;
}

std::string_view Words::word() {
  const std::size_t first = rest_.find_first_not_of(separators);
  if (first == std::string_view::npos || rest_[first] == '!') {
    rest_ = {};
    return {};
  }
  rest_.remove_prefix(first);
  const std::string_view taken = rest_.substr(0, rest_.find_first_of(separators));
  rest_.remove_prefix(taken.size());
  return taken;
}

std::string_view Words::value(std::string_view what) {
  std::string_view taken = word();
  while (taken.empty()) {
    const bool more = next_line();
    if (more) taken = word();
    // The next record instead of a value, or the end: this one is too short.
    constexpr std::string_view numeric = "+-.0123456789";
    if (!more || (!taken.empty() && numeric.find(taken.front()) == std::string_view::npos)) {
      fail(fmt::format("the record '{}' ends before its {}", one_line(keyword_), what));
    }
  }
  return taken;
}

double Words::number(std::string_view what) {
  const std::string_view text = value(what);
  const auto number = finite_number(text);
  if (!number) fail_here(fmt::format("{}: '{}' is not a finite number", what, one_line(text)));
  return *number;
}

std::int64_t Words::integer(std::string_view what) {
  const std::string_view text = value(what);
  const auto number = whole_number(text);
  if (!number) fail_here(fmt::format("{}: '{}' is not a whole number in range", what, one_line(text)));
  return *number;
}

void Words::fail(std::string_view cause) const {
  throw input_error(file_, record_line_, cause);
}

void Words::fail_here(std::string_view cause) const {
  throw input_error(file_, line_, cause);
}

}  // namespace interflect::vs3
