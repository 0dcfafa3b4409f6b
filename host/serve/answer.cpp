#include "interflect/serve/answer.h"

#include <nlohmann/json.hpp>

namespace interflect::serve {

Answer text_answer(int status, std::string type, std::string body) {
  return {status, std::move(type), std::make_shared<const std::string>(std::move(body)), {}};
}

Answer refusal(int status, std::string_view cause) {
  const nlohmann::ordered_json said{{"error", cause.substr(0, cause.find('\n'))}};
  return text_answer(status, "application/json",
                     said.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
}

}  // namespace interflect::serve
