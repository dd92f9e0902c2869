// Events and alarms: the list, newest first, and notices of those that a person should see at once.

import { attempt, type App, type Panel } from '../app.js';
import { api } from '../api.js';
import { button, empty, field, h } from '../dom.js';
import { duration, t, time } from '../i18n.js';
import { EVENT_KINDS, type StationEvent } from '../model.js';
import { beep } from './toasts.js';

const PAGE = 100;
const SOUND = 'baliza.sound';

export function textOf(app: App, event: StationEvent): string {
  const node = app.store.nameOf(event.node);
  const dwell = event.dwell_s === null ? '–' : duration(event.dwell_s);
  return t(`events.${event.kind}`, { node, zone: event.zone ?? '–', dwell });
}

export function eventsPanel(app: App): Panel & { notify(events: readonly StationEvent[]): void } {
  const { store } = app;
  const none = empty('events.none');
  const list = h('ol', { class: 'rows events', label: 'tab.events' });
  const kind = h(
    'select',
    { attributes: { id: 'event-kind' }, on: { change: () => update() } },
    h('option', { t: 'events.all', attributes: { value: '' } }),
    ...EVENT_KINDS.map((k) => h('option', { t: `kind.${k}`, attributes: { value: k } })),
  );
  const sound = h('input', {
    attributes: { type: 'checkbox', id: 'sound' },
    on: {
      change: () => {
        localStorage.setItem(SOUND, String(sound.checked));
        if (sound.checked) beep();
      },
    },
  });
  sound.checked = localStorage.getItem(SOUND) === 'true';
  const more = button('events.more', () => void older());
  const element = h(
    'div',
    {},
    field('events.kind', kind),
    h('label', { class: 'check' }, sound, h('span', { t: 'events.sound' })),
    none,
    list,
    more,
  );
  let shown = false;

  function update(): void {
    if (!shown) return;
    const events = store.events.filter((event) => kind.value === '' || event.kind === kind.value);
    none.hidden = store.events.length > 0;
    more.hidden = store.events.length === 0;
    list.replaceChildren(
      ...events.map((event) =>
        h(
          'li',
          { class: event.alarm ? 'alarm' : '' },
          h('time', { attributes: { datetime: event.t } }, time(event.t)),
          h('span', {}, event.alarm ? `${t('alarm')}: ${textOf(app, event)}` : textOf(app, event)),
        ),
      ),
    );
  }

  async function older(): Promise<void> {
    const oldest = store.events[store.events.length - 1];
    if (store.site === null || oldest === undefined) return;
    const query = { before: oldest.id, limit: PAGE, ...(kind.value === '' ? {} : { kind: kind.value }) };
    const site = store.site.name;
    await attempt(app, async () => {
      more.disabled = store.addEvents(await api.events(site, query)).length === 0;
    });
  }

  store.on(['events', 'language', 'tags', 'site'], update);
  store.on('site', () => (more.disabled = false));
  kind.addEventListener('change', () => (more.disabled = false));
  return {
    key: 'tab.events',
    element,
    shown: (is) => {
      shown = is;
      update();
    },
    notify(events) {
      for (const event of events) {
        const urgent = event.alarm || event.kind === 'moved';
        if (!urgent && event.kind !== 'silent' && event.kind !== 'uncertain') continue;
        const message = event.alarm ? `${t('alarm')}: ${textOf(app, event)}` : textOf(app, event);
        app.toasts.show(message, urgent ? 'bad' : 'plain');
        if (urgent && sound.checked) beep();
      }
    },
  };
}
