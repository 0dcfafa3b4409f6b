// The ranks of an MPI job. A module of its own, so that the program links no MPI: host/cli/launch.cpp opens it where
// mpirun has started the program. It uses nothing of the house but headers.

#include <mpi.h>

#include <algorithm>
#include <climits>
#include <string>

#include "interflect/base/error.h"
#include "interflect/base/ranks.h"

namespace interflect {

namespace {

std::string text_of(int code) {
  std::string text(MPI_MAX_ERROR_STRING, '\0');
  int length = 0;
  if (MPI_Error_string(code, text.data(), &length) != MPI_SUCCESS) return "error " + std::to_string(code);
  text.resize(static_cast<std::size_t>(length));
  return text;
}

void check(int code, const char* call) {
  if (code == MPI_SUCCESS) return;
  throw Error(ErrorKind::internal, std::string("the ranks lost each other: ") + call + ": " + text_of(code));
}

/// MPI counts in int.
int count_of(std::uint64_t bytes) {
  if (bytes > INT_MAX) throw Error(ErrorKind::limit, "MPI: more than 2 GiB in one message: use more ranks");
  return static_cast<int>(bytes);
}

struct Counts {
  std::vector<int> count, place;
  std::uint64_t whole = 0;
  void add(std::uint64_t bytes) {
    count.push_back(count_of(bytes));
    place.push_back(count_of(whole));
    whole += bytes;
  }
};

class SharedFile final : public RankFile {
 public:
  explicit SharedFile(const std::filesystem::path& file) : name_(file.string()) {
    check_file(MPI_File_open(MPI_COMM_WORLD, name_.c_str(), MPI_MODE_WRONLY, MPI_INFO_NULL, &file_), "open");
  }
  SharedFile(const SharedFile&) = delete;
  SharedFile& operator=(const SharedFile&) = delete;
  ~SharedFile() override {
    if (std::uncaught_exceptions() == 0) MPI_File_close(&file_);  // collective: the others may not come
  }
  void write_at(std::uint64_t offset, std::span<const std::byte> bytes) override {
    constexpr std::size_t most = std::size_t{1} << 30;
    while (!bytes.empty()) {
      const auto part = bytes.first(std::min(most, bytes.size()));
      MPI_Status status;
      check_file(MPI_File_write_at(file_, static_cast<MPI_Offset>(offset), part.data(), count_of(part.size()), MPI_BYTE,
                                   &status),
                 "write");
      int written = 0;
      check_file(MPI_Get_count(&status, MPI_BYTE, &written), "write");
      if (written <= 0) throw Error(ErrorKind::limit, name_ + ": cannot write: the disk is full");
      bytes = bytes.subspan(static_cast<std::size_t>(written));
      offset += static_cast<std::uint64_t>(written);
    }
  }
  void sync() override { check_file(MPI_File_sync(file_), "write"); }

