// The geographic origin: where the point x = 0, y = 0 of the site is on the earth, and how the axes are turned.

import { attempt, type App } from '../app.js';
import { api } from '../api.js';
import { button, carefulButton, editForm, field, h, setText } from '../dom.js';
import { number, parseNumber, t, type Key } from '../i18n.js';
import type { GeographicOrigin } from '../model.js';

export type OriginKey = keyof GeographicOrigin;

/// The least and the greatest value of each key, as the station has them (`positioning_core::geodesy`).
const BOUNDS: Record<OriginKey, { least: number; greatest: number; isRequired: boolean }> = {
  latitude_deg: { least: -90, greatest: 90, isRequired: true },
  longitude_deg: { least: -180, greatest: 180, isRequired: true },
  y_azimuth_deg: { least: -360, greatest: 360, isRequired: true },
  height_m: { least: -5000, greatest: 10_000, isRequired: false },
  geoid_separation_m: { least: -120, greatest: 120, isRequired: false },
};
const KEYS = Object.keys(BOUNDS) as OriginKey[];

/// Typed values to an origin, or the first key whose value is wrong.
export function parseOrigin(typed: Readonly<Record<OriginKey, string>>): GeographicOrigin | OriginKey {
  const origin: Partial<GeographicOrigin> = {};
  for (const key of KEYS) {
    const { least, greatest, isRequired } = BOUNDS[key];
    if (typed[key].trim() === '' && !isRequired) continue;
    const value = parseNumber(typed[key]);
    if (!(value >= least && value <= greatest)) return key;
    origin[key] = value;
  }
  return origin as GeographicOrigin;
}

function describe(origin: GeographicOrigin): string {
  const { latitude_deg, longitude_deg, y_azimuth_deg, height_m, geoid_separation_m } = origin;
  const parts = [
    // Seven decimals of a degree are a centimetre.
    t('origin.at', { latitude: number(latitude_deg, 7), longitude: number(longitude_deg, 7) }),
    t('origin.azimuth', { azimuth: number(y_azimuth_deg, 2) }),
  ];
  // An answer leaves out what is unknown; a request may say null.
  if (typeof height_m === 'number') parts.push(t('origin.height', { height: number(height_m, 2) }));
  if (typeof geoid_separation_m === 'number') {
    parts.push(t('origin.separation', { separation: number(geoid_separation_m, 2) }));
  }
  return parts.join(' · ');
}

/// The origin of the shown site as text, and for administrators the form that changes it.
export function originEditor(app: App): { element: HTMLElement; close: () => void } {
  const { store } = app;
  /// The site whose origin is edited.
  let site = '';
  /// The key whose value was wrong when it was to be saved.
  let wrong: OriginKey | null = null;

  const about = h('p', { attributes: { id: 'origin-about' } });
  const open = button('origin.set', () => edit());
  const inputs = Object.fromEntries(
    KEYS.map((key) => {
      // Not of type number: the keyboard of some phones would have no minus.
      const isRequired = String(BOUNDS[key].isRequired);
      const attributes = { id: `origin-${key}`, autocomplete: 'off', 'aria-required': isRequired };
      return [key, h('input', { attributes })];
    }),
  ) as Record<OriginKey, HTMLInputElement>;
  const problem = h('p', { class: 'problem', attributes: { role: 'alert', id: 'origin-problem' } });
  const remove = carefulButton('delete', () => void drop());
  const form = editForm(
    { id: 'origin-form', label: 'origin', save: () => void save(), close: () => close(), remove },
    h('p', { t: 'origin.help', class: 'help' }),
    ...KEYS.map((key) => field(`origin.${key}`, inputs[key])),
    problem,
  );
  const element = h('div', {}, h('h3', { t: 'origin' }), about, h('div', { class: 'buttons' }, open), form);

  /// Says below its field which value is wrong.
  function showProblem(): void {
    for (const input of Object.values(inputs)) {
      input.removeAttribute('aria-invalid');
      input.removeAttribute('aria-describedby');
    }
    if (wrong === null) return setText(problem, '');
    const { least, greatest } = BOUNDS[wrong];
    inputs[wrong].parentElement?.after(problem);
    setText(problem, t('origin.wrong', { field: t(`origin.${wrong}`), least, greatest }));
    inputs[wrong].setAttribute('aria-invalid', 'true');
    inputs[wrong].setAttribute('aria-describedby', problem.id);
  }

  function edit(): void {
    if (store.site === null) return;
    const { name, geographic_origin: origin } = store.site;
    site = name;
    for (const key of KEYS) inputs[key].value = String(origin?.[key] ?? '');
    remove.hidden = origin === null;
    wrong = null;
    showProblem();
    form.hidden = false;
    open.hidden = true;
    inputs.latitude_deg.focus();
  }

  function close(): void {
    const wasInside = form.contains(document.activeElement);
    form.hidden = true;
    update();
    if (wasInside) open.focus();
  }

  async function save(): Promise<void> {
    const typed = Object.fromEntries(KEYS.map((key) => [key, inputs[key].value])) as Record<OriginKey, string>;
    const origin = parseOrigin(typed);
    wrong = typeof origin === 'string' ? origin : null;
    showProblem();
    if (typeof origin === 'string') return inputs[origin].focus();
    await change('saved', () => api.putGeographicOrigin(site, origin));
  }

  async function drop(): Promise<void> {
    await change('deleted', () => api.deleteGeographicOrigin(site));
  }

  async function change(what: 'saved' | 'deleted', send: () => Promise<unknown>): Promise<void> {
    const done = await attempt(app, async () => {
      await send();
      await app.reload('sites');
    });
    if (!done) return;
    app.toasts.show(t(what, { name: t('origin') }), 'good');
    close();
  }

  function update(): void {
    const may = store.mayAdminister && store.site !== null;
    if (!form.hidden && (!may || store.site?.name !== site)) return close();
    const origin = store.site?.geographic_origin ?? null;
    setText(about, origin === null ? t('origin.none') : describe(origin));
    const key: Key = origin === null ? 'origin.set' : 'origin.change';
    open.dataset.t = key;
    setText(open, t(key));
    open.hidden = !may || !form.hidden;
  }

  store.on(['site', 'language', 'me'], update);
  store.on('language', showProblem);
  return { element, close };
}
