// Other people's libraries on small products, as far as they are there, and fakes of those that are not.
#include <dlfcn.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <limits>

#include "device/fake_cuda/fake_cuda.h"
#include "interflect/base/error.h"
#include "interflect/peers/library.h"
#include "interflect/peers/peer.h"

namespace interflect::peers {
namespace {

using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

/// A matrix in panels of a few rows, a third of it zero, and positive columns.
struct Small {
  explicit Small(std::uint32_t n, std::uint64_t panel_bytes = 4096) : f(n, panel_bytes), x(columns) {
    std::uint32_t state = n;
    const auto number = [&state] {
      state = state * 1664525U + 1013904223U;
      return static_cast<float>(state >> 8U) * 0x1p-24F;
    };
    for (std::uint32_t i = 0; i < n; ++i) {
      for (float& element : f.row(i)) element = std::max(0.0F, number() - 0.33F);
      f.row(i)[n - 1] = 1;  // so that a sum without its end is wrong
    }
    for (auto& column : x) {
      for (std::uint32_t i = 0; i < n; ++i) column.push_back(0.5F + number());
    }
  }
  FormFactorMatrix f;
  Columns x;
};

constexpr std::uint32_t sizes[] = {1, 2, 15, 17, 64, 257, 300};

void expect_right(const Peer& peer, const Problem& problem, const Small& small) {
  const Ready ready = peer.prepare(problem);
  EXPECT_FALSE(ready.about.empty());
  ASSERT_FALSE(ready.calls.empty());
  for (const Call& call : ready.calls) {
    call.run();
    call.run();
    EXPECT_LE(product_error(small.f, small.x, call.result()), product_bound(small.f.size()))
        << peer.name << ", n = " << small.f.size() << ", " << call.how;
  }
  EXPECT_LT(fastest(ready.calls), ready.calls.size());
}

/// The message of the Error that prepare() throws; empty when it throws none.
std::string refusal(const Peer& peer, const Problem& problem, ErrorKind kind = ErrorKind::limit) {
  try {
    static_cast<void>(peer.prepare(problem));
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind) << error.what();
    return error.what();
  }
  return "";
}

/// An environment variable for the time of a test.
class Variable {
 public:
  Variable(const char* name, const std::string& value) : name_(name) { ::setenv(name, value.c_str(), 1); }
  Variable(const Variable&) = delete;
  Variable& operator=(const Variable&) = delete;
  ~Variable() { ::unsetenv(name_); }

