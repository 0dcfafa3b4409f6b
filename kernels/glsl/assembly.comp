// The assembly of S by tiles; the backend compiles this once for each kernel, with KERNEL_name defined. Contract:
// kernels/README.md.
#include "shared.comp"

layout(local_size_x = WORKGROUP) in;

layout(push_constant) uniform Arguments {
  uint n;
  uint tiles;
  uint first;
  uint items;
  uint option;
  uint chunks;
  uint cuts;
  float pilot_per_factor;
  float rays_per_factor;
  uint most_in_pilot;
  uint fewest;
  uint most;
  float split_from;
  float three2;
  float six2;
  float three_error2;
  float six_error2;
  float lift;
  uint panel_first;
  uint panel_rows;
  uint panel_stride;
} args;

INPUT_WORDS(0, patches)
INPUT_WORDS(1, tiles)
layout(set = 0, binding = 2, std430) restrict buffer Work { uint work[]; };
layout(set = 0, binding = 3, std430) restrict buffer Extra { uint extra[]; };

#define TILE_PARAMETERS
#define TILE
#define PATCH_WORDS(i) WORDS(patches, i)
#define TILE_WORDS(i) WORDS(tiles, i)
#define ADD_TO(buffer, at, count) atomicAdd(buffer[at], count)
#include "../shared/contour.h"
#include "../shared/polygon.h"
#include "../shared/pairs.h"
#include "../shared/tile_layout.h"

#if defined(KERNEL_tile_rays)
INPUT_WORDS(4, hierarchy_nodes)
INPUT_FOURS(5, hierarchy_leaves)
#include "../shared/occluded.h"
#include "../shared/tile_rays.h"
#define ITEM(item) tile_rays_item(HIERARCHY TILE item)
#elif defined(KERNEL_tile_store)
layout(set = 0, binding = 4, std430) restrict buffer Panel { float panel[]; };
#define PANEL_PARAMETERS
#define PANEL_AT(row, column) panel[(row) * args.panel_stride + (column)]
#include "../shared/tile_store.h"
#define ITEM(item) tile_store_item(TILE item)
#else
#include "../shared/tiles.h"
#if defined(KERNEL_tile_kinds)
#define ITEM(item) tile_kinds_item(TILE item)
#elif defined(KERNEL_tile_special)
#define ITEM(item) tile_special_item(TILE item)
#elif defined(KERNEL_tile_pilot)
#define ITEM(item) tile_pilot_item(TILE item)
#elif defined(KERNEL_tile_shares)
#define ITEM(item) tile_shares_item(TILE item)
#elif defined(KERNEL_tile_mixed)
#define ITEM(item) tile_mixed_item(TILE item)
#elif defined(KERNEL_tile_pieces)
#define ITEM(item) tile_pieces_item(TILE item)
#else
#define ITEM(item) tile_finish_item(TILE item)
#endif
#endif

void main() {
  const uint share = (args.items + gl_NumWorkGroups.y - 1u) / gl_NumWorkGroups.y;
  const uint begin = args.first + min(args.items, gl_WorkGroupID.y * share);
  const uint end = min(args.first + args.items, begin + share);
  for (uint item = begin + gl_LocalInvocationIndex; item < end; item += WORKGROUP) {
    ITEM(item);
  }
}
