#pragma once

#include <optional>
#include <string>

#include "interflect/serve/answer.h"

namespace interflect::serve {

/// A request as far as it matters here. Header fields that are missing are empty.
struct Request {
  std::string method, target;  ///< target: as sent, "/solve?x=1"
  std::string host, origin;
  std::string fetch_site;  ///< Sec-Fetch-Site, which browsers add and pages cannot forge
  std::string content_type;
  std::string body;

  [[nodiscard]] std::string path() const { return target.substr(0, target.find('?')); }
};

/// Keeps pages of other origins from driving a server that listens on this machine only: by name (DNS rebinding: their
/// own name, made to point here) as well as across origins. Programs that are no browser send the right Host and no
/// Origin.
class Guard {
 public:
  /// `bound`: what the server was told to listen on.
  explicit Guard(std::string bound);

  /// Status 403 unless Host is localhost, a loopback address, what the server was told to listen on or, when that is no
  /// loopback address, any IP address; and Origin, where there is one, is this very server's. Ports are not looked at
  /// in Host: a tunnel may have another one.
  [[nodiscard]] std::optional<Answer> refuse(const Request& request) const;

  [[nodiscard]] bool loopback() const { return loopback_; }

 private:
  std::string bound_;
  bool loopback_;
};

}  // namespace interflect::serve