 private:
  const char* name_;
};

TEST(Peers, OnTheProcessorGiveTheProductOrSayWhyNot) {
  for (const std::uint32_t n : sizes) {
    const Small small(n);
    const Problem problem(small.f, small.x, 2);
    for (const Peer& peer : all_peers({})) {
      EXPECT_EQ(peer.device, "host");
      const std::string why = refusal(peer, problem);
      if (why.empty()) {
        expect_right(peer, problem, small);
      } else {
        EXPECT_THAT(why, AnyOf(StartsWith("not installed: lib"), StartsWith("not in this build: ")));
      }
    }
  }
}

TEST(Peers, AllAreListedWhetherOrNotTheyAreThere) {
  std::vector<std::string> names;
  for (const Peer& peer : all_peers({"openmp", "opencl:3", "vulkan:0", "cuda:1"})) {
    names.push_back(peer.device + " " + peer.name);
  }
  EXPECT_THAT(names,
              ::testing::ElementsAre("host openblas-sgemm", "host openblas-sgemv", "host eigen-gemm", "host eigen-gemv",
                                     "host viennacl-gemm", "host viennacl-gemv", "opencl:3 viennacl-gemm",
                                     "opencl:3 viennacl-gemv", "opencl:3 clblast-sgemm", "opencl:3 clblast-sgemv",
                                     "cuda:1 cublas-sgemm", "cuda:1 cublas-sgemv", "cuda:1 cusparse-spmm"));
}

TEST(Peers, AMissingLibraryIsNamed) {
  const Small small(17);
  const Problem problem(small.f, small.x, 1);
  const Variable missing("INTERFLECT_OPENBLAS", "/nonexistent/libopenblas.so.0");
  EXPECT_EQ(refusal(openblas().front(), problem), "not installed: /nonexistent/libopenblas.so.0");
  EXPECT_EQ(refusal({.name = "none",
                     .device = "host",
                     .prepare = [](const Problem&) -> Ready {
                       const Library library("INTERFLECT_NONE", {"libinterflect-none.so.1", "libinterflect-none.so"});
                       return {};
                     }},
                    problem),
            "not installed: libinterflect-none.so.1");
}

TEST(Peers, ALibraryThatIsNoneIsNamed) {
  const Small small(17);
  const Problem problem(small.f, small.x, 1);
  {
    const Variable text("INTERFLECT_OPENBLAS", __FILE__);
    EXPECT_THAT(refusal(openblas().front(), problem),
                AnyOf(StartsWith("does not load: "), StartsWith("not installed: ")));
  }
  const Variable other("INTERFLECT_CLBLAST", FAKE_BLAS);
  EXPECT_THAT(refusal(clblast("opencl:0").front(), problem, ErrorKind::device),
              HasSubstr("has no function CLBlastSgemm"));
}

TEST(Peers, ADeviceThatIsNotThereIsNamed) {
  const Small small(17);
  const Problem problem(small.f, small.x, 1);
  fake_cuda_devices(1);
  fake_cuda_reset();
  const Variable blas("INTERFLECT_CUBLAS", FAKE_BLAS), sparse("INTERFLECT_CUSPARSE", FAKE_BLAS);
  for (const Peer& peer : all_peers({"opencl:99", "cuda:1"})) {
    if (peer.device == "host") continue;
    EXPECT_THAT(refusal(peer, problem),
                AnyOf("no device " + peer.device, StartsWith("not installed: lib"), StartsWith("not in this build: ")));
  }
  EXPECT_THROW(static_cast<void>(index_of("opencl:")), Error);
  EXPECT_THROW(static_cast<void>(index_of("openmp")), Error);
  EXPECT_THROW(static_cast<void>(index_of("cuda:1x")), Error);
  EXPECT_EQ(index_of("cuda:12"), 12U);
}

/// OpenBLAS's calls on the fake, whose loops know what each argument means, and on the one that leaves out the end.
TEST(Peers, ABrokenLibraryIsFarAboveTheBound) {
  for (const std::uint32_t n : sizes) {
    const Small small(n);
    const Problem problem(small.f, small.x, 1);
    for (std::size_t k = 0; k < openblas().size(); ++k) {
      {
        const Variable fake("INTERFLECT_OPENBLAS", FAKE_BLAS);
        expect_right(openblas()[k], problem, small);
      }
      const Variable broken("INTERFLECT_OPENBLAS", BROKEN_BLAS);
      const Ready ready = openblas()[k].prepare(problem);
      EXPECT_EQ(ready.calls.size(), k == 0 ? 4U : 2U);
      for (const Call& call : ready.calls) {
        call.run();
        EXPECT_GT(product_error(small.f, small.x, call.result()), 5 * product_bound(n)) << n << ' ' << call.how;
      }
    }
  }
}

TEST(Peers, NvidiasLibrariesOnTheFakeDriver) {
  fake_cuda_devices(1);
  fake_cuda_reset();
  const auto nvidia = [] {
    std::vector<Peer> all = cublas("cuda:0");
    for (Peer& peer : cusparse("cuda:0")) all.push_back(std::move(peer));
    return all;
  };
  for (const std::uint32_t n : sizes) {
    const Small small(n);
    const Problem problem(small.f, small.x, 1);
    {
      const Variable blas("INTERFLECT_CUBLAS", FAKE_BLAS), sparse("INTERFLECT_CUSPARSE", FAKE_BLAS);
      for (const Peer& peer : nvidia()) expect_right(peer, problem, small);
    }
    const Variable blas("INTERFLECT_CUBLAS", BROKEN_BLAS), sparse("INTERFLECT_CUSPARSE", BROKEN_BLAS);
    for (const Peer& peer : nvidia()) {
      const Ready ready = peer.prepare(problem);
      for (const Call& call : ready.calls) {
        call.run();
        EXPECT_GT(product_error(small.f, small.x, call.result()), 5 * product_bound(n)) << peer.name << ' ' << call.how;
      }
    }
  }
  EXPECT_THAT(fake_cuda_report(), HasSubstr("live=0\n"));
  EXPECT_THAT(fake_cuda_report(), ::testing::Not(HasSubstr("broken")));
  for (const char* path : {FAKE_BLAS, BROKEN_BLAS}) {
    void* const library = ::dlopen(path, RTLD_NOW | RTLD_NOLOAD);
    ASSERT_NE(library, nullptr) << path;
    EXPECT_EQ(reinterpret_cast<int (*)()>(::dlsym(library, "fake_blas_given"))(), 0) << path;
    ::dlclose(library);
  }
}

TEST(Peers, NvidiasLibrariesGiveBackWhatTheyHaveWhenTheDriverFails) {
  const Small small(17);
  const Problem problem(small.f, small.x, 1);
  const Variable blas("INTERFLECT_CUBLAS", FAKE_BLAS), sparse("INTERFLECT_CUSPARSE", FAKE_BLAS);
  for (const Peer& peer : {cublas("cuda:0").front(), cusparse("cuda:0").front()}) {
    fake_cuda_reset();
    { const Ready ready = peer.prepare(problem); }
    const int calls = fake_cuda_calls();
    int refused = 0;
    for (int call = 1; call <= calls; ++call) {
      fake_cuda_reset();
      fake_cuda_fail(call, 999, true);
      try {
        static_cast<void>(peer.prepare(problem));
      } catch (const Error&) {
        ++refused;
      }
      EXPECT_THAT(fake_cuda_report(), HasSubstr("live=0\n")) << peer.name << ", call " << call;
    }
    EXPECT_GT(refused, calls / 2);
    fake_cuda_reset();
  }
}

TEST(Problem, HasFByColumnsAndXInBothLayouts) {
  const Small small(77);
  const Problem problem(small.f, small.x, 2);
  const float* turned = problem.f_by_columns();
  ASSERT_NE(turned, nullptr);
  for (std::uint32_t i = 0; i < 77; ++i) {
    for (std::uint32_t j = 0; j < 77; ++j) ASSERT_EQ(turned[j * small.f.stride() + i], small.f.row(i)[j]);
    for (std::size_t c = 0; c < columns; ++c) {
      EXPECT_EQ(problem.x_by_columns()[c * 77 + i], small.x[c][i]);
      EXPECT_EQ(problem.x_by_rows()[i * columns + c], small.x[c][i]);
    }
  }
  const Problem poor(small.f, small.x, 2);
  const Variable memory("INTERFLECT_MEMORY", "30K");
  EXPECT_EQ(poor.f_by_columns(), nullptr);
  EXPECT_THROW(Problem(small.f, Columns(2, std::vector<float>(77)), 1), Error);
  EXPECT_THROW(Problem(small.f, Columns(3, std::vector<float>(76)), 1), Error);
}

TEST(ProductError, SeesOneWrongElementAndNaN) {
  const Small small(64);
  std::vector<std::vector<double>> exact;
  exact_product(small.f, small.x, exact);
  Columns y(columns);
  for (std::size_t c = 0; c < columns; ++c) y[c].assign(exact[c].begin(), exact[c].end());
  EXPECT_LE(product_error(small.f, small.x, y), 0x1p-24);
  Columns off = y;
  off[2][63] *= 1.01F;
  EXPECT_NEAR(product_error(small.f, small.x, off), 0.01, 1e-4);
  off[1][5] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(std::isnan(product_error(small.f, small.x, off)));
  off[1].pop_back();
  EXPECT_TRUE(std::isnan(product_error(small.f, small.x, off)));
}

}  // namespace
}  // namespace interflect::peers
