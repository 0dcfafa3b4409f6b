// The symmetric format. Contract and error bounds: kernels/README.md. The two kernels have different macros, so that
// only one of them is there at a time.

#ifdef COLUMNS

// sym16: partial sums of blocks. Memory traffic of a launch: 256 bytes for each tile and 4 of index, whatever the number
// of columns (in the GPU's shape tiles come from L2 or memory again for each chunk of three columns), and 8 COLUMNS
// BLOCK bytes written for each block; slices of x and, on processors, of the partial sums come from L1.
#include "tiles.cl"

typedef struct {
  uint blocks, strips, tiles, block_rows, vector_stride;
} SymmetricArguments;

/// A block: its first row and column in F, its strips, and the slots of its rows' and its columns' sums.
typedef struct {
  uint row, column, first, end;
  global float *rows, *columns;
  bool diagonal;
} SymmetricBlock;

#define SLOT (COLUMNS * BLOCK)

SymmetricBlock block_of(const SymmetricArguments a, global const uint* index, global float* partial, uint number) {
  const uint4 entry = vload4(number, index);
  SymmetricBlock b;
  b.row = entry.x * BLOCK;
  b.column = entry.y * BLOCK;
  b.first = entry.z;
  b.end = entry.w;
  b.rows = partial + ((size_t)entry.x * a.block_rows + entry.y) * SLOT;
  b.columns = partial + ((size_t)entry.y * a.block_rows + entry.x) * SLOT;
  b.diagonal = entry.x == entry.y;
  return b;
}

/// The parts of the index behind the blocks: numbers of strips in their blocks, where their tiles begin, tile columns.
#define STRIP_NUMBERS(a, index) ((index) + 4 * (a).blocks)
#define TILE_BEGINS(a, index) ((index) + 4 * (a).blocks + (a).strips)
#define TILE_COLUMN_NUMBERS(a, index) ((index) + 4 * (a).blocks + 2 * (a).strips + 1)

#if WORKGROUP == 1

// A work-item takes a block, strip by strip; slices of x and the slots' sums stay in L1. The rows' sums of a strip are
// in registers, one for each lane, and join the slot after the strip's last tile; a tile's sums of its columns are made
// from its eight rows, then added to the slot. So an element goes through BLOCK / WIDTH additions in a lane, four for the
// lanes, eight in a tile, and BLOCK / 8 + 1 in the slot.

/// STRIP rows of a strip's tiles, for the columns of a chunk.
INLINE void add_strip(const SymmetricArguments a, global const half* tile, global const uint* column, uint count,
                      global const float* x_rows, global const float* x_columns, global float* rows,
                      global float* columns_out, uint columns) {
  vector sum[STRIP][CHUNK];
  float x[STRIP][CHUNK];
  EACH(q, STRIP) {
    EACH(c, CHUNK) sum[q][c] = 0.0f;
    EACH_COLUMN(c) x[q][c] = x_rows[(size_t)c * a.vector_stride + q];
  }
  for (uint k = 0; k < count; ++k, tile += TILE) {
    FETCH_AHEAD(tile);
    EACH(piece, PIECES) {
      const uint j = column[k] * TILE_COLUMNS + piece * WIDTH;
      vector xj[CHUNK], down[CHUNK];
      EACH_COLUMN(c) xj[c] = VECTOR(x_columns + (size_t)c * a.vector_stride + j);
      EACH(q, STRIP) {
        const vector h = floats_at(tile + q * TILE_COLUMNS + piece * WIDTH);
        EACH_COLUMN(c) {
          sum[q][c] = FMA(h, xj[c], sum[q][c]);
          down[c] = q == 0 ? h * x[q][c] : FMA(h, (vector)x[q][c], down[c]);
        }
      }
      EACH_COLUMN(c) VECTOR_OUT(columns_out + c * BLOCK + j) += down[c];
    }
  }
  EACH_COLUMN(c) STRIP_OUT(rows + c * BLOCK) += row_sums(&sum[0][c]);
}

