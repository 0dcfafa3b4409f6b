#include <array>
#include <functional>
#include <vector>

#include "device/fake_cuda/fixture.h"
#include "interflect/base/error.h"
#include "interflect/device/cuda/launches.h"
#include "interflect/device/kernel_arguments.h"
#include "interflect/device/kernel_table.h"
#include "interflect/device/registry.h"

// Launches that repeat as CUDA graphs, on the fake driver: which become graphs, that order and results are those of
// single launches, that nothing is used after it is gone, and that errors are told.

namespace interflect {
namespace {

using test::expect_nothing_left;
using test::FakeCuda;
using test::report;
using testing::HasSubstr;

class FakeCudaGraph : public FakeCuda {};

int number_after(const std::string& text, const std::string& what) {
  const std::size_t at = text.find(what);
  return at == std::string::npos ? -1 : std::stoi(text.substr(at + what.size()));
}
int graphs() {
  return number_after(report(), " graphs=");
}

/// Two vectors, the launches y = a x + y and x = x + y of them, whose order shows in every result.
class Steps {
 public:
  static constexpr std::uint32_t n = 40;

  Steps() : device_(open_device("cuda:0")), axpby_(device_->kernel("axpby", {})) {
    for (auto& vector : vectors_) vector = filled(std::vector<float>(n, 1.0F));
    std::vector<float> sums(sums_size(1, 1));
    sums[slot::axpby_a] = 2;
    sums[slot::axpby_b] = 1;
    sums_ = filled(sums);
    sums[slot::axpby_a] = -1;
    other_sums_ = filled(sums);
  }
  Device& device() { return *device_; }
  /// vector[to] = 2 vector[from] + vector[to], or, with other scalars, vector[to] - vector[from].
  void add(std::size_t from, std::size_t to, std::string_view label = "Step", bool other = false,
           std::uint32_t blocks_per_group = 1) {
    const VectorArguments a{
        .n = n, .vector_stride = 48, .columns = 1, .blocks = 1, .blocks_per_group = blocks_per_group};
    Buffer* const buffers[] = {vectors_[from].get(), vectors_[to].get(), (other ? other_sums_ : sums_).get()};
    device_->queue().launch(*axpby_, 1, buffers, std::as_bytes(std::span(&a, 1)), label);
  }
  float look(std::size_t which) {
    std::vector<float> values(n);
    device_->queue().download(*vectors_[which], 0, std::as_writable_bytes(std::span(values)));
    for (const float value : values) EXPECT_EQ(value, values[0]);
    return values[0];
  }
  /// y = 2 x + y, x = 2 y + x: an iteration, and the look at its result.
  float iterate() {
    add(0, 1, "First");
    add(1, 0, "Second");
    return look(0);
  }
  void renew(std::size_t which) {
    vectors_[which].reset();
    vectors_[which] = filled(std::vector<float>(n, 1.0F));
  }
  void renew_kernel() {
    axpby_.reset();
    axpby_ = device_->kernel("axpby", {});
  }

