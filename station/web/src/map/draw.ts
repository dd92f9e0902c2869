// What is drawn on the map's canvases: plan, walls, zones, heat, anchors below; trails; tags with ellipses and names on
// top. All take metres and a view, and draw in pixels of the screen.

import type { Node, Plan, Wall, Zone } from '../model.js';
import { ellipse, middle, planToMetres, roundLength, toMetres, toScreen, type Point, type View } from './geometry.js';
import type { Heat } from './heat.js';
import type { Mark } from './motion.js';

export interface Palette {
  dark: boolean;
  ground: string;
  grid: string;
  text: string;
  halo: string;
  wall: string;
  room: string;
  zone: string;
  alarm: string;
  good: string;
  warn: string;
  accent: string;
}

export function paletteOf(element: Element): Palette {
  const style = getComputedStyle(element);
  const of = (name: string) => style.getPropertyValue(name).trim();
  return {
    dark: of('--dark') === '1',
    ground: of('--map'),
    grid: of('--map-grid'),
    text: of('--text'),
    halo: of('--map'),
    wall: of('--map-wall'),
    room: of('--map-room'),
    zone: of('--map-zone'),
    alarm: of('--bad'),
    good: of('--good'),
    warn: of('--warn'),
    accent: of('--accent'),
  };
}

const HUES = [212, 24, 140, 280, 45, 335, 180, 95, 255, 5, 160, 305];

export function hueOf(id: string): number {
  let hash = 0;
  for (let i = 0; i < id.length; i++) hash = (hash * 31 + id.charCodeAt(i)) >>> 0;
  return HUES[hash % HUES.length];
}

const colours = new Map<string, string>();

export function colourOf(id: string, dark: boolean, alpha = 1): string {
  const key = `${hueOf(id)} ${dark} ${alpha}`;
  let colour = colours.get(key);
  if (colour === undefined) {
    colour = `hsl(${hueOf(id)} ${dark ? '80% 66%' : '75% 40%'} / ${alpha})`;
    colours.set(key, colour);
  }
  return colour;
}

type Context = CanvasRenderingContext2D;

export function drawGround(g: Context, view: View, palette: Palette): void {
  g.fillStyle = palette.ground;
  g.fillRect(0, 0, view.width, view.height);
  const step = roundLength(view.pixelsPerMetre, 120);
  const low = toMetres(view, { x: 0, y: view.height });
  const high = toMetres(view, { x: view.width, y: 0 });
  g.strokeStyle = palette.grid;
  g.lineWidth = 1;
  g.beginPath();
  for (let x = Math.ceil(low.x / step) * step; x <= high.x; x += step) {
    const s = Math.round(toScreen(view, { x, y: 0 }).x) + 0.5;
    g.moveTo(s, 0);
    g.lineTo(s, view.height);
  }
  for (let y = Math.ceil(low.y / step) * step; y <= high.y; y += step) {
    const s = Math.round(toScreen(view, { x: 0, y }).y) + 0.5;
    g.moveTo(0, s);
    g.lineTo(view.width, s);
  }
  g.stroke();
}

export function drawScaleBar(g: Context, view: View, palette: Palette): void {
  const length = roundLength(view.pixelsPerMetre, 140);
  const pixels = length * view.pixelsPerMetre;
  const y = view.height - 14;
  g.strokeStyle = palette.text;
  g.fillStyle = palette.text;
  g.lineWidth = 2;
  g.beginPath();
  g.moveTo(12, y - 5);
  g.lineTo(12, y);
  g.lineTo(12 + pixels, y);
  g.lineTo(12 + pixels, y - 5);
  g.stroke();
  g.font = FONT;
  g.textAlign = 'left';
  g.textBaseline = 'bottom';
  g.fillText(`${length} m`, 16, y - 3);
}

const FONT = '12px system-ui, sans-serif';

export function drawPlan(g: Context, view: View, plan: Plan, picture: CanvasImageSource, dark: boolean): void {
  const corner = toScreen(view, planToMetres(plan, { x: 0, y: 0 }));
  const scale = view.pixelsPerMetre * plan.metres_per_pixel;
  const cos = Math.cos(plan.rotation_rad) * scale;
  const sin = Math.sin(plan.rotation_rad) * scale;
  g.save();
  g.transform(cos, -sin, sin, cos, corner.x, corner.y);
  // A white plan would glare in the dark.
  g.globalAlpha = dark ? 0.35 : 0.9;
  g.imageSmoothingEnabled = scale < 2;
  g.drawImage(picture, 0, 0, plan.width_px, plan.height_px);
  g.restore();
}

