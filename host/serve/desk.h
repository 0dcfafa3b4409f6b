#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <string>

#include "interflect/serve/answer.h"

namespace interflect::serve {

/// Where connections leave work for the one thread that solves. Bounded: of every client only the newest solve waits.
class Desk {
 public:
  using Work = std::function<Answer()>;
  using Done = std::function<void(Answer)>;

  explicit Desk(std::size_t most_waiting) : most_waiting_(most_waiting) {}
  Desk(const Desk&) = delete;
  Desk& operator=(const Desk&) = delete;

  /// Leaves work; `done` is called once, in any thread, with what the work answers. When work of the same client (and
  /// not of "") waits already, this takes its place and that is answered with status 409; when too much waits, or run()
  /// has ended, this is answered with 503 at once.
  void leave(const std::string& client, Work work, Done done);
  /// Does what is left here, in this thread, until stop(). What then waits is answered with 503. An exception that work
  /// throws is its answer: 500 and its text, and the next is done.
  void run();
  /// From any thread.
  void stop();

 private:
  struct Job {
    std::string client;
    Work work;
    Done done;
  };

  std::mutex mutex_;  ///< of all below
  std::condition_variable changed_;
  std::deque<Job> waiting_;
  std::size_t most_waiting_;
  bool stopped_ = false;
};

}  // namespace interflect::serve