kernel __attribute__((reqd_work_group_size(1, 1, 1))) void interflect_sym16(
    global const half* tiles, global const uint* index, global const float* x, global float* partial,
    const SymmetricArguments a) {
  const uint number = (uint)get_group_id(0);
  if (number >= a.blocks) return;
  const SymmetricBlock b = block_of(a, index, partial, number);
  for (uint i = 0; i < SLOT; i += WIDTH) VECTOR_OUT(b.rows + i) = VECTOR_OUT(b.columns + i) = 0.0f;
  global const uint* begins = TILE_BEGINS(a, index);
  for (uint s = b.first; s < b.end; ++s) {
    const uint begin = begins[s], count = begins[s + 1] - begin;
    global const uint* column = TILE_COLUMN_NUMBERS(a, index) + begin;
    for (uint part = 0; part < TILE_ROWS / STRIP; ++part) {
      global const half* tile = tiles + (size_t)begin * TILE + part * STRIP * TILE_COLUMNS;
      const uint row = STRIP_NUMBERS(a, index)[s] * TILE_ROWS + part * STRIP;
      for (uint k = 0; k < COLUMNS / CHUNK; ++k) {
        const size_t at = (size_t)k * CHUNK * a.vector_stride;
        add_strip(a, tile, column, count, x + at + b.row + row, x + at + b.column, b.rows + k * CHUNK * BLOCK + row,
                  b.columns + k * CHUNK * BLOCK, CHUNK);
      }
#if LEFT_OVER != 0
      const size_t at = (size_t)(CHUNKS - 1) * CHUNK * a.vector_stride;
      add_strip(a, tile, column, count, x + at + b.row + row, x + at + b.column,
                b.rows + (CHUNKS - 1) * CHUNK * BLOCK + row, b.columns + (CHUNKS - 1) * CHUNK * BLOCK, LEFT_OVER);
#endif
    }
  }
}

#else

// A group takes a block, a chunk of columns of x at a time. A work-item has eight columns of the block (half a tile) for
// good, with x and sums of them in registers, and goes down the block's strips; where a strip has no tile for it, it
// adds nothing. PHASES strips are done side by side, by LANES work-items each; a block that is wider than the group is
// done RANGE tile columns at a time. Each strip's rows are joined over its lanes in local memory. So an element goes
// through at most BLOCK additions in its columns' sum, then PHASES; or eight in a row's sum, LANES / PARTS, PARTS, and
// one for each range; on the diagonal one more.

#define TILES_ACROSS (BLOCK / TILE_COLUMNS)
#define RANGE (TILES_ACROSS < WORKGROUP / 2U ? TILES_ACROSS : WORKGROUP / 2U)  // tile columns at a time
#define LANES (2U * RANGE)                                                    // work-items of a strip
#define PITCH (LANES + 4U)   // sums that are read side by side lie in different banks
#define SUMS (8U * CHUNK)    // of a strip's rows, or of a work-item's columns
#define PARTS 4U             // work-items that join one sum over the lanes
#define FLOATS (SUMS * (PITCH + PARTS) + RANGE)                         // local memory of a phase
#define FITTING (8000U / FLOATS < WORKGROUP / LANES ? 8000U / FLOATS : WORKGROUP / LANES)
#define PHASES (FITTING < BLOCK / TILE_ROWS ? FITTING : BLOCK / TILE_ROWS)
#define NOWHERE 0xFFFFFFFFU

typedef struct {
  float sums[PHASES][SUMS * PITCH];
  float parts[PHASES][SUMS * PARTS];
  uint tiles[PHASES][RANGE];  ///< where a strip's tile of each column is; NOWHERE: it has none
} Scratch;

typedef struct {
  const SymmetricArguments a;
  SymmetricBlock b;
  global const half* tiles;
  global const uint* index;
  local Scratch* scratch;
  uint range;         ///< first tile column
  uint phase, lane;   ///< of this work-item; phase = PHASES: it has none
} Work;

/// Notes where the tiles of the strips from `s` on are.
INLINE void find_tiles(const Work* w, uint s) {
  uint k = 0, end = 0;
  if (w->phase < PHASES && s + w->phase < w->b.end) {  // not an early return: PoCL 3.1 then finds no tile at all
    global const uint* begins = TILE_BEGINS(w->a, w->index) + s + w->phase;
    k = begins[0] + w->lane;
    end = begins[1];
  }
  for (; k < end; k += LANES) {
    const uint column = TILE_COLUMN_NUMBERS(w->a, w->index)[k] - w->range;
    if (column < RANGE) w->scratch->tiles[w->phase][column] = k;
  }
}

