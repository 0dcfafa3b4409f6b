#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/device/device.h"
#include "interflect/formfactor/storage.h"

namespace interflect::cli {

/// Before a long use of a device with F in this format: when nothing is kept for the format's kernel and
/// 4 n² bytes are 64 MiB or more, so that it can pay, its launch shape is searched within two seconds and kept, and one
/// line says so. Never with INTERFLECT_TUNING=off or where nothing can be kept; an Error of the device is left to those
/// who use it next.
void tune_on_first_use(Device& device, Storage storage, std::uint32_t n, ProgressSink& progress);
/// The same for several devices and formats; one that cannot be opened is left out.
void tune_on_first_use(const std::vector<std::string>& devices, std::span<const Storage> formats, std::uint32_t n,
                       ProgressSink& progress);

}  // namespace interflect::cli
