// What the tests in a browser have in common: a page with the faults that it reports, and hands on its map.

import assert from 'node:assert/strict';
import type { TestContext } from 'node:test';
import type { Browser, BrowserContextOptions, Page } from 'playwright-core';
import type { MapView } from '../src/map/map.js';
import type { Motion } from '../src/map/motion.js';
import type { Site } from '../src/model.js';
import type { Store } from '../src/store.js';

/// The longest wait for anything: a machine may have other things to do.
export const PATIENCE_MS = 60_000;
const AGAIN_MS = 100;

/// What the page gives to those who look into it.
export interface Inside {
  baliza: { map: MapView; store: Store; motion: Motion };
}

/// Opens the page; at the end of the test, it must not have said that anything is wrong.
export async function visit(
  t: TestContext,
  browser: Browser,
  url: string,
  wanted: BrowserContextOptions = {},
  /// Other places that the browser may go to.
  others: readonly string[] = [],
): Promise<Page> {
  const context = await browser.newContext({ viewport: { width: 1280, height: 800 }, locale: 'en-GB', ...wanted });
  const page = await context.newPage();
  page.setDefaultTimeout(PATIENCE_MS);
  const faults: string[] = [];
  page.on('pageerror', (error) => faults.push(error.message));
  page.on('console', (message) => {
    if (message.type() === 'error' && !/Failed to load resource|ERR_/.test(message.text())) faults.push(message.text());
  });
  page.on('request', (request) => {
    const may = [url, ...others].some((place) => request.url().startsWith(place));
    if (!/^(data|blob):/.test(request.url()) && !may) faults.push(request.url());
  });
  t.after(async () => {
    await context.close();
    assert.deepEqual(faults, []);
  });
  await page.goto(url);
  return page;
}

/// Waits until the page shows live tags.
export async function live(page: Page): Promise<void> {
  await page.locator('#state.live').waitFor();
  await rows(page).first().waitFor();
}

export const rows = (page: Page) => page.locator('#tags li');

/// Clicks on the map at a point in metres.
export async function clickAt(page: Page, x: number, y: number): Promise<void> {
  const p = await page.evaluate(
    ([px, py]) => {
      const { map } = (window as unknown as Inside).baliza;
      const at = map.screenOf({ x: px, y: py });
      const box = map.element.getBoundingClientRect();
      return { x: box.left + at.x, y: box.top + at.y };
    },
    [x, y],
  );
  await page.mouse.click(p.x, p.y);
}

/// Draws a zone whose alarm is on, around a box of the map in metres.
export async function drawZone(
  page: Page,
  name: string,
  [x0, y0, x1, y1]: [number, number, number, number],
): Promise<void> {
  await page.click('#tab-zones');
  await page.getByRole('button', { name: 'Draw', exact: true }).click();
  await page.fill('#zone-name', name);
  await page.selectOption('#zone-kind', 'zone');
  await page.check('#zone-alarm');
  await clickAt(page, x0, y0);
  await clickAt(page, x1, y0);
  await clickAt(page, x1, y1);
  await clickAt(page, x0, y1);
  await page.getByRole('button', { name: 'Save' }).click();
}

/// Clicks on a point of the plan's picture, where the map shows it.
async function clickPixel(page: Page, u: number, v: number): Promise<void> {
  const [x, y] = await page.evaluate(
    ([pu, pv]) => {
      const { plan } = (window as unknown as Inside).baliza.map;
      if (plan === null) return [NaN, NaN];
      return [plan.origin_m[0] + plan.metres_per_pixel * pu, plan.origin_m[1] - plan.metres_per_pixel * pv];
    },
    [u, v],
  );
  await clickAt(page, x, y);
}

/// Uploads a plan, scales it by two points of the picture (pixels) and their distance, and puts the first one to a place.
export async function placePlan(
  page: Page,
  buffer: Buffer,
  [first, second]: readonly [number, number][],
  distance: string,
  [x, y]: readonly string[],
): Promise<void> {
  await page.setInputFiles('#plan-file', { name: 'plan.png', mimeType: 'image/png', buffer });
  await page.locator('#plan-distance').waitFor();
  await page.getByRole('button', { name: 'Show all' }).click();
  await clickPixel(page, ...first);
  await clickPixel(page, ...second);
  await page.fill('#plan-distance', distance);
  await page.getByRole('button', { name: 'Use this scale' }).click();
  await clickPixel(page, ...first);
  await page.fill('#plan-x', x);
  await page.fill('#plan-y', y);
  await page.getByRole('button', { name: 'Put it there' }).click();
}

/// An object of the API.
export async function get<T>(url: string, path: string, token?: string): Promise<T> {
  const headers: Record<string, string> = token === undefined ? {} : { Authorization: `Bearer ${token}` };
  const response = await fetch(url + path, { headers, signal: AbortSignal.timeout(PATIENCE_MS) });
  if (!response.ok) throw new Error(`${path}: ${response.status} ${await response.text()}`);
  return (await response.json()) as T;
}

/// Asks until the answer is as it should be.
export async function until<T>(what: string, ask: () => Promise<T>, isRight: (answer: T) => boolean): Promise<T> {
  const end = Date.now() + PATIENCE_MS;
  for (;;) {
    const answer = await ask();
    if (isRight(answer)) return answer;
    assert.ok(Date.now() < end, `${what}: ${JSON.stringify(answer).slice(0, 500)}`);
    await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
  }
}

/// The site that the page shows.
export async function siteOf(page: Page, url: string): Promise<Site> {
  const name = await page.locator('#site').inputValue();
  const site = (await get<Site[]>(url, '/scenarios')).find((one) => one.name === name);
  assert.ok(site !== undefined);
  return site;
}
