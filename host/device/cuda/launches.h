#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/device/cuda/api.h"

namespace interflect::cuda {

inline constexpr unsigned workgroup = 256;  ///< macro WORKGROUP: threads of a work-group

/// One launch as it was asked for.
struct Launch {
  std::uint64_t kernel = 0;  ///< a number that no other Kernel has or had
  Function* function = nullptr;
  std::uint32_t groups = 0;
  std::uint32_t buffers = 0;  ///< how many of memory are used
  std::array<DevicePointer, 8> memory{};
  std::array<std::byte, 128> arguments{};
  const std::string* name = nullptr;  ///< the kernel's
  std::string label;

  [[nodiscard]] std::string text() const;  ///< "launch cg_step (CG step)"
  [[nodiscard]] bool same(const Launch& other) const {
    return kernel == other.kernel && groups == other.groups && memory == other.memory && arguments == other.arguments;
  }
};

/// The stream of a device, and its launches. What is launched between two ends (a transfer or a wait) is a sequence.
/// When the same sequence of 2 to 64 launches comes twice in a row, as the iterations of a solver do, it becomes a CUDA
/// graph. From then on launches that begin like it are held back, and its last one launches all of them as that graph;
/// where the sequence goes another way, or ends, those held back are launched one by one. So the order is kept, and the
/// results are the same bits.
///
/// INTERFLECT_CUDA_GRAPH=off launches everything at once and by itself; so does a driver without the functions of
/// graphs, or one that cannot make a graph. Not for several threads at once.
class Launches {
 public:
  /// Opens the stream. Throws a device Error, also for an INTERFLECT_CUDA_GRAPH that is neither on nor off.
  explicit Launches(std::shared_ptr<const Session> session);
  Launches(const Launches&) = delete;
  Launches& operator=(const Launches&) = delete;
  ~Launches();

  [[nodiscard]] const Session& session() const { return *session_; }
  [[nodiscard]] Stream* stream() const { return stream_.get(); }

  /// The context must be in use. Errors of a launch name it; those of a graph name the first launch in it.
  void launch(const Launch& launch);
  /// Ends the sequence: everything asked for is in the stream. Also throws what a destructor had to keep to itself.
  void end();

  /// That memory is about to be freed, or that kernel: nothing of it is held back or in a graph any more.
  void forget_memory(DevicePointer memory) noexcept;
  void forget_kernel(std::uint64_t kernel) noexcept;

 private:
  struct Graph {
    std::vector<Launch> launches;
    Session::Owned<GraphExec> exec;
  };

  void enqueue(const Launch& launch);
  void release();
  void start_graph();
  void make_graph();
  [[nodiscard]] bool add_nodes(CudaGraph* graph) const;
  void drop_graph() noexcept;
  void rethrow();
  template <class Uses>
  void forget(Uses uses) noexcept;

  std::shared_ptr<const Session> session_;
  Session::Owned<Stream> stream_;
  bool graphs_ = false;           ///< they are made
  std::vector<Launch> sequence_;  ///< since the last end or graph; of a long one the first few
  std::size_t enqueued_ = 0;      ///< how many of them are in the stream: none, or all
  std::vector<Launch> before_;    ///< the last sequence
  std::optional<Graph> graph_;
  std::exception_ptr failed_;
};

}  // namespace interflect::cuda
