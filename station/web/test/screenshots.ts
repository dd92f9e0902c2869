// Writes the pictures of docs/: the map, the history, the anchors.

import { mkdir, stat } from 'node:fs/promises';
import { fileURLToPath } from 'node:url';
import { chromiumPath, launch } from './chromium.js';
import { Mock, rooms } from './mock.js';

const dist = fileURLToPath(new URL('../../dist', import.meta.url));
const docs = fileURLToPath(new URL('../../../../docs', import.meta.url));
const MOST = 200_000;

const path = chromiumPath();
if (path === null) throw new Error('no chromium (apt-get install chromium, or CHROMIUM=…)');
const mock = new Mock({ tags: 10, rateHz: 10 }, dist);
mock.zones = rooms();
await mock.start();
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

await page.goto(mock.url);
await page.locator('#tags li').first().waitFor();
// The trails of the first minute are read from the history.
await page.waitForTimeout(3000);
await page.locator('#tags li').nth(1).click();
await page.getByRole('button', { name: 'Show all' }).click();
await page.waitForTimeout(500);
await shoot('station-map.png');

await page.click('#tab-history');
await page.getByRole('button', { name: 'Last hour' }).click();
await page.locator('.chart .uplot').waitFor();
await page.check('#heat');
await page.locator('#slider').fill('1800');
await page.locator('#layer-trails').evaluate((box: HTMLInputElement) => box.click());
await page.waitForTimeout(500);
await shoot('station-history.png');
await page.getByRole('button', { name: 'Back to live' }).click();

await page.click('#tab-health');
await page.locator('#health tbody tr').first().waitFor();
await page.waitForTimeout(500);
await shoot('station-health.png');
await browser.close();
await mock.stop();
