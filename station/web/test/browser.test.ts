// The page in Chromium, against the mock, or against a real station (BALIZA_URL, on a site with tags that move). What
// needs control of the station (breaking connections, tokens, anchors that were moved) is tested with the mock alone.

import assert from 'node:assert/strict';
import { readFileSync, readdirSync } from 'node:fs';
import { after, before, describe, test, type TestContext } from 'node:test';
import { fileURLToPath } from 'node:url';
import { gzipSync } from 'node:zlib';
import type { Browser, BrowserContextOptions, Page } from 'playwright-core';
import type { Site, Zone } from '../src/model.js';
import { chromiumPath, launch } from './chromium.js';
import { Mock, rooms, type Options } from './mock.js';
import { png } from './picture.js';

const dist = fileURLToPath(new URL('../../dist', import.meta.url));
const axe = readFileSync(fileURLToPath(new URL('../../node_modules/axe-core/axe.min.js', import.meta.url)), 'utf8');
const real = process.env.BALIZA_URL;
const onlyMock = real === undefined ? false : 'with the mock alone';

test('the page is at most 500 kB when compressed', () => {
  const size = readdirSync(dist).reduce((sum, name) => sum + gzipSync(readFileSync(`${dist}/${name}`)).length, 0);
  console.log(`page: ${(size / 1000).toFixed(1)} kB compressed`);
  assert.ok(size <= 500_000, `${size} bytes`);
});

