#include <algorithm>
#include <stdexcept>

#include "device/fake_cuda/fake_state.h"

// Modules, launches and graphs of the fake driver.

using namespace interflect::fake_cuda;

namespace {

using interflect::cuda::KernelNode;

/// A launch as the driver copies it, or a rule that it breaks.
Result copy_work(Work& work, const KernelNode& asked) {
  if (asked.grid_x == 0 || asked.grid_x > 0x7FFFFFFFU || asked.grid_y * asked.grid_z != 1 || asked.block_x != 256 ||
      asked.block_y * asked.block_z != 1 || asked.shared_bytes != 0) {
    return fake().broke("a launch of an odd shape", invalid_value);
  }
  work.function = reinterpret_cast<const Function*>(asked.function);
  work.grid = asked.grid_x;
  const auto& compiled = *work.function->compiled;
  for (std::uint32_t i = 0; i < compiled.parameters; ++i) {
    if ((compiled.pointers >> i & 1U) != 0) {
      std::memcpy(&work.pointers.emplace_back(), asked.parameters[i], sizeof(DevicePointer));
    } else {
      work.block.resize(compiled.block_bytes);
      std::memcpy(work.block.data(), asked.parameters[i], compiled.block_bytes);
    }
  }
  return 0;
}

/// Whether the kernel is still loaded and all memory still there.
Result check_work(const Work& work) {
  const auto holds = [&](const auto& module) {
    const auto& all = module.second->functions;
    return std::any_of(all.begin(), all.end(), [&](const auto& f) { return f.get() == work.function; });
  };
  const auto& modules = fake().modules;
  if (std::none_of(modules.begin(), modules.end(), holds)) return fake().broke("a kernel that is gone", invalid_handle);
  for (const DevicePointer pointer : work.pointers) {
    if (fake().host(pointer, 1) == nullptr) {
      return fake().broke(work.function->compiled->kernel + ": a pointer to no device memory", invalid_value);
    }
  }
  return 0;
}

Result run(const Work& work) {
  std::vector<std::byte*> addresses;
  for (const DevicePointer pointer : work.pointers) addresses.push_back(fake().host(pointer, 1));
  std::vector<std::uint64_t> block((work.block.size() + 7) / 8);
  std::memcpy(block.data(), work.block.data(), work.block.size());
  std::vector<void*> places;
  for (auto& address : addresses) places.push_back(&address);
  places.push_back(block.data());
  try {
    interflect::cuda_on_cpu::run(*work.function->compiled, work.grid, 256, places.data());
    return 0;
  } catch (const std::runtime_error& error) {
    return fake().broke(error.what(), launch_failed);
  }
}

/// The graph's launches in the order that a driver could choose that was least expected: the last first, as far as
/// nodes need not wait for others.
std::vector<Work> ordered(const Graph& graph) {
  std::vector<Work> all;
  std::vector<const Node*> done;
  const auto ready = [&](const Node& node) {
    return std::find(done.begin(), done.end(), &node) == done.end() &&
           std::all_of(node.after.begin(), node.after.end(),
                       [&](const Node* n) { return std::find(done.begin(), done.end(), n) != done.end(); });
  };
  while (done.size() < graph.nodes.size()) {
    const auto next = std::find_if(graph.nodes.rbegin(), graph.nodes.rend(), [&](const auto& n) { return ready(*n); });
    all.push_back((*next)->work);
    done.push_back(next->get());
  }
  return all;
}

}  // namespace

