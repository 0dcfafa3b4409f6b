// y = t * (H xs) for one panel of tiles and all columns: dense16 and tiled16. Contract and error bound:
// kernels/README.md.
//
// Memory traffic of a launch: 256 bytes for each tile and 4 of index, whatever the number of columns (in the GPU's shape
// tiles come from L2 from the second chunk of three columns on, as far as the strips of the running groups fit it); xs
// from cache, 64 bytes for each column of a tile.
#include "tiles.cl"

typedef struct {
  uint n, first, strips, tiles, vector_stride;
} TileArguments;

#if WORKGROUP == 1

// A work-item takes STRIPS strips, one after the other, and sweeps a strip's tiles by SEGMENT: products go into one
// accumulator per lane, which joins the row's total after a segment and begins again from zero. So an element goes
// through at most SEGMENT * PIECES <= 1,024 additions, one for each segment and four for the lanes. While a segment is
// in the cache, every chunk of columns uses it: tiles come from memory once.

#if COLUMNS <= CHUNK
#define SEGMENT 256U
#else
#define SEGMENT 64U  // 16 KiB
#endif

/// total[q][c] += Σ_k Σ_l tile[k][q][l] * x[c][16 column[k] + l] by lanes, for the STRIP rows at `tile`.
INLINE void add_tiles(const TileArguments a, global const half* tile, global const uint* column, uint count,
                      global const float* x, uint columns, vector (*total)[CHUNK]) {
  vector sum[STRIP][CHUNK];
  EACH(q, STRIP) {
    EACH(c, CHUNK) sum[q][c] = 0.0f;
  }
  for (uint k = 0; k < count; ++k, tile += TILE) {
    FETCH_AHEAD(tile);
    global const float* at = x + column[k] * TILE_COLUMNS;
    EACH(piece, PIECES) {
      vector xj[CHUNK];
      EACH_COLUMN(c) xj[c] = VECTOR(at + (size_t)c * a.vector_stride + piece * WIDTH);
      EACH(q, STRIP) {
        const vector h = floats_at(tile + q * TILE_COLUMNS + piece * WIDTH);
        EACH_COLUMN(c) sum[q][c] = FMA(h, xj[c], sum[q][c]);
      }
    }
  }
  EACH(q, STRIP) {
    EACH_COLUMN(c) total[q][c] += sum[q][c];
  }
}

/// y of one strip, whose first row is `row`.
void multiply_strip(const TileArguments a, global const half* tiles, global const uint* column, uint begin, uint end,
                    global const float* x, global const float* t, global float* y, uint row) {
  vector total[TILE_ROWS / STRIP][CHUNKS][STRIP][CHUNK];
  for (uint part = 0; part < TILE_ROWS / STRIP; ++part) {
    for (uint k = 0; k < CHUNKS; ++k) {
      for (uint q = 0; q < STRIP; ++q) {
        for (uint c = 0; c < CHUNK; ++c) total[part][k][q][c] = 0.0f;
      }
    }
  }
  for (uint from = begin; from < end; from += SEGMENT) {
    const uint count = min(end - from, SEGMENT);
    for (uint part = 0; part < TILE_ROWS / STRIP; ++part) {
      global const half* tile = tiles + (size_t)from * TILE + part * STRIP * TILE_COLUMNS;
      for (uint k = 0; k < COLUMNS / CHUNK; ++k) {
        add_tiles(a, tile, column + from, count, x + (size_t)k * CHUNK * a.vector_stride, CHUNK, total[part][k]);
      }
#if LEFT_OVER != 0
      add_tiles(a, tile, column + from, count, x + (size_t)(CHUNKS - 1) * CHUNK * a.vector_stride, LEFT_OVER,
                total[part][CHUNKS - 1]);
#endif
    }
  }
  for (uint part = 0; part < TILE_ROWS / STRIP; ++part) {
    for (uint c = 0; c < COLUMNS; ++c) {
      const strip sums = row_sums(&total[part][c / CHUNK][0][c % CHUNK]);
      const uint first = row + part * STRIP;
      global float* out = y + (size_t)c * a.vector_stride + first;
      if (first + STRIP <= a.n) {
        STRIP_OUT(out) = *(global const strip*)(t + first) * sums;
      } else {
        for (uint q = 0; q < STRIP && first + q < a.n; ++q) out[q] = t[first + q] * ((const private float*)&sums)[q];
      }
    }
  }
}

kernel __attribute__((reqd_work_group_size(1, 1, 1))) void interflect_tiles16(
    global const half* tiles, global const uint* index, global const float* x, global const float* t, global float* y,
    const TileArguments a) {
  const uint first = (uint)get_group_id(0) * STRIPS;
  const uint last = min(a.strips, first + STRIPS);
  for (uint s = first; s < last; ++s) {
    multiply_strip(a, tiles, index + a.strips + 1, index[s], index[s + 1], x, t, y, a.first + s * TILE_ROWS);
  }
}

#else

