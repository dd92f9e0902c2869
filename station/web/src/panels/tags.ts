// The tags: list with search, whose choice centres the map, and the same as a table for who cannot see the map.

import { api } from '../api.js';
import { attempt, type App, type Panel } from '../app.js';
import { button, empty, h, setText } from '../dom.js';
import { inOrder, number, supply, t, time } from '../i18n.js';
import { colourOf } from '../map/draw.js';
import { otherPlace } from '../map/motion.js';
import type { Tag, TagMessage, TagPosition } from '../model.js';

const EVERY_MS = 1000;
/// How long a tag's light flashes.
const FLASHES_S = 30;
/// How often the station is asked whether the tag has answered.
const LOOKS = 10;

interface Row {
  item: HTMLElement;
  dot: HTMLElement;
  name: HTMLElement;
  where: HTMLElement;
}

export function sigmaOf(tag: Tag): number {
  const p = tag.last_position;
  return p === null ? NaN : Math.hypot(p.sigma_x_m, p.sigma_y_m);
}

/// What makes a position doubtful, to stand after it; nothing of one that is not.
function doubtOf(position: TagPosition): string {
  const other = otherPlace(position);
  if (other !== null) return ` · ${t('tags.ambiguous', { x: number(other.x, 2), y: number(other.y, 2) })}`;
  return position.doubt === null ? '' : ` · ${t('tags.suspect')}`;
}

/// Lets a tag flash its light, and says what became of that.
async function identify(app: App, tag: string): Promise<void> {
  const named = app.store.tags.get(tag)?.name ?? tag;
  const told: Pick<TagMessage, 'state'> = { state: 'waiting' };
  const ask = async () => {
    const { id } = await api.identify(tag, FLASHES_S);
    for (let look = 0; look < LOOKS && told.state === 'waiting'; look++) {
      await new Promise((resolve) => setTimeout(resolve, EVERY_MS));
      told.state = (await api.messages(tag)).find((one) => one.id === id)?.state ?? 'expired';
    }
  };
  if (!(await attempt(app, ask))) return;
  const { state } = told;
  if (state === 'taken') app.toasts.show(t('tags.flashes', { tag: named, seconds: FLASHES_S }), 'good');
  else if (state === 'waiting') app.toasts.show(t('tags.asleep', { tag: named }));
  else app.toasts.show(t('tags.refuses', { tag: named, state }), 'bad');
}