/// This work-item's eight columns of the strip's tile: a load of 16 bytes for each row. False where there is no tile.
INLINE bool load_tile(const Work* w, uint s, uint4* halves) {
  if (w->phase == PHASES || s + w->phase >= w->b.end) return false;
  global const uint* begins = TILE_BEGINS(w->a, w->index) + s + w->phase;
  const uint k = w->scratch->tiles[w->phase][w->lane / 2];
  if (k < begins[0] || k >= begins[1]) return false;  // an earlier strip's, or none yet
  global const uint4* from = (global const uint4*)w->tiles + (size_t)k * 16 + w->lane % 2;
  EACH(q, TILE_ROWS) halves[q] = from[2 * q];
  return true;
}

/// A tile's half: its rows' sums, to be joined, into scratch, and those of its columns added to `down`.
INLINE void add_tile(const Work* w, const uint4* halves, global const float* x_rows, const float8* xj, float8* down,
                     uint columns) {
  local float* sums = w->scratch->sums[w->phase] + w->lane;
  EACH(part, 2) {
    float4 x[CHUNK];
    EACH_COLUMN(c) x[c] = *(global const float4*)(x_rows + (size_t)c * w->a.vector_stride + part * 4);
    EACH(r, 4) {
      const uint q = part * 4 + r;
      const float8 h = floats_of(halves[q]);
      EACH_COLUMN(c) {
        sums[(c * TILE_ROWS + q) * PITCH] = dot_of(h, xj[c], 0.0f);
        down[c] = FMA(h, (float8)(((const private float*)&x[c])[r]), down[c]);
      }
    }
  }
}

/// Joins the rows' sums of PHASES strips from `s` on over their lanes: first by PARTS work-items for each sum, ...
INLINE void join_lanes(const Work* w, uint columns) {
  for (uint i = get_local_id(0); i < PHASES * TILE_ROWS * columns * PARTS; i += WORKGROUP) {
    const uint part = i % PARTS, o = i / PARTS % (TILE_ROWS * columns), phase = i / PARTS / (TILE_ROWS * columns);
    local const float* from = w->scratch->sums[phase] + o * PITCH;
    float sum = 0.0f;
    for (uint k = part; k < LANES; k += PARTS) sum += from[k];
    w->scratch->parts[phase][o * PARTS + part] = sum;
  }
}

/// ... then by one, which adds it to the slot.
INLINE void join_parts(const Work* w, uint s, global float* rows, uint columns) {
  for (uint i = get_local_id(0); i < PHASES * TILE_ROWS * columns; i += WORKGROUP) {
    const uint o = i % (TILE_ROWS * columns), phase = i / (TILE_ROWS * columns);
    if (s + phase >= w->b.end) continue;
    local const float* part = w->scratch->parts[phase] + o * PARTS;
    const uint row = STRIP_NUMBERS(w->a, w->index)[s + phase] * TILE_ROWS + o % TILE_ROWS;
    rows[o / TILE_ROWS * BLOCK + row] += (part[0] + part[1]) + (part[2] + part[3]);
  }
}

/// The columns' sums of a range: the phases' one after the other.
INLINE void join_phases(const Work* w, const float8* down, global float* out, uint columns) {
  barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);  // on the diagonal, the rows' sums are there
  if (w->phase < PHASES) {
    EACH_COLUMN(c) {
      EACH(e, 8) {
        w->scratch->sums[w->phase][(c * 8 + e) * PITCH + w->lane] = ((const private float*)&down[c])[e];
      }
    }
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint j = get_local_id(0); j < 8 * LANES && w->range * TILE_COLUMNS + j < BLOCK; j += WORKGROUP) {
    EACH_COLUMN(c) {
      const uint at = (c * 8 + j % 8) * PITCH + j / 8;
      float sum = w->scratch->sums[0][at];
      for (uint phase = 1; phase < PHASES; ++phase) sum += w->scratch->sums[phase][at];
      global float* to = out + c * BLOCK + w->range * TILE_COLUMNS + j;
      *to = w->b.diagonal ? *to + sum : sum;
    }
  }
}

