#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace interflect {

/// The whole word as a finite decimal number ("1.", "+2e-3"; too small for a double is 0), or nothing.
[[nodiscard]] std::optional<double> finite_number(std::string_view word);
/// The whole word as a decimal whole number that fits into 64 bits, or nothing.
[[nodiscard]] std::optional<std::int64_t> whole_number(std::string_view word);

/// Goes through the statements of an OBJ or MTL text: a keyword and its words per line; "\" at the end of a line
/// continues it, comments and empty lines are skipped (but see camera comments below). Keeps the line number, so that
/// every complaint can name it. Why not tinyobjloader: it gives no line numbers, and it reads "nan", "1e999", "abc" and
/// an index beyond int as 0 or as whatever atoi() makes of them, without a word.
class Statements {
 public:
  /// `text` must outlive this. `file` names it in messages.
  Statements(std::string_view text, std::string file);

  /// Goes to the next statement; false at the end. Throws an input Error for a NUL byte: this is no text.
  bool next();
  [[nodiscard]] std::string_view keyword() const { return keyword_; }
  [[nodiscard]] std::uint32_t line() const { return line_; }
  [[nodiscard]] const std::string& file() const { return file_; }

  /// What is left of the statement, without spaces around it.
  [[nodiscard]] std::string_view rest() const;
  /// Takes the next word; empty at the end or where a comment starts.
  std::string_view word();
  /// Takes the next word as a finite number. Throws an input Error otherwise.
  double number();
  /// The same, but nothing when no word is left.
  std::optional<double> optional_number();
  /// A whole number that fits into 64 bits. Throws an input Error otherwise.
  [[nodiscard]] std::int64_t integer(std::string_view digits) const;

  /// Throws an input Error at this statement.
  [[noreturn]] void fail(std::string_view cause) const;

 private:
  /// The next line as it is in the file.
  bool next_line(std::string_view& line);

  std::string_view text_;
  std::string file_;
  char newline_;
  std::size_t position_ = 0;
  std::uint32_t lines_read_ = 0;
  std::string joined_;  ///< holds a statement of several lines
  std::string_view keyword_, rest_;
  std::uint32_t line_ = 0;
};

}  // namespace interflect
