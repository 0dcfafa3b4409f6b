#include "interflect/serve/server.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <csignal>
#include <utility>

#include "interflect/base/error.h"

namespace interflect::serve {

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using asio::ip::tcp;
using boost::system::error_code;

std::chrono::milliseconds milliseconds(double seconds) {
  return std::chrono::milliseconds(static_cast<std::int64_t>(1000 * seconds));
}

std::string text(beast::string_view view) {
  return {view.data(), view.size()};
}

/// Everything before the body. The page may be shown in no frame, and read by no other origin.
std::string header_of(const Answer& answer, std::size_t length) {
  std::string header = fmt::format(
      "HTTP/1.1 {} {}\r\nContent-Type: {}\r\nContent-Length: {}\r\nConnection: close\r\nCache-Control: no-store\r\n"
      "X-Content-Type-Options: nosniff\r\nX-Frame-Options: DENY\r\nContent-Security-Policy: frame-ancestors 'none'\r\n"
      "Cross-Origin-Resource-Policy: same-origin\r\nCross-Origin-Opener-Policy: same-origin\r\n"
      "Referrer-Policy: no-referrer\r\n",
      answer.status, text(http::obsolete_reason(static_cast<http::status>(answer.status))), answer.type, length);
  if (!answer.allow.empty()) header += fmt::format("Allow: {}\r\n", answer.allow);
  if (answer.status == 503) header += "Retry-After: 1\r\n";
  return header + "\r\n";
}

/// What to say of a request that could not be read; status 0: nobody is there to hear it.
Answer unread(const error_code& error, const ServerLimits& limits) {
  if (error == http::error::body_limit) {
    return refusal(413, fmt::format("the body is larger than {} bytes", limits.body_bytes));
  }
  if (error == http::error::header_limit || error == http::error::buffer_overflow) {
    return refusal(431, fmt::format("the header is larger than {} bytes", limits.header_bytes));
  }
  const bool of_http = error.category() == http::make_error_code(http::error::bad_method).category();
  if (of_http && error != http::error::end_of_stream) {
    return refusal(400, fmt::format("this is no HTTP request: {}", error.message()));
  }
  return {0, {}, {}, {}};
}

}  // namespace

class Server::State {
 public:
  State(const std::string& host, std::uint16_t port, Handler handler, const ServerLimits& limits);
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() { ending_ = true; }  // the context, in going, ends what connections are left

  void accept();
  void on_signal(std::function<void()> end);
  void stop();
  void opened() { ++open_; }
  void closed();

  [[nodiscard]] bool busy() const { return open_ > limits.connections; }

  Handler handler;
  ServerLimits limits;

 private:
  std::size_t open_ = 0;
  bool accepting_ = false, stopping_ = false, ending_ = false;

 public:
  asio::io_context context{1};
  tcp::acceptor acceptor{context};

 private:
  asio::signal_set signals_{context};
  asio::steady_timer grace_{context};
};

namespace {

/// One connection: a request comes, its answer goes, the connection is closed. Lives as long as something is going on.
template <class State>
class Session : public std::enable_shared_from_this<Session<State>> {
 public:
  Session(State& state, tcp::socket socket)
      : state_(&state), stream_(std::move(socket)), deadline_(stream_.get_executor()) {
    state_->opened();
    parser_.header_limit(state_->limits.header_bytes);
    parser_.body_limit(state_->limits.body_bytes);
  }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;
  ~Session() { state_->closed(); }

  void start() {
    busy_ = state_->busy();
    // Not the stream's own timeout, which closes: what is late is told so.
    deadline_.expires_after(
        milliseconds(busy_ ? std::min(1.0, state_->limits.read_seconds) : state_->limits.read_seconds));
    deadline_.async_wait([weak = this->weak_from_this()](error_code error) {
      const auto self = weak.lock();
      if (error || !self || self->complete_) return;
      self->late_ = true;
      self->stream_.cancel();
    });
    http::async_read_header(
        stream_, buffer_, parser_,
        [self = this->shared_from_this()](error_code error, std::size_t) { self->on_header(error); });
  }

 private:
  void on_header(error_code error) {
    if (busy_) return send(refusal(503, "too many connections"));
    // Late without an error: the deadline came when this was on its way here, and nothing would end what follows.
    if (error || late_) return unread_request(error);
    const auto& message = parser_.get();
    const auto field = [&](beast::string_view name) { return text(message[name]); };
    request_ = {text(message.method_string()),
                text(message.target()),
                field("Host"),
                field("Origin"),
                field("Sec-Fetch-Site"),
                field("Content-Type"),
                {}};
    if (auto refused = state_->handler.refuse(request_)) return send(std::move(*refused));
    http::async_read(stream_, buffer_, parser_,
                     [self = this->shared_from_this()](error_code e, std::size_t) { self->on_body(e); });
  }

  void unread_request(const error_code& error) {
    send(late_ ? refusal(408, "the request took too long to come") : unread(error, state_->limits));
  }

  void on_body(error_code error) {
    if (error) return unread_request(error);
    complete_ = true;
    request_.body = std::move(parser_.get().body());
    state_->handler.answer(request_, [self = this->shared_from_this()](Answer answer) mutable {
      auto executor = self->stream_.get_executor();
      asio::post(executor,
                 [self = std::move(self), answer = std::move(answer)]() mutable { self->send(std::move(answer)); });
    });
  }