extern "C" {

/// An image is what the fake NVRTC writes: "fake cubin sm_90", then a line "NAME=VALUE" for each macro.
Result cuModuleLoadDataEx(void** handle, const void* image, unsigned, int*, void**) {
  FAKE_ENTER(fake().enter());
  const std::string text = static_cast<const char*>(image);
  const std::string cubin = "fake cubin sm_", ptx = "fake ptx compute_";
  const bool is_cubin = text.starts_with(cubin);
  if (!is_cubin && !text.starts_with(ptx)) return invalid_image;
  const int target = std::atoi(text.c_str() + (is_cubin ? cubin : ptx).size());
  if (is_cubin ? target != capability : target > capability) return wrong_architecture;
  Module* module = add(fake().modules);
  for (std::size_t begin = text.find('\n') + 1; begin < text.size();) {
    const std::size_t end = text.find('\n', begin);
    const std::size_t equals = text.find('=', begin);
    module->macros[text.substr(begin, equals - begin)] = std::atoi(text.c_str() + equals + 1);
    begin = end + 1;
  }
  if (module->macros["WORKGROUP"] != 256) return fake().broke("WORKGROUP is not 256", invalid_image);
  module->macros.erase("WORKGROUP");
  *handle = module;
  return 0;
}
Result cuModuleUnload(void* handle) {
  const std::lock_guard lock(fake().mutex);
  const Result result = fake().enter();
  fake().drain_all();
  if (fake().modules.erase(handle) == 0) return fake().broke("a module unloaded that is not there", invalid_handle);
  return result;
}
Result cuModuleGetFunction(void** function, void* handle, const char* name) {
  FAKE_ENTER(fake().enter());
  Module* module = find(fake().modules, handle, "module");
  if (module == nullptr) return invalid_handle;
  const auto* compiled = interflect::cuda_on_cpu::find("", name, module->macros);
  if (compiled == nullptr) return not_found;
  *function = module->functions.emplace_back(std::make_unique<Function>(Function{compiled})).get();
  return 0;
}
Result cuLaunchKernel(void* function, unsigned grid_x, unsigned grid_y, unsigned grid_z, unsigned block_x,
                      unsigned block_y, unsigned block_z, unsigned shared_bytes, void* handle, void** parameters,
                      void**) {
  FAKE_ENTER(fake().enter());
  Stream* stream = find(fake().streams, handle, "stream");
  if (stream == nullptr) return invalid_handle;
  Work work;
  const KernelNode asked{static_cast<interflect::cuda::Function*>(function),
                         grid_x,
                         grid_y,
                         grid_z,
                         block_x,
                         block_y,
                         block_z,
                         shared_bytes,
                         parameters};
  if (const Result result = copy_work(work, asked); result != 0) return result;
  if (const Result result = check_work(work); result != 0) return result;
  ++fake().kernels;
  stream->work.emplace_back([work] { return run(work); });
  return 0;
}

Result cuGraphCreate(void** graph, unsigned flags) {
  FAKE_ENTER(fake().enter());
  if (flags != 0) return invalid_value;
  *graph = add(fake().graphs);
  return 0;
}
Result cuGraphDestroy(void* handle) {
  const std::lock_guard lock(fake().mutex);
  const Result result = fake().enter();
  if (find(fake().graphs, handle, "graph") == nullptr) return invalid_handle;
  fake().graphs.erase(handle);
  return result;
}
Result cuGraphAddKernelNode_v2(void** added, void* handle, void* const* after, std::size_t count,
                               const KernelNode* asked) {
  FAKE_ENTER(fake().enter());
  Graph* graph = find(fake().graphs, handle, "graph");
  if (graph == nullptr) return invalid_handle;
  auto node = std::make_unique<Node>();
  for (std::size_t i = 0; i < count; ++i) {
    const auto own = std::find_if(graph->nodes.begin(), graph->nodes.end(),
                                  [&](const auto& other) { return other.get() == after[i]; });
    if (own == graph->nodes.end()) return fake().broke("a node after one of another graph", invalid_value);
    node->after.push_back(own->get());
  }
  if (const Result result = copy_work(node->work, *asked); result != 0) return result;
  if (const Result result = check_work(node->work); result != 0) return result;
  *added = graph->nodes.emplace_back(std::move(node)).get();
  return 0;
}
Result cuGraphInstantiateWithFlags(void** exec, void* handle, unsigned long long flags) {
  FAKE_ENTER(fake().enter());
  const Graph* graph = find(fake().graphs, handle, "graph");
  if (graph == nullptr || flags != 0) return invalid_handle;
  GraphExec* made = add(fake().executables);
  made->work = ordered(*graph);
  *exec = made;
  return 0;
}
Result cuGraphLaunch(void* handle, void* stream_handle) {
  FAKE_ENTER(fake().enter());
  GraphExec* exec = find(fake().executables, handle, "executable graph");
  Stream* stream = find(fake().streams, stream_handle, "stream");
  if (exec == nullptr || stream == nullptr) return invalid_handle;
  for (const Work& work : exec->work) {
    if (const Result result = check_work(work); result != 0) return result;
  }
  ++fake().graph_launches;
  fake().kernels += static_cast<int>(exec->work.size());
  ++exec->running;
  stream->work.emplace_back([exec] {
    --exec->running;
    for (const Work& work : exec->work) {
      if (const Result result = run(work); result != 0) return result;
    }
    return 0;
  });
  return 0;
}
Result cuGraphExecDestroy(void* handle) {
  const std::lock_guard lock(fake().mutex);
  const Result result = fake().enter();
  const GraphExec* exec = find(fake().executables, handle, "executable graph");
  if (exec == nullptr) return invalid_handle;
  if (exec->running != 0) {
    (void)fake().broke("an executable graph destroyed while it may be running", invalid_value);
    fake().drain_all();
  }
  fake().executables.erase(handle);
  return result;
}
}
