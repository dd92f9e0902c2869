// Survey campaigns, led on the browser of a phone: which point comes next, where it is, and how many samples it has. A
// browser cannot receive Bluetooth advertisements; a terminal posts the samples, and the page says where to.

import { attempt, type App, type Panel } from '../app.js';
import { api } from '../api.js';
import { button, carefulButton, empty, field, h, setText } from '../dom.js';
import { number, t } from '../i18n.js';
import { inPolygon, toScreen, type Bounds } from '../map/geometry.js';
import { text } from '../map/draw.js';
import type { Tool } from '../map/map.js';
import type { Campaign, CampaignPoint, Zone } from '../model.js';

const EVERY_MS = 2000;
const MOST_POINTS = 500;

/// Points on a grid within `bounds`, half a cell from its edges; where rooms are drawn, those in rooms alone.
export function gridPoints(bounds: Bounds, spacing: number, rooms: readonly Zone[]): Omit<CampaignPoint, 'samples'>[] {
  const points: Omit<CampaignPoint, 'samples'>[] = [];
  const columns = Math.max(1, Math.floor((bounds.max.x - bounds.min.x) / spacing));
  const rows = Math.max(1, Math.floor((bounds.max.y - bounds.min.y) / spacing));
  if (columns * rows > 100 * MOST_POINTS) return new Array(columns * rows);
  for (let row = 0; row < rows; row++) {
    for (let i = 0; i < columns; i++) {
      // There and back again: the next point is always beside the last one.
      const column = row % 2 === 0 ? i : columns - 1 - i;
      const x = Math.round((bounds.min.x + ((column + 0.5) * (bounds.max.x - bounds.min.x)) / columns) * 100) / 100;
      const y = Math.round((bounds.min.y + ((row + 0.5) * (bounds.max.y - bounds.min.y)) / rows) * 100) / 100;
      const room = rooms.find((zone) => inPolygon(zone.corners_m, { x, y }));
      if (rooms.length > 0 && room === undefined) continue;
      points.push({ id: `p${points.length + 1}`, x_m: x, y_m: y, z_m: null, room: room?.name ?? null });
    }
  }
  return points;
}

