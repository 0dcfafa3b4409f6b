#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>

namespace interflect {

/// A thread that does one job after the other for one other thread. What a job throws is thrown by wait().
class Worker {
 public:
  Worker() : thread_([this] { run(); }) {}
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;
  /// Waits for the job in hand.
  ~Worker();

  /// Begins a job. The one before must have been waited for.
  void start(std::function<void()> job);
  /// Returns when the job is done, or throws what it threw; at once where there is none.
  void wait();

 private:
  void run();

  std::mutex mutex_;
  std::condition_variable changed_;
  std::function<void()> job_;
  std::exception_ptr failure_;
  bool busy_ = false, ends_ = false;
  std::thread thread_;  ///< last: it uses the others
};

}  // namespace interflect
