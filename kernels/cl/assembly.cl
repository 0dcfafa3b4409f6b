// The assembly of S by tiles. Contract: kernels/README.md.
#include "shared.cl"
#include "../shared/occluded.h"

typedef struct {
  uint n, tiles, first, items, option, chunks, cuts;
  float pilot_per_factor, rays_per_factor;
  uint most_in_pilot, fewest, most;
  float split_from, three2, six2, three_error2, six_error2, lift;
  uint panel_first, panel_rows, panel_stride;
} AssemblyArguments;

#define TILE_BUFFERS global const uint4 *patches, global const uint4 *tiles, global uint *work, global uint *extra,
#define TILE_PARAMETERS TILE_BUFFERS const AssemblyArguments args,
#define TILE patches, tiles, work, extra, args,
#define PATCH_WORDS(i) patches[i]
#define TILE_WORDS(i) tiles[i]
#define PANEL_PARAMETERS global float *panel,
#define PANEL_AT(row, column) panel[(size_t)(row) * args.panel_stride + (column)]
#define ADD_TO(buffer, at, count) atomic_add((volatile global uint *)(buffer) + (at), count)
#include "../shared/contour.h"
#include "../shared/polygon.h"
#include "../shared/pairs.h"
#include "../shared/tile_layout.h"
#include "../shared/tile_rays.h"
#include "../shared/tile_store.h"
#include "../shared/tiles.h"

#define ENTRY(name) kernel __attribute__((reqd_work_group_size(WORKGROUP, 1, 1))) void interflect_##name
#define ITEMS_OF_GROUP                                                                    \
  const uint share = (uint)((args.items + get_num_groups(0) - 1) / get_num_groups(0));    \
  const uint begin = args.first + min(args.items, (uint)get_group_id(0) * share);         \
  const uint end = min(args.first + args.items, begin + share);
#define FOR_EACH_ITEM \
  ITEMS_OF_GROUP      \
  for (uint item = begin + (uint)get_local_id(0); item < end; item += WORKGROUP)
#define STEP(name)                                         \
  ENTRY(name)(TILE_BUFFERS const AssemblyArguments args) { \
    FOR_EACH_ITEM name##_item(TILE item);                  \
  }

STEP(tile_kinds)
STEP(tile_special)
STEP(tile_pilot)
STEP(tile_shares)
STEP(tile_mixed)
STEP(tile_pieces)
STEP(tile_finish)

ENTRY(tile_rays)(TILE_BUFFERS HIERARCHY_PARAMETERS const AssemblyArguments args) {
#if PACKET == 1
  FOR_EACH_ITEM tile_rays_item(HIERARCHY TILE item);
#else
  ITEMS_OF_GROUP
  tile_rays_items(HIERARCHY TILE begin, end);
#endif
}

ENTRY(tile_store)(TILE_BUFFERS PANEL_PARAMETERS const AssemblyArguments args) {
  FOR_EACH_ITEM tile_store_item(panel, TILE item);
}
