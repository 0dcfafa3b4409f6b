#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "interflect/device/cuda/api.h"
#include "interflect/peers/peer.h"

namespace interflect::peers {

/// An object of one of NVIDIA's libraries with the function that gives it back.
template <class T>
using Given = std::unique_ptr<T, int (*)(T*)>;

/// A CUDA device in use by a library of NVIDIA's, with X and Y on it, and the stream in which everything is done.
class CudaPlace {
 public:
  /// Throws a limit Error when there is no driver or no such device, device Errors.
  CudaPlace(const Problem& problem, const std::string& id);
  CudaPlace(const CudaPlace&) = delete;
  CudaPlace& operator=(const CudaPlace&) = delete;
  ~CudaPlace() = default;

  /// Memory that is freed with the place.
  [[nodiscard]] cuda::DevicePointer allocate(std::size_t bytes);
  [[nodiscard]] cuda::DevicePointer uploaded(std::span<const std::byte> data);
  /// Makes the context the calling thread's; every use of a library begins with it.
  void use() const { session_.use("peer"); }
  /// Returns when everything in the stream is done.
  void wait() const;
  [[nodiscard]] cuda::Stream* stream() const { return stream_.get(); }
  /// The 3 n floats of Y.
  [[nodiscard]] std::vector<float> download() const;
  /// Throws a device Error unless a library's status is 0.
  void check(int status, const char* function) const;

  struct Rows {
    std::size_t first, rows;
    cuda::DevicePointer f;
  };
  /// Uploads F by its panels, and by columns.
  void upload_f();

  const Problem& problem;
  std::vector<Rows> panels;              ///< after upload_f()
  cuda::DevicePointer f_by_columns = 0;  ///< the same, 0 where the problem has none
  cuda::DevicePointer x_by_columns = 0, x_by_rows = 0, y = 0;

 private:
  struct Memory {
    Memory(const cuda::Session* of, cuda::DevicePointer at) : session(of), pointer(at) {}
    Memory(Memory&& other) noexcept : session(other.session), pointer(std::exchange(other.pointer, 0)) {}
    Memory& operator=(Memory&&) = delete;
    ~Memory() {
      if (pointer != 0) session->free(pointer);
    }
    const cuda::Session* session;
    cuda::DevicePointer pointer;
  };
  /// Memory of the host that the driver can copy from by itself.
  using Pinned = std::unique_ptr<void, std::function<void(void*)>>;
  [[nodiscard]] Pinned pinned(std::size_t bytes) const;

  cuda::Session session_;
  cuda::Session::Owned<cuda::Stream> stream_;
  std::vector<Memory> memory_;
};

}  // namespace interflect::peers