 private:
  std::unique_ptr<Buffer> filled(const std::vector<float>& values) {
    auto made = device_->allocate(values.size() * sizeof(float));
    device_->queue().upload(*made, 0, std::as_bytes(std::span(values)));
    return made;
  }
  std::unique_ptr<Device> device_;
  std::unique_ptr<Kernel> axpby_;
  std::array<std::unique_ptr<Buffer>, 3> vectors_;
  std::unique_ptr<Buffer> sums_, other_sums_;
};

/// What `job` finds with graphs; without them it must find the same bits.
std::vector<float> with_and_without(const std::function<std::vector<float>(Steps&)>& job) {
  std::vector<std::vector<float>> found;
  for (const char* mode : {"off", "on"}) {
    ::setenv("INTERFLECT_CUDA_GRAPH", mode, 1);
    fake_cuda_reset();
    {
      Steps steps;
      found.push_back(job(steps));
    }
    expect_nothing_left();
    if (found.size() == 1) {
      EXPECT_EQ(graphs(), 0);
    }
  }
  EXPECT_EQ(found[0], found[1]);
  return found[1];
}

TEST_F(FakeCudaGraph, TheThirdOfEqualSequencesIsAGraph) {
  const std::vector<float> found = with_and_without([](Steps& steps) {
    std::vector<float> all;
    for (int i = 0; i < 6; ++i) all.push_back(steps.iterate());
    return all;
  });
  EXPECT_EQ(graphs(), 4);
  float x = 1, y = 1;
  for (const float value : found) {
    y += 2 * x;
    x += 2 * y;
    EXPECT_EQ(value, x);
  }
}

TEST_F(FakeCudaGraph, WithoutALookBetweenThemSequencesAreGraphsToo) {
  (void)with_and_without([](Steps& steps) {
    for (int i = 0; i < 2; ++i) (void)steps.iterate();
    for (int i = 0; i < 3; ++i) {
      steps.add(0, 1);
      steps.add(1, 0);
    }
    steps.add(0, 1);  // the beginning of another one
    return std::vector<float>{steps.look(0), steps.look(1)};
  });
  EXPECT_EQ(graphs(), 3);
}

TEST_F(FakeCudaGraph, ASequenceThatGoesAnotherWayIsLaunchedSinglyAndInOrder) {
  const std::vector<std::function<void(Steps&)>> ways = {
      [](Steps& steps) { steps.add(1, 2); },                      // another buffer
      [](Steps& steps) { steps.add(1, 0, "Second", true); },      // another one, read only
      [](Steps& steps) { steps.add(1, 0, "Second", false, 2); },  // other arguments
      [](Steps& steps) { steps.device().queue().wait(); },        // its end
  };
  for (std::size_t way = 0; way < ways.size(); ++way) {
    (void)with_and_without([&](Steps& steps) {
      std::vector<float> all;
      for (int i = 0; i < 3; ++i) all.push_back(steps.iterate());
      steps.add(0, 1, "First");
      ways[way](steps);
      steps.add(1, 0, "Second");
      for (std::size_t i = 0; i < 3; ++i) all.push_back(steps.look(i));
      all.push_back(steps.iterate());  // the graph is still there
      return all;
    });
    EXPECT_EQ(graphs(), 2) << way;
  }
}

TEST_F(FakeCudaGraph, OneLaunchOrVeryManyAreNoGraph) {
  for (const int launches : {1, 65, 200}) {
    (void)with_and_without([launches](Steps& steps) {
      std::vector<float> all;
      for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < launches; ++k) steps.add(0, 1);
        all.push_back(steps.look(1));
      }
      return all;
    });
    EXPECT_EQ(graphs(), 0) << launches;
  }
  (void)with_and_without([](Steps& steps) {
    for (int i = 0; i < 3; ++i) {
      for (int k = 0; k < 64; ++k) steps.add(0, 1);
      steps.device().queue().wait();
    }
    return std::vector<float>{steps.look(1)};
  });
  EXPECT_EQ(graphs(), 1);
}

TEST_F(FakeCudaGraph, NothingIsUsedAfterABufferOrTheKernelIsGone) {
  for (const int what : {0, 1, 2}) {
    (void)with_and_without([what](Steps& steps) {
      for (int i = 0; i < 3; ++i) (void)steps.iterate();
      steps.add(0, 1, "First");  // held back where there are graphs
      if (what == 2) steps.renew_kernel();
      if (what != 2) steps.renew(static_cast<std::size_t>(what));
      std::vector<float> all;
      for (int i = 0; i < 4; ++i) all.push_back(steps.iterate());
      all.push_back(steps.look(1));
      return all;
    });
    EXPECT_GE(graphs(), 2) << what;
  }
}

TEST_F(FakeCudaGraph, AFailedGraphNamesItsFirstLaunch) {
  std::vector<std::string> errors;
  for (int call = 1; call <= 12; ++call) {
    fake_cuda_reset();
    Steps steps;
    for (int i = 0; i < 3; ++i) (void)steps.iterate();
    fake_cuda_fail(call, 719, false);
    try {
      (void)steps.iterate();
    } catch (const Error& error) {
      errors.emplace_back(error.what());
    }
  }
  EXPECT_THAT(errors, testing::Contains("cuda:0: launch axpby (First): cuGraphLaunch: CUDA_ERROR_LAUNCH_FAILED (719)"));
  EXPECT_THAT(errors, testing::Not(testing::Contains(HasSubstr("cuLaunchKernel"))));
}

