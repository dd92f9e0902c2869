// Rooms and zones: list, drawing by hand on the map, editing, deleting. The corners can also be typed.

import { attempt, type App, type Panel } from '../app.js';
import { api } from '../api.js';
import { button, carefulButton, editForm, empty, field, h } from '../dom.js';
import { inOrder, parseNumber, t } from '../i18n.js';
import { toScreen, type Point } from '../map/geometry.js';
import { outline } from '../map/draw.js';
import type { Tool } from '../map/map.js';
import type { Zone } from '../model.js';

type Corner = [number, number];

/// "x y" a line to corners; null where a line is something else.
export function parseCorners(text: string): Corner[] | null {
  const corners: Corner[] = [];
  for (const line of text.split('\n')) {
    const words = line
      .trim()
      .split(/[\s;]+/)
      .filter((word) => word !== '');
    if (words.length === 0) continue;
    const [x, y] = words.map(parseNumber);
    if (words.length !== 2 || !Number.isFinite(x) || !Number.isFinite(y)) return null;
    corners.push([x, y]);
  }
  return corners;
}

export function zonesPanel(app: App): Panel {
  const { store, map } = app;
  /// The zone that is edited, as it was; null while a new one is drawn.
  let before: Zone | null = null;
  let corners: Corner[] = [];
  let held = -1;

  const none = empty('zones.none');
  const list = h('ul', { class: 'rows', label: 'layer.zones' });
  const draw = button('zones.draw', () => edit(null), 'primary');
  const name = h('input', { attributes: { id: 'zone-name', maxlength: 64, autocomplete: 'off' } });
  const kind = h(
    'select',
    { attributes: { id: 'zone-kind' } },
    h('option', { t: 'zones.room', attributes: { value: 'room' } }),
    h('option', { t: 'zones.zone', attributes: { value: 'zone' } }),
  );
  const alarm = h('input', { attributes: { type: 'checkbox', id: 'zone-alarm' } });
  const typed = h('textarea', {
    attributes: { rows: 5, id: 'zone-corners', spellcheck: 'false' },
    on: { input: () => readTyped() },
  });
  const problem = h('p', { class: 'problem', attributes: { role: 'alert' } });
  const remove = carefulButton('delete', () => void drop());
  const form = editForm(
    { id: 'zone-form', save: () => void save(), close: () => stop(), remove },
    h('p', { t: 'zones.drawing', class: 'help' }),
    field('name', name),
    field('zones.kind', kind),
    h('label', { class: 'check' }, alarm, h('span', { t: 'zones.alarm' })),
    field('zones.corners', typed),
    problem,
  );
  const element = h('div', {}, h('div', { class: 'buttons' }, draw), form, none, list);

  const tool: Tool = {
    click(at) {
      corners.push([round(at.x), round(at.y)]);
      write();
    },
    back() {
      corners.pop();
      write();
    },
    grab(at, tolerance) {
      held = corners.findIndex(([x, y]) => Math.hypot(x - at.x, y - at.y) <= tolerance);
      return held >= 0;
    },
    drag(to: Point) {
      if (held >= 0) corners[held] = [round(to.x), round(to.y)];
      write();
    },
    draw(g, view, palette) {
      if (corners.length === 0) return;
      outline(g, view, corners, corners.length > 2);
      g.fillStyle = palette.accent;
      g.globalAlpha = 0.15;
      g.fill();
      g.globalAlpha = 1;
      g.strokeStyle = palette.accent;
      g.lineWidth = 2;
      g.stroke();
      g.fillStyle = palette.ground;
      for (const [x, y] of corners) {
        const p = toScreen(view, { x, y });
        g.beginPath();
        g.arc(p.x, p.y, 6, 0, 2 * Math.PI);
        g.fill();
        g.stroke();
      }
    },
  };

  function write(): void {
    typed.value = corners.map(([x, y]) => `${x} ${y}`).join('\n');
    problem.textContent = '';
    map.redraw('marks');
  }

  function readTyped(): void {
    const read = parseCorners(typed.value);
    problem.textContent = read === null ? t('zones.corners') : '';
    if (read !== null) corners = read;
    map.redraw('marks');
  }

  function edit(zone: Zone | null): void {
    before = zone;
    corners = zone === null ? [] : zone.corners_m.map(([x, y]) => [x, y]);
    name.value = zone?.name ?? '';
    kind.value = zone?.kind ?? 'room';
    alarm.checked = zone?.alarm ?? false;
    remove.hidden = zone === null;
    form.hidden = false;
    map.setTool(tool);
    write();
    name.focus();
  }

  function stop(): void {
    form.hidden = true;
    if (map.isTool(tool)) map.setTool(null);
    draw.focus();
  }

  async function save(): Promise<void> {
    const site = store.site;
    if (site === null) return;
    const called = name.value.trim();
    const read = parseCorners(typed.value);
    const taken = called !== before?.name && store.zones.some((zone) => zone.name === called);
    const wrong =
      called === ''
        ? t('zones.noname')
        : taken
          ? t('zones.exists')
          : read === null
            ? t('zones.corners')
            : read.length < 3
              ? t('zones.few')
              : '';
    problem.textContent = wrong;
    if (wrong !== '' || read === null) return;
    const zone: Zone = {
      site: site.name,
      name: called,
      kind: kind.value === 'zone' ? 'zone' : 'room',
      corners_m: read,
      alarm: alarm.checked,
    };
    const old = before;
    const done = await attempt(app, async () => {
      await api.putZone(zone);
      if (old !== null && old.name !== called) await api.deleteZone(site.name, old.name);
      await app.reload('zones');
    });
    if (!done) return;
    app.toasts.show(t('saved', { name: called }), 'good');
    stop();
  }

  async function drop(): Promise<void> {
    const zone = before;
    if (zone === null) return;
    const done = await attempt(app, async () => {
      await api.deleteZone(zone.site, zone.name);
      await app.reload('zones');
    });
    if (!done) return;
    app.toasts.show(t('deleted', { name: zone.name }), 'good');
    stop();
  }

  function inside(zone: Zone): number {
    let count = 0;
    for (const tag of store.tags.values()) {
      const is = zone.kind === 'room' ? tag.last_position?.room === zone.name : tag.zones.includes(zone.name);
      if (is) count++;
    }
    return count;
  }

  let shown = false;

  function update(): void {
    if (!shown) return;
    draw.disabled = !store.mayChange || store.site === null;
    none.hidden = store.zones.length > 0;
    list.hidden = store.zones.length === 0;
    const focused = document.activeElement instanceof HTMLElement ? document.activeElement.dataset.zone : undefined;
    const sorted = [...store.zones].sort((a, b) => inOrder(a.kind, b.kind) || inOrder(a.name, b.name));
    list.replaceChildren(
      ...sorted.map((zone) =>
        h(
          'li',
          {},
          h(
            'button',
            {
              class: 'row',
              attributes: { type: 'button', 'data-zone': zone.name, disabled: !store.mayChange },
              on: { click: () => edit(zone) },
            },
            h('span', { class: 'name' }, zone.name),
            h(
              'span',
              { class: 'where' },
              [
                t(zone.kind === 'room' ? 'zones.room' : 'zones.zone'),
                t('zones.inside', { count: inside(zone) }),
                ...(zone.alarm ? [t('zones.alarmed')] : []),
              ].join(' · '),
            ),
          ),
        ),
      ),
    );
    if (focused !== undefined) {
      for (const row of list.querySelectorAll<HTMLElement>('[data-zone]'))
        if (row.dataset.zone === focused) row.focus();
    }
  }

  store.on(['zones', 'language', 'site', 'me'], update);
  setInterval(() => {
    if (document.visibilityState === 'visible') update();
  }, 2000);
  return {
    key: 'tab.zones',
    element,
    shown: (is) => {
      shown = is;
      update();
      if (!is && !form.hidden) stop();
    },
  };
}

function round(value: number): number {
  return Math.round(value * 1000) / 1000;
}
