#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace interflect::vs3 {

/// Goes through the records of a View3D text. Words stand between blanks, tabs and commas; "!" where a word would begin
/// starts a comment. A record begins with the first word of a line; its values may go on in the lines after it; what is
/// left of a line when it has its values is skipped.
class Words {
 public:
  /// `text` must outlive this. `file` names it in messages.
  Words(std::string_view text, std::string file);

  /// Goes to the next record; false at the end of the text. Throws an input Error for a NUL byte: this is no text.
  bool next_record();
  /// The record's first letter, in upper case: what it is.
  [[nodiscard]] char letter() const { return letter_; }
  [[nodiscard]] std::string_view keyword() const { return keyword_; }
  /// Where the record begins.
  [[nodiscard]] std::uint32_t line() const { return record_line_; }
  [[nodiscard]] const std::string& file() const { return file_; }

  /// The next word of this line; empty at its end.
  std::string_view word();
  /// The next value, of this line or the next one that has any. `what` it should be stands in messages.
  double number(std::string_view what);
  std::int64_t integer(std::string_view what);
  /// Leaves the rest of this line out: the next value is looked for in the next one.
  void skip_line() { rest_ = {}; }

  /// Throws an input Error where the record begins.
  [[noreturn]] void fail(std::string_view cause) const;

 private:
  bool next_line();
  std::string_view value(std::string_view what);
  [[noreturn]] void fail_here(std::string_view cause) const;

  std::string_view text_;
  std::string file_;
  char newline_;
  std::size_t position_ = 0;
  std::uint32_t line_ = 0, record_line_ = 0;
  std::string_view rest_, keyword_;
  char letter_ = 0;
};

}  // namespace interflect::vs3