/// Graphs are made, started and dropped on the way: every call fails once.
TEST_F(FakeCudaGraph, EveryCallMayFail) {
  const auto job = [] {
    Steps steps;
    std::vector<float> all;
    for (int i = 0; i < 4; ++i) all.push_back(steps.iterate());
    steps.add(0, 1, "First");
    steps.renew(2);  // in no launch
    steps.renew(1);
    for (int i = 0; i < 4; ++i) all.push_back(steps.iterate());
    return all;
  };
  const std::vector<float> right = job();
  EXPECT_EQ(graphs(), 4);
  const int calls = fake_cuda_calls();
  ASSERT_GT(calls, 150);
  for (const bool lost : {false, true}) {
    int errors = 0;
    for (int call = 1; call <= calls; ++call) {
      fake_cuda_reset();
      fake_cuda_fail(call, 719, lost);
      try {
        EXPECT_EQ(job(), right) << "call " << call << " failed unnoticed";
      } catch (const Error& error) {
        ++errors;
        EXPECT_EQ(error.kind(), ErrorKind::device) << error.what();
        EXPECT_THAT(error.what(), HasSubstr("CUDA_ERROR_LAUNCH_FAILED (719)")) << "call " << call;
        EXPECT_THAT(error.what(), testing::StartsWith("cuda:0: ")) << "call " << call;
      }
      EXPECT_THAT(report(), HasSubstr("live=0\n")) << "call " << call << (lost ? ", lost" : "");
    }
    // Only what gives something back, is tried again, or makes a graph may fail without an error.
    EXPECT_GT(errors, calls - 60);
  }
}

TEST_F(FakeCudaGraph, WithoutTheFunctionsOfGraphsLaunchesAreSingle) {
  std::string reason;
  const cuda::Driver* driver = cuda::Driver::open(reason);
  ASSERT_NE(driver, nullptr) << reason;
  EXPECT_TRUE(driver->has_graphs());
  for (const bool missing : {false, true}) {
    fake_cuda_reset();
    cuda::Driver other = *driver;
    if (missing) other.graph_launch = nullptr;
    int ordinal = 0;
    ASSERT_EQ(other.device_get(&ordinal, 0), 0);
    {
      const auto session = std::make_shared<const cuda::Session>(other, "cuda:0", ordinal);
      cuda::Launches launches(session);
      cuda::Module* module = nullptr;
      cuda::Function* function = nullptr;
      ASSERT_EQ(other.module_load(&module, "fake cubin sm_90\nWORKGROUP=256\n", 0, nullptr, nullptr), 0);
      const auto owned = session->owned(module, other.module_unload);
      ASSERT_EQ(other.module_function(&function, module, "copy"), 0);
      const std::string name = "copy";
      cuda::Launch launch{.kernel = 1, .function = function, .groups = 1, .buffers = 2, .name = &name, .label = "Test"};
      for (auto* memory : {&launch.memory[0], &launch.memory[1]}) ASSERT_EQ(other.memory_allocate(memory, 64), 0);
      for (int i = 0; i < 6; ++i) {
        launches.launch(launch);
        if (i % 2 == 1) launches.end();
      }
      for (const auto memory : {launch.memory[0], launch.memory[1]}) {
        launches.forget_memory(memory);
        session->free(memory);
      }
      launches.forget_kernel(1);
    }
    EXPECT_THAT(report(), HasSubstr(missing ? "kernels=6 graphs=0" : "kernels=6 graphs=1"));
    expect_nothing_left();
  }
}

TEST_F(FakeCudaGraph, AWrongSwitchIsAnError) {
  ::setenv("INTERFLECT_CUDA_GRAPH", "maybe", 1);
  try {
    (void)open_device("cuda:0");
    FAIL() << "it opened";
  } catch (const Error& error) {
    EXPECT_STREQ(error.what(), "cuda:0: open: INTERFLECT_CUDA_GRAPH is 'maybe', it must be on or off");
  }
  expect_nothing_left();
}

TEST_F(FakeCudaGraph, ASolveGivesTheSameBitsWithAndWithoutThem) {
  const std::string scene = INTERFLECT_SOURCE_DIR "/scenes/cornell-box.obj --patches 60";
  for (const char* method : {"cg", "bicgstab", "jacobi"}) {
    std::vector<std::string> answers;
    for (const char* mode : {"off", "on"}) {
      const std::string file = (folder_ / (std::string(method) + mode + ".csv")).string();
      const std::string solved =
          program(std::string("INTERFLECT_NVRTC=" FAKE_CUDA_FOLDER "/libnvrtc.so INTERFLECT_CUDA_GRAPH=") + mode,
                  "solve " + scene + " --quiet --method " + method + " --device cuda:0 -o '" + file + "'");
      ASSERT_THAT(solved, HasSubstr("\nSTATUS 0\n")) << solved;
      EXPECT_THAT(solved, HasSubstr("live=0\n"));
      EXPECT_THAT(solved, testing::Not(HasSubstr("broken")));
      if (std::string(mode) == "off") {
        EXPECT_THAT(solved, HasSubstr(" graphs=0 "));
      } else {
        EXPECT_GT(number_after(solved, " graphs="), 1) << solved;
      }
      answers.push_back(text(file));
    }
    EXPECT_GT(answers[0].size(), 1000U);
    EXPECT_EQ(answers[0], answers[1]) << method;
  }
}

}  // namespace
}  // namespace interflect
