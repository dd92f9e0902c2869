// Geometry of the map: metres (x right, y up) to pixels of the screen and of the plan, the scale of a plan from two
// clicks, the ellipse of a covariance, polygons. Pure functions; tests are in test/geometry.test.ts.

import type { PlanScale } from '../model.js';

export interface Point {
  x: number;
  y: number;
}

export interface Bounds {
  min: Point;
  max: Point;
}

/// What of the frame is on the screen: `centre` (metres) is in the middle of `width` by `height` pixels.
export interface View {
  centre: Point;
  pixelsPerMetre: number;
  width: number;
  height: number;
}

export function toScreen(view: View, p: Point): Point {
  return {
    x: view.width / 2 + (p.x - view.centre.x) * view.pixelsPerMetre,
    y: view.height / 2 - (p.y - view.centre.y) * view.pixelsPerMetre,
  };
}

export function toMetres(view: View, p: Point): Point {
  return {
    x: view.centre.x + (p.x - view.width / 2) / view.pixelsPerMetre,
    y: view.centre.y - (p.y - view.height / 2) / view.pixelsPerMetre,
  };
}

/// Zooms by `factor`; what is at `at` (pixels of the screen) stays there.
export function zoomed(view: View, factor: number, at: Point): View {
  const fixed = toMetres(view, at);
  const pixelsPerMetre = Math.min(2000, Math.max(0.2, view.pixelsPerMetre * factor));
  return {
    ...view,
    pixelsPerMetre,
    centre: {
      x: fixed.x - (at.x - view.width / 2) / pixelsPerMetre,
      y: fixed.y + (at.y - view.height / 2) / pixelsPerMetre,
    },
  };
}

/// The view that shows all of `bounds`, with a margin (pixels).
export function fitted(view: View, bounds: Bounds, margin: number): View {
  const width = Math.max(bounds.max.x - bounds.min.x, 1);
  const height = Math.max(bounds.max.y - bounds.min.y, 1);
  const inner = { x: Math.max(view.width - 2 * margin, 20), y: Math.max(view.height - 2 * margin, 20) };
  return {
    ...view,
    pixelsPerMetre: Math.min(inner.x / width, inner.y / height),
    centre: { x: (bounds.min.x + bounds.max.x) / 2, y: (bounds.min.y + bounds.max.y) / 2 },
  };
}

export function boundsOf(points: Iterable<Point>): Bounds | null {
  const min = { x: Infinity, y: Infinity };
  const max = { x: -Infinity, y: -Infinity };
  for (const p of points) {
    if (!Number.isFinite(p.x) || !Number.isFinite(p.y)) continue;
    min.x = Math.min(min.x, p.x);
    min.y = Math.min(min.y, p.y);
    max.x = Math.max(max.x, p.x);
    max.y = Math.max(max.y, p.y);
  }
  return min.x <= max.x ? { min, max } : null;
}

/// A point of the plan's picture (pixels from the upper left corner, v down) to metres.
export function planToMetres(plan: PlanScale, p: Point): Point {
  const cos = Math.cos(plan.rotation_rad) * plan.metres_per_pixel;
  const sin = Math.sin(plan.rotation_rad) * plan.metres_per_pixel;
  return { x: plan.origin_m[0] + cos * p.x + sin * p.y, y: plan.origin_m[1] + sin * p.x - cos * p.y };
}

/// The inverse of `planToMetres`.
export function metresToPlan(plan: PlanScale, p: Point): Point {
  const cos = Math.cos(plan.rotation_rad) / plan.metres_per_pixel;
  const sin = Math.sin(plan.rotation_rad) / plan.metres_per_pixel;
  const dx = p.x - plan.origin_m[0];
  const dy = p.y - plan.origin_m[1];
  return { x: cos * dx + sin * dy, y: sin * dx - cos * dy };
}

/// Metres per pixel, from two points of the picture and their distance in metres; null where that says nothing.
export function scaleFromTwoPoints(a: Point, b: Point, distanceM: number): number | null {
  const pixels = Math.hypot(b.x - a.x, b.y - a.y);
  const scale = distanceM / pixels;
  return pixels >= 1 && Number.isFinite(scale) && scale > 0 ? scale : null;
}

/// The origin (place of the upper left corner) that puts the picture's point `p` at `at`.
export function originFor(scale: PlanScale, p: Point, at: Point): [number, number] {
  const relative = planToMetres({ ...scale, origin_m: [0, 0] }, p);
  return [at.x - relative.x, at.y - relative.y];
}

export interface Ellipse {
  /// The greater and the smaller semi-axis, metres.
  major: number;
  minor: number;
  /// Of the major axis, anticlockwise from x.
  angle: number;
}

/// The ellipse of `k` standard deviations of a covariance: semi-axes are k times the roots of its eigenvalues.
export function ellipse(sigmaX: number, sigmaY: number, cov: number, k = 2): Ellipse {
  const a = sigmaX * sigmaX;
  const c = sigmaY * sigmaY;
  const mean = (a + c) / 2;
  const root = Math.hypot((a - c) / 2, cov);
  return {
    major: k * Math.sqrt(mean + root),
    minor: k * Math.sqrt(Math.max(mean - root, 0)),
    angle: Math.atan2(2 * cov, a - c) / 2,
  };
}

export function inPolygon(corners: readonly (readonly [number, number])[], p: Point): boolean {
  let inside = false;
  for (let i = 0, j = corners.length - 1; i < corners.length; j = i++) {
    const [xi, yi] = corners[i];
    const [xj, yj] = corners[j];
    if (yi > p.y !== yj > p.y && p.x < ((xj - xi) * (p.y - yi)) / (yj - yi) + xi) inside = !inside;
  }
  return inside;
}

/// Twice the signed area of a polygon, m²: positive when its corners go anticlockwise.
export function doubleArea(corners: readonly (readonly [number, number])[]): number {
  let sum = 0;
  for (let i = 0, j = corners.length - 1; i < corners.length; j = i++) {
    sum += corners[j][0] * corners[i][1] - corners[i][0] * corners[j][1];
  }
  return sum;
}

/// The middle of a polygon: its centroid, or the mean of its corners where it has no area.
export function middle(corners: readonly (readonly [number, number])[]): Point {
  const area = doubleArea(corners);
  let x = 0;
  let y = 0;
  if (Math.abs(area) < 1e-9) {
    for (const c of corners) {
      x += c[0] / corners.length;
      y += c[1] / corners.length;
    }
    return { x, y };
  }
  for (let i = 0, j = corners.length - 1; i < corners.length; j = i++) {
    const cross = corners[j][0] * corners[i][1] - corners[i][0] * corners[j][1];
    x += ((corners[j][0] + corners[i][0]) * cross) / (3 * area);
    y += ((corners[j][1] + corners[i][1]) * cross) / (3 * area);
  }
  return { x, y };
}

/// A length of 1, 2 or 5 times a power of ten, of at most `pixels` on the screen: for the scale bar and the grid.
export function roundLength(pixelsPerMetre: number, pixels: number): number {
  const most = pixels / pixelsPerMetre;
  const power = 10 ** Math.floor(Math.log10(most));
  for (const step of [5, 2, 1]) if (step * power <= most) return step * power;
  return power;
}
