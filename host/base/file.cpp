#include "interflect/base/file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <system_error>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/base/last_words.h"

namespace interflect {

namespace {

/// Owns a descriptor for the length of read_file().
struct Descriptor {
  int value;
  explicit Descriptor(int fd) : value(fd) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (value >= 0) ::close(value);
  }
};

constexpr std::array ending{SIGINT, SIGTERM, SIGHUP};

/// Keeps the signals that end the process waiting for the length of a block.
class HeldSignals {
 public:
  HeldSignals() {
    sigset_t held;
    ::sigemptyset(&held);
    for (const int signal : ending) ::sigaddset(&held, signal);
    ::pthread_sigmask(SIG_BLOCK, &held, &old_);
  }
  HeldSignals(const HeldSignals&) = delete;
  HeldSignals& operator=(const HeldSignals&) = delete;
  ~HeldSignals() { ::pthread_sigmask(SIG_SETMASK, &old_, nullptr); }

 private:
  sigset_t old_{};
};

/// The temporary files that are open now, where a signal's handler finds them without a lock. A program that has more
/// than fit loses only their removal by a signal.
std::array<std::atomic<const char*>, 32> temporaries{};
static_assert(std::atomic<const char*>::is_always_lock_free);

int enter(const char* name) {
  for (std::size_t k = 0; k < temporaries.size(); ++k) {
    const char* empty = nullptr;
    if (temporaries[k].compare_exchange_strong(empty, name)) return static_cast<int>(k);
  }
  return -1;
}

void leave(int entry) {
  if (entry >= 0) temporaries[static_cast<std::size_t>(entry)] = nullptr;
}

std::atomic<const std::string_view*> last_words{nullptr};

void remove_temporaries(int signal) {
  for (const auto& name : temporaries) {
    if (const char* file = name; file != nullptr) ::unlink(file);
  }
  if (const std::string_view* line = last_words; line != nullptr) {
    static_cast<void>(::write(STDERR_FILENO, line->data(), line->size()) < 0);  // nobody reads: as good as said
  }
  ::raise(signal);  // SA_RESETHAND: its own effect this time, once the handler returns
}

constexpr std::array patient{SIGINT, SIGTERM};
std::array<struct sigaction, patient.size()> before_patience;
volatile std::sig_atomic_t end_asked = 0;
std::string_view end_line;  ///< set while no handler of ours is there

/// The first signal. Puts the handlers from before back, so that the second one has their effect.
void note_interrupt(int) {
  const int error = errno;
  end_asked = 1;
  for (std::size_t k = 0; k < patient.size(); ++k) ::sigaction(patient[k], &before_patience[k], nullptr);
  if (::write(STDERR_FILENO, end_line.data(), end_line.size()) < 0) errno = error;  // nobody reads: as good as said
  errno = error;
}

Error system_error(const std::filesystem::path& path, std::string_view action) {
  return input_error(path.string(), 0, fmt::format("cannot {}: {}", action, std::strerror(errno)));
}

}  // namespace

