// y = F x for one panel and all columns. Contract and error bound: kernels/README.md.
//
// Memory traffic of a launch: F once, 4 * rows * n bytes (in the GPU's shape from the second chunk of four columns on
// from L2, as far as the rows of the running groups fit it); x from cache, 4 * n * columns bytes for eight rows.

typedef struct {
  uint n, first, rows, row_stride, vector_stride;
} MatvecArguments;

#ifdef FP_FAST_FMAF
#define FMA(a, b, c) fma(a, b, c)
#else
#define FMA(a, b, c) ((a) * (b) + (c))
#endif

/// The columns of a chunk; `columns` is a constant once the function is inlined, the loop's end must be one before.
#define EACH_COLUMN(c) _Pragma("unroll") for (uint c = 0; c < CHUNK; ++c) if (c < columns)

#if WORKGROUP == 1

// One work-item takes ROWS rows, a strip at a time, and sweeps them by vectors of WIDTH columns. Products go into one
// accumulator per lane; every 1,024 columns the accumulators join the row's totals and begin again from zero, so that
// an element goes through at most 1,024 / WIDTH additions, one for each block, and four for the lanes. While a block
// of the strip is in the cache, every chunk of columns uses it: F comes from memory once.

#define BLOCK 1024U
#define CHUNK 3  // columns in registers at once
#define CHUNKS ((COLUMNS + CHUNK - 1) / CHUNK)
#if WIDTH == 16
#define STRIP 8  // rows in registers at once: accumulators, vectors of x and one of F fill 32 or 16 registers
typedef float16 vector;
#define LOAD(p) vload16(0, p)
#define LANE (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
#elif WIDTH == 8
#define STRIP 4
typedef float8 vector;
#define LOAD(p) vload8(0, p)
#define LANE (int8)(0, 1, 2, 3, 4, 5, 6, 7)
#else
#define STRIP 4
typedef float4 vector;
#define LOAD(p) vload4(0, p)
#define LANE (int4)(0, 1, 2, 3)
#endif

float lane_sum(vector v) {
#if WIDTH == 16
  const float8 a = v.lo + v.hi;
  const float4 b = a.lo + a.hi;
#elif WIDTH == 8
  const float4 b = v.lo + v.hi;
#else
  const float4 b = v;
#endif
  const float2 c = b.lo + b.hi;
  return c.lo + c.hi;
}

/// sum[q][c] += f[q][j...] * x[c][j...] for the WIDTH columns from j. Of the last vector of a row only `left` lanes
/// count; what lies behind them is padding.
#define MULTIPLY(j, KEEP)                                                          \
  {                                                                                \
    vector xj[CHUNK];                                                              \
    EACH_COLUMN(c) xj[c] = KEEP(LOAD(x + (size_t)c * a.vector_stride + (j)));      \
    _Pragma("unroll") for (uint q = 0; q < STRIP; ++q) {                           \
      const vector fj = KEEP(LOAD(f[q] + (j)));                                    \
      EACH_COLUMN(c) sum[q][c] = FMA(fj, xj[c], sum[q][c]);                        \
    }                                                                              \
  }
#define WHOLE(v) (v)
#define PART(v) select((vector)0.0f, v, LANE < left)

/// total[q][c] += Σ_j f[q][j] * x[c][j] by lanes, for j in [begin, end) and up to CHUNK columns.
__attribute__((always_inline)) void add_block(const MatvecArguments a, global const float* const* f,
                                              global const float* x, uint columns, uint begin, uint end,
                                              vector (*total)[CHUNK]) {
  vector sum[STRIP][CHUNK];
#pragma unroll
  for (uint q = 0; q < STRIP; ++q) {
#pragma unroll
    for (uint c = 0; c < CHUNK; ++c) sum[q][c] = 0.0f;
  }
  uint j = begin;
  for (; j + WIDTH <= end; j += WIDTH) MULTIPLY(j, WHOLE)
  const int left = (int)(end - j);
  if (left > 0) MULTIPLY(j, PART)
#pragma unroll
  for (uint q = 0; q < STRIP; ++q) {
    EACH_COLUMN(c) total[q][c] += sum[q][c];
  }
}

/// A strip of rows from `row`. Past `last` it computes the panel's last row again and stores nothing.
void multiply_strip(const MatvecArguments a, global const float* f, global const float* x, global float* y, uint row,
                    uint last) {
  global const float* rows[STRIP];
#pragma unroll
  for (uint q = 0; q < STRIP; ++q) rows[q] = f + (size_t)min(row + q, last - 1) * a.row_stride;
  vector total[CHUNKS][STRIP][CHUNK];
  for (uint k = 0; k < CHUNKS; ++k) {
    for (uint q = 0; q < STRIP; ++q) {
      for (uint c = 0; c < CHUNK; ++c) total[k][q][c] = 0.0f;
    }
  }
  for (uint begin = 0; begin < a.n; begin += BLOCK) {
    const uint end = min(a.n, begin + BLOCK);
    for (uint k = 0; k < COLUMNS / CHUNK; ++k) {
      add_block(a, rows, x + (size_t)k * CHUNK * a.vector_stride, CHUNK, begin, end, total[k]);
    }
#if COLUMNS % CHUNK != 0
    add_block(a, rows, x + (size_t)(CHUNKS - 1) * CHUNK * a.vector_stride, COLUMNS % CHUNK, begin, end,
              total[CHUNKS - 1]);
#endif
  }
  for (uint c = 0; c < COLUMNS; ++c) {
    for (uint q = 0; q < STRIP && row + q < last; ++q) {
      y[(size_t)c * a.vector_stride + a.first + row + q] = lane_sum(total[c / CHUNK][q][c % CHUNK]);
    }
  }
}

