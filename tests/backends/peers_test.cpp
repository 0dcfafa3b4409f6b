// CLBlast and ViennaCL on every OpenCL device, as far as they are there.
#include <gtest/gtest.h>

#include "devices.h"
#include "interflect/base/error.h"
#include "interflect/peers/peer.h"

namespace interflect::test {
namespace {

FormFactorMatrix matrix(std::uint32_t n) {
  FormFactorMatrix f(n, 16384);
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::uint32_t j = 0; j < n; ++j) f.row(i)[j] = static_cast<float>((i * 31 + j * 17) % 64) / 64.0F;
  }
  return f;
}

TEST(OpenClPeers, GiveTheProductOrSayWhyNot) {
  std::vector<std::string> devices;
  for (const DeviceEntry& entry : list_devices()) {
    if (entry.info.backend == "opencl" && entry.available) devices.push_back(entry.info.id);
  }
  if (devices.empty() && !required("opencl:0")) GTEST_SKIP() << "there is no OpenCL device";
  ASSERT_FALSE(devices.empty());
  for (const std::uint32_t n : {5U, 96U, 131U}) {
    const FormFactorMatrix f = matrix(n);
    Columns x(peers::columns, std::vector<float>(n));
    for (std::uint32_t i = 0; i < n; ++i) {
      for (std::size_t c = 0; c < x.size(); ++c) x[c][i] = 0.5F + static_cast<float>((i + 7 * c) % 16) / 16.0F;
    }
    const peers::Problem problem(f, x, 2);
    for (const peers::Peer& peer : peers::all_peers(devices)) {
      if (peer.device == "host") continue;
      try {
        const peers::Ready ready = peer.prepare(problem);
        for (const peers::Call& call : ready.calls) {
          call.run();
          EXPECT_LE(peers::product_error(f, x, call.result()), peers::product_bound(n))
              << peer.device << ' ' << peer.name << ", n = " << n << ", " << call.how;
        }
      } catch (const Error& error) {
        EXPECT_EQ(error.kind(), ErrorKind::limit) << peer.name << ": " << error.what();  // it is not installed
      }
    }
  }
}

}  // namespace
}  // namespace interflect::test
