// Writes the pictures of docs/ from real stations: the map, a zone with its alarm, the history, the anchors, a survey, a
// plan that is scaled by two clicks, and the login.

import { mkdir, stat } from 'node:fs/promises';
import { fileURLToPath } from 'node:url';
import type { TagPosition } from '../src/model.js';
import { chromiumPath, launch } from './chromium.js';
import { clickPixel, drawZone, get, live, until } from './page.js';
import { Station } from './station.js';

const docs = fileURLToPath(new URL('../../../../docs', import.meta.url));
const MOST = 200_000;
/// Long enough for trails and a chart.
const HISTORY_MS = 60_000;

/// A floor plan of 20 m by 12 m, 40 pixels a metre, as an architect's program would draw it.
const FLOOR_PLAN = `<svg xmlns="http://www.w3.org/2000/svg" width="880" height="560" viewBox="-1 -1 22 14"
  fill="none" stroke="#444" stroke-width="0.25" font-family="sans-serif">
  <rect x="-1" y="-1" width="22" height="14" fill="#fff" stroke="none"/>
  <path d="M12 12H0V0H20V12H14M0 7.5H5M7 7.5H13V7.5M15 7.5H20M8 0V3M8 5V7.5M14 0V3M14 5V7.5"/>
  <path stroke-width="0.06" d="M12 12A2 2 0 0 1 14 10V12M5 7.5A2 2 0 0 1 7 5.5V7.5M13 7.5A2 2 0 0 0 15 9.5V7.5"/>
  <g fill="#777" stroke="none" font-size="0.7" text-anchor="middle">
    <text x="4" y="4">Office</text><text x="11" y="4">Press</text><text x="17" y="4">Store</text>
    <text x="7" y="10">Hall</text>
  </g>
</svg>`;

const path = chromiumPath();
if (path === null) throw new Error('no chromium (apt-get install chromium, or CHROMIUM=…)');
const station = await new Station(['--simulate']).start();
const closed = Station.withTokens(['--simulate']);
const browser = await launch(path);
const viewport = { width: 1180, height: 700 };
const context = await browser.newContext({ viewport, colorScheme: 'light', locale: 'en-GB' });
const page = await context.newPage();
await mkdir(docs, { recursive: true });
const shoot = async (name: string) => {
  const file = `${docs}/${name}`;
  await page.screenshot({ path: file });
  const { size } = await stat(file);
  console.log(`${name}: ${(size / 1000).toFixed(0)} kB`);
  if (size > MOST) throw new Error(`${name} is greater than ${MOST} bytes`);
};

try {
  await page.goto(station.url);
  await live(page);
  const history = () => get<TagPosition[]>(station.url, '/api/v1/positions?site=simulation&step_s=1&limit=10000');
  const span = (rows: TagPosition[]) => Date.parse(rows.at(-1)?.t ?? '') - Date.parse(rows[0]?.t ?? '');
  await until('a minute of history', history, (rows) => span(rows) > HISTORY_MS);
  await page.locator('#tags li').nth(1).click();
  await page.getByRole('button', { name: 'Show all' }).click();
  await shoot('station-map.png');

  await drawZone(page, 'Press', [4, 0.5, 11, 7]);
  await page.locator('.toast', { hasText: 'entered Press' }).first().waitFor();
  await page.locator('[data-zone="Press"]').waitFor();
  await shoot('station-zone.png');
  for (const close of await page.locator('.toast button').all()) await close.click().catch(() => {});

  await page.click('#tab-history');
  await page.getByRole('button', { name: 'Last 10 minutes' }).click();
  await page.locator('.chart .uplot').waitFor();
  await page.check('#heat');
  const end = Number(await page.locator('#slider').getAttribute('max'));
  await page.locator('#slider').fill(String(Math.round(end / 2)));
  await page.getByText(/Darkest: \d+ s/).waitFor();
  await shoot('station-history.png');
  await page.getByRole('button', { name: 'Back to live' }).click();

  await page.click('#tab-health');
  await page.locator('#health tbody tr').filter({ hasText: '%' }).nth(5).waitFor();
  await shoot('station-health.png');

  await page.click('#tab-survey');
  await page.fill('#campaign-name', 'ground floor');
  await page.fill('#campaign-spacing', '2');
  await page.getByRole('button', { name: 'Make it' }).click();
  await page.locator('#survey-go', { hasText: 'Go to point p1' }).waitFor();
  await page.getByRole('button', { name: 'Show all' }).click();
  await shoot('station-survey.png');

  const drawing = await context.newPage();
  await drawing.setViewportSize({ width: 880, height: 560 });
  await drawing.setContent(`<body style="margin: 0">${FLOOR_PLAN}</body>`);
  const buffer = await drawing.screenshot();
  await drawing.close();
  await page.click('#tab-plan');
  await page.setInputFiles('#plan-file', { name: 'plan.png', mimeType: 'image/png', buffer });
  await page.locator('#plan-distance').waitFor();
  await clickPixel(page, 40, 520);
  await clickPixel(page, 840, 520);
  await page.fill('#plan-distance', '20');
  await shoot('station-plan.png');

  await closed.start();
  await page.goto(closed.url);
  await page.locator('#login').waitFor();
  await shoot('station-login.png');
} finally {
  await browser.close();
  await station.stop();
  await closed.stop();
}
