// The page: makes its parts, reads the station, and keeps both together. Data flow one way: API and live updates to the
// store, from there to the map and the panels; what a person does goes to the API and comes back by a reload.

import './style.css';
import 'uplot/dist/uPlot.min.css';
import { allPositions, api } from './api.js';
import { attempt, type App, type Panel } from './app.js';
import { button, field, h, setText, translateAll } from './dom.js';
import { chooseLanguage, language, setLanguage, t, type Key, type Language } from './i18n.js';
import { Live, type Connection } from './live.js';
import { MapView, type Layers } from './map/map.js';
import { Motion, type Marks } from './map/motion.js';
import type { TagPosition } from './model.js';
import { eventsPanel } from './panels/events.js';
import { healthPanel } from './panels/health.js';
import { historyPanel } from './panels/history.js';
import { Login } from './panels/login.js';
import { planPanel } from './panels/plan.js';
import { surveyPanel } from './panels/survey.js';
import { tagsPanel } from './panels/tags.js';
import { Toasts } from './panels/toasts.js';
import { zonesPanel } from './panels/zones.js';
import { Store, TRAIL_MS } from './store.js';
import { applyTheme, chosenTheme, system, type Theme } from './theme.js';

const LANGUAGE = 'baliza.language';
const LAYERS = 'baliza.layers';
const SITE = 'baliza.site';
const TAGS_EVERY_MS = 10_000;
const CHANGED_WAIT_MS = 300;
/// A phone that slept this long opens the connection again.
const ASLEEP_MS = 45_000;
/// A gap that is longer is not filled in full: its end is what trails show.
const LONGEST_GAP_MS = TRAIL_MS;
const GAP_ROWS = 60_000;
/// With at most this number of tags, a gap has no more rows than these, at 100 positions a second each.
const FEW_TAGS = GAP_ROWS / (100 * (LONGEST_GAP_MS / 1000));
/// After the first of these times, the history has what was live at the connection; after a later one where the
/// station's disk or database is slow. It lacked no more than this before.
const WRITTEN_MS = [1500, 4000, 10_000, 30_000];
const UNWRITTEN_MS = 10_000;
const EVENTS = 200;

const stored = localStorage.getItem(LANGUAGE);
setLanguage(chooseLanguage(stored === null ? navigator.languages : [stored]));
applyTheme(chosenTheme());

const store = new Store();
const map = new MapView();
const motion = new Motion();
const toasts = new Toasts();
const login = new Login(() => void begin());
let live: Live | null = null;
let connection: Connection = 'connecting';

const liveMarks: Marks = {
  at: (now) => motion.at(now),
  moving: (now) => motion.moving(now),
  trails(line) {
    const newest = Math.max(0, ...[...store.steps.values()].map((steps) => steps[steps.length - 1]?.t ?? 0));
    for (const [id, steps] of store.steps) {
      let from = steps.length;
      while (from > 0 && steps[from - 1].t >= newest - TRAIL_MS) from--;
      if (from < steps.length) line(id, steps.slice(from));
    }
  },
};

const app: App = {
  store,
  map,
  toasts,
  reload,
  showPast(marks) {
    store.past = marks !== null;
    map.setMarks(marks ?? liveMarks);
    showConnection();
    store.tell('mode');
  },
  askToken: () => ask(),
};

async function reload(what: 'sites' | 'tags' | 'nodes' | 'zones'): Promise<void> {
  if (what === 'sites') {
    store.setSites(await api.sites(), store.site?.name ?? localStorage.getItem(SITE));
    return;
  }
  const site = store.site?.name;
  if (site === undefined) return;
  const is = () => site === store.site?.name;
  if (what === 'tags') {
    const tags = await api.tags(site);
    if (is()) store.setTags(tags);
  } else if (what === 'nodes') {
    const nodes = await api.nodes(site);
    if (is()) store.setNodes(nodes);
  } else {
    const zones = await api.zones(site);
    if (is()) store.setZones(zones);
  }
}

// Head

