// Where tags are drawn: between two positions a tag moves in a straight line, for as long as its positions are apart,
// so that ten positions a second look like sixty. In: positions with the time of their arrival; out: marks at a time.

import type { TagPosition } from '../model.js';

export interface Mark {
  id: string;
  label: string;
  x: number;
  y: number;
  sigmaX: number;
  sigmaY: number;
  cov: number;
  /// The other place that the ranges fit.
  other: { x: number; y: number } | null;
  faded: boolean;
}

/// What the map draws, live or from the past.
export interface Marks {
  at(now: number): Iterable<Mark>;
  /// Something is still on its way at `now`.
  moving(now: number): boolean;
  /// Calls `line` with the corners of each trail.
  trails(line: (id: string, points: readonly { x: number; y: number }[]) => void): void;
}

interface Moving extends Mark {
  fromX: number;
  fromY: number;
  toX: number;
  toY: number;
  start: number;
  length: number;
}

/// The other place of an ambiguous position.
export function otherPlace(position: TagPosition): Mark['other'] {
  if (position.doubt?.flag !== 'ambiguous') return null;
  const [x, y] = position.doubt.alternative_m;
  return { x, y };
}

const LONGEST_MS = 1000;

export class Motion {
  private readonly tags = new Map<string, Moving>();
  /// Until when something moves.
  private until = 0;
  smooth = true;

  clear(): void {
    this.tags.clear();
  }

  remove(id: string): void {
    this.tags.delete(id);
  }

  has(id: string): boolean {
    return this.tags.has(id);
  }

  ids(): Iterable<string> {
    return this.tags.keys();
  }

  style(id: string, label: string, faded: boolean): void {
    const tag = this.tags.get(id);
    if (tag === undefined) return;
    tag.label = label;
    tag.faded = faded;
  }

  move(position: TagPosition, label: string, now: number): void {
    const tag = this.tags.get(position.tag);
    const other = otherPlace(position);
    const shape = { sigmaX: position.sigma_x_m, sigmaY: position.sigma_y_m, cov: position.cov_xy_m2, other };
    const to = { toX: position.x_m, toY: position.y_m };
    if (tag === undefined) {
      const x = position.x_m;
      const y = position.y_m;
      const fresh = { fromX: x, fromY: y, ...to, x, y, start: now, length: 0, faded: false };
      this.tags.set(position.tag, { id: position.tag, label, ...shape, ...fresh });
      this.until = Math.max(this.until, now);
      return;
    }
    place(tag, now);
    const length = this.smooth ? Math.min(now - tag.start, LONGEST_MS) : 0;
    Object.assign(tag, shape, to, { fromX: tag.x, fromY: tag.y, start: now, length, label, faded: false });
    this.until = Math.max(this.until, now + length);
  }

  at(now: number): Iterable<Mark> {
    for (const tag of this.tags.values()) place(tag, now);
    return this.tags.values();
  }

  moving(now: number): boolean {
    return now <= this.until;
  }
}

function place(tag: Moving, now: number): void {
  const share = tag.length > 0 ? Math.min((now - tag.start) / tag.length, 1) : 1;
  tag.x = tag.fromX + (tag.toX - tag.fromX) * share;
  tag.y = tag.fromY + (tag.toY - tag.fromY) * share;
}
