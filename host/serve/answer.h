#pragma once

#include <memory>
#include <string>
#include <string_view>

namespace interflect::serve {

/// What a connection is answered.
struct Answer {
  int status = 200;
  std::string type = "application/json";
  std::shared_ptr<const std::string> body = {};  ///< shared: many may be sent at once
  std::string allow = {};                        ///< the methods of a path, with status 405
};

[[nodiscard]] Answer text_answer(int status, std::string type, std::string body);
/// {"error": CAUSE} on one line; the cause is made printable.
[[nodiscard]] Answer refusal(int status, std::string_view cause);

}  // namespace interflect::serve