const siteChoice = h('select', {
  attributes: { id: 'site' },
  on: {
    change: () => {
      localStorage.setItem(SITE, siteChoice.value);
      store.setSites(store.sites, siteChoice.value);
      void follow();
    },
  },
});
const state = h('span', { class: 'state', attributes: { role: 'status', id: 'state' } });
const languageChoice = h(
  'select',
  { label: 'language', attributes: { id: 'language' } },
  h('option', { attributes: { value: 'en', lang: 'en' } }, 'English'),
  h('option', { attributes: { value: 'es', lang: 'es' } }, 'Español'),
);
languageChoice.value = language();
languageChoice.addEventListener('change', () => {
  localStorage.setItem(LANGUAGE, languageChoice.value);
  speak(languageChoice.value as Language);
});
const themeChoice = h(
  'select',
  { label: 'theme', attributes: { id: 'theme' } },
  ...(['auto', 'light', 'dark'] as const).map((theme) =>
    h('option', { t: `theme.${theme}`, attributes: { value: theme } }),
  ),
);
themeChoice.value = chosenTheme();
const retheme = () => {
  applyTheme(themeChoice.value as Theme);
  map.restyle();
  // Colours of lists and charts follow.
  store.tell('language');
};
themeChoice.addEventListener('change', retheme);
system.addEventListener('change', retheme);
const still = matchMedia('(prefers-reduced-motion: reduce)');
const follows = () => (motion.smooth = !still.matches);
still.addEventListener('change', follows);
follows();
const liveButton = button('history.live', () => app.showPast(null), 'primary');
const ask = () => login.ask(store.me.sign_in);
const loginButton = button('login', () => ask());
const logoutButton = button(
  'logout',
  () =>
    void attempt(app, async () => {
      const endSession = await api.logout();
      if (endSession === null) location.reload();
      else location.assign(endSession);
    }),
);

function showConnection(): void {
  const key: Key = connection === 'live' && store.past ? 'state.history' : `state.${connection}`;
  state.dataset.t = key;
  state.className = `state ${connection}`;
  liveButton.hidden = !store.past;
  setText(state, t(key));
}

function speak(next: Language): void {
  setLanguage(next);
  document.documentElement.lang = next;
  document.title = t('app.title');
  translateAll(document);
  showConnection();
  store.tell('language');
}

// Panels

const events = eventsPanel(app);
const panels: Panel[] = [
  tagsPanel(app),
  zonesPanel(app),
  historyPanel(app),
  healthPanel(app),
  events,
  surveyPanel(app),
  planPanel(app),
];
let open = 0;
const tabs = panels.map((panel, i) => {
  const id = panel.key.replace('.', '-');
  const attributes = { type: 'button', role: 'tab', id, 'aria-controls': `${id}-panel` };
  return h('button', { t: panel.key, attributes, on: { click: () => openPanel(i) } });
});
const tabList = h(
  'div',
  {
    class: 'tabs',
    label: 'panels',
    attributes: { role: 'tablist' },
    on: {
      keydown: (event) => {
        const last = tabs.length - 1;
        const next: Record<string, number> = {
          ArrowRight: open === last ? 0 : open + 1,
          ArrowLeft: open === 0 ? last : open - 1,
          Home: 0,
          End: last,
        };
        const to = next[event.key];
        if (to === undefined) return;
        event.preventDefault();
        openPanel(to);
        tabs[to].focus();
      },
    },
  },
  ...tabs,
);
panels.forEach((panel, i) => {
  panel.element.id = `${tabs[i].id}-panel`;
  panel.element.className = 'panel';
  panel.element.tabIndex = -1;
  panel.element.setAttribute('role', 'tabpanel');
  panel.element.setAttribute('aria-labelledby', tabs[i].id);
});

function openPanel(which: number): void {
  open = which;
  panels.forEach((panel, i) => {
    const is = i === which;
    panel.element.hidden = !is;
    tabs[i].setAttribute('aria-selected', String(is));
    tabs[i].tabIndex = is ? 0 : -1;
    if (!is) panel.shown?.(false);
  });
  panels[which].shown?.(true);
}

// Map

const kept = readLayers();
Object.assign(map.layers, kept);
const layerChecks = (Object.keys(map.layers) as (keyof Layers)[]).map((layer) => {
  const check = h('input', { attributes: { type: 'checkbox', id: `layer-${layer}` } });
  check.checked = map.layers[layer];
  check.addEventListener('change', () => {
    map.layers[layer] = check.checked;
    localStorage.setItem(LAYERS, JSON.stringify(map.layers));
    map.redraw();
  });
  return h('label', { class: 'check' }, check, h('span', { t: `layer.${layer}` }));
});

