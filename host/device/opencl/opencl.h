#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "interflect/device/device.h"
#include "interflect/device/registry.h"

// The OpenCL backend: every device of every platform that the ICD loader knows, of any vendor, OpenCL 1.2 or newer.
// Kernels are those of kernels/cl/, compiled by the driver, in one of two shapes:
//   cpu  a work-group is one work-item that sweeps rows by vectors; for devices of type CPU
//   gpu  a work-group of up to 256 work-items shares a few rows; for all others
// INTERFLECT_OPENCL_SHAPE=cpu or gpu forces one of them on every device, so that both can be tested anywhere; with
// another value no device is available, for that reason.

namespace interflect::opencl {

/// Every device that it sees, "opencl:0" and so on, and what keeps it from seeing any.
[[nodiscard]] std::vector<DeviceEntry> list_devices();
/// Opens list_devices()[index]. Throws a device Error.
[[nodiscard]] std::unique_ptr<interflect::Device> open_device(std::uint32_t index);

}  // namespace interflect::opencl