std::string read_file(const std::filesystem::path& path, std::uintmax_t limit) {
  // O_NONBLOCK: opening a pipe would wait for its writer, for ever if there is none.
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (file.value < 0) throw system_error(path, "open");
  struct stat status {};
  if (::fstat(file.value, &status) != 0) throw system_error(path, "stat");
  if (S_ISDIR(status.st_mode)) throw input_error(path.string(), 0, "is a folder, not a file");
  if (!S_ISREG(status.st_mode)) throw input_error(path.string(), 0, "is a pipe or a device, not a regular file");
  if (static_cast<std::uintmax_t>(status.st_size) > limit) {
    throw input_error(path.string(), 0, fmt::format("is larger than the limit of {} bytes", limit));
  }
  std::string content;
  content.reserve(static_cast<std::size_t>(status.st_size));
  std::string chunk(std::size_t{1} << 16, '\0');
  for (;;) {
    const ssize_t got = ::read(file.value, chunk.data(), chunk.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw system_error(path, "read");
    if (got == 0) return content;
    content.append(chunk, 0, static_cast<std::size_t>(got));
    if (content.size() > limit) {
      throw input_error(path.string(), 0, fmt::format("is larger than the limit of {} bytes", limit));
    }
  }
}

AtomicFile::AtomicFile(std::filesystem::path path) : path_(std::move(path)) {
  std::error_code none;
  // A rename would replace a link, not write to its target.
  for (int links = 0; std::filesystem::is_symlink(path_, none); ++links) {
    constexpr int most = 40;  // as the system itself
    if (links == most) throw input_error(path_.string(), 0, "cannot create: too many symbolic links");
    const std::filesystem::path target = std::filesystem::read_symlink(path_, none);
    path_ = path_.parent_path() / target;
  }
  if (std::filesystem::is_directory(path_, none)) throw input_error(path_.string(), 0, "is a folder, not a file");
  if (std::filesystem::exists(path_, none)) {
    if (!std::filesystem::is_regular_file(path_, none)) {
      throw input_error(path_.string(), 0, "is a pipe or a device, not a regular file");
    }
    if (::access(path_.c_str(), W_OK) != 0) throw system_error(path_, "replace");
  }
  std::string name = path_.string() + ".part-XXXXXX";
  {
    const HeldSignals held;  // from its creation to its entry here the file would be forgotten
    descriptor_ = ::mkostemp(name.data(), O_CLOEXEC);
    if (descriptor_ < 0) throw system_error(path_, "create");
    temporary_ = name;
    entry_ = enter(temporary_.c_str());
  }
  // mkostemp makes the file private; a result gets the permissions that any new file would have.
  const mode_t mask = ::umask(0);
  ::umask(mask);
  if (::fchmod(descriptor_, 0666 & ~mask) != 0) errno = 0;  // some filesystems have no permissions to change
}

AtomicFile::~AtomicFile() {
  if (descriptor_ < 0) return;
  const HeldSignals held;
  ::close(descriptor_);
  ::unlink(temporary_.c_str());
  leave(entry_);
}

void AtomicFile::write(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) throw system_error(path_, "write");
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
}

void AtomicFile::commit() {
  if (::fsync(descriptor_) != 0 && errno != EINVAL) throw system_error(path_, "write");
  const HeldSignals held;
  if (::rename(temporary_.c_str(), path_.c_str()) != 0) throw system_error(path_, "rename the finished file");
  leave(entry_);
  ::close(std::exchange(descriptor_, -1));
}

void set_last_words(std::string_view line) noexcept {
  // Two places in turn, so that a signal in the middle finds the line before.
  static std::array<std::string_view, 2> lines;
  static std::size_t at = 0;
  if (line.empty()) {
    last_words = nullptr;
    return;
  }
  at = 1 - at;
  lines[at] = line;
  last_words = &lines[at];
}

void remove_temporaries_on_signals() {
  for (const int signal : ending) {
    struct sigaction old {};
    if (::sigaction(signal, nullptr, &old) != 0 || old.sa_handler == SIG_IGN) continue;  // as nohup wants it
    struct sigaction action {};
    action.sa_handler = remove_temporaries;
    action.sa_flags = static_cast<int>(SA_RESETHAND);
    ::sigaction(signal, &action, nullptr);
  }
}

PatientInterrupt::PatientInterrupt(std::string_view line) {
  end_asked = 0;
  end_line = line;
  for (std::size_t k = 0; k < patient.size(); ++k) ::sigaction(patient[k], nullptr, &before_patience[k]);
  for (std::size_t k = 0; k < patient.size(); ++k) {
    if (before_patience[k].sa_handler == SIG_IGN) continue;
    struct sigaction action {};
    action.sa_handler = note_interrupt;
    action.sa_flags = SA_RESTART;  // the writes of the panel in hand go on
    for (const int signal : patient) ::sigaddset(&action.sa_mask, signal);
    ::sigaction(patient[k], &action, nullptr);
  }
}

PatientInterrupt::~PatientInterrupt() {
  for (std::size_t k = 0; k < patient.size(); ++k) ::sigaction(patient[k], &before_patience[k], nullptr);
}

bool PatientInterrupt::asked() noexcept {
  return end_asked != 0;
}

void file_limit_is_an_error() {
  struct sigaction action {};
  action.sa_handler = SIG_IGN;
  ::sigaction(SIGXFSZ, &action, nullptr);
}

}  // namespace interflect
