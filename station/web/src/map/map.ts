// The map: three canvases above each other (what rarely changes; trails; tags), moved and zoomed by mouse, fingers and
// keys. In: the scene and its marks; out: clicks of a person, to the tool in use or to `onPick`.

import type { Node, Plan, Wall, Zone } from '../model.js';
import { h } from '../dom.js';
import { boundsOf, fitted, planToMetres, toMetres, toScreen, zoomed, type Point, type View } from './geometry.js';
import * as draw from './draw.js';
import type { Heat } from './heat.js';
import type { Mark, Marks } from './motion.js';

export interface Scene {
  plan: Plan | null;
  picture: CanvasImageSource | null;
  walls: readonly Wall[];
  zones: readonly Zone[];
  nodes: readonly Node[];
  heat: Heat | null;
}

export interface Layers {
  plan: boolean;
  zones: boolean;
  nodes: boolean;
  names: boolean;
  ellipses: boolean;
  trails: boolean;
}

/// What takes the clicks on the map while it is in use. Points are metres.
export interface Tool {
  click(at: Point): void;
  back?(): void;
  /// Takes hold of something within `tolerance` metres.
  grab?(at: Point, tolerance: number): boolean;
  drag?(to: Point): void;
  draw(g: CanvasRenderingContext2D, view: View, palette: draw.Palette): void;
}

/// Trails are drawn again after this time for each hundred tags, at least.
const TRAILS_EVERY_MS = 100;
const NAMES_EVERY_MS = 250;

export class MapView {
  readonly element: HTMLElement;
  readonly scene: Scene = { plan: null, picture: null, walls: [], zones: [], nodes: [], heat: null };
  readonly layers: Layers = { plan: true, zones: true, nodes: true, names: true, ellipses: true, trails: true };
  /// A plan that is being placed and is not saved yet: it is shown instead of the scene's.
  preview: { plan: Plan; picture: CanvasImageSource | null } | null = null;
  onPick: (tag: string) => void = () => {};
  selected: string | null = null;
  private marks: Marks | null = null;
  private tool: Tool | null = null;
  private view: View = { centre: { x: 0, y: 0 }, pixelsPerMetre: 40, width: 1, height: 1 };
  private ratio = 1;
  private palette: draw.Palette;
  private heatPicture: HTMLCanvasElement | null = null;
  private readonly names = new draw.Names();
  private readonly stamps = new draw.Stamps();
  private fit: ReadonlySet<string> = new Set();
  private fitAt = 0;
  private trailsAt = 0;
  private trailsWait = TRAILS_EVERY_MS;
  private stale = { base: true, trails: true, marks: true };
  private frame = 0;
  private wantFit = true;
  private readonly pointers = new Map<number, Point>();
  private pressed: { at: Point; moved: boolean; grabbed: boolean } | null = null;
  private readonly base = h('canvas');
  private readonly trails = h('canvas');
  private readonly top = h('canvas');

  constructor() {
    for (const canvas of [this.base, this.trails, this.top]) canvas.setAttribute('aria-hidden', 'true');
    this.element = h(
      'div',
      { class: 'map', label: 'map.help', attributes: { tabindex: 0, role: 'application', id: 'map' } },
      this.base,
      this.trails,
      this.top,
    );
    this.palette = draw.paletteOf(document.documentElement);
    new ResizeObserver(() => this.resize()).observe(this.element);
    this.element.addEventListener('pointerdown', (e) => this.down(e));
    this.element.addEventListener('pointermove', (e) => this.move(e));
    this.element.addEventListener('pointerup', (e) => this.up(e));
    this.element.addEventListener('pointercancel', (e) => this.up(e));
    this.element.addEventListener('wheel', (e) => this.wheel(e), { passive: false });
    this.element.addEventListener('keydown', (e) => this.key(e));
  }

  /// Draws again: all, or the tags alone.
  redraw(what: 'all' | 'trails' | 'marks' = 'all'): void {
    if (what === 'all') this.stale.base = true;
    if (what !== 'marks') this.stale.trails = true;
    this.stale.marks = true;
    if (this.frame === 0) this.frame = requestAnimationFrame((now) => this.paint(now));
  }

  setMarks(marks: Marks): void {
    this.marks = marks;
    this.redraw();
  }

  setHeat(heat: Heat | null): void {
    this.scene.heat = heat;
    this.heatPicture = heat === null ? null : draw.heatPicture(heat);
    this.redraw();
  }

  setTool(tool: Tool | null): void {
    this.tool = tool;
    this.element.classList.toggle('tool', tool !== null);
    this.redraw();
  }

  isTool(tool: Tool): boolean {
    return this.tool === tool;
  }

