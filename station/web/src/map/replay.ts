// The past on the map: positions of a span, and where each tag was at a time of it. Between two positions that are
// close in time the tag moves in a straight line; where a tag was away for longer, it is not shown.

import type { TagPosition } from '../model.js';
import type { Track } from './heat.js';
import { type Mark, type Marks, otherPlace } from './motion.js';

interface Row {
  t: number;
  x: number;
  y: number;
  position: TagPosition;
}

const TRAIL_ROWS = 60;

export class Replay implements Marks {
  readonly tracks = new Map<string, Row[]>();
  readonly rows: number;
  /// The time that is shown, ms.
  time: number;
  private playing = false;

  constructor(
    positions: readonly TagPosition[],
    readonly from: number,
    readonly to: number,
    /// A tag without positions for this time is away, ms.
    readonly away: number,
    private readonly nameOf: (tag: string) => string,
  ) {
    this.time = from;
    this.rows = positions.length;
    for (const position of positions) {
      const track = this.tracks.get(position.tag) ?? [];
      this.tracks.set(position.tag, track);
      track.push({ t: Date.parse(position.t), x: position.x_m, y: position.y_m, position });
    }
    for (const track of this.tracks.values()) track.sort((a, b) => a.t - b.t);
  }

  track(tag: string): Track {
    return this.tracks.get(tag) ?? [];
  }

  set play(is: boolean) {
    this.playing = is;
  }

  *at(): Iterable<Mark> {
    for (const [id, track] of this.tracks) {
      const i = lastBefore(track, this.time);
      if (i < 0) continue;
      const row = track[i];
      const next = track[i + 1];
      const near = next !== undefined && next.t - row.t <= this.away;
      if (!near && this.time - row.t > this.away) continue;
      const share = near ? (this.time - row.t) / (next.t - row.t) : 0;
      yield {
        id,
        label: this.nameOf(id),
        x: near ? row.x + (next.x - row.x) * share : row.x,
        y: near ? row.y + (next.y - row.y) * share : row.y,
        sigmaX: row.position.sigma_x_m,
        sigmaY: row.position.sigma_y_m,
        cov: row.position.cov_xy_m2,
        other: otherPlace(row.position),
        faded: false,
      };
    }
  }

  moving(): boolean {
    return this.playing;
  }

  trails(line: (id: string, points: readonly { x: number; y: number }[]) => void): void {
    for (const [id, track] of this.tracks) {
      const end = lastBefore(track, this.time) + 1;
      if (end < 2 || this.time - track[end - 1].t > this.away) continue;
      line(id, track.slice(Math.max(0, end - TRAIL_ROWS), end));
    }
  }
}

/// The index of the last row at or before `t`, -1 without one.
export function lastBefore(track: readonly { t: number }[], t: number): number {
  let low = 0;
  let high = track.length;
  while (low < high) {
    const mid = (low + high) >> 1;
    if (track[mid].t <= t) low = mid + 1;
    else high = mid;
  }
  return low - 1;
}