export function drawWalls(g: Context, view: View, walls: readonly Wall[], palette: Palette): void {
  g.strokeStyle = palette.wall;
  g.lineWidth = 3;
  g.lineCap = 'round';
  g.beginPath();
  for (const [a, b] of walls) {
    const from = toScreen(view, { x: a[0], y: a[1] });
    const to = toScreen(view, { x: b[0], y: b[1] });
    g.moveTo(from.x, from.y);
    g.lineTo(to.x, to.y);
  }
  g.stroke();
}

export function outline(g: Context, view: View, corners: readonly (readonly [number, number])[], close: boolean): void {
  g.beginPath();
  corners.forEach((corner, i) => {
    const p = toScreen(view, { x: corner[0], y: corner[1] });
    if (i === 0) g.moveTo(p.x, p.y);
    else g.lineTo(p.x, p.y);
  });
  if (close) g.closePath();
}

export function drawZones(g: Context, view: View, zones: readonly Zone[], palette: Palette): void {
  // Rooms below zones.
  for (const kind of ['room', 'zone'] as const) {
    for (const zone of zones) {
      if (zone.kind !== kind || zone.corners_m.length < 3) continue;
      const colour = zone.alarm ? palette.alarm : kind === 'room' ? palette.room : palette.zone;
      outline(g, view, zone.corners_m, true);
      g.globalAlpha = 0.1;
      g.fillStyle = colour;
      g.fill();
      g.globalAlpha = 0.9;
      g.strokeStyle = colour;
      g.lineWidth = 1.5;
      g.setLineDash(kind === 'zone' ? [6, 4] : []);
      g.stroke();
      g.setLineDash([]);
      g.globalAlpha = 1;
      text(g, zone.name, toScreen(view, middle(zone.corners_m)), palette, 'center');
    }
  }
}

export function text(g: Context, what: string, at: Point, palette: Palette, align: CanvasTextAlign): void {
  g.font = FONT;
  g.textAlign = align;
  g.textBaseline = 'middle';
  g.lineJoin = 'round';
  g.lineWidth = 3;
  g.strokeStyle = palette.halo;
  g.strokeText(what, at.x, at.y);
  g.fillStyle = palette.text;
  g.fillText(what, at.x, at.y);
}

/// The state of a node: what the table of anchors says and the map colours.
export type NodeState = 'good' | 'moved' | 'unseen' | 'weak' | 'nlos';

export function stateOf(node: Node): NodeState {
  if (node.moved) return 'moved';
  if (node.last_seen === null) return 'unseen';
  if (node.success_rate !== null && node.success_rate < 0.7) return 'weak';
  // Below −10 dB the first path is so much weaker than the whole that something stands in its way.
  if (node.first_path_minus_received_db !== null && node.first_path_minus_received_db < -10) return 'nlos';
  return 'good';
}

export function drawNodes(g: Context, view: View, nodes: readonly Node[], palette: Palette, names: boolean): void {
  for (const node of nodes) {
    if (node.position_m === null) continue;
    const p = toScreen(view, { x: node.position_m[0], y: node.position_m[1] });
    const state = stateOf(node);
    const colour =
      state === 'good'
        ? palette.good
        : state === 'moved'
          ? palette.alarm
          : state === 'unseen'
            ? palette.grid
            : palette.warn;
    g.fillStyle = colour;
    g.strokeStyle = palette.text;
    g.lineWidth = 1.5;
    g.beginPath();
    if (node.role === 'beacon') g.arc(p.x, p.y, 5, 0, 2 * Math.PI);
    else {
      g.moveTo(p.x, p.y - 7);
      g.lineTo(p.x + 7, p.y + 5);
      g.lineTo(p.x - 7, p.y + 5);
      g.closePath();
    }
    g.fill();
    g.stroke();
    if (state === 'moved') text(g, '?', { x: p.x, y: p.y - 15 }, palette, 'center');
    if (names) text(g, node.name ?? node.node, { x: p.x, y: p.y + 15 }, palette, 'center');
  }
}

/// The heat map's picture: a pixel a cell, the highest y first.
export function heatPicture(heat: Heat): HTMLCanvasElement {
  const canvas = document.createElement('canvas');
  canvas.width = heat.columns;
  canvas.height = heat.rows;
  const g = canvas.getContext('2d');
  if (g === null) return canvas;
  const image = g.createImageData(heat.columns, heat.rows);
  for (let row = 0; row < heat.rows; row++) {
    for (let column = 0; column < heat.columns; column++) {
      const seconds = heat.seconds[row * heat.columns + column];
      if (seconds <= 0) continue;
      // The root shows corridors beside places where tags stay for hours.
      const share = Math.sqrt(seconds / heat.max);
      const at = 4 * ((heat.rows - 1 - row) * heat.columns + column);
      image.data[at] = 255 - 75 * share;
      image.data[at + 1] = 200 * (1 - share);
      image.data[at + 2] = 40 * (1 - share) + 30;
      image.data[at + 3] = 40 + 180 * share;
    }
  }
  g.putImageData(image, 0, 0);
  return canvas;
}

