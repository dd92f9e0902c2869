// The past: a span of time on the map with a slider, a heat map of the time spent, a chart of one tag, and its track as
// GPX.

import { attempt, type App, type Panel } from '../app.js';
import { allPositions, api } from '../api.js';
import { button, field, h, setText } from '../dom.js';
import { inOrder, number, t, time } from '../i18n.js';
import { heatOf } from '../map/heat.js';
import { Replay } from '../map/replay.js';
import { Chart, type Line } from './chart.js';

/// Rows that the page loads for a span; the step between them follows from it.
const MOST_ROWS = 60_000;
/// The most that the station gives at once: ten minutes of a tag at ten positions a second are 6000.
const CHART_ROWS = 10_000;
const SPEEDS = [1, 2, 5, 10, 30, 60, 300];

interface ChartRow {
  /// ms.
  t: number;
  x: number;
  y: number;
  s: number;
}

/// The step between two positions of a tag, s, at which a span of `seconds` with `tags` tags fits into `most` rows.
export function stepFor(seconds: number, tags: number, most: number): number {
  return Math.max(1, Math.ceil((seconds * Math.max(tags, 1)) / most));
}

/// For an input of type datetime-local: the local time without its zone.
export function localInput(at: number): string {
  const date = new Date(at);
  const two = (value: number) => String(value).padStart(2, '0');
  const day = `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
  return `${day}T${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}`;
}

export function historyPanel(app: App): Panel {
  const { store, map } = app;
  let replay: Replay | null = null;
  let playing = false;
  let last = 0;
  let step = 1;
  let loading = 0;

  const when = (id: string) => h('input', { attributes: { type: 'datetime-local', step: 1, id } });
  const from = when('from');
  const to = when('to');
  const load = button('history.load', () => void fetchSpan(), 'primary');
  const status = h('p', { class: 'help', attributes: { role: 'status', id: 'history-status' } });
  const slider = h('input', {
    label: 'history.at',
    attributes: { type: 'range', id: 'slider', min: 0, value: 0, step: 0.1 },
    on: { input: () => seek(Number(slider.value)) },
  });
  const clock = h('output', { attributes: { for: 'slider', id: 'clock' } });
  const play = button('history.play', () => setPlaying(!playing));
  play.id = 'play';
  const speed = h(
    'select',
    { attributes: { id: 'speed' } },
    ...SPEEDS.map((s) => h('option', { attributes: { value: s, selected: s === 10 } }, `${s}×`)),
  );
  const heat = h('input', { attributes: { type: 'checkbox', id: 'heat' }, on: { change: () => showHeat() } });
  const heatOfTag = h('select', { attributes: { id: 'heat-of' }, on: { change: () => showHeat() } });
  const heatHelp = h('p', { class: 'help' });
  const chartOf = h('select', { attributes: { id: 'chart-of' }, on: { change: () => void showChart() } });
  const chart = new Chart();
  const gpx = h('a', { t: 'history.gpx', attributes: { id: 'gpx' } });
  const gpxHelp = h('p', { class: 'help' });
  const track = h('div', {}, gpx, gpxHelp);
  const controls = h(
    'div',
    { attributes: { hidden: true } },
    h('div', { class: 'player' }, play, slider),
    h('p', { class: 'clock' }, clock),
    field('history.speed', speed),
    h('label', { class: 'check' }, heat, h('span', { t: 'history.heat' })),
    field('history.heat.of', heatOfTag),
    heatHelp,
    field('history.chart', chartOf),
    h('p', { t: 'history.chart.help', class: 'help' }),
    chart.element,
    track,
  );
  const preset = (key: 'history.last10' | 'history.lasthour' | 'history.today', start: () => number) =>
    button(key, () => {
      from.value = localInput(start());
      to.value = localInput(Date.now());
      void fetchSpan();
    });
  const element = h(
    'div',
    {},
    h(
      'div',
      { class: 'buttons' },
      preset('history.last10', () => Date.now() - 600_000),
      preset('history.lasthour', () => Date.now() - 3_600_000),
      preset('history.today', () => new Date().setHours(0, 0, 0, 0)),
    ),
    field('history.from', from),
    field('history.to', to),
    h('div', { class: 'buttons' }, load),
    status,
    controls,
  );
  from.value = localInput(Date.now() - 600_000);
  to.value = localInput(Date.now());
  status.textContent = t('history.start');

  async function fetchSpan(): Promise<void> {
    const start = new Date(from.value).getTime();
    const end = new Date(to.value).getTime();
    const site = store.site;
    if (site === null || !(end > start)) {
      setText(status, t('history.span'));
      return;
    }
    setPlaying(false);
    step = stepFor((end - start) / 1000, store.tags.size, MOST_ROWS);
    setText(status, t('history.loading'));
    const mine = ++loading;
    const done = await attempt(app, async () => {
      const rows = await allPositions(site.name, iso(start), iso(end), step, MOST_ROWS);
      if (mine !== loading) return;
      if (rows.length === 0) {
        leave();
        setText(status, t('history.none'));
        return;
      }
      const away = Math.max(3 * step, 10) * 1000;
      replay = new Replay(rows, Date.parse(rows[0].t), end, away, (tag) => store.nameOf(tag));
      describe();
      enter();
    });
    if (!done) setText(status, '');
  }

  function describe(): void {
    if (replay === null) return;
    const { rows, tracks } = replay;
    const all = t('history.rows', { rows: number(rows, 0), tags: tracks.size, step });
    setText(status, rows >= MOST_ROWS ? `${all} ${t('history.cut', { rows: number(rows, 0) })}` : all);
  }

  function enter(): void {
    if (replay === null) return;
    // Behind the last position there is nothing to see.
    const end = Math.max(...[...replay.tracks.values()].map((track) => track[track.length - 1].t));
    slider.max = String(Math.max((end - replay.from) / 1000, 0.1));
    controls.hidden = false;
    const ids = [...replay.tracks.keys()].sort((a, b) => inOrder(store.nameOf(a), store.nameOf(b)));
    const options = () => ids.map((id) => h('option', { attributes: { value: id } }, store.nameOf(id)));
    heatOfTag.replaceChildren(h('option', { t: 'history.heat.all', attributes: { value: '' } }), ...options());
    chartOf.replaceChildren(...options());
    if (store.selected !== null && ids.includes(store.selected)) chartOf.value = store.selected;
    app.showPast(replay);
    seek(0);
    showHeat();
    void showChart();
  }

  function leave(): void {
    setPlaying(false);
    replay = null;
    controls.hidden = true;
    setText(status, t('history.start'));
    map.setHeat(null);
    heat.checked = false;
    app.showPast(null);
  }

  function seek(seconds: number): void {
    if (replay === null) return;
    replay.time = replay.from + seconds * 1000;
    if (document.activeElement !== slider || playing) slider.value = String(seconds);
    setText(clock, time(replay.time));
    slider.setAttribute('aria-valuetext', time(replay.time));
    map.redraw('trails');
  }

  function setPlaying(is: boolean): void {
    playing = is && replay !== null;
    if (replay !== null) replay.play = playing;
    play.dataset.t = playing ? 'history.pause' : 'history.play';
    setText(play, t(playing ? 'history.pause' : 'history.play'));
    if (!playing || replay === null) return;
    if (Number(slider.value) >= Number(slider.max)) seek(0);
    last = performance.now();
    requestAnimationFrame(tick);
    map.redraw('marks');
  }

  function tick(now: number): void {
    if (!playing || replay === null) return;
    const at = (replay.time - replay.from) / 1000 + (Math.max(now - last, 0) / 1000) * Number(speed.value);
    last = now;
    const end = Number(slider.max);
    seek(Math.min(at, end));
    if (at >= end) setPlaying(false);
    else requestAnimationFrame(tick);
  }

  function showHeat(): void {
    if (replay === null || !heat.checked) {
      map.setHeat(null);
      heatHelp.textContent = '';
      return;
    }
    const tag = heatOfTag.value;
    const tracks = tag === '' ? replay.tracks.values() : [replay.track(tag)];
    const made = heatOf(tracks, replay.away / 1000);
    map.setHeat(made);
    heatHelp.textContent =
      made === null ? '' : t('history.heat.max', { seconds: number(made.max, 0), cell: number(made.cell, 1) });
  }

  /// The link to the track of the tag whose chart is shown, where the site has a geographic origin.
  function linkTrack(): void {
    const { site } = store;
    const tag = chartOf.value;
    track.hidden = replay === null || tag === '' || site === null || site.geographic_origin === null;
    if (replay === null || site === null || track.hidden) return;
    gpx.href = api.trackUrl(site.name, tag, iso(replay.from), iso(replay.to), CHART_ROWS);
    gpx.download = `${store.nameOf(tag)}.gpx`;
    setText(gpxHelp, t('history.gpx.help', { rows: number(CHART_ROWS, 0) }));
  }

  async function showChart(): Promise<void> {
    linkTrack();
    const tag = chartOf.value;
    if (replay === null || store.site === null || tag === '') return;
    const { from: start, to: end } = replay;
    const site = store.site.name;
    await attempt(app, async () => {
      // A short span is shown at the full rate; a long one at the step of the map.
      let rows: ChartRow[] = [];
      if (end - start <= 600_000) {
        const positions = await api.tagPositions(site, tag, iso(start), iso(end), CHART_ROWS);
        rows = positions.reverse().map((p) => ({
          t: Date.parse(p.t),
          x: p.x_m,
          y: p.y_m,
          s: Math.hypot(p.sigma_x_m, p.sigma_y_m),
        }));
      } else {
        rows = (replay?.tracks.get(tag) ?? []).map((row) => ({
          t: row.t,
          x: row.x,
          y: row.y,
          s: Math.hypot(row.position.sigma_x_m, row.position.sigma_y_m),
        }));
      }
      if (chartOf.value !== tag || replay === null) return;
      const line = (name: string, colour: Line['colour'], value: (row: ChartRow) => number): Line => {
        return { name, unit: 'm', digits: 2, colour, values: rows.map(value) };
      };
      const lines = [
        line('x', '--chart-x', (row) => row.x),
        line('y', '--chart-y', (row) => row.y),
        line('σ', '--chart-s', (row) => row.s),
      ];
      const times = rows.map((row) => row.t);
      chart.show(store.nameOf(tag), t('history.chart.help'), times, lines);
    });
  }

  store.on('language', () => {
    if (replay === null) setText(status, t('history.start'));
    else {
      describe();
      showHeat();
      void showChart();
    }
  });
  store.on('selection', () => {
    if (replay === null || store.selected === null || !replay.tracks.has(store.selected)) return;
    chartOf.value = store.selected;
    void showChart();
  });
  store.on('mode', () => {
    if (!store.past && replay !== null) leave();
  });
  let site = store.site?.name;
  store.on('site', () => {
    if (site !== store.site?.name && replay !== null) leave();
    site = store.site?.name;
    linkTrack();
  });
  return { key: 'tab.history', element };
}

function iso(at: number): string {
  return new Date(at).toISOString();
}
