// S to F in place for one panel, and what the rows tell of it. Contract: kernels/README.md.
//
// A group takes ROWS rows; its work-items lie along the columns, WIDE neighbours each (one text for processors, where a group
// is one work-item, and GPUs). Memory traffic of a launch: 4 * rows * n bytes read and as many written; d from cache.

typedef struct {
  uint n, first, rows, row_stride, vector_stride;
} MatvecArguments;

#define ROWS 4U
#if WORKGROUP == 1
#define WIDE 16
typedef float16 part;
typedef int16 lanes_of_part;
#define LOAD(p) vload16(0, p)
#define STORE(v, p) vstore16(v, 0, p)
#else
#define WIDE 4
typedef float4 part;
typedef int4 lanes_of_part;
#define LOAD(p) vload4(0, p)
#define STORE(v, p) vstore4(v, 0, p)
#endif

/// What a work-item has seen of a row, or of one lane of it.
typedef struct {
  part low, high, count;
} Seen;

/// Of a row: least and largest d, and how many of its factors are not 0.
void report(const float* low, const float* high, const float* count, uint lanes, local float* scratch,
            global float* of_rows, uint stride) {
  const uint l = get_local_id(0);
  local float* lows = scratch;
  local float* highs = scratch + WORKGROUP;
  local float* counts = scratch + 2 * WORKGROUP;
  barrier(CLK_LOCAL_MEM_FENCE);  // the row before has been read
  float least = low[0], largest = high[0], all = count[0];
  for (uint k = 1; k < lanes; ++k) {
    least = fmin(least, low[k]);
    largest = fmax(largest, high[k]);
    all += count[k];
  }
  lows[l] = least;
  highs[l] = largest;
  counts[l] = all;
  for (uint width = WORKGROUP / 2; width > 0; width /= 2) {
    barrier(CLK_LOCAL_MEM_FENCE);  // the level before is there
    if (l < width) {
      lows[l] = fmin(lows[l], lows[l + width]);
      highs[l] = fmax(highs[l], highs[l + width]);
      counts[l] += counts[l + width];
    }
  }
  if (l == 0) {
    of_rows[0] = lows[0];
    of_rows[stride] = highs[0];
    of_rows[2 * (size_t)stride] = counts[0];
  }
}

kernel __attribute__((reqd_work_group_size(WORKGROUP, 1, 1))) void interflect_close_rows(
    global float* s, global const float* d, global const float* factor, global float* of_rows, const MatvecArguments a) {
  local float scratch[3 * WORKGROUP];
  const uint begin = (uint)get_group_id(0) * ROWS;
  const uint end = min(a.rows, begin + ROWS);
  for (uint r = begin; r < end; ++r) {
    global float* row = s + (size_t)r * a.row_stride;
    const float by = factor[a.first + r];
    Seen seen = {(part)FLT_MAX, (part)0.0f, (part)0.0f};
    uint j = get_local_id(0) * WIDE;
    for (; j + WIDE <= a.n; j += WORKGROUP * WIDE) {
      const part old = LOAD(row + j), dj = LOAD(d + j);
      const lanes_of_part there = old != (part)0.0f;
      seen.low = select(seen.low, fmin(seen.low, dj), there);
      seen.high = select(seen.high, fmax(seen.high, dj), there);
      seen.count += select((part)0.0f, (part)1.0f, there);
      STORE(old * (by * dj), row + j);
    }
    float low[WIDE], high[WIDE], count[WIDE];
    STORE(seen.low, low);
    STORE(seen.high, high);
    STORE(seen.count, count);
    for (uint k = 0; j + k < a.n; ++k) {  // the row's last part, which n cuts
      const float old = row[j + k], dj = d[j + k];
      if (old != 0.0f) {
        low[k] = fmin(low[k], dj);
        high[k] = fmax(high[k], dj);
        count[k] += 1.0f;
      }
      row[j + k] = old * (by * dj);
    }
    report(low, high, count, WIDE, scratch, of_rows + a.first + r, a.vector_stride);
  }
}
