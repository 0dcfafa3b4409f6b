#undef _FORTIFY_SOURCE  // its longjmp takes a jump to another stack for damage

#include <setjmp.h>
#include <ucontext.h>

#include <algorithm>
#include <cstddef>
#include <deque>
#include <limits>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <vector>

#include "device/cuda_on_cpu.h"

#if defined(__SANITIZE_ADDRESS__)
#define FIBERS_TELL_ASAN 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define FIBERS_TELL_ASAN 1
#endif
#endif
#ifdef FIBERS_TELL_ASAN
#include <sanitizer/common_interface_defs.h>
#endif

// The threads of a block as fibers: each runs until it waits, then the scheduler takes the next that is ready.

ThreadIndex threadIdx, blockIdx, blockDim, gridDim;

// The bounds of the section that __shared__ puts arrays into.
extern "C" {
extern float start_of_shared[] __asm__("__start_cuda_shared") __attribute__((visibility("hidden")));
extern float end_of_shared[] __asm__("__stop_cuda_shared") __attribute__((visibility("hidden")));
}

namespace interflect::cuda_on_cpu {

namespace {

constexpr std::uint32_t warp_size = 32;

/// A stack that can be left and gone on with. Under AddressSanitizer it is told which stack is in use, and contexts are
/// swapped; else they are swapped by setjmp and longjmp, which spare the two system calls of swapcontext.
class Stack {
 public:
  explicit Stack(std::size_t bytes) : memory_(bytes == 0 ? nullptr : new std::byte[bytes]), bytes_(bytes) {}

  /// From here on `function` runs when this stack is switched to.
  void begin(void (*function)()) {
    ::getcontext(&context_);
    context_.uc_stack.ss_sp = memory_.get();
    context_.uc_stack.ss_size = bytes_;
    context_.uc_link = nullptr;
    ::makecontext(&context_, function, 0);
    fresh_ = true;
  }

#ifdef FIBERS_TELL_ASAN
  static void swap(Stack& from, Stack& to) {
    const bool own = to.memory_ != nullptr;
    __sanitizer_start_switch_fiber(&from.fake_, own ? to.memory_.get() : main_bottom, own ? to.bytes_ : main_bytes);
    ::swapcontext(&from.context_, &to.context_);
    arrived(from);
  }
  /// A fiber's first words.
  static void arrived(Stack& here) {
    const void* bottom = nullptr;
    std::size_t bytes = 0;
    __sanitizer_finish_switch_fiber(here.fake_, &bottom, &bytes);
    if (here.memory_ != nullptr) {  // came from the scheduler: remember its stack
      main_bottom = bottom;
      main_bytes = bytes;
    }
  }
#else
  static void swap(Stack& from, Stack& to) {
    if (_setjmp(from.place_) != 0) return;
    if (to.fresh_) {
      to.fresh_ = false;
      ::setcontext(&to.context_);
    }
    _longjmp(to.place_, 1);
  }
  static void arrived(Stack& /*here*/) {}
#endif

 private:
  std::unique_ptr<std::byte[]> memory_;
  std::size_t bytes_;
  ucontext_t context_{};
  bool fresh_ = false;
#ifdef FIBERS_TELL_ASAN
  void* fake_ = nullptr;
  static inline const void* main_bottom = nullptr;
  static inline std::size_t main_bytes = 0;
#else
  jmp_buf place_{};
#endif
};

struct Fiber {
  explicit Fiber(std::size_t stack_bytes) : stack(stack_bytes) {}
  Stack stack;
  bool ended = true;
  std::uint32_t given = 0, from = 0, taken = 0;  ///< of an exchange
};

class Scheduler {
 public:
  Order order = Order::forwards;
  std::mutex one_launch;

  void run_block(const Compiled& kernel, std::uint32_t threads, void* const* parameters) {
    begin(kernel, threads, parameters);
    for (std::uint32_t running = threads; running > 0;) {
      if (ready_.empty()) {
        broken_ = true;
        throw std::runtime_error(running == threads ? kernel.kernel + ": threads wait at different places"
                                                    : kernel.kernel + ": a thread ended while others wait for it");
      }
      current_ = take();
      threadIdx = {current_, 0, 0};
      Stack::swap(main_, fibers_[current_]->stack);
      if (fibers_[current_]->ended) --running;
    }
  }

  void wait_for_block() {
    if (++at_block_barrier_ == threads_) {
      at_block_barrier_ = 0;
      for (std::uint32_t t = 0; t < threads_; ++t) ready_.push_back(t);
    }
    leave();
  }

