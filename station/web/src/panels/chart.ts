// A chart of a tag's x, y and sigma over time, by uPlot.

import uPlot from 'uplot';
import { h } from '../dom.js';
import { clock, number, t, time } from '../i18n.js';

/// Between two times of the axis.
const STEPS_S = [1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 14_400, 43_200, 86_400];

export interface ChartRow {
  /// ms.
  t: number;
  x: number;
  y: number;
  s: number;
}

export class Chart {
  readonly element = h('div', { class: 'chart' });
  private plot: uPlot | null = null;

  show(rows: readonly ChartRow[], name: string): void {
    this.plot?.destroy();
    this.plot = null;
    this.element.hidden = rows.length === 0;
    if (rows.length === 0) return;
    const style = getComputedStyle(document.documentElement);
    const of = (variable: string) => style.getPropertyValue(variable).trim();
    const axis = {
      stroke: of('--text'),
      grid: { stroke: of('--map-grid'), width: 1 },
      ticks: { stroke: of('--map-grid') },
    };
    const short = rows[rows.length - 1].t - rows[0].t < 300_000;
    const line = (label: string, colour: string): uPlot.Series => ({
      label,
      stroke: colour,
      width: 1.5,
      points: { show: false },
      value: (_plot, value) => (value === null ? '–' : number(value, 2)),
    });
    const options: uPlot.Options = {
      width: Math.max(this.element.clientWidth, 240),
      height: 220,
      title: name,
      legend: { live: true },
      scales: { x: { time: true } },
      axes: [
        { ...axis, space: 65, incrs: STEPS_S, values: (_plot, splits) => splits.map((s) => clock(s * 1000, short)) },
        { ...axis, size: 44 },
      ],
      series: [
        { label: t('time'), value: (_plot, value) => (value === null ? '–' : time(value * 1000)) },
        line('x (m)', of('--chart-x')),
        line('y (m)', of('--chart-y')),
        line('σ (m)', of('--chart-s')),
      ],
    };
    const data: uPlot.AlignedData = [
      rows.map((row) => row.t / 1000),
      rows.map((row) => row.x),
      rows.map((row) => row.y),
      rows.map((row) => row.s),
    ];
    this.plot = new uPlot(options, data, this.element);
    this.plot.root.setAttribute('role', 'img');
    this.plot.root.setAttribute('aria-label', `${name}: ${t('history.chart.help')}`);
  }
}
