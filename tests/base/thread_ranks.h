#pragma once

#include <algorithm>
#include <barrier>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "interflect/base/ranks.h"

namespace interflect::test {

/// Threads of this process as ranks. What one posts the others copy between two barriers.
class ThreadWorld {
 public:
  explicit ThreadWorld(std::uint32_t size) : size_(size), barrier_(size), posted_(size), sent_(size) {}

  /// Called with what all_gather() gives, before anybody sees it: a test spoils it.
  std::function<void(std::span<const std::uint64_t> bytes, std::span<std::byte> all)> spoil = {};

  /// `work` as every rank; throws what the first failing rank threw. A rank that fails alone must do so in agreed():
  /// else the others wait for it.
  void run(const std::function<void(Ranks&)>& work);

 private:
  friend class ThreadRanks;
  std::uint32_t size_;
  std::barrier<> barrier_;
  std::vector<std::span<const std::byte>> posted_;
  std::vector<const std::vector<std::vector<std::byte>>*> sent_;
};

class ThreadRanks final : public Ranks {
 public:
  ThreadRanks(ThreadWorld& world, std::uint32_t rank) : world_(world), rank_(rank) {}
  [[nodiscard]] std::uint32_t rank() const override { return rank_; }
  [[nodiscard]] std::uint32_t size() const override { return world_.size_; }
  [[nodiscard]] std::uint32_t local_rank() const override { return rank_; }
  [[nodiscard]] std::uint32_t local_size() const override { return world_.size_; }
  [[nodiscard]] std::string transport() const override { return "threads"; }
  [[nodiscard]] std::unique_ptr<RankFile> open(const std::filesystem::path& file) override {
    return OneRank().open(file);
  }
  [[noreturn]] void abort(int) noexcept override { std::terminate(); }

 protected:
  void do_all_gather(std::span<const std::byte> mine, std::span<const std::uint64_t> bytes,
                     std::span<std::byte> all) override {
    world_.posted_[rank_] = mine;
    world_.barrier_.arrive_and_wait();
    auto to = all.begin();
    for (std::size_t k = 0; k < bytes.size(); ++k) {
      to = std::copy(world_.posted_[k].begin(), world_.posted_[k].end(), to);
    }
    world_.barrier_.arrive_and_wait();
    if (world_.spoil) world_.spoil(bytes, all);
  }
  void do_broadcast(std::span<std::byte> bytes) override {
    world_.posted_[rank_] = bytes;
    world_.barrier_.arrive_and_wait();
    if (rank_ != 0) std::copy(world_.posted_[0].begin(), world_.posted_[0].end(), bytes.begin());
    world_.barrier_.arrive_and_wait();
  }
  [[nodiscard]] std::vector<std::vector<std::byte>> do_exchange(
      const std::vector<std::vector<std::byte>>& to) override {
    world_.sent_[rank_] = &to;
    world_.barrier_.arrive_and_wait();
    std::vector<std::vector<std::byte>> from;
    for (const auto* sent : world_.sent_) from.push_back((*sent)[rank_]);
    world_.barrier_.arrive_and_wait();
    return from;
  }

 private:
  ThreadWorld& world_;
  std::uint32_t rank_;
};

inline void ThreadWorld::run(const std::function<void(Ranks&)>& work) {
  std::vector<std::exception_ptr> failures(size_);
  std::vector<std::thread> threads;
  for (std::uint32_t rank = 0; rank < size_; ++rank) {
    threads.emplace_back([&, rank] {
      ThreadRanks ranks(*this, rank);
      try {
        work(ranks);
      } catch (...) {
        failures[rank] = std::current_exception();
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const std::exception_ptr& failure : failures) {
    if (failure) std::rethrow_exception(failure);
  }
}

}  // namespace interflect::test