test('the page asks for nothing from elsewhere', () => {
  for (const name of readdirSync(dist).filter((file) => /\.(html|css)$/.test(file))) {
    assert.doesNotMatch(readFileSync(`${dist}/${name}`, 'utf8'), /(src|href)="https?:|url\(["']?https?:|@import/);
  }
});

const chromium = chromiumPath();
if (chromium === null) {
  console.log('no chromium (apt-get install chromium, or CHROMIUM=…): the tests in a browser are left out');
}

describe('in a browser', { skip: chromium === null }, () => {
  let browser: Browser;
  before(async () => {
    browser = await launch(chromium ?? '');
  });
  after(() => browser.close());

  /// Opens the page; at the end of the test, it must not have said that anything is wrong.
  async function open(
    t: TestContext,
    options: Partial<Options> & { context?: BrowserContextOptions } = {},
    prepare: (mock: Mock) => void = () => {},
  ): Promise<{ page: Page; url: string; mock: Mock; faults: string[] }> {
    const { context: wanted, ...rest } = options;
    const mock = new Mock({ tags: 8, rateHz: 10, ...rest }, dist);
    prepare(mock);
    await mock.start();
    const url = real ?? mock.url;
    const context = await browser.newContext({ viewport: { width: 1280, height: 800 }, locale: 'en-GB', ...wanted });
    const page = await context.newPage();
    page.setDefaultTimeout(15_000);
    const faults: string[] = [];
    page.on('pageerror', (error) => faults.push(error.message));
    page.on('console', (message) => {
      if (message.type() === 'error' && !/Failed to load resource|ERR_/.test(message.text()))
        faults.push(message.text());
    });
    page.on('request', (request) => {
      if (!/^(data|blob):/.test(request.url()) && !request.url().startsWith(url)) faults.push(request.url());
    });
    t.after(async () => {
      await context.close();
      await mock.stop();
      assert.deepEqual(faults, []);
    });
    await page.goto(url);
    return { page, url, mock, faults };
  }

  /// Waits until the page shows live tags.
  async function live(page: Page): Promise<void> {
    await page.locator('#state.live').waitFor();
    await page.locator('#tags li').first().waitFor();
  }

  const rows = (page: Page) => page.locator('#tags li');

  /// Clicks on the map at a point in metres.
  async function clickAt(page: Page, x: number, y: number): Promise<void> {
    const p = await page.evaluate(
      ([px, py]) => {
        const { map } = (window as unknown as { baliza: { map: import('../src/map/map.js').MapView } }).baliza;
        const at = map.screenOf({ x: px, y: py });
        const box = map.element.getBoundingClientRect();
        return { x: box.left + at.x, y: box.top + at.y };
      },
      [x, y],
    );
    await page.mouse.click(p.x, p.y);
  }

  const get = async <T>(url: string, path: string): Promise<T> => (await (await fetch(url + path)).json()) as T;

  /// The site that the page shows.
  const siteOf = async (page: Page, url: string): Promise<Site> => {
    const name = await page.locator('#site').inputValue();
    const site = (await get<Site[]>(url, '/scenarios')).find((one) => one.name === name);
    assert.ok(site !== undefined);
    return site;
  };

  test('live tags are listed with positions that change, and are found by their names', async (t) => {
    const { page } = await open(t);
    await live(page);
    const paint = await page.evaluate(
      () => performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? NaN,
    );
    console.log(`first paint after ${paint.toFixed(0)} ms`);
    const first = rows(page).first();
    const name = (await first.locator('.name').textContent()) ?? '';
    const where = await first.locator('.where').textContent();
    assert.match(where ?? '', /-?\d+\.\d\d, -?\d+\.\d\d ± \d+\.\d\d m/);
    await page.waitForFunction((old) => document.querySelector('#tags .where')?.textContent !== old, where);
    await page.fill('#search', name);
    await page.waitForFunction((wanted) => document.querySelector('#tags .name')?.textContent === wanted, name);
    await page.fill('#search', 'no such tag');
    await page.getByText('No tag matches.').waitFor();
  });

  test('the list and the map are used with the keyboard', async (t) => {
    const { page } = await open(t);
    await live(page);
    await page.focus('#tags');
    await page.keyboard.press('ArrowDown');
    await page.keyboard.press('ArrowDown');
    assert.equal(await rows(page).nth(1).getAttribute('aria-selected'), 'true');
    assert.equal(
      await page.locator('#tags').getAttribute('aria-activedescendant'),
      await rows(page).nth(1).getAttribute('id'),
    );
    const at = () =>
      page.evaluate(() => {
        const { map } = (window as unknown as { baliza: { map: import('../src/map/map.js').MapView } }).baliza;
        const [a, b] = [map.screenOf({ x: 0, y: 0 }), map.screenOf({ x: 1, y: 0 })];
        return { x: a.x, metre: b.x - a.x };
      });
    await page.focus('#map');
    const start = await at();
    await page.keyboard.press('ArrowRight');
    assert.ok(Math.abs((await at()).x - (start.x - 50)) < 0.01);
    await page.keyboard.press('+');
    assert.ok(Math.abs((await at()).metre / start.metre - 1.3) < 1e-6);
  });

  test('a table says what the map shows', async (t) => {
    const { page } = await open(t);
    await live(page);
    await page.getByText('As a table').click();
    const cells = await page.locator('#table tbody tr').first().locator('th, td').allTextContents();
    assert.equal(cells.length, 9);
    assert.match(cells[1], /^-?\d+\.\d\d$/);
    assert.equal(cells[7], '3.10 V');
  });

  test('a zone is drawn, edited, and deleted', async (t) => {
    const { page, url } = await open(t);
    await live(page);
    const site = await siteOf(page, url);
    const zones = async () => await get<Zone[]>(url, `/api/v1/rooms?site=${encodeURIComponent(site.name)}`);
    await page.click('#tab-zones');
    await page.getByRole('button', { name: 'Draw', exact: true }).click();
    // Names are text, whatever is in them.
    const name = '<b>Test</b>';
    await page.fill('#zone-name', name);
    await page.selectOption('#zone-kind', 'zone');
    await page.check('#zone-alarm');
    for (const [x, y] of [
      [3, 3],
      [6, 3],
      [6, 6],
      [3, 6],
    ])
      await clickAt(page, x, y);
    await page.getByRole('button', { name: 'Save' }).click();
    await page.locator('[data-zone]', { hasText: name }).waitFor();
    const drawn = (await zones()).find((zone) => zone.name === name);
    assert.ok(drawn !== undefined && drawn.alarm && drawn.kind === 'zone');
    assert.equal(drawn.corners_m.length, 4);
    // A click is as exact as a pixel of the screen.
    for (const [i, [x, y]] of [
      [3, 3],
      [6, 3],
      [6, 6],
      [3, 6],
    ].entries()) {
      assert.ok(Math.hypot(drawn.corners_m[i][0] - x, drawn.corners_m[i][1] - y) < 0.05, String(drawn.corners_m[i]));
    }
    await page.locator('[data-zone]', { hasText: name }).click();
    await page.fill('#zone-name', 'Test 2');
    await page.fill('#zone-corners', '1 1\n2,5 1\n2,5 4');
    await page.getByRole('button', { name: 'Save' }).click();
    await page.locator('[data-zone="Test 2"]').waitFor();
    assert.deepEqual((await zones()).find((zone) => zone.name === 'Test 2')?.corners_m, [
      [1, 1],
      [2.5, 1],
      [2.5, 4],
    ]);
    assert.ok(!(await zones()).some((zone) => zone.name === name));
    await page.locator('[data-zone="Test 2"]').click();
    await page.getByRole('button', { name: 'Delete' }).click();
    await page.getByRole('button', { name: 'Really delete?' }).click();
    await page.locator('[data-zone="Test 2"]').waitFor({ state: 'detached' });
    assert.ok(!(await zones()).some((zone) => zone.name === 'Test 2'));
  });

  test('a plan is uploaded, scaled by two clicks, and put to its place', async (t) => {
    const { page, url } = await open(t);
    await live(page);
    await page.click('#tab-plan');
    await page.setInputFiles('#plan-file', { name: 'plan.png', mimeType: 'image/png', buffer: png(800, 480) });
    await page.locator('#plan-distance').waitFor();
    /// Clicks on a point of the picture, where the page shows it.
    const clickPixel = async (u: number, v: number) => {
      const [x, y] = await page.evaluate(
        ([pu, pv]) => {
          const { map } = (window as unknown as { baliza: { map: import('../src/map/map.js').MapView } }).baliza;
          const plan = map.plan;
          if (plan === null) return [NaN, NaN];
          return [plan.origin_m[0] + plan.metres_per_pixel * pu, plan.origin_m[1] - plan.metres_per_pixel * pv];
        },
        [u, v],
      );
      await clickAt(page, x, y);
    };
    await clickPixel(40, 440);
    await clickPixel(440, 440);
    await page.fill('#plan-distance', '10');
    await page.getByRole('button', { name: 'Use this scale' }).click();
    await clickPixel(40, 440);
    await page.fill('#plan-x', '1');
    await page.fill('#plan-y', '1');
    await page.getByRole('button', { name: 'Put it there' }).click();
    await page.getByRole('button', { name: 'Save the plan' }).click();
    await page.getByText('Saved: Plan').waitFor();
    const { plan } = await siteOf(page, url);
    assert.ok(plan !== null);
    assert.deepEqual([plan.width_px, plan.height_px], [800, 480]);
    // 10 m are 400 pixels. The point (40, 440) is at (1, 1): the corner is 40 px left of it and 440 px above.
    assert.ok(Math.abs(plan.metres_per_pixel - 0.025) < 0.0002, String(plan.metres_per_pixel));
    assert.ok(Math.hypot(plan.origin_m[0] - 0, plan.origin_m[1] - 12) < 0.15, String(plan.origin_m));
    const picture = await fetch(`${url}/blueprints/${encodeURIComponent(await page.locator('#site').inputValue())}`);
    assert.equal(picture.headers.get('Content-Type'), 'image/png');
    assert.equal((await picture.arrayBuffer()).byteLength, png(800, 480).length);
  });

  test('a file that is no picture is refused in the page', async (t) => {
    const { page, mock } = await open(t);
    await live(page);
    await page.click('#tab-plan');
    await page.setInputFiles('#plan-file', { name: 'plan.png', mimeType: 'image/png', buffer: Buffer.from('nothing') });
    await page.getByText('This file is no picture').waitFor();
    assert.ok(!mock.requests.some((request) => request.startsWith('PUT')));
  });

  test('walls are drawn', { skip: onlyMock }, async (t) => {
    const { page, mock } = await open(
      t,
      {},
      (m) =>
        (m.site.walls_m = [
          [
            [0, 0],
            [20, 0],
          ],
        ]),
    );
    await live(page);
    await page.click('#tab-plan');
    await page.getByRole('button', { name: 'Draw walls' }).click();
    for (const [x, y] of [
      [2, 2],
      [5, 2],
      [5, 4],
    ])
      await clickAt(page, x, y);
    await page.getByText('3 walls').waitFor();
    await page.getByRole('button', { name: 'Take the last one back' }).click();
    await page.getByRole('button', { name: 'Save the walls' }).click();
    await page.getByText('Saved: Walls').waitFor();
    assert.equal(mock.site.walls_m.length, 2);
    assert.deepEqual(mock.site.walls_m[0], [
      [0, 0],
      [20, 0],
    ]);
  });

  test('the history is loaded, played, and shown as a heat map and a chart', async (t) => {
    const { page } = await open(t);
    await live(page);
    await page.click('#tab-history');
    await page.getByRole('button', { name: 'Last 10 minutes' }).click();
    await page.locator('#history-status', { hasText: /positions of \d+ tags/ }).waitFor();
    assert.equal(await page.locator('#state').textContent(), 'history');
    const clock = await page.locator('#clock').textContent();
    await page.click('#play');
    await page.waitForFunction((old) => document.querySelector('#clock')?.textContent !== old, clock);
    await page.click('#play');
    await page.focus('#slider');
    const value = Number(await page.locator('#slider').inputValue());
    await page.keyboard.press('ArrowRight');
    assert.ok(Number(await page.locator('#slider').inputValue()) > value);
    await page.check('#heat');
    await page.getByText(/Darkest: \d+ s/).waitFor();
    await page.locator('.chart .uplot').waitFor();
    await page.getByRole('button', { name: 'Back to live' }).click();
    await page.locator('#state', { hasText: 'live' }).waitFor();
  });

  test('a span without positions says so', async (t) => {
    const { page } = await open(t);
    await live(page);
    await page.click('#tab-history');
    await page.fill('#tab-history-panel input >> nth=0', '2001-01-01T00:00:00');
    await page.fill('#tab-history-panel input >> nth=1', '2001-01-01T01:00:00');
    await page.getByRole('button', { name: 'Load', exact: true }).click();
    await page.getByText('No position in this span').waitFor();
  });

  test('an anchor that was moved is the first of the table', { skip: onlyMock }, async (t) => {
    const { page } = await open(t);
    await live(page);
    await page.click('#tab-health');
    const first = page.locator('#health tbody tr').first();
    await first.waitFor();
    const cells = await first.locator('th, td').allTextContents();
    assert.deepEqual(cells.slice(0, 5), ['0x0103', 'was it moved?', '95 %', '+0.83 ± 0.08 m', '-2.6 dB']);
    assert.equal(await page.locator('#health tbody tr').count(), 6);
  });

  test('alarms are told at once and stay in the list', { skip: onlyMock }, async (t) => {
    const { page, mock } = await open(t);
    await live(page);
    mock.happen('entered', '0x1001', 'Press', true);
    mock.happen('left', '0x1001', 'Press', false);
    await page.locator('.toast', { hasText: 'Alarm: Ana entered Press' }).waitFor();
    await page.click('#tab-events');
    await page.locator('.events li', { hasText: 'Ana left Press after 42 s' }).waitFor();
    assert.equal(await page.locator('.toast').count(), 1);
    await page.selectOption('#event-kind', 'entered');
    assert.equal(await page.locator('.events li').count(), 1);
    assert.equal(await page.locator('#sound').isChecked(), false);
  });

  test('a survey leads from point to point and counts the samples', async (t) => {
    const phone = { viewport: { width: 390, height: 800 }, hasTouch: true, isMobile: true };
    const { page, url } = await open(t, { context: phone });
    await live(page);
    const wide = await page.evaluate(() => document.documentElement.scrollWidth);
    assert.ok(wide <= 390, `${wide} pixels wide`);
    await page.click('#tab-survey');
    const name = `Test ${Date.now()}`;
    await page.fill('#campaign-name', name);
    await page.fill('#campaign-spacing', '4');
    await page.getByRole('button', { name: 'Make it' }).click();
    await page.getByText(`Saved: ${name}`).waitFor();
    assert.equal(await page.locator('#campaign').inputValue(), name);
    await page.locator('#survey-go', { hasText: 'Go to point p1' }).waitFor();
    const command = await page.locator('#survey-command').inputValue();
    const target = /'(http[^']*)'/.exec(command)?.[1] ?? '';
    const sample = /-d '(.*)'/.exec(command)?.[1] ?? '';
    const posted = await fetch(target, {
      method: 'POST',
      headers: { 'Content-Type': 'application/json' },
      body: sample,
    });
    assert.equal(posted.status, 201);
    await page.locator('#survey-samples', { hasText: /^1 sample/ }).waitFor();
    await page.getByRole('button', { name: 'Next point' }).click();
    await page.locator('#survey-go', { hasText: 'Go to point p2' }).waitFor();
    await page.getByRole('button', { name: 'Delete' }).click();
    await page.getByRole('button', { name: 'Really delete?' }).click();
    await page.getByText(`Deleted: ${name}`).waitFor();
    assert.ok(!(await get<{ name: string }[]>(url, '/campaigns')).some((one) => one.name === name));
  });

  test('a station with tokens asks for one, and says when it is wrong', { skip: onlyMock }, async (t) => {
    const { page } = await open(t, { tokens: { secret: 'administer', look: 'view' } });
    await page.locator('#login').waitFor();
    await page.fill('#token', 'guess');
    await page.keyboard.press('Enter');
    await page.getByText('does not know this token').waitFor();
    await page.fill('#token', 'look');
    await page.keyboard.press('Enter');
    await live(page);
    // Who may only look finds nothing to change.
    await page.click('#tab-zones');
    assert.ok(await page.getByRole('button', { name: 'Draw', exact: true }).isDisabled());
    await page.getByRole('button', { name: 'Log out' }).click();
    await page.locator('#login').waitFor();
    await page.fill('#token', 'secret');
    await page.keyboard.press('Enter');
    await live(page);
    await page.click('#tab-zones');
    assert.ok(await page.getByRole('button', { name: 'Draw', exact: true }).isEnabled());
  });

  test('after a break the page connects again and fills the gap', { skip: onlyMock }, async (t) => {
    const { page, mock } = await open(t, { tags: 2 });
    await live(page);
    await page.waitForTimeout(1000);
    mock.down = true;
    mock.breakStreams();
    await page.locator('#state.reconnecting').waitFor();
    await page.waitForTimeout(2000);
    mock.down = false;
    await page.locator('#state.live').waitFor();
    // The longest time between two positions of the trail is far below the two seconds of the break.
    await page.waitForFunction(() => {
      const { store } = (window as unknown as { baliza: { store: import('../src/store.js').Store } }).baliza;
      const steps = store.steps.get('0x1001') ?? [];
      const newest = steps.filter((step) => step.t > Date.now() - 4000);
      return newest.length > 20 && newest.every((step, i) => i === 0 || step.t - newest[i - 1].t < 400);
    });
  });

  test('without a site or a tag the page says what to do', { skip: onlyMock }, async (t) => {
    const { page } = await open(t, { tags: 0, empty: true });
    await page.locator('.over code', { hasText: 'baliza serve --simulate' }).waitFor();
    await page.getByText('No tag yet').waitFor();
    for (const [tab, text] of [
      ['zones', 'No room or zone yet'],
      ['health', 'No anchor or beacon yet'],
      ['events', 'No event yet'],
      ['survey', 'No campaign yet'],
      ['plan', 'No plan yet'],
    ]) {
      await page.click(`#tab-${tab}`);
      await page.getByText(text).waitFor();
    }
  });

  test('the language is the browser’s, and can be changed', async (t) => {
    const { page } = await open(t, { context: { locale: 'es-ES' } });
    await live(page);
    assert.equal(await page.locator('#state').textContent(), 'en directo');
    assert.equal(await page.locator('html').getAttribute('lang'), 'es');
    assert.match((await rows(page).first().locator('.where').textContent()) ?? '', /\d,\d\d, /);
    await page.selectOption('#language', 'en');
    assert.equal(await page.locator('#state').textContent(), 'live');
    await page.reload();
    await live(page);
    assert.equal(await page.locator('#tab-history').textContent(), 'History');
  });

  test('dark follows the system, and can be chosen', async (t) => {
    const { page } = await open(t, { context: { colorScheme: 'dark' } });
    await live(page);
    const back = () => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
    assert.equal(await back(), 'rgb(16, 22, 28)');
    await page.selectOption('#theme', 'light');
    assert.equal(await back(), 'rgb(244, 246, 248)');
    await page.reload();
    await live(page);
    assert.equal(await back(), 'rgb(244, 246, 248)');
  });

  for (const colorScheme of ['light', 'dark'] as const) {
    test(`axe finds nothing serious (${colorScheme})`, async (t) => {
      const { page, mock } = await open(t, { context: { colorScheme } }, (m) => (m.zones = rooms()));
      await live(page);
      mock.happen('moved', '0x0103', null, true);
      await page.evaluate(axe);
      for (const tab of ['tags', 'zones', 'history', 'health', 'events', 'survey', 'plan']) {
        await page.click(`#tab-${tab}`);
        if (tab === 'zones') await page.getByRole('button', { name: 'Draw', exact: true }).click();
        if (tab === 'history') {
          await page.getByRole('button', { name: 'Last 10 minutes' }).click();
          await page.locator('.chart .uplot').waitFor();
        }
        const found = await page.evaluate(async () => {
          const { run } = (window as unknown as { axe: typeof import('axe-core') }).axe;
          const { violations } = await run(document, { resultTypes: ['violations'] });
          const bad = violations.filter((v) => v.impact === 'serious' || v.impact === 'critical');
          return bad.flatMap((v) => v.nodes.map((node) => `${v.id}: ${node.html} ${node.failureSummary ?? ''}`));
        });
        assert.deepEqual(found, [], tab);
      }
    });
  }

  for (const [tags, rateHz] of [
    [100, 10],
    [500, 2],
  ]) {
    test(`${tags} tags at ${rateHz} positions a second move smoothly`, { skip: onlyMock }, async (t) => {
      const { page } = await open(t, { tags, rateHz }, (m) => (m.zones = rooms()));
      await live(page);
      await page.waitForFunction((n) => document.querySelectorAll('#tags li').length === n, tags);
      await page.waitForTimeout(1500);
      const frames = await page.evaluate(
        () =>
          new Promise<number>((resolve) => {
            const start = performance.now();
            let count = 0;
            const next = (now: number) => {
              count++;
              if (now - start < 4000) requestAnimationFrame(next);
              else resolve((count * 1000) / (now - start));
            };
            requestAnimationFrame(next);
          }),
      );
      // The figure depends on the machine and on what else it does: it is printed, and only a standstill is a fault.
      console.log(`${tags} tags at ${rateHz} Hz: ${frames.toFixed(1)} frames a second`);
      assert.ok(frames > 3, `${frames} frames a second`);
    });
  }
});
