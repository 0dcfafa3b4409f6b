// y = F x as pairs hi + lo of floats, for one panel and all columns. Contract and error bound: kernels/README.md.
//
// Every product is split into its rounded value and what rounding took away (by fused multiply-add), every sum likewise (Knuth's
// two-sum; Ogita, Rump and Oishi 2005). No addition may be regrouped and no product folded into one: hence the pragma, and
// why this file must not be compiled with -cl-fast-relaxed-math.
//
// A group takes ROWS rows, STRIP at a time; its work-items lie along the columns, WIDE neighbours each. Memory traffic of a
// launch: F once, 4 * rows * n bytes, once more from cache for every further CHUNK columns of x.
//
// Order of sums: after BLOCK products a work-item's pair (in the processors' shape: of each lane) joins the row's total and
// begins again from zero; then lanes and work-items join in a tree.

#pragma OPENCL FP_CONTRACT OFF

typedef struct {
  uint n, first, rows, row_stride, vector_stride;
} MatvecArguments;

#define ROWS 4U
#define CHUNK 3U   // columns of x in registers at once
#define BLOCK 128U  // products of a lane before its sum joins the total
#if WORKGROUP == 1
#define STRIP 1U
#define WIDE 16U
#define LANES 16U
typedef float16 part;   // what is loaded at once
typedef float16 lanes;  // what has a sum of its own
#define LOAD(p) vload16(0, p)
#define ADD(f, x, sum) add_product(f, x, sum)
#define TO_ARRAY(v, array) vstore16(v, 0, array)
#else
#define STRIP 4U
#define WIDE 4U
#define LANES 1U
typedef float4 part;
typedef float lanes;
#define LOAD(p) vload4(0, p)
#define ADD(four_f, four_x, sum)             \
  add_product((four_f).x, (four_x).x, sum);  \
  add_product((four_f).y, (four_x).y, sum);  \
  add_product((four_f).z, (four_x).z, sum);  \
  add_product((four_f).w, (four_x).w, sum)
#define TO_ARRAY(v, array) (array)[0] = v
#endif

typedef struct {
  lanes hi, lo;
} Sum;
typedef struct {
  float hi, lo;
} Pair;

/// s + t = a + b, s being the rounded sum.
#define TWO_SUM(type, a, b, s, t)         \
  const type s = (a) + (b);               \
  const type s##_b = s - (a);             \
  const type s##_a = s - s##_b;           \
  const type t = ((a)-s##_a) + ((b)-s##_b)

__attribute__((always_inline)) void add_product(lanes f, lanes x, Sum* sum) {
  const lanes p = f * x;
  const lanes e = fma(f, x, -p);  // f x = p + e
  TWO_SUM(lanes, sum->hi, p, s, t);
  sum->hi = s;
  sum->lo += t + e;
}

/// sum += other, and |lo| is then at most a rounding of hi.
#define JOIN(type, sum, other)                           \
  {                                                      \
    TWO_SUM(type, (sum)->hi, (other).hi, s, t);          \
    const type w = t + ((sum)->lo + (other).lo);         \
    TWO_SUM(type, s, w, high, low);                      \
    (sum)->hi = high;                                    \
    (sum)->lo = low;                                     \
  }

/// The sum over all work-items, for work-item 0.
Pair of_group(Pair mine, local float* scratch) {
  const uint l = get_local_id(0);
  barrier(CLK_LOCAL_MEM_FENCE);  // the sum before has been read
  scratch[l] = mine.hi;
  scratch[WORKGROUP + l] = mine.lo;
  for (uint width = WORKGROUP / 2; width > 0; width /= 2) {
    barrier(CLK_LOCAL_MEM_FENCE);  // the level before is there
    if (l < width) {
      const Pair other = {scratch[l + width], scratch[WORKGROUP + l + width]};
      JOIN(float, &mine, other);
      scratch[l] = mine.hi;
      scratch[WORKGROUP + l] = mine.lo;
    }
  }
  return mine;
}

Pair of_lanes(Sum sum) {
  float hi[LANES], lo[LANES];
  TO_ARRAY(sum.hi, hi);
  TO_ARRAY(sum.lo, lo);
  Pair all = {hi[0], lo[0]};
  for (uint k = 1; k < LANES; ++k) {
    const Pair lane = {hi[k], lo[k]};
    JOIN(float, &all, lane);
  }
  return all;
}

/// The WIDE values from column j; those from n on are padding, read as 0.
part values(global const float* p, uint j, uint n) {
  if (j + WIDE <= n) return LOAD(p + j);
  float left[WIDE] = {0};
  for (uint k = 0; j + k < n; ++k) left[k] = p[j + k];
  return LOAD(left);
}

/// Up to STRIP rows from `row` by up to CHUNK columns of x from column `column` on.
void multiply(const MatvecArguments a, global const float* f, global const float* x, global float* y, uint column,
              uint row, uint last, local float* scratch) {
  Sum sum[STRIP][CHUNK], total[STRIP][CHUNK];
  for (uint q = 0; q < STRIP; ++q) {
    for (uint c = 0; c < CHUNK; ++c) total[q][c].hi = total[q][c].lo = 0.0f;
  }
  const uint step = WORKGROUP * WIDE, block = BLOCK * LANES / WIDE * step;
  for (uint begin = 0; begin < a.n; begin += block) {
    for (uint q = 0; q < STRIP; ++q) {
      for (uint c = 0; c < CHUNK; ++c) sum[q][c].hi = sum[q][c].lo = 0.0f;
    }
    const uint end = a.n - begin < block ? a.n : begin + block;
    for (uint j = begin + get_local_id(0) * WIDE; j < end; j += step) {
      part xj[CHUNK];
#pragma unroll
      for (uint c = 0; c < CHUNK; ++c) {
        xj[c] = values(x + (size_t)min(column + c, COLUMNS - 1U) * a.vector_stride, j, a.n);
      }
#pragma unroll
      for (uint q = 0; q < STRIP; ++q) {
        const part fj = values(f + (size_t)min(row + q, last - 1) * a.row_stride, j, a.n);
#pragma unroll
        for (uint c = 0; c < CHUNK; ++c) {
          ADD(fj, xj[c], &sum[q][c]);
        }
      }
    }
    for (uint q = 0; q < STRIP; ++q) {
      for (uint c = 0; c < CHUNK; ++c) JOIN(lanes, &total[q][c], sum[q][c]);
    }
  }
  for (uint q = 0; q < STRIP; ++q) {
    for (uint c = 0; c < CHUNK; ++c) {
      const Pair all = of_group(of_lanes(total[q][c]), scratch);
      if (get_local_id(0) != 0 || row + q >= last || column + c >= COLUMNS) continue;
      const size_t at = (size_t)(column + c) * a.vector_stride + a.first + row + q;
      y[at] = all.hi;
      y[(size_t)COLUMNS * a.vector_stride + at] = all.lo;
    }
  }
}

kernel __attribute__((reqd_work_group_size(WORKGROUP, 1, 1))) void interflect_matvec_exact(
    global const float* f, global const float* x, global float* y, const MatvecArguments a) {
  local float scratch[2 * WORKGROUP];
  const uint first = (uint)get_group_id(0) * ROWS;
  const uint last = min(a.rows, first + ROWS);
  for (uint row = first; row < last; row += STRIP) {
    for (uint column = 0; column < COLUMNS; column += CHUNK) multiply(a, f, x, y, column, row, last, scratch);
  }
}
