// Writes the pictures of docs/ from a real station: the map, a zone with its alarm, the history, the anchors, a survey.

import { mkdir, stat } from 'node:fs/promises';
import { fileURLToPath } from 'node:url';
import type { TagPosition } from '../src/model.js';
import { chromiumPath, launch } from './chromium.js';
import { drawZone, get, live, until } from './page.js';
import { Station } from './station.js';

const docs = fileURLToPath(new URL('../../../../docs', import.meta.url));
const MOST = 200_000;
/// Long enough for trails and a chart.
const HISTORY_MS = 60_000;

const path = chromiumPath();
if (path === null) throw new Error('no chromium (apt-get install chromium, or CHROMIUM=…)');
const station = await new Station(['--simulate']).start();
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
} finally {
  await browser.close();
  await station.stop();
}
