// The heat map: time spent in each cell of a grid, from the positions of a span. Each position counts until the next
// one of the same tag, at most `longest` seconds: a tag that was away did not stay where it was last.

import { boundsOf, type Bounds } from './geometry.js';

export interface Heat {
  bounds: Bounds;
  cell: number;
  columns: number;
  rows: number;
  /// Seconds, row by row from the lowest y.
  seconds: Float64Array;
  max: number;
}

/// A tag's positions in the order of their times (`t` in ms).
export type Track = readonly { t: number; x: number; y: number }[];

const MOST_CELLS = 40_000;

export function heatOf(tracks: Iterable<Track>, longest: number, wanted = 0.5): Heat | null {
  const all = [...tracks];
  const bounds = boundsOf(all.flat());
  if (bounds === null) return null;
  const width = bounds.max.x - bounds.min.x;
  const height = bounds.max.y - bounds.min.y;
  // Far outliers must not make a grid that fills the memory: the cells grow instead.
  let cell = wanted;
  while ((Math.floor(width / cell) + 1) * (Math.floor(height / cell) + 1) > MOST_CELLS) cell *= 2;
  const columns = Math.floor(width / cell) + 1;
  const rows = Math.floor(height / cell) + 1;
  const seconds = new Float64Array(columns * rows);
  for (const track of all) {
    for (let i = 0; i + 1 < track.length; i++) {
      const p = track[i];
      const column = Math.floor((p.x - bounds.min.x) / cell);
      const row = Math.floor((p.y - bounds.min.y) / cell);
      seconds[row * columns + column] += Math.min(Math.max((track[i + 1].t - p.t) / 1000, 0), longest);
    }
  }
  let max = 0;
  for (const s of seconds) max = Math.max(max, s);
  return { bounds, cell, columns, rows, seconds, max };
}
