// The plan: a picture of the floor, its scale from two clicks and their distance, its place from a known point; walls;
// the geographic origin.

import { attempt, type App, type Panel } from '../app.js';
import { api } from '../api.js';
import { button, empty, field, h, setText } from '../dom.js';
import { number, t } from '../i18n.js';
import { toScreen, metresToPlan, originFor, planToMetres, scaleFromTwoPoints, type Point } from '../map/geometry.js';
import { drawWalls } from '../map/draw.js';
import type { Tool } from '../map/map.js';
import type { Plan, Wall } from '../model.js';
import { originEditor } from './origin.js';

/// How wide a picture is before anybody has said it, metres.
const FIRST_WIDTH_M = 20;

export function planPanel(app: App): Panel {
  const { store, map } = app;
  /// A picture that was chosen and is not saved yet.
  let picture: { blob: Blob; image: HTMLImageElement } | null = null;
  let plan: Plan | null = null;
  /// Clicked points, in pixels of the picture: they stay on it when its scale changes.
  let points: Point[] = [];
  let wanted = 0;
  let walls: Wall[] = [];
  let end: [number, number] | null = null;

  const none = empty('plan.none');
  const file = h('input', {
    attributes: { type: 'file', accept: 'image/png,image/jpeg,image/webp', id: 'plan-file' },
    on: { change: () => void choose() },
  });
  const about = h('p', { class: 'help', attributes: { id: 'plan-about' } });
  const step = h('p', { class: 'step', attributes: { role: 'status' } });
  const metres = (id: string, value = '') =>
    h('input', { attributes: { id, type: 'number', step: 'any', inputmode: 'decimal', value } });
  const distance = metres('plan-distance');
  const originX = metres('plan-x', '0');
  const originY = metres('plan-y', '0');
  const rotation = metres('plan-rotation', '0');
  rotation.addEventListener('change', () => turn());
  const scaleForm = h(
    'div',
    { class: 'form', attributes: { hidden: true } },
    field('plan.distance', distance),
    button('plan.apply', () => applyScale(), 'primary'),
  );
  const originForm = h(
    'div',
    { class: 'form', attributes: { hidden: true } },
    field('plan.originx', originX),
    field('plan.originy', originY),
    button('plan.place', () => applyOrigin(), 'primary'),
  );
  const save = button('plan.save', () => void savePlan(), 'primary');
  const cancel = button('cancel', () => revert());
  const edit = h(
    'div',
    {},
    about,
    h(
      'div',
      { class: 'buttons' },
      button('plan.scale', () => pick(2)),
      button('plan.origin', () => pick(1)),
    ),
    step,
    scaleForm,
    originForm,
    field('plan.rotation', rotation),
    h('div', { class: 'buttons' }, save, cancel),
  );
  const wallCount = h('p');
  const wallHelp = h('p', { t: 'plan.walls.help', class: 'help' });
  const wallSave = button('plan.walls.save', () => void saveWalls(), 'primary');
  const wallDraw = button('plan.walls.draw', () => startWalls());
  const wallEdit = h(
    'div',
    { attributes: { hidden: true } },
    wallHelp,
    h(
      'div',
      { class: 'buttons' },
      button('plan.walls.break', () => {
        end = null;
        map.redraw('marks');
      }),
      button('plan.walls.undo', () => wallTool.back?.()),
      wallSave,
      button('cancel', () => stopWalls()),
    ),
  );
  const origin = originEditor(app);
  const element = h(
    'div',
    {},
    h('h3', { t: 'plan.picture' }),
    none,
    field('plan.choose', file),
    edit,
    h('h3', { t: 'plan.walls' }),
    wallCount,
    h('div', { class: 'buttons' }, wallDraw),
    wallEdit,
    origin.element,
  );

  const pickTool: Tool = {
    click(at) {
      if (plan === null) return;
      if (points.length >= wanted) points = [];
      points.push(metresToPlan(plan, at));
      tell();
    },
    back() {
      points.pop();
      tell();
    },
    draw(g, view, palette) {
      if (plan === null) return;
      g.strokeStyle = palette.accent;
      g.lineWidth = 2;
      const on = points.map((p) => toScreen(view, planToMetres(plan as Plan, p)));
      g.beginPath();
      on.forEach((p, i) => (i === 0 ? g.moveTo(p.x, p.y) : g.lineTo(p.x, p.y)));
      g.stroke();
      for (const p of on) {
        g.beginPath();
        g.arc(p.x, p.y, 7, 0, 2 * Math.PI);
        g.moveTo(p.x - 11, p.y);
        g.lineTo(p.x + 11, p.y);
        g.moveTo(p.x, p.y - 11);
        g.lineTo(p.x, p.y + 11);
        g.stroke();
      }
    },
  };

  const wallTool: Tool = {
    click(at) {
      const next: [number, number] = [round(at.x), round(at.y)];
      if (end !== null) walls.push([end, next]);
      end = next;
      update();
    },
    back() {
      const last = walls.pop();
      end = last === undefined ? null : last[0];
      update();
      map.redraw('marks');
    },
    draw(g, view, palette) {
      drawWalls(g, view, walls, { ...palette, wall: palette.accent });
      if (end === null) return;
      const p = toScreen(view, { x: end[0], y: end[1] });
      g.fillStyle = palette.accent;
      g.beginPath();
      g.arc(p.x, p.y, 5, 0, 2 * Math.PI);
      g.fill();
    },
  };

  async function choose(): Promise<void> {
    const chosen = file.files?.[0];
    if (chosen === undefined) return;
    const image = new Image();
    const url = URL.createObjectURL(chosen);
    image.src = url;
    try {
      await image.decode();
    } catch {
      URL.revokeObjectURL(url);
      app.toasts.show(t('plan.nopicture'), 'bad');
      return;
    }
    picture = { blob: chosen, image };
    const scale = plan?.metres_per_pixel ?? FIRST_WIDTH_M / image.naturalWidth;
    plan = {
      origin_m: plan?.origin_m ?? [0, image.naturalHeight * scale],
      metres_per_pixel: scale,
      rotation_rad: plan?.rotation_rad ?? 0,
      width_px: image.naturalWidth,
      height_px: image.naturalHeight,
      media_type: chosen.type,
    };
    preview();
    map.showAll();
    pick(2);
  }

  function preview(): void {
    map.preview = plan === null ? null : { plan, picture: picture?.image ?? null };
    map.redraw();
    update();
  }

  function pick(count: number): void {
    wanted = count;
    points = [];
    scaleForm.hidden = count !== 2;
    originForm.hidden = count !== 1;
    map.setTool(pickTool);
    tell();
  }

  function tell(): void {
    const two = (['plan.first', 'plan.second', 'plan.both'] as const)[points.length];
    const one = (['plan.pick', 'plan.picked'] as const)[points.length];
    setText(step, wanted === 2 ? t(two ?? 'plan.both') : wanted === 1 ? t(one ?? 'plan.picked') : '');
    map.redraw('marks');
  }

  function applyScale(): void {
    if (plan === null) return;
    const [a, b] = points;
    const scale = b === undefined ? null : scaleFromTwoPoints(a, b, Number(distance.value));
    if (scale === null) {
      setText(step, b === undefined ? t(points.length === 0 ? 'plan.first' : 'plan.second') : t('plan.bad'));
      return;
    }
    // The first point stays where it is, so that the plan does not jump away.
    const fixed = planToMetres(plan, a);
    const scaled = { ...plan, metres_per_pixel: scale };
    plan = { ...scaled, origin_m: originFor(scaled, a, fixed) };
    preview();
    map.showAll();
    pick(1);
  }

  function applyOrigin(): void {
    const p = points[0];
    const at = { x: Number(originX.value), y: Number(originY.value) };
    if (plan === null || p === undefined || !Number.isFinite(at.x) || !Number.isFinite(at.y)) return tell();
    plan = { ...plan, origin_m: originFor(plan, p, at) };
    stopPicking();
    preview();
    map.showAll();
  }

  function turn(): void {
    if (plan === null || !Number.isFinite(Number(rotation.value))) return;
    const centre = { x: plan.width_px / 2, y: plan.height_px / 2 };
    const fixed = planToMetres(plan, centre);
    const turned = { ...plan, rotation_rad: (Number(rotation.value) * Math.PI) / 180 };
    plan = { ...turned, origin_m: originFor(turned, centre, fixed) };
    preview();
  }

  function stopPicking(): void {
    wanted = 0;
    points = [];
    scaleForm.hidden = true;
    originForm.hidden = true;
    if (map.isTool(pickTool)) map.setTool(null);
    tell();
  }

  async function savePlan(): Promise<void> {
    const site = store.site;
    const now = plan;
    if (site === null || now === null) return;
    const { origin_m, metres_per_pixel, rotation_rad } = now;
    const scale = { origin_m, metres_per_pixel, rotation_rad };
    const done = await attempt(app, async () => {
      if (picture === null) await api.putScale(site.name, scale);
      else await api.putPlan(site.name, scale, picture.blob);
      await app.reload('sites');
    });
    if (!done) return;
    revert();
    app.toasts.show(t('saved', { name: t('tab.plan') }), 'good');
  }

  /// Forgets what is not saved.
  function forget(): void {
    if (picture !== null) URL.revokeObjectURL(picture.image.src);
    picture = null;
    file.value = '';
    plan = store.site?.plan ?? null;
    map.preview = null;
    map.redraw();
    stopPicking();
  }

  function revert(): void {
    forget();
    update();
  }

  function startWalls(): void {
    walls = [...(store.site?.walls_m ?? [])];
    end = null;
    wallEdit.hidden = false;
    wallDraw.hidden = true;
    map.setTool(wallTool);
    update();
  }

  function stopWalls(): void {
    wallEdit.hidden = true;
    wallDraw.hidden = false;
    if (map.isTool(wallTool)) map.setTool(null);
    update();
  }

  async function saveWalls(): Promise<void> {
    const site = store.site;
    if (site === null) return;
    const done = await attempt(app, async () => {
      await api.putWalls(site.name, walls);
      await app.reload('sites');
    });
    if (!done) return;
    app.toasts.show(t('saved', { name: t('plan.walls') }), 'good');
    stopWalls();
  }

  function update(): void {
    const may = store.mayAdminister && store.site !== null;
    if (map.preview === null) plan = store.site?.plan ?? null;
    none.hidden = plan !== null;
    edit.hidden = plan === null || !may;
    file.disabled = !may;
    wallDraw.disabled = !may;
    const count = wallEdit.hidden ? (store.site?.walls_m.length ?? 0) : walls.length;
    setText(wallCount, t('plan.walls.count', { count }));
    if (plan === null) return;
    const [x, y] = plan.origin_m;
    const mpp = number(plan.metres_per_pixel, 4);
    setText(about, t('plan.mpp', { mpp, x: number(x, 2), y: number(y, 2) }));
    if (document.activeElement !== rotation) {
      rotation.value = String(Math.round((plan.rotation_rad * 180_000) / Math.PI) / 1000);
    }
  }

  store.on(['site', 'language', 'me'], () => {
    update();
    tell();
  });
  return {
    key: 'tab.plan',
    element,
    shown: (is) => {
      if (is) return update();
      revert();
      if (!wallEdit.hidden) stopWalls();
      origin.close();
    },
  };
}

function round(value: number): number {
  return Math.round(value * 1000) / 1000;
}
