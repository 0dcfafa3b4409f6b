#include "shared.cuh"
#include "../shared/occluded.h"

// The assembly of S by tiles. Contract: kernels/README.md.

// Field by field as in host/device/kernel_arguments.h.
struct AssemblyArguments {
  uint n, tiles, first, items, option, chunks, cuts;
  float pilot_per_factor, rays_per_factor;
  uint most_in_pilot, fewest, most;
  float split_from, three2, six2, three_error2, six_error2, lift;
  uint panel_first, panel_rows, panel_stride;
};

#define TILE_BUFFERS                                    \
  [[maybe_unused]] const uint4 *__restrict__ patches,   \
      [[maybe_unused]] const uint4 *__restrict__ tiles, \
      [[maybe_unused]] uint *__restrict__ work,         \
      [[maybe_unused]] uint *__restrict__ extra,
#define TILE_PARAMETERS TILE_BUFFERS [[maybe_unused]] const AssemblyArguments &args,
#define TILE patches, tiles, work, extra, args,
#define PATCH_WORDS(i) __ldg(patches + (i))
#define TILE_WORDS(i) __ldg(tiles + (i))
#define PANEL_PARAMETERS float *__restrict__ panel,
#define PANEL_AT(row, column) panel[static_cast<unsigned long long>(row) * args.panel_stride + (column)]
#define ADD_TO(buffer, at, count) atomicAdd((buffer) + (at), count)
#include "../shared/contour.h"
#include "../shared/polygon.h"
#include "../shared/pairs.h"
#include "../shared/tile_layout.h"
#include "../shared/tile_rays.h"
#include "../shared/tile_store.h"
#include "../shared/tiles.h"

#define ENTRY(name) extern "C" __global__ void __launch_bounds__(WORKGROUP, 2) name
#define FOR_EACH_ITEM                                                              \
  const uint share = (args.items + gridDim.x - 1) / gridDim.x;                     \
  const uint begin = args.first + smaller(args.items, blockIdx.x * share);         \
  const uint end = smaller(args.first + args.items, begin + share);                \
  for (uint item = begin + threadIdx.x; item < end; item += WORKGROUP)

ENTRY(tile_kinds)(TILE_BUFFERS const AssemblyArguments args) {
  FOR_EACH_ITEM tile_kinds_item(TILE item);
}
ENTRY(tile_special)(TILE_BUFFERS const AssemblyArguments args) {
  FOR_EACH_ITEM tile_special_item(TILE item);
}
ENTRY(tile_pilot)(TILE_BUFFERS const AssemblyArguments args) {
  FOR_EACH_ITEM tile_pilot_item(TILE item);
}
ENTRY(tile_shares)(TILE_BUFFERS const AssemblyArguments args) {
  FOR_EACH_ITEM tile_shares_item(TILE item);
}
ENTRY(tile_mixed)(TILE_BUFFERS const AssemblyArguments args) {
  FOR_EACH_ITEM tile_mixed_item(TILE item);
}
ENTRY(tile_pieces)(TILE_BUFFERS const AssemblyArguments args) {
  FOR_EACH_ITEM tile_pieces_item(TILE item);
}
ENTRY(tile_finish)(TILE_BUFFERS const AssemblyArguments args) {
  FOR_EACH_ITEM tile_finish_item(TILE item);
}
ENTRY(tile_rays)(TILE_BUFFERS HIERARCHY_PARAMETERS const AssemblyArguments args) {
  FOR_EACH_ITEM tile_rays_item(HIERARCHY TILE item);
}
ENTRY(tile_store)(TILE_BUFFERS PANEL_PARAMETERS const AssemblyArguments args) {
  FOR_EACH_ITEM tile_store_item(panel, TILE item);
}
