// The end of the assembly: from tiles to rows of S.

/// An item is a pair: S_ij and S_ji, where their rows lie in the panel.
FUNCTION void tile_store_item(PANEL_PARAMETERS TILE_PARAMETERS uint pair) {
  const uint i = row_patch(TILE pair), j = column_patch(TILE pair);
  if (!(i < j && j < args.n)) return;
  const float s = float_in(TILE SECTION_S, pair);
  const uint row_i = i - args.panel_first, row_j = j - args.panel_first;  // wraps where it lies before
  if (row_i < args.panel_rows) PANEL_AT(row_i, j) = s;
  if (row_j < args.panel_rows) PANEL_AT(row_j, i) = s;
}
