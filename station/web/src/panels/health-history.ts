// The last 24 hours of an anchor's health, as a chart and in words.

import { attempt, type App } from '../app.js';
import { api } from '../api.js';
import { h, setText } from '../dom.js';
import { clock, number, signed, t } from '../i18n.js';
import type { NodeHealth } from '../model.js';
import { Chart } from './chart.js';

const SPAN_MS = 86_400_000;
/// One a minute.
const MOST_ROWS = 1440;
/// Rows that are farther apart have minutes between them in which the anchor was not seen.
const APART_MS = 90_000;

/// Success rates in % and residuals in m by time, ms; null where nothing is known.
export interface Curves {
  times: number[];
  success: (number | null)[];
  residual: (number | null)[];
}

/// The curves of rows, which are newest first. Between rows that are apart, there is a time of which nothing is known.
export function curvesOf(rows: readonly NodeHealth[]): Curves {
  const curves: Curves = { times: [], success: [], residual: [] };
  const add = (at: number, success: number | null, residual: number | null) => {
    curves.times.push(at);
    curves.success.push(success === null ? null : success * 100);
    curves.residual.push(residual);
  };
  for (const row of [...rows].reverse()) {
    const at = Date.parse(row.t);
    const last = curves.times.at(-1);
    if (last !== undefined && at - last > APART_MS) add((last + at) / 2, null, null);
    add(at, row.success_rate, row.residual_mean_m);
  }
  return curves;
}

/// When the anchor was worst, in words: the lowest success rate, and the residual that is farthest from zero.
export function worstOf({ times, success, residual }: Curves): string {
  const first = (values: (number | null)[], isWorse: (a: number, b: number) => boolean) => {
    let worst: { at: number; value: number } | null = null;
    for (const [i, value] of values.entries()) {
      if (value !== null && (worst === null || isWorse(value, worst.value))) worst = { at: times[i], value };
    }
    return worst;
  };
  const lowest = first(success, (a, b) => a < b);
  const farthest = first(residual, (a, b) => Math.abs(a) > Math.abs(b));
  const said: string[] = [];
  if (lowest !== null) {
    said.push(t('health.day.success', { value: `${number(lowest.value, 0)} %`, time: clock(lowest.at, false) }));
  }
  if (farthest !== null) {
    said.push(t('health.day.residual', { value: `${signed(farthest.value, 2)} m`, time: clock(farthest.at, false) }));
  }
  return said.join(' ');
}

export class HealthHistory {
  private readonly words = h('p', { class: 'help', attributes: { role: 'status' } });
  private readonly chart = new Chart();
  readonly element = h('div', { attributes: { id: 'health-day', hidden: true } }, this.chart.element, this.words);
  /// The anchor that is shown; null: none is.
  node: string | null = null;
  /// Null while they are loading.
  private curves: Curves | null = null;

  constructor(private readonly app: App) {}

  /// Loads and shows an anchor's history; null hides it.
  async show(node: string | null): Promise<void> {
    const { site } = this.app.store;
    this.node = site === null ? null : node;
    this.curves = null;
    this.write();
    if (site === null || node === null) return;
    const from = new Date(Date.now() - SPAN_MS).toISOString();
    const done = await attempt(this.app, async () => {
      const rows = await api.nodeHealth(site.name, node, from, MOST_ROWS);
      if (this.node !== node || this.app.store.site?.name !== site.name) return;
      this.curves = curvesOf(rows);
      this.write();
      this.element.scrollIntoView({ block: 'nearest' });
    });
    if (!done && this.node === node) await this.show(null);
  }

  /// Writes what is known, in the current language and colours.
  write(): void {
    this.element.hidden = this.node === null;
    if (this.node === null) return;
    const name = this.app.store.nameOf(this.node);
    const curves = this.curves ?? curvesOf([]);
    const worst = worstOf(curves);
    const none = this.curves === null ? t('history.loading') : t('health.day.none', { name });
    setText(this.words, worst === '' ? none : worst);
    const times = worst === '' ? [] : curves.times;
    const { success, residual } = curves;
    this.chart.show(t('health.day', { name }), `${t('health.day.help')} ${worst}`, times, [
      { name: t('health.success'), unit: '%', digits: 0, colour: '--chart-x', least: [0, 100], values: success },
      // Beyond half a metre, the default of the station, an anchor counts as moved.
      { name: t('health.residual'), unit: 'm', digits: 2, colour: '--chart-y', least: [-0.5, 0.5], values: residual },
    ]);
  }
}