function readLayers(): Partial<Layers> {
  try {
    const saved = JSON.parse(localStorage.getItem(LAYERS) ?? '{}') as Record<string, unknown>;
    const known = Object.keys(map.layers) as (keyof Layers)[];
    return Object.fromEntries(known.filter((k) => typeof saved[k] === 'boolean').map((k) => [k, saved[k]]));
  } catch {
    return {};
  }
}

const mapButton = (sign: string, key: Key, press: () => void) =>
  h('button', { label: key, attributes: { type: 'button' }, on: { click: press } }, sign);
const noSite = h(
  'div',
  { class: 'empty over', attributes: { hidden: true } },
  h('p', { t: 'sites.none' }),
  h('code', {}, 'baliza serve --simulate'),
);
document.body.append(
  h('a', { t: 'skip', class: 'skip', attributes: { href: '#tab-tags' } }),
  h(
    'header',
    {},
    h('h1', { attributes: { id: 'title' } }, 'Baliza'),
    field('site', siteChoice),
    state,
    liveButton,
    h('span', { class: 'space' }),
    languageChoice,
    themeChoice,
    loginButton,
    logoutButton,
  ),
  h(
    'main',
    {},
    h(
      'section',
      { class: 'mapside', label: 'map' },
      map.element,
      h(
        'div',
        { class: 'mapbuttons' },
        mapButton('+', 'map.in', () => map.zoom(1.4)),
        mapButton('−', 'map.out', () => map.zoom(1 / 1.4)),
        mapButton('⤢', 'map.fit', () => map.showAll()),
      ),
      h('details', { class: 'layers' }, h('summary', { t: 'map.layers' }), ...layerChecks),
      noSite,
    ),
    h('section', { class: 'side', label: 'panels' }, tabList, ...panels.map((panel) => panel.element)),
  ),
  toasts.element,
  login.element,
);
map.setMarks(liveMarks);
map.onPick = (tag) => {
  store.select(tag);
  openPanel(0);
};

// The store to the map

store.on('selection', () => {
  map.selected = store.selected;
  map.redraw('trails');
});
store.on('tags', () => {
  const now = performance.now();
  for (const tag of store.tags.values()) {
    if (tag.last_position === null) continue;
    if (!motion.has(tag.tag)) motion.move(tag.last_position, tag.name ?? tag.tag, now);
    motion.style(tag.tag, tag.name ?? tag.tag, tag.silent);
  }
  for (const id of [...motion.ids()]) if (!store.tags.has(id)) motion.remove(id);
  map.showFirst();
  map.redraw('marks');
});
store.on('zones', () => {
  map.scene.zones = store.zones;
  map.showFirst();
  map.redraw();
});
store.on('nodes', () => {
  map.scene.nodes = store.nodes;
  map.showFirst();
  map.redraw();
});
let shownSite: string | null = null;
store.on('site', () => {
  const site = store.site;
  noSite.hidden = site !== null;
  siteChoice.replaceChildren(...store.sites.map((s) => h('option', { attributes: { value: s.name } }, s.name)));
  siteChoice.value = site?.name ?? '';
  siteChoice.disabled = store.sites.length < 2;
  if (site?.name !== shownSite) {
    shownSite = site?.name ?? null;
    motion.clear();
    map.forget();
    map.scene.zones = [];
    map.scene.nodes = [];
  }
  map.scene.walls = site?.walls_m ?? [];
  map.scene.plan = site?.plan ?? null;
  void showPicture();
  map.showFirst();
  map.redraw();
});

async function showPicture(): Promise<void> {
  const site = store.site;
  const plan = site?.plan ?? null;
  if (site === null || plan === null) {
    map.scene.picture = null;
    return;
  }
  let picture: ImageBitmap;
  try {
    picture = await createImageBitmap(await api.blueprint(site.name));
  } catch {
    return;
  }
  if (store.site?.plan !== plan) return;
  map.scene.picture = picture;
  map.redraw();
}

// The station to the store