export function surveyPanel(app: App): Panel {
  const { store, map } = app;
  let campaigns: Campaign[] = [];
  let campaign: Campaign | null = null;
  let at = 0;
  let shown = false;

  const none = empty('survey.none');
  const choice = h('select', { attributes: { id: 'campaign' }, on: { change: () => choose(choice.value) } });
  const progress = h('p', { attributes: { id: 'survey-progress' } });
  const bar = h('progress', { label: 'survey.points', attributes: { max: 1, value: 0 } });
  const go = h('h3', { attributes: { id: 'survey-go' } });
  const samples = h('p', { class: 'big', attributes: { role: 'status', id: 'survey-samples' } });
  const command = h('textarea', {
    label: 'survey.command',
    attributes: { readonly: true, rows: 5, id: 'survey-command' },
  });
  const remove = carefulButton('delete', () => void drop());
  const guide = h(
    'section',
    {},
    progress,
    bar,
    go,
    samples,
    h(
      'div',
      { class: 'buttons' },
      button('survey.previous', () => step(-1)),
      button('survey.next', () => step(1), 'primary'),
    ),
    h('p', { t: 'survey.how', class: 'help' }),
    command,
    h('div', { class: 'buttons' }, remove),
  );
  const name = h('input', { attributes: { id: 'campaign-name', maxlength: 64, autocomplete: 'off' } });
  const spacing = h('input', { attributes: { id: 'campaign-spacing', type: 'number', min: 0.2, step: 0.1, value: 2 } });
  const problem = h('p', { class: 'problem', attributes: { role: 'alert' } });
  const create = h('button', { t: 'survey.create', attributes: { type: 'submit' } });
  const form = h(
    'form',
    {
      class: 'form',
      on: {
        submit: (event) => {
          event.preventDefault();
          void make();
        },
      },
    },
    h('h3', { t: 'survey.new' }),
    field('name', name),
    field('survey.spacing', spacing),
    problem,
    h('div', { class: 'buttons' }, create),
  );
  const chooser = field('survey.campaign', choice);
  const element = h('div', {}, none, chooser, guide, form);

  const tool: Tool = {
    click(where) {
      if (campaign === null) return;
      const near = campaign.points.map((p) => Math.hypot(p.x_m - where.x, p.y_m - where.y));
      const best = near.indexOf(Math.min(...near));
      if (best >= 0) step(best - at);
    },
    draw(g, view, palette) {
      campaign?.points.forEach((point, i) => {
        const p = toScreen(view, { x: point.x_m, y: point.y_m });
        g.beginPath();
        g.arc(p.x, p.y, i === at ? 11 : 5, 0, 2 * Math.PI);
        g.fillStyle = point.samples > 0 ? palette.good : palette.warn;
        g.fill();
        if (i !== at) return;
        g.strokeStyle = palette.text;
        g.lineWidth = 3;
        g.stroke();
        text(g, point.id, { x: p.x, y: p.y - 20 }, palette, 'center');
      });
    },
  };

  function choose(called: string): void {
    campaign = campaigns.find((c) => c.name === called) ?? null;
    // The first point without samples is the next one to go to.
    at = Math.max(campaign?.points.findIndex((point) => point.samples === 0) ?? 0, 0);
    useTool();
    update();
  }

  function useTool(): void {
    if (shown && campaign !== null) map.setTool(tool);
    else if (map.isTool(tool)) map.setTool(null);
  }

  function step(by: number): void {
    if (campaign === null || campaign.points.length === 0) return;
    const count = campaign.points.length;
    at = (at + by + count) % count;
    const point = campaign.points[at];
    map.centreOn({ x: point.x_m, y: point.y_m });
    update();
  }

  function update(): void {
    none.hidden = campaigns.length > 0;
    chooser.hidden = campaigns.length === 0;
    guide.hidden = campaign === null;
    form.hidden = !store.mayChange || store.site === null;
    remove.hidden = !store.mayChange;
    if (campaign === null) return;
    const done = campaign.points.filter((point) => point.samples > 0).length;
    setText(progress, t('survey.progress', { done, all: campaign.points.length }));
    bar.max = Math.max(campaign.points.length, 1);
    bar.value = done;
    const point = campaign.points[at];
    if (point === undefined) return;
    setText(go, t('survey.go', { point: point.id, x: number(point.x_m, 2), y: number(point.y_m, 2) }));
    setText(samples, t('survey.samples', { count: number(point.samples, 0) }));
    const body = '[{"beacon": "1-7", "rssi_dbm": -63.0, "t_s": 0.5}]';
    const url = api.samplesUrl(campaign.name, point.id);
    const bearer = store.me.tokens ? `\n  -H 'Authorization: Bearer TOKEN'` : '';
    const line = `curl -X POST '${url}'${bearer}\n  -H 'Content-Type: application/json'\n  -d '${body}'`.replace(
      /\n/g,
      ' \\\n',
    );
    if (command.value !== line) command.value = line;
    map.redraw('marks');
  }

  async function read(): Promise<void> {
    const site = store.site?.name;
    campaigns = (await api.campaigns()).filter((c) => c.scenario === site);
    const options = campaigns.map((c) => h('option', { attributes: { value: c.name } }, c.name));
    choice.replaceChildren(...options);
    const again = campaigns.find((c) => c.name === campaign?.name);
    if (again !== undefined) {
      campaign = again;
      choice.value = again.name;
      update();
    } else choose(campaigns[0]?.name ?? '');
  }

  async function make(): Promise<void> {
    problem.textContent = '';
    const called = name.value.trim();
    const bounds = map.bounds();
    const grid = Number(spacing.value);
    if (called === '' || store.site === null) {
      problem.textContent = t('zones.noname');
      return;
    }
    if (bounds === null || !(grid > 0)) {
      problem.textContent = t('survey.nogrid');
      return;
    }
    const rooms = store.zones.filter((zone) => zone.kind === 'room');
    const points = gridPoints(bounds, grid, rooms);
    if (points.length === 0 || points.length > MOST_POINTS) {
      problem.textContent = t('survey.many', { count: points.length });
      return;
    }
    const site = store.site.name;
    const done = await attempt(app, async () => {
      await api.createCampaign({ name: called, scenario: site, points });
      await read();
    });
    if (!done) return;
    app.toasts.show(t('saved', { name: called }), 'good');
    choice.value = called;
    choose(called);
    name.value = '';
    element.scrollTop = 0;
  }

  async function drop(): Promise<void> {
    const gone = campaign?.name;
    if (gone === undefined) return;
    const done = await attempt(app, async () => {
      await api.deleteCampaign(gone);
      await read();
    });
    if (done) app.toasts.show(t('deleted', { name: gone }), 'good');
  }

  async function count(): Promise<void> {
    const now = campaign;
    if (!shown || now === null || document.visibilityState !== 'visible') return;
    try {
      now.points = await api.campaignPoints(now.name);
      update();
    } catch {
      // The connection's state is shown above; the next count comes soon.
    }
  }

  setInterval(() => void count(), EVERY_MS);
  store.on(['language', 'me'], update);
  store.on('site', () => {
    if (shown) void attempt(app, read);
  });
  return {
    key: 'tab.survey',
    element,
    shown: (is) => {
      shown = is;
      useTool();
      update();
      if (is && store.site !== null) void attempt(app, read);
    },
  };
}
