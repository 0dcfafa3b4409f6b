#include "interflect/serve/desk.h"

#include <algorithm>
#include <exception>
#include <utility>

namespace interflect::serve {

namespace {

Answer done_by(const Desk::Work& work) {
  try {
    return work();
  } catch (const std::exception& error) {
    return refusal(500, error.what());
  }
}

}  // namespace

void Desk::leave(const std::string& client, Work work, Done done) {
  Done refused;
  Answer answer;
  {
    const std::lock_guard lock(mutex_);
    const auto same = std::find_if(waiting_.begin(), waiting_.end(),
                                   [&](const Job& job) { return !client.empty() && job.client == client; });
    if (stopped_) {
      refused = std::move(done);
      answer = refusal(503, "the server ends");
    } else if (same != waiting_.end()) {
      refused = std::exchange(same->done, std::move(done));
      same->work = std::move(work);
      answer = refusal(409, "a newer change has taken the place of this one");
    } else if (waiting_.size() >= most_waiting_) {
      refused = std::move(done);
      answer = refusal(503, "too many solves are waiting");
    } else {
      waiting_.push_back({client, std::move(work), std::move(done)});
    }
  }
  changed_.notify_one();
  if (refused) refused(answer);
}

void Desk::run() {
  while (true) {
    Job job;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return stopped_ || !waiting_.empty(); });
      if (stopped_) break;
      job = std::move(waiting_.front());
      waiting_.pop_front();
    }
    job.done(done_by(job.work));
  }
  std::deque<Job> left;
  {
    const std::lock_guard lock(mutex_);
    left.swap(waiting_);
  }
  for (const Job& job : left) job.done(refusal(503, "the server ends"));
}

void Desk::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  changed_.notify_all();
}

}  // namespace interflect::serve