 private:
  void check_file(int code, const char* action) const {
    if (code == MPI_SUCCESS) return;
    int kind = MPI_ERR_OTHER;
    MPI_Error_class(code, &kind);
    const bool full = kind == MPI_ERR_NO_SPACE || kind == MPI_ERR_QUOTA;
    throw Error(full ? ErrorKind::limit : ErrorKind::input, name_ + ": cannot " + action + ": " + text_of(code));
  }
  std::string name_;
  MPI_File file_ = MPI_FILE_NULL;
};

class MpiRanks final : public Ranks {
 public:
  MpiRanks() {
    int level = 0;
    check(MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &level), "MPI_Init_thread");
    check(MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_RETURN), "MPI_Comm_set_errhandler");
    check(MPI_Comm_rank(MPI_COMM_WORLD, &rank_), "MPI_Comm_rank");
    check(MPI_Comm_size(MPI_COMM_WORLD, &size_), "MPI_Comm_size");
    MPI_Comm machine = MPI_COMM_NULL;
    check(MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, rank_, MPI_INFO_NULL, &machine),
          "MPI_Comm_split_type");
    check(MPI_Comm_rank(machine, &local_rank_), "MPI_Comm_rank");
    check(MPI_Comm_size(machine, &local_size_), "MPI_Comm_size");
    MPI_Comm_free(&machine);
  }
  MpiRanks(const MpiRanks&) = delete;
  MpiRanks& operator=(const MpiRanks&) = delete;
  ~MpiRanks() override { MPI_Finalize(); }

  [[nodiscard]] std::uint32_t rank() const override { return static_cast<std::uint32_t>(rank_); }
  [[nodiscard]] std::uint32_t size() const override { return static_cast<std::uint32_t>(size_); }
  [[nodiscard]] std::uint32_t local_rank() const override { return static_cast<std::uint32_t>(local_rank_); }
  [[nodiscard]] std::uint32_t local_size() const override { return static_cast<std::uint32_t>(local_size_); }
  [[nodiscard]] std::string transport() const override {
    std::string text(MPI_MAX_LIBRARY_VERSION_STRING, '\0');
    int length = 0;
    MPI_Get_library_version(text.data(), &length);
    text.resize(static_cast<std::size_t>(length));
    return text.substr(0, text.find_first_of(",\n"));
  }
  [[nodiscard]] std::unique_ptr<RankFile> open(const std::filesystem::path& file) override {
    return std::make_unique<SharedFile>(file);
  }
  [[noreturn]] void abort(int status) noexcept override {
    MPI_Abort(MPI_COMM_WORLD, status);
    std::_Exit(status);
  }

 protected:
  void do_all_gather(std::span<const std::byte> mine, std::span<const std::uint64_t> bytes,
                     std::span<std::byte> all) override {
    Counts counts;
    for (const std::uint64_t b : bytes) counts.add(b);
    check(MPI_Allgatherv(mine.data(), count_of(mine.size()), MPI_BYTE, all.data(), counts.count.data(),
                         counts.place.data(), MPI_BYTE, MPI_COMM_WORLD),
          "MPI_Allgatherv");
  }
  void do_broadcast(std::span<std::byte> bytes) override {
    constexpr std::size_t most = std::size_t{1} << 30;
    for (std::size_t at = 0; at < bytes.size(); at += most) {
      const auto part = bytes.subspan(at, std::min(most, bytes.size() - at));
      check(MPI_Bcast(part.data(), count_of(part.size()), MPI_BYTE, 0, MPI_COMM_WORLD), "MPI_Bcast");
    }
  }
  [[nodiscard]] std::vector<std::vector<std::byte>> do_exchange(
      const std::vector<std::vector<std::byte>>& to) override {
    std::vector<std::uint64_t> out_bytes, in_bytes(to.size());
    for (const auto& part : to) out_bytes.push_back(part.size());
    check(MPI_Alltoall(out_bytes.data(), 1, MPI_UINT64_T, in_bytes.data(), 1, MPI_UINT64_T, MPI_COMM_WORLD),
          "MPI_Alltoall");
    Counts in, out;
    for (std::size_t k = 0; k < to.size(); ++k) {
      out.add(out_bytes[k]);
      in.add(in_bytes[k]);
    }
    std::vector<std::byte> sent, received(in.whole);
    sent.reserve(out.whole);
    for (const auto& part : to) sent.insert(sent.end(), part.begin(), part.end());
    check(MPI_Alltoallv(sent.data(), out.count.data(), out.place.data(), MPI_BYTE, received.data(), in.count.data(),
                        in.place.data(), MPI_BYTE, MPI_COMM_WORLD),
          "MPI_Alltoallv");
    std::vector<std::vector<std::byte>> from;
    for (std::size_t k = 0, at = 0; k < to.size(); at += in_bytes[k++]) {
      const auto begin = received.begin() + static_cast<std::ptrdiff_t>(at);
      from.emplace_back(begin, begin + static_cast<std::ptrdiff_t>(in_bytes[k]));
    }
    return from;
  }

 private:
  int rank_ = 0, size_ = 1, local_rank_ = 0, local_size_ = 1;
};

}  // namespace

}  // namespace interflect

extern "C" {

/// Of the Ranks interface: the program opens no module of another version.
[[gnu::visibility("default")]] const char* interflect_mpi_version() {
  return INTERFLECT_VERSION;
}

/// Joins the job; the caller owns what is returned. Throws interflect::Error.
[[gnu::visibility("default")]] interflect::Ranks* interflect_mpi_join() {
  return new interflect::MpiRanks;
}
}