  /// Reads the colours again, after a change of the appearance.
  restyle(): void {
    this.palette = draw.paletteOf(document.documentElement);
    this.names.clear();
    this.stamps.clear();
    this.redraw();
  }

  /// The plan that is shown.
  get plan(): Plan | null {
    return this.preview?.plan ?? this.scene.plan;
  }

  get dark(): boolean {
    return this.palette.dark;
  }

  centreOn(p: Point): void {
    this.view = { ...this.view, centre: { x: p.x, y: p.y }, pixelsPerMetre: Math.max(this.view.pixelsPerMetre, 20) };
    this.redraw();
  }

  zoom(factor: number): void {
    this.setView(zoomed(this.view, factor, { x: this.view.width / 2, y: this.view.height / 2 }));
  }

  /// All that has a place.
  bounds() {
    const points: Point[] = [];
    const { walls, zones, nodes } = this.scene;
    const plan = this.plan;
    if (plan !== null) {
      for (const x of [0, plan.width_px])
        for (const y of [0, plan.height_px]) points.push(planToMetres(plan, { x, y }));
    }
    for (const wall of walls) for (const [x, y] of wall) points.push({ x, y });
    for (const zone of zones) for (const [x, y] of zone.corners_m) points.push({ x, y });
    for (const node of nodes)
      if (node.position_m !== null) points.push({ x: node.position_m[0], y: node.position_m[1] });
    return boundsOf(points);
  }

  showAll(): void {
    const marks = [...(this.marks?.at(performance.now()) ?? [])];
    const bounds = this.bounds() ?? boundsOf(marks);
    // Without a place to show, the first thing that has one is shown when it comes.
    this.wantFit = bounds === null || this.view.width < 2;
    if (bounds !== null) this.setView(fitted(this.view, bounds, 36));
  }

  /// Shows all if nothing was there to show before.
  showFirst(): void {
    if (this.wantFit) this.showAll();
  }

  /// For another site.
  forget(): void {
    this.wantFit = true;
  }

  /// Pixels of the screen, within the map, of a point in metres.
  screenOf(p: Point): Point {
    return toScreen(this.view, p);
  }

  private setView(view: View): void {
    this.view = view;
    this.redraw();
  }

  private resize(): void {
    const box = this.element.getBoundingClientRect();
    if (box.width < 1 || box.height < 1) return;
    this.ratio = Math.min(window.devicePixelRatio || 1, 2);
    for (const canvas of [this.base, this.trails, this.top]) {
      canvas.width = Math.round(box.width * this.ratio);
      canvas.height = Math.round(box.height * this.ratio);
    }
    this.view = { ...this.view, width: box.width, height: box.height };
    if (this.wantFit) this.showAll();
    // A canvas whose size changes is empty: it is painted in the same frame, so that nothing flickers.
    this.stale = { base: true, trails: true, marks: true };
    cancelAnimationFrame(this.frame);
    this.paint(performance.now());
  }

  private clean(canvas: HTMLCanvasElement): CanvasRenderingContext2D | null {
    const g = canvas.getContext('2d');
    if (g === null) return null;
    g.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    g.clearRect(0, 0, this.view.width, this.view.height);
    return g;
  }

  private paint(now: number): void {
    this.frame = 0;
    const moving = this.marks?.moving(now) ?? false;
    if (this.stale.base) this.paintBase();
    if (this.layers.trails && moving && now - this.trailsAt >= this.trailsWait) this.stale.trails = true;
    if (this.stale.trails) {
      this.paintTrails();
      this.trailsAt = now;
    }
    if (this.stale.marks || moving) this.paintMarks(now);
    this.stale = { base: false, trails: false, marks: false };
    if (moving) this.redraw('marks');
  }

  private paintBase(): void {
    const g = this.clean(this.base);
    if (g === null) return;
    const { view, scene, palette, layers } = this;
    draw.drawGround(g, view, palette);
    const picture = this.preview?.picture ?? scene.picture;
    if (layers.plan && this.plan !== null && picture !== null) draw.drawPlan(g, view, this.plan, picture, palette.dark);
    if (scene.heat !== null && this.heatPicture !== null) draw.drawHeat(g, view, scene.heat, this.heatPicture);
    if (layers.zones) draw.drawZones(g, view, scene.zones, palette);
    if (layers.plan) draw.drawWalls(g, view, scene.walls, palette);
    if (layers.nodes) draw.drawNodes(g, view, scene.nodes, palette, layers.names);
    draw.drawScaleBar(g, view, palette);
  }

  private paintTrails(): void {
    const g = this.clean(this.trails);
    if (g === null || !this.layers.trails) return;
    let count = 0;
    this.marks?.trails((id, points) => {
      count++;
      const wide = id === this.selected;
      draw.drawTrail(g, this.view, points, draw.colourOf(id, this.palette.dark, wide ? 0.9 : 0.4), wide);
    });
    this.trailsWait = TRAILS_EVERY_MS * Math.max(1, count / 100);
  }