  void send(Answer answer) {
    complete_ = true;
    deadline_.cancel();
    if (answer.status == 0) return;
    answer_ = std::move(answer);
    const std::size_t length = answer_.body ? answer_.body->size() : 0;
    header_ = header_of(answer_, length);
    if (request_.method == "HEAD") answer_.body = nullptr;
    write(asio::buffer(header_), 0);
  }

  /// `next`: of the body, when this is written.
  void write(asio::const_buffer piece, std::size_t next) {
    stream_.expires_after(milliseconds(state_->limits.write_seconds));
    asio::async_write(stream_, piece, [self = this->shared_from_this(), next](error_code error, std::size_t) {
      constexpr std::size_t most = 256 << 10;
      const std::size_t length = self->answer_.body ? self->answer_.body->size() : 0;
      if (error) return;
      if (next >= length) return self->finish();
      const std::size_t bytes = std::min(most, length - next);
      self->write(asio::buffer(self->answer_.body->data() + next, bytes), next + bytes);
    });
  }

  /// What the client still sends is read away for a moment: a connection that is closed over unread bytes is reset, and
  /// the client might never see the answer.
  void finish() {
    error_code ignored;
    stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    stream_.expires_after(milliseconds(std::min(1.0, state_->limits.write_seconds)));
    drain(0);
  }

  void drain(std::size_t so_far) {
    constexpr std::size_t most = 4 << 20;
    stream_.async_read_some(asio::buffer(scrap_),
                            [self = this->shared_from_this(), so_far](error_code error, std::size_t n) {
                              if (!error && so_far + n < most) self->drain(so_far + n);
                            });
  }

  State* state_;
  beast::tcp_stream stream_;
  asio::steady_timer deadline_;  ///< until the request is complete
  beast::flat_buffer buffer_{96 << 10};
  http::request_parser<http::string_body> parser_;
  Request request_;
  Answer answer_;
  std::string header_;
  std::array<char, 4096> scrap_{};
  bool busy_ = false, late_ = false, complete_ = false;
};

}  // namespace

Server::State::State(const std::string& host, std::uint16_t port, Handler handle, const ServerLimits& given)
    : handler(std::move(handle)), limits(given) {
  const auto check = [&](const error_code& error) {
    if (!error) return;
    throw Error(ErrorKind::usage, fmt::format("cannot listen on {}:{}: {}", host, port, error.message()));
  };
  // To a resolver that would be every address of the machine.
  if (host.empty()) throw Error(ErrorKind::usage, "cannot listen: no address is given");
  error_code error;
  tcp::resolver resolver(context);
  const auto found = resolver.resolve(host, std::to_string(port), tcp::resolver::passive, error);
  check(error);
  const tcp::endpoint endpoint = found.begin()->endpoint();
  check(acceptor.open(endpoint.protocol(), error));
  check(acceptor.set_option(tcp::acceptor::reuse_address(true), error));
  check(acceptor.bind(endpoint, error));
  check(acceptor.listen(512, error));
}

void Server::State::accept() {
  if (accepting_ || stopping_ || open_ >= limits.most_connections) return;
  accepting_ = true;
  acceptor.async_accept([this](error_code error, tcp::socket socket) {
    accepting_ = false;
    if (stopping_) return;
    if (!error) {
      std::make_shared<Session<State>>(*this, std::move(socket))->start();
      return accept();
    }
    // Out of descriptors, most likely: it will not help to try again at once.
    grace_.expires_after(std::chrono::milliseconds(100));
    grace_.async_wait([this](error_code) { accept(); });
  });
}

void Server::State::closed() {
  --open_;
  if (ending_) return;
  if (stopping_ && open_ == 0) context.stop();
  if (!stopping_) accept();
}

void Server::State::on_signal(std::function<void()> end) {
  for (const int signal : {SIGINT, SIGTERM}) {
    struct sigaction old {};
    if (::sigaction(signal, nullptr, &old) == 0 && old.sa_handler != SIG_IGN) signals_.add(signal);
  }
  signals_.async_wait([this, end = std::move(end)](error_code error, int) {
    if (error) return;
    error_code ignored;
    signals_.clear(ignored);  // the next one has its own effect
    end();
  });
}

void Server::State::stop() {
  asio::post(context, [this] {
    error_code ignored;
    stopping_ = true;
    acceptor.close(ignored);
    signals_.cancel(ignored);
    if (open_ == 0) return context.stop();
    grace_.expires_after(std::chrono::seconds(1));
    grace_.async_wait([this](error_code error) {
      if (!error) context.stop();
    });
  });
}

Server::Server(const std::string& host, std::uint16_t port, Handler handler, const ServerLimits& limits)
    : state_(std::make_unique<State>(host, port, std::move(handler), limits)) {}

Server::~Server() = default;

std::uint16_t Server::port() const {
  return state_->acceptor.local_endpoint().port();
}

void Server::on_signal(std::function<void()> end) {
  state_->on_signal(std::move(end));
}

void Server::run() {
  state_->accept();
  state_->context.run();
}

void Server::stop() {
  state_->stop();
}

}  // namespace interflect::serve