// A group takes STRIPS strips, one after the other. Four work-items share a tile: work-item l has eight columns, half
// l % 2, of the rows (l / 2) % 2, + 2, + 4 and + 6, so that four neighbours read 64 bytes in a row and each has four
// loads of 16 bytes under way. A work-item's sums join its totals after SEGMENT tiles, so that an element goes through at
// most 8 * SEGMENT = 1,024 additions, one for each segment, PER_PART - 1 to join work-items and a tree of PARTS.

#define ROWS 4U                       // of a work-item
#define TEAMS (WORKGROUP / 4U)        // tiles side by side
#define SEGMENT 128U
#define SUMS (WORKGROUP / 2U)         // work-items that have sums of a row
#define PITCH (SUMS + 16U)            // the two rows that a warp writes lie in different banks
#define PARTS (WORKGROUP / TILE_ROWS)  // work-items that join a row's sums
#define PER_PART (SUMS / PARTS)

/// The sums over all work-items of a strip's rows, times t, into y for `rows` of them.
INLINE void join(float (*sum)[ROWS], uint columns, local float (*scratch)[TILE_ROWS * PITCH], global const float* t,
                 global float* y, uint stride, uint rows) {
  const uint l = get_local_id(0), q = l / PARTS, part = l % PARTS;
  barrier(CLK_LOCAL_MEM_FENCE);  // the strip before has been read
  EACH_COLUMN(c) {
    EACH(r, ROWS) scratch[c][(l / 2 % 2 + 2 * r) * PITCH + l / 4 * 2 + l % 2] = sum[c][r];
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  float mine[CHUNK];
  EACH_COLUMN(c) {
    mine[c] = scratch[c][q * PITCH + part];
    EACH(k, PER_PART - 1) mine[c] += scratch[c][q * PITCH + part + (k + 1) * PARTS];
    scratch[c][q * PITCH + part] = mine[c];  // nobody else has read it
  }
  for (uint width = PARTS / 2; width > 0; width /= 2) {
    barrier(CLK_LOCAL_MEM_FENCE);
    if (part < width) {
      EACH_COLUMN(c) scratch[c][q * PITCH + part] += scratch[c][q * PITCH + part + width];
    }
  }
  if (part == 0 && q < rows) {
    EACH_COLUMN(c) y[(size_t)c * stride + q] = t[q] * scratch[c][q * PITCH];
  }
}

INLINE void multiply(const TileArguments a, global const half* tiles, global const uint* column, uint begin, uint end,
                     global const float* x, global const float* t, global float* y, uint columns, uint row,
                     local float (*scratch)[TILE_ROWS * PITCH]) {
  const uint l = get_local_id(0);
  global const uint4* piece = (global const uint4*)tiles + (l / 2 % 2) * 2 + l % 2;  // 16 to a tile, two to a row
  float total[CHUNK][ROWS];
  EACH(c, CHUNK) {
    EACH(r, ROWS) total[c][r] = 0.0f;
  }
  for (uint from = begin; from < end; from += SEGMENT * TEAMS) {
    float sum[CHUNK][ROWS];
    EACH(c, CHUNK) {
      EACH(r, ROWS) sum[c][r] = 0.0f;
    }
    const uint to = min(end, from + SEGMENT * TEAMS);
    for (uint k = from + l / 4; k < to; k += TEAMS) {
      uint4 halves[ROWS];
      EACH(r, ROWS) halves[r] = piece[(size_t)k * 16 + 4 * r];
      global const float* at = x + column[k] * TILE_COLUMNS + l % 2 * 8;
      float8 h[ROWS];
      EACH(r, ROWS) h[r] = floats_of(halves[r]);
      EACH_COLUMN(c) {
        global const float4* xj = (global const float4*)(at + (size_t)c * a.vector_stride);
        const float8 both = (float8)(xj[0], xj[1]);
        EACH(r, ROWS) sum[c][r] = dot_of(h[r], both, sum[c][r]);
      }
    }
    EACH_COLUMN(c) {
      EACH(r, ROWS) total[c][r] += sum[c][r];
    }
  }
  join(total, columns, scratch, t + row, y + row, a.vector_stride, a.n - row);
}

kernel __attribute__((reqd_work_group_size(WORKGROUP, 1, 1))) void interflect_tiles16(
    global const half* tiles, global const uint* index, global const float* x, global const float* t, global float* y,
    const TileArguments a) {
  local float scratch[CHUNK][TILE_ROWS * PITCH];
  const uint first = (uint)get_group_id(0) * STRIPS;
  const uint last = min(a.strips, first + STRIPS);
  for (uint s = first; s < last; ++s) {
    const uint row = a.first + s * TILE_ROWS;
    for (uint k = 0; k < COLUMNS / CHUNK; ++k) {
      const size_t column = (size_t)k * CHUNK * a.vector_stride;
      multiply(a, tiles, index + a.strips + 1, index[s], index[s + 1], x + column, t, y + column, CHUNK, row, scratch);
    }
#if LEFT_OVER != 0
    const size_t column = (size_t)(CHUNKS - 1) * CHUNK * a.vector_stride;
    multiply(a, tiles, index + a.strips + 1, index[s], index[s + 1], x + column, t, y + column, LEFT_OVER, row,
             scratch);
#endif
  }
}

#endif
