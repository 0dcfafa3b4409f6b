#include "interflect/serve/guard.h"

#include <gtest/gtest.h>

#include <string>

// Who may ask a server, by what it was told to listen on. A loopback one is also asked by tests/serve/serve_test.py.

namespace interflect::serve {
namespace {

bool lets_in(const std::string& bound, const std::string& host, const std::string& origin = {},
             const std::string& site = {}, const std::string& target = "/scene") {
  const auto refused = Guard(bound).refuse({"GET", target, host, origin, site, {}, {}});
  EXPECT_EQ(refused ? refused->status : 403, 403);
  return !refused;
}

TEST(Guard, OfThisMachineOnlyKnowsItsNames) {
  for (const char* bound : {"127.0.0.1", "localhost", "LOCALHOST", "::1", "127.0.0.2"}) {
    EXPECT_TRUE(Guard(bound).loopback()) << bound;
    EXPECT_TRUE(lets_in(bound, "localhost:8080")) << bound;
    EXPECT_TRUE(lets_in(bound, "[::1]:1")) << bound;
    for (const char* stranger : {"192.168.1.5:8080", "[fe80::1]", "evil.example", "", "0.0.0.0"}) {
      EXPECT_FALSE(lets_in(bound, stranger)) << bound << ' ' << stranger;
    }
  }
}

TEST(Guard, OfAllAddressesKnowsAddressesButNoNames) {
  for (const char* bound : {"0.0.0.0", "::", "192.168.1.5"}) {
    EXPECT_FALSE(Guard(bound).loopback()) << bound;
    for (const char* host : {"192.168.1.5:8080", "[fe80::1]:8080", "127.0.0.1", "localhost:80"}) {
      EXPECT_TRUE(lets_in(bound, host)) << bound << ' ' << host;
    }
    // A name that points here may be anybody's (DNS rebinding).
    for (const char* host : {"evil.example", "192.168.1.5.evil.example", "192.168.1", "192.168.1.5:", "[fe80::1"}) {
      EXPECT_FALSE(lets_in(bound, host)) << bound << ' ' << host;
    }
  }
  EXPECT_TRUE(lets_in("Box.Local", "box.local:8080"));
  EXPECT_FALSE(lets_in("Box.Local", "other.local:8080"));
}

TEST(Guard, KeepsPagesOfOthersOut) {
  const std::string bound = "0.0.0.0", host = "192.168.1.5:8080";
  EXPECT_TRUE(lets_in(bound, host, "http://192.168.1.5:8080", "same-origin"));
  EXPECT_FALSE(lets_in(bound, host, "http://192.168.1.6:8080"));
  EXPECT_FALSE(lets_in(bound, host, "null"));
  for (const char* site : {"cross-site", "same-site", "unheard-of"}) {
    EXPECT_FALSE(lets_in(bound, host, {}, site)) << site;
    EXPECT_TRUE(lets_in(bound, host, {}, site, "/?from=a-link")) << site;
  }
}

}  // namespace
}  // namespace interflect::serve