export function drawHeat(g: Context, view: View, heat: Heat, picture: CanvasImageSource): void {
  const min = heat.bounds.min;
  const corner = toScreen(view, { x: min.x, y: min.y + heat.rows * heat.cell });
  const size = heat.cell * view.pixelsPerMetre;
  g.imageSmoothingEnabled = true;
  g.drawImage(picture, corner.x, corner.y, heat.columns * size, heat.rows * size);
}

export function drawTrail(g: Context, view: View, points: readonly Point[], colour: string, wide: boolean): void {
  if (points.length < 2) return;
  g.strokeStyle = colour;
  g.lineWidth = wide ? 3 : 1.5;
  g.lineJoin = 'round';
  g.beginPath();
  let last = { x: NaN, y: NaN };
  points.forEach((point, i) => {
    const p = toScreen(view, point);
    // Steps below two pixels cost time and show nothing.
    if (i > 0 && i < points.length - 1 && Math.abs(p.x - last.x) + Math.abs(p.y - last.y) < 2) return;
    if (i === 0) g.moveTo(p.x, p.y);
    else g.lineTo(p.x, p.y);
    last = p;
  });
  g.stroke();
}

export interface MarkStyle {
  ellipses: boolean;
  names: boolean;
  selected: string | null;
}

/// Names are drawn once each and then copied: text is the slowest thing on a canvas.
export class Names {
  private readonly made = new Map<string, { picture: HTMLCanvasElement; width: number; height: number }>();

  clear(): void {
    this.made.clear();
  }

  draw(g: Context, name: string, x: number, y: number, ratio: number, palette: Palette): void {
    const key = `${ratio} ${name}`;
    let label = this.made.get(key);
    if (label === undefined) {
      if (this.made.size > 2000) this.made.clear();
      const picture = document.createElement('canvas');
      const own = picture.getContext('2d');
      if (own === null) return;
      own.font = FONT;
      const width = Math.ceil(own.measureText(name).width) + 8;
      const height = 18;
      picture.width = width * ratio;
      picture.height = height * ratio;
      own.scale(ratio, ratio);
      text(own, name, { x: 4, y: height / 2 }, palette, 'left');
      label = { picture, width, height };
      this.made.set(key, label);
    }
    g.drawImage(label.picture, Math.round(x), Math.round(y), label.width, label.height);
  }
}

/// Which names fit: the selected one first, then each that does not cover one before it. A grid of cells stands for the
/// screen, so that 500 names take no time.
export function namesThatFit(marks: readonly Mark[], view: View, selected: string | null): Set<string> {
  const taken = new Set<number>();
  const fit = new Set<string>();
  const place = (mark: Mark) => {
    const p = toScreen(view, mark);
    if (p.x < 0 || p.y < 0 || p.x > view.width || p.y > view.height) return;
    const cells: number[] = [];
    // A name is 18 pixels high, and about 7 wide a letter.
    for (const y of [p.y - 8, p.y + 8]) {
      for (let x = p.x; x < p.x + mark.label.length * 7 + 16; x += 16) {
        cells.push(Math.floor(y / 16) * 10_000 + Math.floor(x / 16));
      }
    }
    if (mark.id !== selected && cells.some((cell) => taken.has(cell))) return;
    for (const cell of cells) taken.add(cell);
    fit.add(mark.id);
  };
  for (const mark of marks) if (mark.id === selected) place(mark);
  for (const mark of marks) if (mark.id !== selected) place(mark);
  return fit;
}

/// With more tags than this, a tag's dot and ellipse are a stamp: drawn once and then copied at whole pixels. Without a
/// graphics processor, 500 paths take longer than a frame, and 500 copies that are stretched and turned do as well.
const MANY = 50;
/// Ellipses with a longer axis than this, pixels, are drawn each time: they would take much memory, and are few.
const LONGEST = 40;
/// Stamps are turned by this part of half a turn.
const TURNS = 16;
const MOST_STAMPS = 3000;
const DOT = 4.5;
const SELECTED_DOT = 7;

/// An ellipse of a stamp in pixels, and its turn in steps.
interface Shape {
  major: number;
  minor: number;
  turn: number;
}

/// A stamp's axis: to one pixel, a long one to two.
function rounded(axis: number): number {
  return axis < 12 ? Math.round(axis) : 2 * Math.round(axis / 2);
}

/// Dots with ellipses, each in a picture of its own.
export class Stamps {
  private readonly made = new Map<string, HTMLCanvasElement>();

  clear(): void {
    this.made.clear();
  }

