#include "interflect/base/ranks.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <new>
#include <numeric>
#include <optional>

#include "interflect/base/timer.h"

namespace interflect {

RanksUse operator-(const RanksUse& later, const RanksUse& earlier) {
  return {later.messages - earlier.messages, later.bytes_gathered - earlier.bytes_gathered,
          later.bytes_exchanged - earlier.bytes_exchanged, later.seconds - earlier.seconds};
}

void Ranks::all_gather(std::span<const std::byte> mine, std::span<const std::uint64_t> bytes,
                       std::span<std::byte> all) {
  const std::uint64_t whole = std::accumulate(bytes.begin(), bytes.end(), std::uint64_t{0});
  if (bytes.size() != size() || mine.size() != bytes[rank()] || all.size() != whole) {
    throw Error(ErrorKind::internal, "ranks: a gather of another shape");
  }
  const Timer timer;
  do_all_gather(mine, bytes, all);
  ++use_.messages;
  use_.bytes_gathered += all.size() - mine.size();
  use_.seconds += timer.seconds();
}

void Ranks::broadcast(std::span<std::byte> bytes) {
  const Timer timer;
  do_broadcast(bytes);
  ++use_.messages;
  if (rank() != 0) use_.bytes_gathered += bytes.size();
  use_.seconds += timer.seconds();
}

std::vector<std::vector<std::byte>> Ranks::exchange(const std::vector<std::vector<std::byte>>& to) {
  if (to.size() != size()) throw Error(ErrorKind::internal, "ranks: an exchange of another shape");
  const Timer timer;
  std::vector<std::vector<std::byte>> from = do_exchange(to);
  ++use_.messages;
  for (std::uint32_t k = 0; k < size(); ++k) use_.bytes_exchanged += k == rank() ? 0 : from[k].size();
  use_.seconds += timer.seconds();
  return from;
}

std::vector<double> Ranks::all_values(double mine) {
  std::vector<double> all(size());
  const std::vector<std::uint64_t> bytes(size(), sizeof(double));
  all_gather(std::as_bytes(std::span(&mine, 1)), bytes, std::as_writable_bytes(std::span(all)));
  return all;
}

double Ranks::sum(double mine) {
  const std::vector<double> all = all_values(mine);
  return std::accumulate(all.begin(), all.end(), 0.0);
}

std::vector<std::string> Ranks::all_texts(std::string_view mine) {
  std::vector<std::uint64_t> bytes;
  for (const double length : all_values(static_cast<double>(mine.size()))) {
    bytes.push_back(static_cast<std::uint64_t>(length));
  }
  std::string joined(std::accumulate(bytes.begin(), bytes.end(), std::uint64_t{0}), '\0');
  all_gather(std::as_bytes(std::span(mine.data(), mine.size())), bytes,
             std::as_writable_bytes(std::span(joined.data(), joined.size())));
  std::vector<std::string> all;
  for (std::size_t k = 0, at = 0; k < bytes.size(); at += bytes[k++]) all.push_back(joined.substr(at, bytes[k]));
  return all;
}

bool Ranks::rank_zeros(bool mine) {
  auto byte = static_cast<std::byte>(mine ? 1 : 0);
  broadcast(std::span(&byte, 1));
  return byte != std::byte{0};
}

std::uint64_t Ranks::rank_zeros(std::uint64_t mine) {
  broadcast(std::as_writable_bytes(std::span(&mine, 1)));
  return mine;
}

void agreed(Ranks& ranks, const std::function<void()>& work) {
  std::optional<Error> failure;
  try {
    work();
  } catch (const Error& error) {
    failure = error;
  } catch (const std::bad_alloc&) {
    failure = Error(ErrorKind::limit, "out of memory");
  }
  if (ranks.size() == 1) {
    if (failure) throw Error(*failure);
    return;
  }
  const std::vector<double> kinds = ranks.all_values(failure ? static_cast<double>(failure->kind()) : -1.0);
  const auto failed = [](double kind) { return kind >= 0; };
  const auto first = std::find_if(kinds.begin(), kinds.end(), failed);
  if (first == kinds.end()) return;
  const std::vector<std::string> texts = ranks.all_texts(failure ? failure->what() : "");
  const auto rank = static_cast<std::size_t>(first - kinds.begin());
  const bool all = std::all_of(kinds.begin(), kinds.end(), failed);
  throw AgreedError(static_cast<ErrorKind>(static_cast<int>(*first)),
                    all ? texts[rank] : fmt::format("{} (rank {})", texts[rank], rank));
}

void OneRank::do_all_gather(std::span<const std::byte> mine, std::span<const std::uint64_t>, std::span<std::byte> all) {
  std::copy(mine.begin(), mine.end(), all.begin());
}

namespace {

class PlainFile final : public RankFile {
 public:
  explicit PlainFile(const std::filesystem::path& file)
      : name_(file.string()), descriptor_(::open(file.c_str(), O_WRONLY | O_CLOEXEC)) {
    if (descriptor_ < 0) fail("open");
  }
  PlainFile(const PlainFile&) = delete;
  PlainFile& operator=(const PlainFile&) = delete;
  ~PlainFile() override { ::close(descriptor_); }
  void write_at(std::uint64_t offset, std::span<const std::byte> bytes) override {
    while (!bytes.empty()) {
      const ssize_t done = ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
      if (done < 0 && errno == EINTR) continue;
      if (done <= 0) fail("write");
      bytes = bytes.subspan(static_cast<std::size_t>(done));
      offset += static_cast<std::uint64_t>(done);
    }
  }
  void sync() override {
    if (::fdatasync(descriptor_) != 0 && errno != EINVAL) fail("write");
  }

 private:
  [[noreturn]] void fail(const char* action) const {
    const int cause = errno;
    const bool full = cause == ENOSPC || cause == EDQUOT || cause == EFBIG;
    throw Error(full ? ErrorKind::limit : ErrorKind::input,
                fmt::format("{}: cannot {}: {}", name_, action, std::strerror(cause)));
  }
  std::string name_;
  int descriptor_;
};

}  // namespace

std::unique_ptr<RankFile> OneRank::open(const std::filesystem::path& file) {
  return std::make_unique<PlainFile>(file);
}

void OneRank::abort(int status) noexcept {
  std::_Exit(status);
}

}  // namespace interflect
