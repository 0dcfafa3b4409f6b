#include "interflect/serve/server.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "interflect/base/error.h"

// What a connection may do to the server, with deadlines short enough to be met here.

namespace interflect::serve {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

/// A client's end of a connection.
class Socket {
 public:
  explicit Socket(std::uint16_t port, int receive_buffer = 0) : descriptor_(::socket(AF_INET, SOCK_STREAM, 0)) {
    if (receive_buffer > 0) {
      ::setsockopt(descriptor_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    }
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(port);
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(descriptor_, reinterpret_cast<const sockaddr*>(&to), sizeof to), 0);
  }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  ~Socket() { ::close(descriptor_); }

  void send(std::string_view text) const {
    static_cast<void>(::send(descriptor_, text.data(), text.size(), MSG_NOSIGNAL));
  }
  /// Everything until the other end closes.
  [[nodiscard]] std::string rest() const {
    std::string all, piece(1 << 16, '\0');
    for (ssize_t n = 0; (n = ::recv(descriptor_, piece.data(), piece.size(), 0)) > 0;) {
      all.append(piece, 0, static_cast<std::size_t>(n));
    }
    return all;
  }

 private:
  int descriptor_;
};

constexpr std::string_view whole = "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n";

/// A server that answers everything with `body`.
class Running {
 public:
  explicit Running(const ServerLimits& limits, std::string body = "hello")
      : body_(std::make_shared<const std::string>(std::move(body))),
        server_("127.0.0.1", 0,
                {[](const Request&) { return std::nullopt; },
                 [this](const Request&, const std::function<void(Answer)>& done) {
                   done({200, "text/plain", body_, {}});
                 }},
                limits),
        thread_([this] { server_.run(); }) {}
  Running(const Running&) = delete;
  Running& operator=(const Running&) = delete;
  ~Running() {
    server_.stop();
    thread_.join();
  }
  [[nodiscard]] std::uint16_t port() const { return server_.port(); }

 private:
  std::shared_ptr<const std::string> body_;
  Server server_;
  std::thread thread_;
};

ServerLimits hasty() {
  ServerLimits limits;
  limits.read_seconds = limits.write_seconds = 0.2;
  return limits;
}

TEST(Server, AnswersAndCloses) {
  const Running running({});
  const Socket client(running.port());
  client.send(whole);
  const std::string answer = client.rest();
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200 OK\r\n"));
  EXPECT_THAT(answer, ::testing::EndsWith("\r\n\r\nhello"));
}

TEST(Server, SendsAwayWhoTakesTooLongToAsk) {
  const Running running(hasty());
  for (const std::string_view text : {std::string_view(), whole.substr(0, 20),
                                      std::string_view("POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 9\r\n\r\n{}")}) {
    const Socket client(running.port());
    client.send(text);
    EXPECT_THAT(client.rest(), StartsWith("HTTP/1.1 408 ")) << text;
  }
  // A byte now and then does not win time.
  const Socket drip(running.port());
  std::thread dripping([&] {
    for (int k = 0; k < 50; ++k) {
      drip.send("G");
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  });
  EXPECT_THAT(drip.rest(), StartsWith("HTTP/1.1 408 "));
  dripping.join();
}

TEST(Server, LeavesWhoDoesNotListen) {
  const std::string large(64 << 20, 'x');
  const Running running(hasty(), large);
  const Socket deaf(running.port(), 4096);
  deaf.send(whole);
  std::this_thread::sleep_for(std::chrono::milliseconds(600));
  EXPECT_LT(deaf.rest().size(), large.size());  // it was cut off
  const Socket listening(running.port());
  listening.send(whole);
  EXPECT_GT(listening.rest().size(), large.size());
}

TEST(Server, TooManyConnectionsAreToldToComeAgain) {
  ServerLimits limits;
  limits.connections = 4;
  limits.read_seconds = 2;
  const Running running(limits);
  std::vector<std::unique_ptr<Socket>> hanging;
  for (int k = 0; k < 4; ++k) hanging.push_back(std::make_unique<Socket>(running.port()));
  const Socket client(running.port());
  client.send(whole);
  const std::string answer = client.rest();
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 503 "));
  EXPECT_THAT(answer, HasSubstr("\r\nRetry-After: 1\r\n"));
  hanging.clear();
  std::string again;
  do {  // until the server has seen them go
    const Socket next(running.port());
    next.send(whole);
    again = next.rest();
  } while (again.starts_with("HTTP/1.1 503 "));
  EXPECT_THAT(again, StartsWith("HTTP/1.1 200 "));
}

TEST(Server, MoreThanItAcceptsWaitTheirTurn) {
  ServerLimits limits = hasty();
  limits.connections = 2;
  limits.most_connections = 3;
  const Running running(limits);
  std::vector<std::unique_ptr<Socket>> clients;
  for (int k = 0; k < 20; ++k) {
    clients.push_back(std::make_unique<Socket>(running.port()));
    if (k >= 3) clients.back()->send(whole);
  }
  for (std::size_t k = 3; k < clients.size(); ++k) {
    EXPECT_THAT(clients[k]->rest(), ::testing::AnyOf(StartsWith("HTTP/1.1 200 "), StartsWith("HTTP/1.1 503 "))) << k;
  }
}

TEST(Server, EndsWhileClientsHang) {
  std::vector<std::unique_ptr<Socket>> clients;
  {
    const Running running({});
    for (int k = 0; k < 5; ++k) clients.push_back(std::make_unique<Socket>(running.port()));
    for (const auto& client : clients) client->send("GET /");
    const Socket known(running.port());  // the others have been accepted before it is answered
    known.send(whole);
    EXPECT_THAT(known.rest(), StartsWith("HTTP/1.1 200 "));
  }
  for (const auto& client : clients) EXPECT_EQ(client->rest(), "");
}

TEST(Server, SaysWhatItCannotListenOn) {
  const auto refuse = [](const Request&) { return std::nullopt; };
  const auto answer = [](const Request&, const std::function<void(Answer)>&) {};
  const Server first("127.0.0.1", 0, {refuse, answer});
  EXPECT_THROW(Server("", 0, {refuse, answer}), Error);  // not all addresses, which would be open to everyone
  for (const auto& [host, port] :
       {std::pair<std::string, std::uint16_t>("127.0.0.1", first.port()), {"no.such.host.invalid", 0}}) {
    try {
      const Server second(host, port, {refuse, answer});
      ADD_FAILURE() << host;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::usage);
      EXPECT_THAT(error.what(), HasSubstr("cannot listen on " + host));
    }
  }
}

}  // namespace
}  // namespace interflect::serve