  private paintMarks(now: number): void {
    const g = this.clean(this.top);
    if (g === null) return;
    const marks: Mark[] = [...(this.marks?.at(now) ?? [])];
    if (this.layers.names && (now - this.fitAt >= NAMES_EVERY_MS || !this.marks?.moving(now))) {
      this.fit = draw.namesThatFit(marks, this.view, this.selected);
      this.fitAt = now;
    }
    const style = { ellipses: this.layers.ellipses, names: this.layers.names, selected: this.selected };
    draw.drawMarks(g, this.view, marks, this.fit, this.names, this.stamps, style, this.palette, this.ratio);
    if (this.tool === null) return;
    this.tool.draw(g, this.view, this.palette);
    if (document.activeElement === this.element) this.drawCross(g);
  }

  /// Where Enter puts a point.
  private drawCross(g: CanvasRenderingContext2D): void {
    const x = this.view.width / 2;
    const y = this.view.height / 2;
    g.strokeStyle = this.palette.accent;
    g.lineWidth = 1.5;
    g.beginPath();
    g.moveTo(x - 10, y);
    g.lineTo(x + 10, y);
    g.moveTo(x, y - 10);
    g.lineTo(x, y + 10);
    g.stroke();
  }

  private at(event: MouseEvent): Point {
    const box = this.element.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  private down(event: PointerEvent): void {
    if (event.button !== 0) return;
    const at = this.at(event);
    this.element.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, at);
    const grabbed = this.tool?.grab?.(toMetres(this.view, at), 12 / this.view.pixelsPerMetre) ?? false;
    this.pressed = { at, moved: this.pointers.size > 1, grabbed };
  }

  private move(event: PointerEvent): void {
    const before = this.pointers.get(event.pointerId);
    if (before === undefined || this.pressed === null) return;
    const at = this.at(event);
    if (Math.hypot(at.x - this.pressed.at.x, at.y - this.pressed.at.y) > 5) this.pressed.moved = true;
    if (!this.pressed.moved) return;
    if (this.pressed.grabbed) {
      this.tool?.drag?.(toMetres(this.view, at));
      this.redraw('marks');
    } else if (this.pointers.size === 2) {
      const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1] ?? before;
      const factor = Math.hypot(at.x - other.x, at.y - other.y) / Math.hypot(before.x - other.x, before.y - other.y);
      if (Number.isFinite(factor) && factor > 0) {
        this.setView(zoomed(this.view, factor, { x: (at.x + other.x) / 2, y: (at.y + other.y) / 2 }));
      }
    } else {
      this.pan(before.x - at.x, before.y - at.y);
    }
    this.pointers.set(event.pointerId, at);
  }

  private up(event: PointerEvent): void {
    if (!this.pointers.delete(event.pointerId) || this.pressed === null || this.pointers.size > 0) return;
    const { at, moved } = this.pressed;
    this.pressed = null;
    if (!moved && event.type === 'pointerup') this.click(at);
  }

  private click(at: Point): void {
    if (this.tool !== null) {
      this.tool.click(toMetres(this.view, at));
      this.redraw('marks');
      return;
    }
    let best: { id: string; distance: number } | null = null;
    for (const mark of this.marks?.at(performance.now()) ?? []) {
      const p = toScreen(this.view, mark);
      const distance = Math.hypot(p.x - at.x, p.y - at.y);
      if (distance < 16 && (best === null || distance < best.distance)) best = { id: mark.id, distance };
    }
    if (best !== null) this.onPick(best.id);
  }

  private pan(dx: number, dy: number): void {
    const { centre, pixelsPerMetre } = this.view;
    this.setView({ ...this.view, centre: { x: centre.x + dx / pixelsPerMetre, y: centre.y - dy / pixelsPerMetre } });
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
    this.setView(zoomed(this.view, Math.exp(-event.deltaY * lines * 0.0015), this.at(event)));
  }

  private key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const step = event.shiftKey ? 200 : 50;
    const actions: Record<string, () => void> = {
      ArrowLeft: () => this.pan(-step, 0),
      ArrowRight: () => this.pan(step, 0),
      ArrowUp: () => this.pan(0, -step),
      ArrowDown: () => this.pan(0, step),
      '+': () => this.zoom(1.3),
      '=': () => this.zoom(1.3),
      '-': () => this.zoom(1 / 1.3),
      '0': () => this.showAll(),
      Enter: () => this.click({ x: this.view.width / 2, y: this.view.height / 2 }),
      Backspace: () => this.tool?.back?.(),
    };
    const act = actions[event.key];
    if (act === undefined) return;
    event.preventDefault();
    act();
    this.redraw('marks');
  }
}