/// Reads positions from the history, from `begin` to before `end`, ms.
async function fillTrails(site: string, begin: number, end: number, step: number): Promise<void> {
  if (begin >= end) return;
  const [from, to] = [new Date(begin).toISOString(), new Date(end).toISOString()];
  const fresh = new Set<string>();
  for (const row of await allPositions(site, from, to, step, GAP_ROWS)) if (store.addPosition(row)) fresh.add(row.tag);
  for (const id of fresh) {
    const position = store.tags.get(id)?.last_position ?? null;
    if (position !== null) moveMark(position);
  }
}

async function fill(site: string, since: string | null): Promise<void> {
  await Promise.all([reload('tags'), reload('nodes'), reload('zones')]);
  const positions = [...store.tags.values()].flatMap((tag) => tag.last_position ?? []);
  if (positions.length > 0) {
    const end = positions.reduce((last, { t }) => Math.max(last, Date.parse(t)), 0) + 1;
    const begin = Math.max(since === null ? end - TRAIL_MS : Date.parse(since), end - LONGEST_GAP_MS);
    // With many tags, a step between positions keeps the answer small. A gap of few tags is filled with all of them.
    const { size } = store.tags;
    const step = since === null ? Math.max(1, size / 100) : size > FEW_TAGS ? size / 1000 : 0;
    await fillTrails(site, begin, end, step);
    // The station writes its rows in batches: the last ones before the connection come into the history later.
    const unwritten = Math.max(begin, end - UNWRITTEN_MS);
    for (const wait of WRITTEN_MS) setTimeout(() => void fillTrails(site, unwritten, end, step).catch(() => {}), wait);
  }
  const known = store.events.length > 0;
  const fresh = store.addEvents(await api.events(site, { limit: EVENTS }));
  // What happened during the gap is told; what happened before the page was opened is in the list.
  if (known && since !== null) events.notify(fresh.slice(0, 3));
  map.redraw('trails');
}

function moveMark(position: TagPosition): void {
  motion.move(position, store.tags.get(position.tag)?.name ?? position.tag, performance.now());
}

async function follow(): Promise<void> {
  live?.stop();
  live = null;
  const site = store.site?.name;
  if (site === undefined) return;
  let changed: ReturnType<typeof setTimeout> | undefined;
  live = new Live(() => new EventSource(api.updates(site)), {
    position(position) {
      if (!store.addPosition(position)) return;
      moveMark(position);
      if (!store.past) map.redraw('marks');
    },
    event(event) {
      store.applyEvent(event);
      events.notify(store.addEvents([event]));
    },
    changed() {
      clearTimeout(changed);
      changed = setTimeout(() => {
        void Promise.all([reload('sites'), reload('tags'), reload('nodes'), reload('zones')]).catch(() => {});
      }, CHANGED_WAIT_MS);
    },
    fill: (since) => fill(site, since),
    connection(next) {
      connection = next;
      showConnection();
      if (next === 'reconnecting') void whoAmI().catch(() => {});
    },
  });
  live.start();
}

/// Whether a token is needed; asks for it.
async function whoAmI(): Promise<boolean> {
  store.me = await api.me();
  store.tell('me');
  const missing = store.me.role === null;
  loginButton.hidden = !missing;
  logoutButton.hidden = !store.me.tokens || missing;
  if (missing) ask();
  return !missing;
}

async function begin(): Promise<void> {
  try {
    if (!(await whoAmI())) return;
    await reload('sites');
  } catch {
    connection = 'reconnecting';
    showConnection();
    setTimeout(() => void begin(), 2000);
    return;
  }
  if (store.site === null) {
    connection = 'live';
    showConnection();
  }
  await follow();
}

document.addEventListener('visibilitychange', () => {
  if (document.visibilityState === 'visible') live?.refresh(ASLEEP_MS);
});
setInterval(() => {
  if (document.visibilityState !== 'visible' || connection !== 'live') return;
  if (store.site === null) void begin();
  // A session may have ended.
  else void reload('tags').catch(() => whoAmI().catch(() => {}));
}, TAGS_EVERY_MS);

// What the tests and a person with the developer tools look at.
Object.assign(window, { baliza: { map, store, motion } });

speak(language());
loginButton.hidden = true;
logoutButton.hidden = true;
openPanel(0);
void begin();