export function tagsPanel(app: App): Panel {
  const { store, map } = app;
  const rows = new Map<string, Row>();
  const search = h('input', {
    label: 'tags.search',
    placeholder: 'tags.search',
    attributes: { type: 'search', id: 'search', autocomplete: 'off' },
    on: { input: () => update() },
  });
  const count = h('p', { class: 'count', attributes: { role: 'status' } });
  const list = h('ul', {
    class: 'list',
    label: 'tags.list',
    attributes: { role: 'listbox', tabindex: 0, id: 'tags' },
    on: { keydown: (event) => key(event) },
  });
  const none = empty('tags.none', 'baliza serve --simulate');
  const noMatch = empty('tags.nomatch');
  const body = h('tbody');
  const head = h('tr', {}, h('th', { t: 'tag' }));
  for (const text of ['x (m)', 'y (m)', '± (m)']) head.append(h('th', {}, text));
  head.append(h('th', { t: 'room' }), h('th', { t: 'zones.zones' }), h('th', { t: 'rate' }));
  head.append(h('th', { t: 'health.supply' }), h('th', { t: 'time' }));
  for (const cell of head.children) cell.setAttribute('scope', 'col');
  const table = h(
    'details',
    { attributes: { id: 'table' }, on: { toggle: () => update() } },
    h('summary', { t: 'tags.table' }),
    h(
      'div',
      { class: 'scroll', label: 'tags.table', attributes: { tabindex: 0, role: 'region' } },
      h('table', {}, h('thead', {}, head), body),
    ),
  );
  const flash = button('tags.identify', () => {
    if (store.selected !== null) void identify(app, store.selected);
  });
  flash.id = 'identify';
  const element = h('div', {}, search, count, none, noMatch, list, flash, table);
  let shown = true;

  function matching(): Tag[] {
    const words = search.value.trim().toLowerCase();
    return [...store.tags.values()]
      .filter((tag) => `${tag.name ?? ''} ${tag.tag} ${tag.last_position?.room ?? ''}`.toLowerCase().includes(words))
      .sort((a, b) => inOrder(a.name ?? a.tag, b.name ?? b.tag));
  }

  function where(tag: Tag): string {
    const p = tag.last_position;
    if (tag.silent) return t('tags.silent', { time: time(tag.last_seen) });
    if (tag.reason !== null) return t('tags.nowhere', { reason: tag.reason });
    if (p === null) return '–';
    const place = `${number(p.x_m, 2)}, ${number(p.y_m, 2)} ± ${number(sigmaOf(tag), 2)} m${doubtOf(p)}`;
    return p.room === null ? place : `${p.room} · ${place}`;
  }

  function choose(id: string): void {
    store.select(id);
    const p = store.tags.get(id)?.last_position;
    if (p !== null && p !== undefined && !store.past) map.centreOn({ x: p.x_m, y: p.y_m });
  }

  function rowOf(tag: Tag): Row {
    let row = rows.get(tag.tag);
    if (row === undefined) {
      const dot = h('span', { class: 'dot', attributes: { 'aria-hidden': 'true' } });
      const name = h('span', { class: 'name' });
      const where = h('span', { class: 'where' });
      const id = tag.tag;
      const attributes = { role: 'option', id: `tag-${rows.size}`, 'data-tag': id };
      const item = h('li', { attributes, on: { click: () => choose(id) } }, dot, name, where);
      row = { item, dot, name, where };
      rows.set(id, row);
    }
    return row;
  }

  function update(): void {
    if (!shown) return;
    const tags = matching();
    none.hidden = store.tags.size > 0;
    noMatch.hidden = tags.length > 0 || store.tags.size === 0;
    list.hidden = tags.length === 0;
    table.hidden = tags.length === 0;
    // Phones and other devices that receivers locate have no address, and take no messages.
    flash.hidden = store.past || store.selected === null || !/^0x[0-9a-f]{4}$/i.test(store.selected);
    setText(count, t('tags.count', { shown: tags.length, all: store.tags.size }));
    const items = tags.map((tag) => {
      const row = rowOf(tag);
      row.dot.style.background = colourOf(tag.tag, map.dark);
      setText(row.name, tag.name ?? tag.tag);
      setText(row.where, where(tag));
      row.item.classList.toggle('silent', tag.silent);
      row.item.setAttribute('aria-selected', String(tag.tag === store.selected));
      return row.item;
    });
    if (items.length !== list.childElementCount || items.some((item, i) => list.children[i] !== item)) {
      list.replaceChildren(...items);
    }
    const active = store.selected === null ? undefined : rows.get(store.selected)?.item;
    if (active?.isConnected === true) list.setAttribute('aria-activedescendant', active.id);
    else list.removeAttribute('aria-activedescendant');
    if (table.open) fillTable(tags);
  }

  function fillTable(tags: readonly Tag[]): void {
    while (body.childElementCount > tags.length) body.lastElementChild?.remove();
    tags.forEach((tag, i) => {
      const p = tag.last_position;
      const cells = [
        tag.name ?? tag.tag,
        p === null ? '–' : number(p.x_m, 2),
        p === null ? '–' : number(p.y_m, 2),
        p === null ? '–' : number(sigmaOf(tag), 2),
        p?.room ?? '–',
        tag.zones.join(', ') || '–',
        `${number(tag.rate_hz, 1)} Hz`,
        supply(tag.supply_v),
        time(tag.last_seen),
      ];
      let row = body.children[i];
      if (row === undefined) {
        row = h('tr', {}, h('th', { attributes: { scope: 'row' } }), ...cells.slice(1).map(() => h('td')));
        body.append(row);
      }
      cells.forEach((cell, j) => setText(row.children[j], cell));
    });
  }

  function key(event: KeyboardEvent): void {
    const items = [...list.children] as HTMLElement[];
    const now = items.findIndex((item) => item.dataset.tag === store.selected);
    const next: Record<string, number> = {
      ArrowDown: Math.min(now + 1, items.length - 1),
      ArrowUp: Math.max(now - 1, 0),
      Home: 0,
      End: items.length - 1,
      PageDown: Math.min(now + 10, items.length - 1),
      PageUp: Math.max(now - 10, 0),
      Enter: now,
    };
    const item = items[next[event.key] ?? -1];
    if (item === undefined) return;
    event.preventDefault();
    choose(item.dataset.tag ?? '');
    item.scrollIntoView({ block: 'nearest' });
  }

  store.on(['tags', 'selection', 'language', 'site'], update);
  store.on('selection', () => {
    const row = store.selected === null ? undefined : rows.get(store.selected);
    row?.item.scrollIntoView({ block: 'nearest' });
  });
  let site = store.site?.name;
  store.on('site', () => {
    if (site !== store.site?.name) rows.clear();
    site = store.site?.name;
  });
  setInterval(() => {
    if (document.visibilityState === 'visible') update();
  }, EVERY_MS);
  return {
    key: 'tab.tags',
    element,
    shown: (is) => {
      shown = is;
      update();
    },
  };
}
