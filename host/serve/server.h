#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "interflect/serve/answer.h"
#include "interflect/serve/guard.h"

namespace interflect::serve {

/// What one connection, and all of them together, may take.
struct ServerLimits {
  std::size_t connections = 64;        ///< above: 503
  std::size_t most_connections = 256;  ///< above: not accepted until one ends
  std::uint32_t header_bytes = 16 << 10;
  std::uint64_t body_bytes = 64 << 10;
  double read_seconds = 10;   ///< for a whole request to come
  double write_seconds = 20;  ///< for each piece of 256 KiB of the answer to go
};

/// What a Server asks.
struct Handler {
  /// Of a request without its body; nothing: read the body.
  std::function<std::optional<Answer>(const Request&)> refuse;
  /// Calls its second argument once, in any thread, now or later.
  std::function<void(const Request&, std::function<void(Answer)>)> answer;
};

/// HTTP/1.1 over TCP, a request per connection, in one thread that never waits for a client: reading and writing have
/// deadlines. An oversized body is answered with 413, an oversized header with 431, one that is no HTTP with 400, a
/// client that is too slow with 408.
class Server {
 public:
  /// Listens; port 0 is any free one. Throws a usage Error when that cannot be, and for an empty host.
  Server(const std::string& host, std::uint16_t port, Handler handler, const ServerLimits& limits = {});
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;
  ~Server();

  [[nodiscard]] std::uint16_t port() const;
  /// `end` is called once, in run()'s thread, at the first SIGINT or SIGTERM; the second one ends the process. A signal
  /// that was ignored stays so.
  void on_signal(std::function<void()> end);
  /// Serves in this thread until stop().
  void run();
  /// From any thread: accepts no more, lets answers that are on their way out for a second, and ends run().
  void stop();

 private:
  class State;
  std::unique_ptr<State> state_;
};

}  // namespace interflect::serve
