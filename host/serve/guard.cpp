#include "interflect/serve/guard.h"

#include <arpa/inet.h>

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

namespace interflect::serve {

namespace {

std::string lower(std::string_view text) {
  std::string out(text);
  for (char& c : out) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return out;
}

/// "name", "name:port", "[v6]:port" without the port and the brackets; empty where it is none of these.
std::string name_of(std::string_view host) {
  const auto is_port = [](std::string_view text) {
    return text.size() >= 2 && text.size() <= 6 && text.front() == ':' &&
           std::all_of(text.begin() + 1, text.end(), [](char c) { return c >= '0' && c <= '9'; });
  };
  if (host.starts_with('[')) {
    const std::size_t end = host.find(']');
    if (end == std::string_view::npos) return {};
    const std::string_view rest = host.substr(end + 1);
    return rest.empty() || is_port(rest) ? lower(host.substr(1, end - 1)) : std::string();
  }
  const std::size_t colon = host.find(':');
  if (colon == std::string_view::npos) return lower(host);
  return is_port(host.substr(colon)) ? lower(host.substr(0, colon)) : std::string();
}

bool is_address(const std::string& name) {
  std::array<unsigned char, sizeof(in6_addr)> bytes{};
  return ::inet_pton(AF_INET, name.c_str(), bytes.data()) == 1 ||
         ::inet_pton(AF_INET6, name.c_str(), bytes.data()) == 1;
}

bool is_loopback(const std::string& name) {
  in_addr v4{};
  if (::inet_pton(AF_INET, name.c_str(), &v4) == 1) return ntohl(v4.s_addr) >> 24U == 127;
  return name == "localhost" || name == "::1";
}

}  // namespace

Guard::Guard(std::string bound) : bound_(lower(bound)), loopback_(is_loopback(bound_)) {}

std::optional<Answer> Guard::refuse(const Request& request) const {
  const std::string name = name_of(request.host);
  const bool known = is_loopback(name) || name == bound_ || (!loopback_ && is_address(name));
  if (name.empty() || !known) return refusal(403, "this server does not go by that name (header Host)");
  if (!request.origin.empty() && lower(request.origin) != "http://" + lower(request.host)) {
    return refusal(403, "pages of other origins may not use this server (header Origin)");
  }
  // A link from elsewhere may open the page; nothing else may come from there.
  const bool own = request.fetch_site.empty() || request.fetch_site == "same-origin" || request.fetch_site == "none";
  if (!own && request.path() != "/") {
    return refusal(403, "pages of other origins may not use this server (header Sec-Fetch-Site)");
  }
  return std::nullopt;
}

}  // namespace interflect::serve
