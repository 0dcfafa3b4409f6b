#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/base/error.h"

namespace interflect {

/// What the ranks said to each other so far, as this rank has seen it.
struct RanksUse {
  std::uint64_t messages = 0;         ///< collective calls
  std::uint64_t bytes_gathered = 0;   ///< that came from other ranks by all_gather() and broadcast()
  std::uint64_t bytes_exchanged = 0;  ///< that came from other ranks by exchange()
  double seconds = 0;                 ///< within these calls, waiting for the others included
};
[[nodiscard]] RanksUse operator-(const RanksUse& later, const RanksUse& earlier);

/// A file that all ranks write: each its own places.
class RankFile {
 public:
  RankFile() = default;
  RankFile(const RankFile&) = delete;
  RankFile& operator=(const RankFile&) = delete;
  virtual ~RankFile() = default;  ///< collective
  /// Throws a limit Error where the disk is full, an input Error else.
  virtual void write_at(std::uint64_t offset, std::span<const std::byte> bytes) = 0;
  /// Collective: when it returns, what every rank has written is on the disk.
  virtual void sync() = 0;
};

/// The processes that do one job together, as MPI's ranks. Every function but rank() and size() is collective: all
/// ranks call it, in the same order. One thread at a time. Throws internal Errors when the transport fails.
class Ranks {
 public:
  Ranks() = default;
  Ranks(const Ranks&) = delete;
  Ranks& operator=(const Ranks&) = delete;
  virtual ~Ranks() = default;

  [[nodiscard]] virtual std::uint32_t rank() const = 0;
  [[nodiscard]] virtual std::uint32_t size() const = 0;
  [[nodiscard]] virtual std::uint32_t local_rank() const = 0;  ///< among those on the same machine
  [[nodiscard]] virtual std::uint32_t local_size() const = 0;
  [[nodiscard]] virtual std::string transport() const = 0;  ///< such as "Open MPI 4.1.4"; of one process: ""

  /// `all` becomes the bytes of all ranks, one behind the other in their order: bytes[k] of rank k.
  void all_gather(std::span<const std::byte> mine, std::span<const std::uint64_t> bytes, std::span<std::byte> all);
  /// `bytes` of every rank becomes that of rank 0.
  void broadcast(std::span<std::byte> bytes);
  /// Sends to[k] to rank k; gives what rank k has sent here at [k].
  [[nodiscard]] std::vector<std::vector<std::byte>> exchange(const std::vector<std::vector<std::byte>>& to);
  /// Opens a file that is there for writing.
  [[nodiscard]] virtual std::unique_ptr<RankFile> open(const std::filesystem::path& file) = 0;
  /// Ends all ranks at once, this one with them.
  [[noreturn]] virtual void abort(int status) noexcept = 0;

  // Made of these:
  /// What each rank has, by rank.
  [[nodiscard]] std::vector<std::string> all_texts(std::string_view mine);
  [[nodiscard]] std::vector<double> all_values(double mine);
  /// In rank order, so that every rank has the same bits.
  [[nodiscard]] double sum(double mine);
  /// What rank 0 says.
  [[nodiscard]] bool rank_zeros(bool mine);
  [[nodiscard]] std::uint64_t rank_zeros(std::uint64_t mine);
  template <class T>
  void broadcast_values(std::span<T> values) {
    broadcast(std::as_writable_bytes(values));
  }

  [[nodiscard]] const RanksUse& use() const { return use_; }

 protected:
  virtual void do_all_gather(std::span<const std::byte> mine, std::span<const std::uint64_t> bytes,
                             std::span<std::byte> all) = 0;
  virtual void do_broadcast(std::span<std::byte> bytes) = 0;
  [[nodiscard]] virtual std::vector<std::vector<std::byte>> do_exchange(
      const std::vector<std::vector<std::byte>>& to) = 0;

 private:
  RanksUse use_;
};

/// An Error that every rank throws, because one of them has met it: all end in order, and rank 0 says it.
class AgreedError : public Error {
 public:
  using Error::Error;
};

/// Collective: `work` on every rank. Where it throws an Error on one, all throw an AgreedError with the first failing
/// rank's kind and text; " (rank 2)" is added where not all ranks have failed. `work` calls nothing that is collective.
void agreed(Ranks& ranks, const std::function<void()>& work);

/// A job of one process.
class OneRank final : public Ranks {
 public:
  [[nodiscard]] std::uint32_t rank() const override { return 0; }
  [[nodiscard]] std::uint32_t size() const override { return 1; }
  [[nodiscard]] std::uint32_t local_rank() const override { return 0; }
  [[nodiscard]] std::uint32_t local_size() const override { return 1; }
  [[nodiscard]] std::string transport() const override { return {}; }
  [[nodiscard]] std::unique_ptr<RankFile> open(const std::filesystem::path& file) override;
  [[noreturn]] void abort(int status) noexcept override;

 protected:
  void do_all_gather(std::span<const std::byte> mine, std::span<const std::uint64_t> bytes,
                     std::span<std::byte> all) override;
  void do_broadcast(std::span<std::byte>) override {}
  [[nodiscard]] std::vector<std::vector<std::byte>> do_exchange(
      const std::vector<std::vector<std::byte>>& to) override {
    return to;
  }
};

}  // namespace interflect
