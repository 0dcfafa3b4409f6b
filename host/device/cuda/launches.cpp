#include "interflect/device/cuda/launches.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "interflect/device/kernel_table.h"

namespace interflect::cuda {

namespace {

constexpr std::size_t most_launches = 64;  // of a graph

/// What a launch hands to the driver, which copies it during the call: pointers to the kernel's parameters, in order.
class Parameters {
 public:
  explicit Parameters(const Launch& launch) {
    for (std::size_t i = 0; i < launch.buffers; ++i) all_[i] = const_cast<DevicePointer*>(&launch.memory[i]);
    all_[launch.buffers] = const_cast<std::byte*>(launch.arguments.data());
  }
  [[nodiscard]] void** get() { return all_.data(); }

 private:
  std::array<void*, std::tuple_size_v<decltype(Launch::memory)> + 1> all_{};
};

bool same(const std::vector<Launch>& a, const std::vector<Launch>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const Launch& l, const Launch& r) { return l.same(r); });
}

bool wanted(const std::string& id) {
  const char* value = std::getenv("INTERFLECT_CUDA_GRAPH");
  const std::string_view asked = value == nullptr || *value == '\0' ? "on" : value;
  if (asked != "on" && asked != "off") {
    refuse(id, "open", fmt::format("INTERFLECT_CUDA_GRAPH is '{}', it must be on or off", asked));
  }
  return asked == "on";
}

}  // namespace

std::string Launch::text() const {
  return fmt::format("launch {} ({})", *name, label);
}

Launches::Launches(std::shared_ptr<const Session> session) : session_(std::move(session)) {
  graphs_ = wanted(session_->id) && session_->cuda.has_graphs();
  session_->use("open");
  Stream* stream = nullptr;
  session_->check(session_->cuda.stream_create(&stream, stream_non_blocking), "open", "cuStreamCreate");
  stream_ = session_->owned(stream, session_->cuda.stream_destroy);
}

Launches::~Launches() {
  drop_graph();
}

void Launches::launch(const Launch& launch) {
  rethrow();
  const std::size_t at = sequence_.size();
  if (at > most_launches) {  // longer than any graph
    enqueue(launch);
    return;
  }
  const bool expected = graph_ && enqueued_ == 0 && graph_->launches[at].same(launch);
  sequence_.push_back(launch);
  if (!expected) {
    release();
  } else if (sequence_.size() == graph_->launches.size()) {
    start_graph();
  }
}

void Launches::end() {
  rethrow();
  release();
  if (graphs_ && sequence_.size() >= 2 && sequence_.size() <= most_launches && same(sequence_, before_)) make_graph();
  if (!sequence_.empty()) before_.swap(sequence_);
  sequence_.clear();
  enqueued_ = 0;
}

void Launches::enqueue(const Launch& launch) {
  Parameters parameters(launch);
  const Result result = session_->cuda.launch(launch.function, launch.groups, 1, 1, workgroup, 1, 1, 0, stream(),
                                              parameters.get(), nullptr);
  if (result != 0) session_->check(result, launch.text(), "cuLaunchKernel");
}

/// Launches what is held back, in order. After an error the rest of it is not launched.
void Launches::release() {
  try {
    for (; enqueued_ < sequence_.size(); ++enqueued_) enqueue(sequence_[enqueued_]);
  } catch (...) {
    sequence_.clear();
    enqueued_ = 0;
    throw;
  }
}

void Launches::start_graph() {
  const Result result = session_->cuda.graph_launch(graph_->exec.get(), stream());
  const std::string first = result == 0 ? "" : sequence_.front().text();
  sequence_.clear();
  if (result != 0) drop_graph();
  session_->check(result, first, "cuGraphLaunch");
}

/// A graph of the sequence, in place of the one before. Where the driver cannot make one, launches stay single from
/// now on.
void Launches::make_graph() {
  const Driver& cuda = session_->cuda;
  drop_graph();
  graphs_ = false;
  CudaGraph* raw = nullptr;
  if (cuda.graph_create(&raw, 0) != 0) return;
  const Session::Owned<CudaGraph> graph = session_->owned(raw, cuda.graph_destroy);
  GraphExec* exec = nullptr;
  if (!add_nodes(raw) || cuda.graph_instantiate(&exec, raw, 0) != 0) return;
  graph_ = Graph{sequence_, session_->owned(exec, cuda.graph_exec_destroy)};
  graphs_ = true;
}

/// A node for each launch, after the one before.
bool Launches::add_nodes(CudaGraph* graph) const {
  GraphNode* before = nullptr;
  for (const Launch& launch : sequence_) {
    Parameters parameters(launch);
    const KernelNode node{
        .function = launch.function, .grid_x = launch.groups, .block_x = workgroup, .parameters = parameters.get()};
    GraphNode* added = nullptr;
    if (session_->cuda.graph_add_kernel(&added, graph, &before, before == nullptr ? 0 : 1, &node) != 0) return false;
    before = added;
  }
  return true;
}

/// It may still be running.
void Launches::drop_graph() noexcept {
  if (!graph_) return;
  session_->cuda.context_use(session_->context());
  session_->cuda.stream_wait(stream());
  graph_.reset();
}

void Launches::rethrow() {
  if (failed_ != nullptr) std::rethrow_exception(std::exchange(failed_, nullptr));
}

template <class Uses>
void Launches::forget(Uses uses) noexcept {
  const auto used = [&](const std::vector<Launch>& all) { return std::any_of(all.begin(), all.end(), uses); };
  if (used(sequence_)) {
    try {
      session_->use("launch");
      release();
    } catch (...) {
      failed_ = std::current_exception();
    }
    sequence_.clear();
    enqueued_ = 0;
  }
  if (used(before_)) before_.clear();
  if (graph_ && used(graph_->launches)) drop_graph();
}

void Launches::forget_memory(DevicePointer memory) noexcept {
  forget([memory](const Launch& launch) {
    const auto* end = launch.memory.begin() + launch.buffers;
    return std::find(launch.memory.begin(), end, memory) != end;
  });
}

void Launches::forget_kernel(std::uint64_t kernel) noexcept {
  forget([kernel](const Launch& launch) { return launch.kernel == kernel; });
}

}  // namespace interflect::cuda
