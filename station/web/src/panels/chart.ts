// A chart of lines over time, by uPlot.

import uPlot from 'uplot';
import { h } from '../dom.js';
import { clock, number, t, time } from '../i18n.js';

/// Between two times of the axis.
const STEPS_S = [1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 14_400, 43_200, 86_400];

/// A line, with a value for each time of the chart; null: a gap. Lines of one unit share an axis.
export interface Line {
  name: string;
  unit: string;
  digits: number;
  colour: '--chart-x' | '--chart-y' | '--chart-s';
  /// What the axis shows at least.
  least?: [number, number];
  values: (number | null)[];
}

const rangeOf = ([low, high]: [number, number]): uPlot.Scale => ({
  range: (_plot, min, max) => [Math.min(low, min ?? low), Math.max(high, max ?? high)],
});

export class Chart {
  readonly element = h('div', { class: 'chart' });
  private plot: uPlot | null = null;

  /// `times` are ms; `words` say what is shown to those who do not see it.
  show(title: string, words: string, times: readonly number[], lines: readonly Line[]): void {
    this.plot?.destroy();
    this.plot = null;
    this.element.hidden = times.length === 0;
    if (times.length === 0) return;
    const style = getComputedStyle(document.documentElement);
    const of = (variable: string) => style.getPropertyValue(variable).trim();
    const axis = {
      stroke: of('--text'),
      grid: { stroke: of('--map-grid'), width: 1 },
      ticks: { stroke: of('--map-grid') },
    };
    const short = times[times.length - 1] - times[0] < 300_000;
    const units = [...new Set(lines.map((line) => line.unit))];
    const options: uPlot.Options = {
      width: Math.max(this.element.clientWidth, 240),
      height: 220,
      title,
      legend: { live: true },
      scales: {
        x: { time: true },
        ...Object.fromEntries(lines.map(({ unit, least }) => [unit, least === undefined ? {} : rangeOf(least)])),
      },
      axes: [
        { ...axis, space: 65, incrs: STEPS_S, values: (_plot, splits) => splits.map((s) => clock(s * 1000, short)) },
        // The first unit's axis is on the left, and has the grid.
        ...units.map((scale, i) => ({
          ...axis,
          scale,
          size: 44,
          ...(units.length > 1 ? { label: scale, labelSize: 20 } : {}),
          ...(i > 0 ? { side: 1 as const, grid: { show: false } } : {}),
        })),
      ],
      series: [
        { label: t('time'), value: (_plot, value) => (value === null ? '–' : time(value * 1000)) },
        ...lines.map(
          ({ name, unit, digits, colour }): uPlot.Series => ({
            label: `${name} (${unit})`,
            scale: unit,
            stroke: of(colour),
            width: 1.5,
            points: { show: false },
            // uPlot draws a line through gaps and cuts it off there, a pixel too late.
            gaps: (_plot, _line, _first, _last, gaps) => gaps.map(([from, to]) => [from - 2, to + 2]),
            value: (_plot, value) => (value === null ? '–' : number(value, digits)),
          }),
        ),
      ],
    };
    const data: uPlot.AlignedData = [times.map((at) => at / 1000), ...lines.map((line) => line.values)];
    this.plot = new uPlot(options, data, this.element);
    this.plot.root.setAttribute('role', 'img');
    this.plot.root.setAttribute('aria-label', `${title}: ${words}`);
  }
}