  std::uint32_t exchange(std::uint32_t bits, std::uint32_t from) {
    const std::uint32_t first = current_ / warp_size * warp_size;
    Fiber& fiber = *fibers_[current_];
    fiber.given = bits;
    fiber.from = from;
    std::uint32_t& waiting = waiting_in_warp_[current_ / warp_size];
    if (++waiting == warp_size) {
      waiting = 0;
      for (std::uint32_t t = first; t < first + warp_size; ++t) {
        fibers_[t]->taken = fibers_[first + fibers_[t]->from]->given;
        ready_.push_back(t);
      }
    }
    leave();
    return fiber.taken;
  }

 private:
  void begin(const Compiled& kernel, std::uint32_t threads, void* const* parameters) {
    std::fill(start_of_shared, end_of_shared, std::numeric_limits<float>::quiet_NaN());
    kernel_ = &kernel;
    parameters_ = parameters;
    threads_ = threads;
    const std::size_t had = broken_ ? 0 : fibers_.size();
    while (fibers_.size() < threads) fibers_.push_back(std::make_unique<Fiber>(stack_bytes));
    for (std::size_t t = had; t < fibers_.size(); ++t) fibers_[t]->stack.begin(&Scheduler::fiber_main);
    broken_ = false;
    at_block_barrier_ = 0;
    waiting_in_warp_.assign(threads / warp_size, 0);
    ready_.clear();
    for (std::uint32_t t = 0; t < threads; ++t) {
      fibers_[t]->ended = false;
      ready_.push_back(t);
    }
  }

  /// A thread of one block after the other.
  static void fiber_main();

  void leave() { Stack::swap(fibers_[current_]->stack, main_); }

  std::uint32_t take() {
    std::uint32_t next = 0;
    if (order == Order::forwards) {
      next = ready_.front();
      ready_.pop_front();
      return next;
    }
    if (order == Order::shuffled) {
      random_ = random_ * 6364136223846793005U + 1442695040888963407U;  // Knuth's
      std::swap(ready_.back(), ready_[(random_ >> 33U) % ready_.size()]);
    }
    next = ready_.back();
    ready_.pop_back();
    return next;
  }

#ifdef FIBERS_TELL_ASAN
  static constexpr std::size_t stack_bytes = std::size_t{256} << 10U;
#else
  static constexpr std::size_t stack_bytes = std::size_t{64} << 10U;
#endif
  const Compiled* kernel_ = nullptr;
  void* const* parameters_ = nullptr;
  std::uint32_t threads_ = 0, current_ = 0, at_block_barrier_ = 0;
  bool broken_ = false;
  std::uint64_t random_ = 1;
  Stack main_{0};
  std::vector<std::unique_ptr<Fiber>> fibers_;
  std::vector<std::uint32_t> waiting_in_warp_;
  std::deque<std::uint32_t> ready_;
};

Scheduler& scheduler() {
  static Scheduler one;
  return one;
}

void Scheduler::fiber_main() {
  Scheduler& s = scheduler();
  Stack::arrived(s.fibers_[s.current_]->stack);
  for (;;) {
    s.kernel_->thread(s.parameters_);
    s.fibers_[s.current_]->ended = true;
    s.leave();
  }
}

std::vector<Compiled>& all_compiled() {
  static std::vector<Compiled> all;
  return all;
}

}  // namespace

void use_order(Order order) {
  scheduler().order = order;
}

void add(Compiled compiled) {
  all_compiled().push_back(std::move(compiled));
}

const Compiled* find(const std::string& variant, const std::string& kernel, const std::map<std::string, int>& macros) {
  const Compiled* found = nullptr;
  for (const Compiled& one : all_compiled()) {
    const bool fits = std::includes(macros.begin(), macros.end(), one.macros.begin(), one.macros.end());
    if (one.kernel != kernel || !fits) continue;
    if (one.variant == variant) return &one;
    if (one.variant.empty()) found = &one;
  }
  return found;
}

bool changes(const std::string& variant, const std::string& kernel) {
  return std::any_of(all_compiled().begin(), all_compiled().end(),
                     [&](const Compiled& one) { return one.variant == variant && one.kernel == kernel; });
}

void run(const Compiled& kernel, std::uint32_t grid, std::uint32_t threads, void* const* parameters) {
  if (threads == 0 || threads % warp_size != 0) throw std::runtime_error("whole warps only");
  const std::lock_guard lock(scheduler().one_launch);
  gridDim = {grid, 1, 1};
  blockDim = {threads, 1, 1};
  for (std::uint32_t block = 0; block < grid; ++block) {
    blockIdx = {block, 0, 0};
    scheduler().run_block(kernel, threads, parameters);
  }
}

std::uint32_t exchange(std::uint32_t bits, std::uint32_t from) {
  return scheduler().exchange(bits, from);
}

void block_barrier() {
  scheduler().wait_for_block();
}

void warp_barrier() {
  (void)scheduler().exchange(0, 0);
}

}  // namespace interflect::cuda_on_cpu
