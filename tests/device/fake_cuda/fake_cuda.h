#pragma once

// A fake CUDA driver, for tests only: libcuda.so.1 with the functions that host/device/cuda uses, in host memory, whose
// launches run kernels/cuda/ on the processor (../cuda_on_cpu.h). It proves nothing about a GPU. It holds the backend
// to the driver's rules: streams run only when somebody waits, so that staging memory reused too early shows; a device
// pointer is none of the host's; memory starts as rubbish; a call needs a current context; everything is given back.
//
// What a program that only loads it is told comes from the environment:
//   FAKE_CUDA_DEVICES=n      how many GPUs there are (1)
//   FAKE_CUDA_INIT=code      what cuInit returns
//   FAKE_CUDA_FAIL=k         the k-th call fails; FAKE_CUDA_LOST=1: and so do all that follow
//   FAKE_CUDA_REPORT=file    where fake_cuda_report() is written when the process ends
// The fake NVRTC beside it takes FAKE_NVRTC_VERSION=12.8 and FAKE_NVRTC_NEWEST=90. Only the two together work: NVRTC 13
// asks libcuda.so.1 for functions that the fake has not, and crashes.

extern "C" {

/// Nothing fails, nothing is counted so far.
void fake_cuda_reset();
/// Call number `call` from now on returns `code`, without having done anything, unless it gives something back; with
/// `lost` all later ones do as well.
void fake_cuda_fail(int call, int code, bool lost);
/// How many GPUs there are.
void fake_cuda_devices(int count);
/// How many calls there were since fake_cuda_reset(). cuGetErrorName does not count.
int fake_cuda_calls();
/// "calls=12 kernels=3 live=0" and a line for each thing that is still there, and for each rule that was broken.
const char* fake_cuda_report();
}
