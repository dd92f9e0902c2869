// What ranges say against the site; the health of anchors and beacons, as a table, and the last 24 hours of one of them;
// the map shows it by colours.

import { api } from '../api.js';
import { attempt, type App, type Panel } from '../app.js';
import { empty, h, setText } from '../dom.js';
import { inOrder, number, signed, supply, t, time, type Key, type Text } from '../i18n.js';
import { stateOf } from '../map/draw.js';
import type { Node } from '../model.js';
import { HealthHistory } from './health-history.js';

const EVERY_MS = 5000;

/// A column of the table: its title, and what it says of a node.
interface Column {
  title: Key | Text;
  cell: (node: Node) => string;
}

/// The columns after the node's name and its state.
const COLUMNS: readonly Column[] = [
  { title: 'health.success', cell: (node) => known(node.success_rate, (rate) => `${number(rate * 100, 0)} %`) },
  { title: 'health.residual', cell: residual },
  {
    title: { en: 'First path − received', es: 'Primer camino − recibida' },
    cell: (node) => known(node.first_path_minus_received_db, (db) => `${signed(db, 1)} dB`),
  },
  {
    title: { en: 'Clock offset', es: 'Desvío del reloj' },
    cell: (node) => known(node.clock_offset_ppm, (ppm) => `${signed(ppm, 1)} ppm`),
  },
  { title: 'health.supply', cell: (node) => supply(node.supply_v) },
  { title: { en: 'Last seen', es: 'Vista' }, cell: (node) => known(node.last_seen, time) },
];

function known<T>(value: T | null, text: (value: T) => string): string {
  return value === null ? '–' : text(value);
}

function residual(node: Node): string {
  if (node.residual_mean_m === null) return '–';
  const mean = signed(node.residual_mean_m, 2);
  return node.residual_sigma_m === null ? `${mean} m` : `${mean} ± ${number(node.residual_sigma_m, 2)} m`;
}

export function healthPanel(app: App): Panel {
  const { store, map } = app;
  const none = empty('health.none');
  // The station's own words, which are English.
  const findings = h('p', { class: 'problem', attributes: { id: 'findings', role: 'status', lang: 'en' } });
  const body = h('tbody');
  const head = h('tr');
  const writeHead = () => {
    const titles: (Key | Text)[] = ['health.node', 'health.state', ...COLUMNS.map((column) => column.title)];
    head.replaceChildren(...titles.map((title) => h('th', { attributes: { scope: 'col' } }, t(title))));
  };
  writeHead();
  const table = h(
    'div',
    { class: 'scroll', label: 'tab.health', attributes: { tabindex: 0, role: 'region', id: 'health' } },
    h('table', {}, h('thead', {}, head), body),
  );
  const day = new HealthHistory(app);
  const element = h('div', {}, findings, none, table, day.element, h('p', { t: 'health.help', class: 'help' }));
  let shown = false;

  async function reload(): Promise<void> {
    const site = store.site?.name;
    if (site === undefined) return;
    const [found] = await Promise.all([api.findings(site), app.reload('nodes')]);
    if (site === store.site?.name) setText(findings, found.map((finding) => finding.message).join('\n'));
  }

  function update(): void {
    if (!shown) return;
    none.hidden = store.nodes.length > 0;
    table.hidden = store.nodes.length === 0;
    // What needs a person comes first.
    const order = { moved: 0, weak: 1, nlos: 2, unseen: 3, good: 4 };
    const nodes = [...store.nodes].sort((a, b) => order[stateOf(a)] - order[stateOf(b)] || inOrder(a.node, b.node));
    const focused = document.activeElement instanceof HTMLElement ? document.activeElement.dataset.node : undefined;
    body.replaceChildren(
      ...nodes.map((node) => {
        const state = stateOf(node);
        const isOpen = day.node === node.node;
        const go = () => {
          void day.show(isOpen ? null : node.node);
          update();
          if (node.position_m !== null) map.centreOn({ x: node.position_m[0], y: node.position_m[1] });
        };
        return h(
          'tr',
          { class: state },
          h(
            'th',
            { attributes: { scope: 'row' } },
            h(
              'button',
              {
                class: 'link',
                attributes: {
                  type: 'button',
                  'data-node': node.node,
                  'aria-expanded': String(isOpen),
                  'aria-controls': 'health-day',
                },
                on: { click: go },
              },
              node.name ?? node.node,
            ),
          ),
          h('td', {}, h('span', { class: `badge ${state}` }, t(`health.${state}`))),
          ...COLUMNS.map((column) => h('td', {}, column.cell(node))),
        );
      }),
    );
    if (focused !== undefined) {
      for (const link of body.querySelectorAll<HTMLElement>('[data-node]'))
        if (link.dataset.node === focused) link.focus();
    }
  }

  store.on(['nodes', 'language'], update);
  store.on('language', () => {
    writeHead();
    day.write();
  });
  let site = store.site?.name;
  store.on('site', () => {
    if (site !== store.site?.name) {
      void day.show(null);
      setText(findings, '');
    }
    site = store.site?.name;
    update();
  });
  setInterval(() => {
    if (shown && document.visibilityState === 'visible') void reload().catch(() => {});
  }, EVERY_MS);
  return {
    key: 'tab.health',
    element,
    shown: (is) => {
      shown = is;
      update();
      if (is) void attempt(app, reload);
    },
  };
}