  draw(g: Context, at: Point, mark: Mark, shape: Shape | null, dark: boolean, ratio: number): void {
    const { major, minor, turn } = shape ?? { major: 0, minor: 0, turn: 0 };
    const key = `${hueOf(mark.id)} ${mark.faded} ${major} ${minor} ${turn} ${ratio} ${dark}`;
    const half = Math.max(major, Math.ceil(DOT)) + 1;
    let picture = this.made.get(key);
    if (picture === undefined) {
      if (this.made.size >= MOST_STAMPS) this.made.clear();
      picture = document.createElement('canvas');
      picture.width = Math.ceil(2 * half * ratio);
      picture.height = picture.width;
      const own = picture.getContext('2d');
      if (own === null) return;
      own.scale(ratio, ratio);
      own.translate(half, half);
      if (shape !== null) {
        own.beginPath();
        own.ellipse(0, 0, major, Math.max(minor, 0.5), (-turn * Math.PI) / TURNS, 0, 2 * Math.PI);
        paintEllipse(own, mark, dark);
      }
      paintDot(own, { x: 0, y: 0 }, mark, dark, DOT);
      this.made.set(key, picture);
    }
    const x = Math.round((at.x - half) * ratio) / ratio;
    const y = Math.round((at.y - half) * ratio) / ratio;
    g.drawImage(picture, x, y, picture.width / ratio, picture.height / ratio);
  }
}

function paintEllipse(g: Context, mark: Mark, dark: boolean): void {
  g.fillStyle = colourOf(mark.id, dark, mark.faded ? 0.06 : 0.15);
  g.fill();
  g.strokeStyle = colourOf(mark.id, dark, mark.faded ? 0.25 : 0.55);
  g.lineWidth = 1;
  g.stroke();
}

function paintDot(g: Context, at: Point, mark: Mark, dark: boolean, radius: number): void {
  g.beginPath();
  g.arc(at.x, at.y, radius, 0, 2 * Math.PI);
  g.fillStyle = colourOf(mark.id, dark, mark.faded ? 0.4 : 1);
  g.fill();
}

/// A dashed ring where the tag may be instead, and a dashed line to it.
function paintOther(g: Context, at: Point, other: Point, mark: Mark, dark: boolean): void {
  g.setLineDash([4, 4]);
  g.strokeStyle = colourOf(mark.id, dark, mark.faded ? 0.4 : 1);
  g.lineWidth = 1.5;
  g.beginPath();
  g.moveTo(at.x, at.y);
  g.lineTo(other.x, other.y);
  g.stroke();
  g.beginPath();
  g.arc(other.x, other.y, SELECTED_DOT, 0, 2 * Math.PI);
  g.stroke();
  g.setLineDash([]);
}

export function drawMarks(
  g: Context,
  view: View,
  marks: readonly Mark[],
  fit: ReadonlySet<string>,
  names: Names,
  stamps: Stamps,
  style: MarkStyle,
  palette: Palette,
  ratio: number,
): void {
  const { dark } = palette;
  for (const mark of marks) {
    const p = toScreen(view, mark);
    if (p.x < -200 || p.y < -200 || p.x > view.width + 200 || p.y > view.height + 200) continue;
    const selected = mark.id === style.selected;
    if (mark.other !== null) paintOther(g, p, toScreen(view, mark.other), mark, dark);
    const e = ellipse(mark.sigmaX, mark.sigmaY, mark.cov);
    const major = e.major * view.pixelsPerMetre;
    const minor = e.minor * view.pixelsPerMetre;
    // Not one that is smaller than the dot of its tag, or no number.
    const hasEllipse = style.ellipses && major >= 3 && Number.isFinite(major);
    if (marks.length > MANY && !selected && !(hasEllipse && major > LONGEST)) {
      const turn = (Math.round((e.angle * TURNS) / Math.PI) + TURNS) % TURNS;
      const shape = hasEllipse ? { major: rounded(major), minor: rounded(minor), turn } : null;
      stamps.draw(g, p, mark, shape, dark, ratio);
      continue;
    }
    if (hasEllipse) {
      g.beginPath();
      // The screen's y goes down, so that the angle turns round.
      g.ellipse(p.x, p.y, major, minor, -e.angle, 0, 2 * Math.PI);
      paintEllipse(g, mark, dark);
    }
    paintDot(g, p, mark, dark, selected ? SELECTED_DOT : DOT);
    if (selected) {
      g.strokeStyle = palette.text;
      g.lineWidth = 2;
      g.stroke();
    }
  }
  if (!style.names) return;
  for (const mark of marks) {
    if (!fit.has(mark.id)) continue;
    const p = toScreen(view, mark);
    names.draw(g, mark.label, p.x + 7, p.y - 9, ratio, palette);
  }
}
