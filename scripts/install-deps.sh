#!/usr/bin/env bash
# Installs what Interflect needs to build and to run its tests, from Debian 12's own packages.
# Does nothing when everything is there already, so that it can stand in front of every build.
set -euo pipefail

packages=(
  # build
  build-essential cmake ninja-build pkg-config git ca-certificates
  # libraries that the program uses
  libembree-dev libtbb-dev libtinygltf-dev libtinyobjloader-dev libpugixml-dev libcli11-dev nlohmann-json3-dev
  libfmt-dev libhwy-dev libopenexr-dev libpng-dev zlib1g-dev libxxhash-dev libstb-dev
  # solves on several machines: the MPI module, and what starts it
  libopenmpi-dev openmpi-bin
  # the page of `view`: three.js is embedded in the program
  libjs-three
  # Boost.Beast, header-only: the HTTP of `serve`
  libboost-dev
  # loaders and compilers of the GPU backends (CUDA needs nothing to build)
  ocl-icd-opencl-dev opencl-headers libvulkan-dev glslang-dev glslang-tools spirv-tools
  # drivers that run GPU kernels on the processor, and what watches them in the tests
  pocl-opencl-icd mesa-vulkan-drivers vulkan-validationlayers oclgrind
  # other people's libraries, which `bench --peers` measures beside ours
  libopenblas-dev libeigen3-dev libviennacl-dev libclblast-dev
  # the bundle
  patchelf
  # tests, benchmarks, sanitizers and fuzzers
  libgtest-dev libgmock-dev libbenchmark-dev
  clang-14 clang-format-14 clang-tidy-14 libomp-14-dev libclang-rt-14-dev llvm-14
  python3 iproute2
  # programs that no one here wrote, with which tests open what we write
  assimp-utils openexr blender python3-numpy ffmpeg
  # a browser that opens the page
  chromium chromium-driver
  # the documentation as a site
  mkdocs
)

missing=()
for package in "${packages[@]}"; do
  state=$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null || true)
  [ "$state" = installed ] || missing+=("$package")
done
if [ "${#missing[@]}" -eq 0 ]; then
  echo "install-deps: every package is there"
  exit 0
fi

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || {
    echo "install-deps: these packages are missing, and installing them needs root: ${missing[*]}" >&2
    exit 1
  }
  as_root=(sudo)
fi
echo "install-deps: installing ${missing[*]}"
export DEBIAN_FRONTEND=noninteractive
"${as_root[@]}" apt-get update -q
"${as_root[@]}" apt-get install -y -q --no-install-recommends "${missing[@]}"
