// Tiles of halves: 8 rows x 16 columns, row-major, two fours of words (8 halves each) for each row.

const uint TILE_ROWS = 8u;
const uint TILE_WORDS = 16u;  // fours of words in a tile

// Eight halves as floats. unpackHalf2x16 is exact.
struct Eight {
  vec4 low, high;
};

Eight eight(uvec4 words) {
  return Eight(vec4(unpackHalf2x16(words.x), unpackHalf2x16(words.y)),
               vec4(unpackHalf2x16(words.z), unpackHalf2x16(words.w)));
}

float dot8(Eight p, Eight q) { return dot(p.low, q.low) + dot(p.high, q.high); }
