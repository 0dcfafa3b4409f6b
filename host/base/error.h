#pragma once

#include <stdexcept>
#include <string>
#include <string_view>

namespace interflect {

/// What went wrong, in the terms in which a caller must react.
enum class ErrorKind {
  internal,       ///< a defect of Interflect's own; exit status 1
  usage,          ///< a wrong option or argument; exit status 2
  input,          ///< a file that cannot be read or does not make sense; exit status 3
  device,         ///< an accelerator that is missing, lost or refuses; exit status 4
  not_converged,  ///< only used by the command line: the result is written and said to be unconverged; exit status 5
  limit,          ///< a limit such as memory, known before the work starts; exit status 6
  interrupted,    ///< the user ended it, and what is done is kept; exit status 130
};

/// The one exception type of Interflect. what() is one line without a trailing newline.
class Error : public std::runtime_error {
 public:
  Error(ErrorKind kind, const std::string& message) : std::runtime_error(message), kind_(kind) {}
  [[nodiscard]] ErrorKind kind() const noexcept { return kind_; }

 private:
  ErrorKind kind_;
};

/// The exit status that the command line gives for an error of this kind.
[[nodiscard]] int exit_status(ErrorKind kind) noexcept;

/// An input error at a place: "FILE:LINE: CAUSE", or "FILE: CAUSE" when line is 0. Control characters in the parts are
/// replaced, so that the message stays one line whatever the file holds.
[[nodiscard]] Error input_error(std::string_view file, std::size_t line, std::string_view cause);

/// A device error: "DEVICE: OPERATION: CAUSE".
[[nodiscard]] Error device_error(std::string_view device, std::string_view operation, std::string_view cause);

}  // namespace interflect
