// Writes the pictures of docs/use/station/ from real stations: the map, a zone with its alarm, the history, the
// anchors, a survey, a plan that is scaled by two clicks, and the login.

import { mkdir, stat } from 'node:fs/promises';
import { fileURLToPath } from 'node:url';
import type { TagPosition } from '../src/model.js';
import { chromiumPath, launch } from './chromium.js';
import { drawZone, get, live, placePlan, until } from './page.js';
import { Station } from './station.js';

const docs = fileURLToPath(new URL('../../../../docs/use/station', import.meta.url));
const MOST = 200_000;
/// Long enough for trails and a chart.
const HISTORY_MS = 45_000;

/// A floor plan of 12 m by 8 m, 60 pixels a metre.
const FLOOR_PLAN = `<svg xmlns="http://www.w3.org/2000/svg" width="780" height="540" viewBox="-0.5 -0.5 13 9"
  fill="none" stroke="#444" stroke-width="0.2" font-family="sans-serif">
  <rect x="-0.5" y="-0.5" width="13" height="9" fill="#fff" stroke="none"/>
  <path d="M1.6 8H0V0H12V8H3.2M0 3H1.6"/>
  <path stroke-width="0.05" d="M1.6 8A1.6 1.6 0 0 1 3.2 6.4V8M11 1V4.6H11.7V1Z"/>
  <path stroke-width="0.05" d="M4.5 2H7V5.5H4.5ZM4.5 2L7 5.5M7 2L4.5 5.5M0.4 0.4H2V1.2H0.4Z"/>
  <g fill="#777" stroke="none" font-size="0.4" text-anchor="middle">
    <text x="5.75" y="6">Press</text><text x="11.3" y="5.1">Shelf</text><text x="1.2" y="2">Office</text>
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
const closeToasts = async () => {
  for (const close of await page.locator('.toast button').all()) await close.click({ timeout: 1000 }).catch(() => {});
};

try {
  await page.goto(station.url);
  await live(page);
  const history = () => get<TagPosition[]>(station.url, '/api/v1/positions?site=simulation&step_s=1&limit=10000');
  const span = (rows: TagPosition[]) => Date.parse(rows.at(-1)?.t ?? '') - Date.parse(rows[0]?.t ?? '');
  await until('enough history', history, (rows) => span(rows) > HISTORY_MS);
  await page.locator('#tags li').nth(1).click();
  await page.getByRole('button', { name: 'Show all' }).click();
  await shoot('map.png');

  await drawZone(page, 'Press', [4, 0.5, 11, 7]);
  await page.locator('.toast', { hasText: 'entered Press' }).first().waitFor();
  await page.locator('[data-zone="Press"]').waitFor();
  await shoot('zone.png');
  await closeToasts();

  await page.click('#tab-history');
  await page.getByRole('button', { name: 'Last 10 minutes' }).click();
  await page.locator('.chart .uplot').waitFor();
  await page.check('#heat');
  const end = Number(await page.locator('#slider').getAttribute('max'));
  await page.locator('#slider').fill(String(Math.round(end / 2)));
  await page.getByText(/Darkest: \d+ s/).waitFor();
  await shoot('history.png');
  await page.getByRole('button', { name: 'Back to live' }).click();

  await page.click('#tab-health');
  await page.locator('#health tbody tr').filter({ hasText: '%' }).nth(5).waitFor();
  await shoot('health.png');

  await page.click('#tab-survey');
  await page.fill('#campaign-name', 'ground floor');
  await page.fill('#campaign-spacing', '2');
  await page.getByRole('button', { name: 'Make it' }).click();
  await page.locator('#survey-go', { hasText: 'Go to point p1' }).waitFor();
  await page.getByRole('button', { name: 'Show all' }).click();
  await shoot('survey.png');

  // Its alarms would cover the plan.
  await fetch(`${station.url}/api/v1/rooms/simulation/Press`, { method: 'DELETE' });
  const drawing = await context.newPage();
  await drawing.setViewportSize({ width: 780, height: 540 });
  await drawing.setContent(`<body style="margin: 0">${FLOOR_PLAN}</body>`);
  const buffer = await drawing.screenshot();
  await drawing.close();
  await page.click('#tab-plan');
  await closeToasts();
  await placePlan(page, buffer, [[30, 510], [750, 510]], '12', ['0', '0']); // prettier-ignore
  await page.getByRole('button', { name: 'Show all' }).click();
  await closeToasts();
  await shoot('plan.png');

  await closed.start();
  await page.goto(closed.url);
  await page.locator('#login').waitFor();
  await shoot('login.png');
} finally {
  await browser.close();
  await station.stop();
  await closed.stop();
}