kernel __attribute__((reqd_work_group_size(1, 1, 1))) void interflect_matvec(global const float* f, global const float* x,
                                                                  global float* y, const MatvecArguments a) {
  const uint first = (uint)get_group_id(0) * ROWS;
  const uint last = min(a.rows, first + ROWS);
  for (uint row = first; row < last; row += STRIP) multiply_strip(a, f, x, y, row, last);
}

#else

// A group takes ROWS rows, eight at a time; its work-items go over the columns side by side, four columns each, and the
// eight rows' loads are under way at once. A work-item's sum of a row joins the row's total every BLOCK fours and begins
// again from zero, so that an element goes through at most 4 * BLOCK = 256 additions, one for each BLOCK * 4 * WORKGROUP
// columns, STRIP - 1 to join work-items, and a tree of PARTS.

#define STRIP 8
#define BLOCK 64U                   // fours that a work-item adds before they join the total
#define CHUNK 4                     // columns of x in registers at once
#define PARTS (WORKGROUP / STRIP)  // work-items that join a row's sums

/// Four values from column j; those from n on are padding.
float4 four(global const float* p, uint j, uint n) {
  const float4 v = vload4(0, p + j);
  return j + 4 <= n ? v : select((float4)0.0f, v, (int4)(0, 1, 2, 3) < (int)(n - j));
}

/// The sums over all work-items of one column of x, eight rows at once.
void join(const float* sum, local float* scratch, global float* y, uint rows) {
  const uint l = get_local_id(0);
  barrier(CLK_LOCAL_MEM_FENCE);  // the column before has been read
#pragma unroll
  for (uint q = 0; q < STRIP; ++q) scratch[q * WORKGROUP + l] = sum[q];
  barrier(CLK_LOCAL_MEM_FENCE);
  local float* row = scratch + l / PARTS * WORKGROUP;
  const uint part = l % PARTS;
  float mine = row[part];
#pragma unroll
  for (uint k = 1; k < STRIP; ++k) mine += row[part + k * PARTS];
  barrier(CLK_LOCAL_MEM_FENCE);  // all have read what is now written over
  row[part] = mine;
  for (uint width = PARTS / 2; width > 0; width /= 2) {
    barrier(CLK_LOCAL_MEM_FENCE);
    if (part < width) row[part] += row[part + width];
  }
  if (part == 0 && l / PARTS < rows) y[l / PARTS] = row[0];
}

__attribute__((always_inline)) void multiply(const MatvecArguments a, global const float* f, global const float* x,
                                             global float* y, uint columns, uint row, uint last,
                                             local float* scratch) {
  float total[CHUNK][STRIP];
#pragma unroll
  for (uint c = 0; c < CHUNK; ++c) {
#pragma unroll
    for (uint q = 0; q < STRIP; ++q) total[c][q] = 0.0f;
  }
  global const float* rows[STRIP];
#pragma unroll
  for (uint q = 0; q < STRIP; ++q) rows[q] = f + (size_t)min(row + q, last - 1) * a.row_stride;
  for (uint begin = 0; begin < a.n; begin += BLOCK * WORKGROUP * 4) {
    float sum[CHUNK][STRIP];
#pragma unroll
    for (uint c = 0; c < CHUNK; ++c) {
#pragma unroll
      for (uint q = 0; q < STRIP; ++q) sum[c][q] = 0.0f;
    }
    const uint end = min(a.n, begin + BLOCK * WORKGROUP * 4);
    for (uint j = begin + get_local_id(0) * 4; j < end; j += WORKGROUP * 4) {
      float4 fj[STRIP];
#pragma unroll
      for (uint q = 0; q < STRIP; ++q) fj[q] = four(rows[q], j, a.n);
      EACH_COLUMN(c) {
        const float4 xj = four(x + (size_t)c * a.vector_stride, j, a.n);
#pragma unroll
        for (uint q = 0; q < STRIP; ++q) {
          sum[c][q] = FMA(fj[q].x, xj.x, sum[c][q]);
          sum[c][q] = FMA(fj[q].y, xj.y, sum[c][q]);
          sum[c][q] = FMA(fj[q].z, xj.z, sum[c][q]);
          sum[c][q] = FMA(fj[q].w, xj.w, sum[c][q]);
        }
      }
    }
    EACH_COLUMN(c) {
#pragma unroll
      for (uint q = 0; q < STRIP; ++q) total[c][q] += sum[c][q];
    }
  }
  EACH_COLUMN(c) {
    join(total[c], scratch, y + (size_t)c * a.vector_stride + a.first + row, last - row);
  }
}

kernel __attribute__((reqd_work_group_size(WORKGROUP, 1, 1))) void interflect_matvec(global const float* f, global const float* x,
                                                                          global float* y, const MatvecArguments a) {
  local float scratch[STRIP * WORKGROUP];
  const uint first = (uint)get_group_id(0) * ROWS;
  const uint last = min(a.rows, first + ROWS);
  for (uint row = first; row < last; row += STRIP) {
    for (uint k = 0; k < COLUMNS / CHUNK; ++k) {
      const size_t column = (size_t)k * CHUNK * a.vector_stride;
      multiply(a, f, x + column, y + column, CHUNK, row, last, scratch);
    }
#if COLUMNS % CHUNK != 0
    const size_t column = (size_t)(COLUMNS / CHUNK) * CHUNK * a.vector_stride;
    multiply(a, f, x + column, y + column, COLUMNS % CHUNK, row, last, scratch);
#endif
  }
}

#endif