/// The tile columns from w->range on.
INLINE void multiply_range(const Work* w, global const float* x, global float* rows, global float* out, uint columns) {
  const uint j = w->b.column + (w->range + w->lane / 2) * TILE_COLUMNS + w->lane % 2 * 8;
  const bool inside = w->phase < PHASES && w->range + w->lane / 2 < TILES_ACROSS && j < w->a.vector_stride;
  float8 xj[CHUNK], down[CHUNK];
  EACH_COLUMN(c) {
    global const float4* from = (global const float4*)(x + (size_t)c * w->a.vector_stride + j);
    xj[c] = inside ? (float8)(from[0], from[1]) : (float8)0.0f;
    down[c] = 0.0f;
  }
  if (w->phase < PHASES && w->lane < RANGE) w->scratch->tiles[w->phase][w->lane] = NOWHERE;
  barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);  // the range before is done, or the slot full of zeros
  find_tiles(w, w->b.first);
  barrier(CLK_LOCAL_MEM_FENCE);
  uint4 halves[TILE_ROWS];
  bool there = load_tile(w, w->b.first, halves);
  barrier(CLK_LOCAL_MEM_FENCE);
  for (uint s = w->b.first; s < w->b.end; s += PHASES) {
    if (there) {
      const uint row = w->b.row + STRIP_NUMBERS(w->a, w->index)[s + w->phase] * TILE_ROWS;
      add_tile(w, halves, x + row, xj, down, columns);
    } else if (w->phase < PHASES) {
      EACH(o, TILE_ROWS * columns) w->scratch->sums[w->phase][o * PITCH + w->lane] = 0.0f;
    }
    find_tiles(w, s + PHASES);
    barrier(CLK_LOCAL_MEM_FENCE);
    there = load_tile(w, s + PHASES, halves);  // under way while sums are joined
    join_lanes(w, columns);
    barrier(CLK_LOCAL_MEM_FENCE);
    join_parts(w, s, rows, columns);
  }
  join_phases(w, down, out, columns);
}

INLINE void multiply_block(Work* w, global const float* x, global float* rows, global float* out, uint columns) {
  for (uint i = get_local_id(0); i < columns * BLOCK; i += WORKGROUP) rows[i] = 0.0f;
  for (w->range = 0; w->range < TILES_ACROSS; w->range += RANGE) multiply_range(w, x, rows, out, columns);
  barrier(CLK_LOCAL_MEM_FENCE);  // the next chunk begins anew
}

kernel __attribute__((reqd_work_group_size(WORKGROUP, 1, 1))) void interflect_sym16(
    global const half* tiles, global const uint* index, global const float* x, global float* partial,
    const SymmetricArguments a) {
  local Scratch scratch;
  const uint number = (uint)get_group_id(0), l = get_local_id(0);
  if (number >= a.blocks) return;
  Work w = {a, block_of(a, index, partial, number), tiles, index, &scratch, 0, min(l / LANES, PHASES), l % LANES};
  for (uint k = 0; k < COLUMNS / CHUNK; ++k) {
    const size_t slot = (size_t)k * CHUNK * BLOCK;
    multiply_block(&w, x + (size_t)k * CHUNK * a.vector_stride, w.b.rows + slot, w.b.columns + slot, CHUNK);
  }
#if LEFT_OVER != 0
  const size_t slot = (size_t)(CHUNKS - 1) * CHUNK * BLOCK;
  multiply_block(&w, x + (size_t)(CHUNKS - 1) * CHUNK * a.vector_stride, w.b.rows + slot, w.b.columns + slot,
                 LEFT_OVER);
#endif
}

#endif

#else

// sym16_fold: y = t * the sum of a row's slots in order. Memory traffic: 4 bytes of partial sums for each element, column
// and block of a row of blocks, 4 of t, and 4 written.
#include "blocks.cl"

kernel GROUP_OF_ITEMS void interflect_sym16_fold(global const float* partial, global const float* t, global float* y,
                                      const VectorArguments a) {
  const uint block = a.option, block_rows = a.slot;
  const size_t slot = (size_t)a.columns * block;
  FOR_EACH_BLOCK(item) {
    const Block b = block_of(a, item);
    const size_t column = (size_t)b.column * a.vector_stride;
    FOR_EACH_ELEMENT(i, b) {
      const uint row = (uint)(i - column);  // a vector of rows is in one slot, which is whole
      global const float* from = partial + (size_t)(row / block) * block_rows * slot + b.column * block + row % block;
      lanes sum = 0.0f;
      for (uint k = 0; k < block_rows; ++k) sum += load(from, k * slot, k * slot + LANES);
      store(load(t, row, a.n) * sum, y, i, b.end);
    }
  }
}

#endif
