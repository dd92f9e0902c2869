// The page in Chromium against a real station: `baliza serve --simulate`, the program that BALIZA names.

import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { after, before, describe, test, type TestContext } from 'node:test';
import type { Browser, BrowserContextOptions, Page } from 'playwright-core';
import type { Marks } from '../src/map/motion.js';
import type { Replay } from '../src/map/replay.js';
import type { Node, NodeHealth, Site, StationEvent, TagPosition, Zone } from '../src/model.js';
import { chromiumPath, launch } from './chromium.js';
import { clickAt, drawZone, get, live, placePlan, rows, siteOf, until, visit, type Inside } from './page.js';
import { png } from './picture.js';
import { program, SECRETS, Station } from './station.js';

/// A station is back, and pages are live again, within this time.
const BACK_MS = 5000;

const chromium = chromiumPath();
const isPossible = chromium !== null && program !== null;
if (!isPossible) {
  const missing = 'no chromium, or BALIZA does not name the program: the tests against a real station are left out';
  if (process.env.CI === 'true') throw new Error(missing);
  console.log(missing);
}

describe('with a station', { skip: !isPossible }, () => {
  let browser: Browser;
  let station: Station;
  let url: string;
  before(async () => {
    browser = await launch(chromium ?? '');
    station = await new Station(['--simulate']).start();
    url = station.url;
  });
  after(async () => {
    await browser.close();
    await station.stop();
  });

  const open = (t: TestContext, options: { context?: BrowserContextOptions } = {}): Promise<Page> =>
    visit(t, browser, url, options.context);

  /// The history of a tag, newest first.
  const history = (of: string, tag: string) =>
    get<TagPosition[]>(of, `/api/v1/tags/${tag}/positions?site=simulation&limit=10000`);

  test('live tags are listed with positions that change, and are found by their names', async (t) => {
    const page = await open(t);
    await live(page);
    const paint = await page.evaluate(
      () => performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? NaN,
    );
    console.log(`first paint after ${paint.toFixed(0)} ms`);
    const first = rows(page).first();
    const name = (await first.locator('.name').textContent()) ?? '';
    // A tag that has just started may have no position yet.
    const position = first.locator('.where', { hasText: /-?\d+\.\d\d, -?\d+\.\d\d ± \d+\.\d\d m/ });
    const where = await position.textContent();
    await page.waitForFunction((old) => document.querySelector('#tags .where')?.textContent !== old, where);
    await page.fill('#search', name);
    await page.waitForFunction((wanted) => document.querySelector('#tags .name')?.textContent === wanted, name);
    await page.fill('#search', 'no such tag');
    await page.getByText('No tag matches.').waitFor();
  });

  test('a tag flashes its light when asked, and the page says so', async (t) => {
    const page = await open(t);
    await live(page);
    assert.equal(await page.locator('#identify').isVisible(), false, 'no tag is chosen');
    await rows(page).first().click();
    await page.click('#identify');
    await page.getByText(/flashes its light for 30 s/).waitFor();
    const address = await rows(page).first().getAttribute('data-tag');
    const messages = await get<{ state: string; content: unknown }[]>(url, `/api/v1/tags/${address}/messages`);
    assert.deepEqual([messages[0].state, messages[0].content], ['taken', { identify_s: 30 }]);
  });

  test('the list and the map are used with the keyboard', async (t) => {
    const page = await open(t);
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
        const { map } = (window as unknown as Inside).baliza;
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
    const page = await open(t);
    await live(page);
    await page.getByText('As a table').click();
    const cells = await page.locator('#table tbody tr').first().locator('th, td').allTextContents();
    assert.equal(cells.length, 9);
    assert.match(cells[1], /^-?\d+\.\d\d$/);
  });

  test('a zone is drawn, edited, and deleted', async (t) => {
    const page = await open(t);
    await live(page);
    const site = await siteOf(page, url);
    const zones = async () => await get<Zone[]>(url, `/api/v1/rooms?site=${encodeURIComponent(site.name)}`);
    // Names are text, whatever is in them.
    const name = '<b>Test</b>';
    await drawZone(page, name, [3, 3, 6, 6]);
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
    const page = await open(t);
    await live(page);
    await page.click('#tab-plan');
    await placePlan(page, png(800, 480), [[40, 440], [440, 440]], '10', ['1', '1']); // prettier-ignore
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
    const page = await open(t);
    await live(page);
    const { plan } = await siteOf(page, url);
    const sent: string[] = [];
    page.on('request', (request) => sent.push(request.method()));
    await page.click('#tab-plan');
    await page.setInputFiles('#plan-file', { name: 'plan.png', mimeType: 'image/png', buffer: Buffer.from('nothing') });
    await page.getByText('This file is no picture').waitFor();
    assert.ok(!sent.includes('PUT'));
    assert.deepEqual((await siteOf(page, url)).plan, plan);
  });

  test('walls are drawn', async (t) => {
    const page = await open(t);
    await live(page);
    const before = (await siteOf(page, url)).walls_m;
    await page.click('#tab-plan');
    await page.getByRole('button', { name: 'Draw walls' }).click();
    const ends = [
      [2, 2],
      [5, 2],
      [5, 4],
    ];
    for (const [x, y] of ends) await clickAt(page, x, y);
    await page.getByText(`${before.length + 2} walls`).waitFor();
    await page.getByRole('button', { name: 'Take the last one back' }).click();
    await page.getByRole('button', { name: 'Save the walls' }).click();
    await page.getByText('Saved: Walls').waitFor();
    const { walls_m } = await siteOf(page, url);
    assert.deepEqual(walls_m.slice(0, -1), before);
    const drawn = walls_m.at(-1) ?? [];
    // A click is as exact as a pixel of the screen.
    for (const [i, [x, y]] of ends.slice(0, 2).entries()) {
      assert.ok(Math.hypot(drawn[i][0] - x, drawn[i][1] - y) < 0.05, String(drawn[i]));
    }
  });

  test('a geographic origin is set with the keyboard, changed, and deleted; with it, a tag has a track', async (t) => {
    const page = await open(t);
    await live(page);
    const stored = async () => (await siteOf(page, url)).geographic_origin;
    const saved = page.getByText('Saved: Geographic origin');
    await page.click('#tab-plan');
    await page.getByText('No geographic origin yet').waitFor();
    await page.getByRole('button', { name: 'Set the geographic origin' }).focus();
    await page.keyboard.press('Enter');
    for (const value of ['40.332', '-3.766', '12,5', '650']) {
      await page.keyboard.type(value);
      await page.keyboard.press('Tab');
    }
    await page.keyboard.press('Enter');
    await saved.waitFor();
    const origin = { latitude_deg: 40.332, longitude_deg: -3.766, y_azimuth_deg: 12.5 };
    assert.deepEqual(await stored(), { ...origin, height_m: 650 });
    const text =
      'x = 0, y = 0 is at latitude 40.3320000°, longitude -3.7660000° · azimuth of the y axis 12.50° · ' +
      'z = 0 is 650.00 m above mean sea level';
    assert.equal(await page.locator('#origin-about').textContent(), text);
    const change = page.getByRole('button', { name: 'Change the geographic origin' });
    assert.ok(await change.evaluate((button) => button === document.activeElement));
    await page.locator('.toast', { has: saved }).getByRole('button').click();
    await change.click();
    const height = page.getByLabel(/^Height of z = 0/);
    assert.equal(await height.inputValue(), '650');
    await height.fill('');
    await page.getByRole('button', { name: 'Save', exact: true }).click();
    await saved.waitFor();
    assert.deepEqual(await stored(), origin);

    await page.click('#tab-history');
    await page.getByRole('button', { name: 'Last 10 minutes' }).click();
    const link = page.getByRole('link', { name: 'Track for maps (GPX)' });
    const [download] = await Promise.all([page.waitForEvent('download'), link.click()]);
    const name = await page.locator('#chart-of option:checked').textContent();
    assert.equal(download.suggestedFilename(), `${name}.gpx`);
    const gpx = readFileSync(await download.path(), 'utf8');
    const points = [...gpx.matchAll(/<trkpt lat="([^"]*)" lon="([^"]*)"/g)].map(([, lat, lon]) => [+lat, +lon]);
    assert.ok(points.length > 0, gpx);
    // The tags walk within 15 m of x = 0, y = 0: a degree of latitude is 111 km there, one of longitude 85 km.
    for (const [latitude, longitude] of points) {
      assert.ok(Math.abs(latitude - 40.332) < 2e-4 && Math.abs(longitude + 3.766) < 2e-4, `${latitude}, ${longitude}`);
    }

    await page.click('#tab-plan');
    await change.click();
    await page.keyboard.press('Escape');
    assert.ok(await height.isHidden());
    await change.click();
    await page.getByRole('button', { name: 'Delete' }).click();
    await page.getByRole('button', { name: 'Really delete?' }).click();
    await page.getByText('No geographic origin yet').waitFor();
    assert.equal(await stored(), null);
    await page.click('#tab-history');
    assert.ok(await link.isHidden());
  });

  test('the slider puts the tags where they were, and the history is played and charted', async (t) => {
    const page = await open(t);
    await live(page);
    const seconds = (rows: TagPosition[]) => (Date.parse(rows[0]?.t) - Date.parse(rows.at(-1)?.t ?? '')) / 1000;
    await until('eight seconds of history', () => history(url, '0x1001'), (rows) => seconds(rows) > 8);
    await page.click('#tab-history');
    await page.getByRole('button', { name: 'Last 10 minutes' }).click();
    await page.locator('#history-status', { hasText: /positions of \d+ tags/ }).waitFor();
    assert.equal(await page.locator('#state').textContent(), 'history');
    const end = Number(await page.locator('#slider').getAttribute('max'));
    let moved = 0;
    const first = new Map<string, { x: number; y: number }>();
    for (const share of [0.2, 0.5, 0.8]) {
      await page.locator('#slider').fill(String(Math.round(end * share)));
      const shown = await page.evaluate(() => {
        const { map } = (window as unknown as Inside).baliza;
        const { marks } = map as unknown as { marks: Marks & Replay };
        return { t: marks.time, marks: [...marks.at()].map(({ id, x, y }) => ({ id, x, y })) };
      });
      assert.equal(shown.marks.length, 5);
      for (const { id, x, y } of shown.marks) {
        const was = await history(url, id);
        const near = was.reduce((a, b) =>
          Math.abs(Date.parse(b.t) - shown.t) < Math.abs(Date.parse(a.t) - shown.t) ? b : a,
        );
        // The page knows a position a second; a tag walks at 1 m/s, and may turn in between.
        assert.ok(Math.hypot(near.x_m - x, near.y_m - y) < 0.8, `${id} at ${x}, ${y}: ${JSON.stringify(near)}`);
        const begun = first.get(id) ?? { x, y };
        first.set(id, begun);
        moved = Math.max(moved, Math.hypot(begun.x - x, begun.y - y));
      }
    }
    assert.ok(moved > 1.6, `a tag that walks at 1 m/s moved by ${moved} m`);
    const clock = await page.locator('#clock').textContent();
    await page.locator('#slider').fill('0');
    await page.click('#play');
    await page.waitForFunction((old) => document.querySelector('#clock')?.textContent !== old, clock);
    if ((await page.locator('#play').textContent()) === 'Pause') await page.click('#play');
    await page.check('#heat');
    await page.getByText(/Darkest: \d+ s/).waitFor();
    await page.locator('.chart .uplot').waitFor();
    await page.getByRole('button', { name: 'Back to live' }).click();
    await page.locator('#state', { hasText: 'live' }).waitFor();
  });

  test('a span without positions says so', async (t) => {
    const page = await open(t);
    await live(page);
    await page.click('#tab-history');
    await page.fill('#tab-history-panel input >> nth=0', '2001-01-01T00:00:00');
    await page.fill('#tab-history-panel input >> nth=1', '2001-01-01T01:00:00');
    await page.getByRole('button', { name: 'Load', exact: true }).click();
    await page.getByText('No position in this span').waitFor();
  });

  test('a tag that enters a drawn zone raises an alarm, which is told at once and stays in the list', async (t) => {
    const page = await open(t);
    await live(page);
    // The whole room, in which all tags walk.
    await drawZone(page, 'Press', [-0.5, -0.5, 12.5, 8.5]);
    await page.locator('.toast', { hasText: /Alarm: .* entered Press/ }).first().waitFor();
    const path = '/api/v1/events?site=simulation&kind=entered&limit=1000';
    const inPress = (events: StationEvent[]) => events.filter((event) => event.zone === 'Press');
    const all = await until('five alarms', () => get<StationEvent[]>(url, path), (events) => inPress(events).length >= 5);
    assert.ok(inPress(all).every((event) => event.alarm));
    await page.click('#tab-events');
    await page.selectOption('#event-kind', 'entered');
    const told = page.locator('.events li.alarm', { hasText: 'entered Press' });
    await told.nth(4).waitFor();
    assert.equal(await page.locator('#sound').isChecked(), false);
    await page.click('#tab-zones');
    await page.locator('[data-zone="Press"]', { hasText: '5 inside' }).click();
    await page.getByRole('button', { name: 'Delete' }).click();
    await page.getByRole('button', { name: 'Really delete?' }).click();
    await page.locator('[data-zone="Press"]').waitFor({ state: 'detached' });
    // Without the zone, nobody is in it.
    const inside = () => get<{ zones: string[] }[]>(url, '/api/v1/tags?site=simulation');
    await until('no tag inside', inside, (tags) => tags.every((tag) => !tag.zones.includes('Press')));
  });

  test('the health of each anchor is in the table, and is what the API says', async (t) => {
    const page = await open(t);
    await live(page);
    const measured = (nodes: Node[]) => nodes.filter((node) => node.residual_mean_m !== null);
    const nodes = () => get<Node[]>(url, '/api/v1/nodes?site=simulation');
    const anchors = measured(await until('six anchors', nodes, (all) => measured(all).length === 6));
    await page.click('#tab-health');
    const table = page.locator('#health tbody tr');
    await table.nth(5).waitFor();
    for (const anchor of anchors) {
      const row = table.filter({ has: page.locator(`[data-node="${anchor.node}"]`) });
      await row.filter({ hasText: /\d+ % ?[+-]?\d\.\d\d ± \d\.\d\d m/ }).waitFor();
      const cells = await row.locator('td').allTextContents();
      // Means over minutes: between the two looks they change by less than this.
      const shown = Number.parseFloat(cells[2]);
      assert.ok(Math.abs(shown - (anchor.residual_mean_m ?? NaN)) < 0.2, `${anchor.node}: ${cells.join(', ')}`);
      // Clocks keep their rate.
      assert.match(cells[4], / ppm$/);
      const offset = Number.parseFloat(cells[4]);
      assert.ok(Math.abs(offset - (anchor.clock_offset_ppm ?? NaN)) < 1, `${anchor.node}: ${cells.join(', ')}`);
    }
  });

  test('the last 24 hours of an anchor are those of the API', async (t) => {
    const page = await open(t);
    await live(page);
    // The first row comes a minute after the start.
    const path = '/api/v1/nodes/simulation/0x0001/health';
    const [row] = await until('a row', () => get<NodeHealth[]>(url, path), (some) => some.length > 0);
    assert.ok(row.success_rate !== null && row.residual_mean_m !== null && row.rate_hz > 0, JSON.stringify(row));
    await page.click('#tab-health');
    await page.locator('[data-node="0x0001"]').click();
    const day = page.locator('#health-day');
    await day.locator('.uplot').waitFor();
    await day.getByText(/^Lowest success rate: \d+ % at .*Residual farthest from zero: [+-]?\d+\.\d\d m at/).waitFor();
  });

  test('a survey leads from point to point and counts the samples', async (t) => {
    const phone = { viewport: { width: 390, height: 800 }, hasTouch: true, isMobile: true };
    const page = await open(t, { context: phone });
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

  test('a station with tokens asks for one, and each role may do what it may', async (t) => {
    const guarded = await Station.withTokens(['--simulate']).start();
    t.after(() => guarded.stop());
    const page = await visit(t, browser, guarded.url);
    const enter = async (secret: string) => {
      await page.locator('#login').waitFor();
      await page.fill('#token', secret);
      await page.keyboard.press('Enter');
    };
    const draw = page.getByRole('button', { name: 'Draw', exact: true });
    const file = page.locator('#plan-file');
    const origin = page.getByRole('button', { name: 'Set the geographic origin' });
    await enter('guess');
    await page.getByText('does not know this token').waitFor();
    for (const [role, mayDraw, mayPlan] of [
      ['view', false, false],
      ['operate', true, false],
      ['administer', true, true],
    ] as const) {
      await enter(SECRETS[role]);
      await live(page);
      await page.click('#tab-zones');
      assert.equal(await draw.isEnabled(), mayDraw, role);
      await page.click('#tab-plan');
      assert.equal(await file.isEnabled(), mayPlan, role);
      assert.equal(await origin.isVisible(), mayPlan, role);
      // The station says the same to those who do not ask the page.
      const status = (method: string, path: string, body: string) =>
        page.evaluate(
          async ([m, p, b]) =>
            (await fetch(p, { method: m, body: b, headers: { 'Content-Type': 'application/json' } })).status,
          [method, path, body],
        );
      const zone = { site: 'simulation', name: role, kind: 'zone', corners_m: [[0, 0], [1, 0], [1, 1]] }; // prettier-ignore
      const put = await status('PUT', `/api/v1/rooms/simulation/${role}`, JSON.stringify(zone));
      assert.equal(put === 403, !mayDraw, `${role}: ${put}`);
      const walls = await status('PUT', '/api/v1/sites/simulation/walls', '[]');
      assert.equal(walls === 403, !mayPlan, `${role}: ${walls}`);
      await page.getByRole('button', { name: 'Log out' }).click();
    }
    await page.locator('#login').waitFor();
    const names = (await get<Zone[]>(guarded.url, '/api/v1/rooms', SECRETS.view)).map((zone) => zone.name);
    assert.deepEqual(names.filter((name) => name in SECRETS).sort(), ['administer', 'operate']);
    const [site] = await get<Site[]>(guarded.url, '/scenarios', SECRETS.view);
    assert.deepEqual(site.walls_m, []);
  });

  test('after a kill of the station under load the page is live again within 5 s, with all that the station has', async (t) => {
    const killed = await new Station(['--simulate']).start();
    t.after(() => killed.stop());
    const page = await visit(t, browser, killed.url);
    await live(page);
    // Readers that ask without a pause, and keep what they were told.
    const tags = ['0x1001', '0x1002', '0x1003', '0x1004', '0x1005'];
    const told = new Map<string, TagPosition[]>();
    let isReading = true;
    const readers = tags.map(async (tag) => {
      while (isReading) {
        const rows = await history(killed.url, tag).catch(() => null);
        if (rows !== null) told.set(tag, rows);
      }
    });
    const hasTold = async () => [...told.values()].filter((rows) => rows.length > 30).length;
    await until('thirty positions of each tag', hasTold, (count) => count === tags.length);
    let refused = 0;
    page.on('requestfailed', (request) => (refused += Number(request.url().includes('/api/v1/updates'))));
    await killed.kill();
    isReading = false;
    await Promise.all(readers);
    await page.locator('#state.reconnecting').waitFor();
    // By then the pauses between two tries have their full length.
    await until('four tries', async () => refused, (count) => count >= 4);
    await killed.start();
    const back = Date.now();
    await page.locator('#state.live').waitFor();
    const away = Date.now() - back;
    console.log(`live again ${away} ms after the station listens`);
    assert.ok(away < BACK_MS, `${away} ms`);
    // Nothing that a reader was told is lost.
    for (const tag of tags) {
      const now = new Set((await history(killed.url, tag)).map((row) => JSON.stringify(row)));
      const lost = (told.get(tag) ?? []).filter((row) => !now.has(JSON.stringify(row)));
      assert.deepEqual(lost, [], tag);
    }
    // What came between the station's start and the page's connection is in the trails.
    const since = (all: TagPosition[]) => all.map((row) => Date.parse(row.t)).filter((time) => time > back - 500);
    const fresh = await Promise.all(
      tags.map(async (tag) => {
        const full = (all: TagPosition[]) => since(all).length > 10;
        return [tag, since(await until('positions since', () => history(killed.url, tag), full))] as const;
      }),
    );
    const missing = () =>
      page.evaluate((wanted) => {
        const { store } = (window as unknown as Inside).baliza;
        return wanted.flatMap(([tag, times]) => {
          const known = new Set((store.steps.get(tag) ?? []).map((step) => step.t));
          return times.filter((time) => !known.has(time)).map((time) => `${tag} ${new Date(time).toISOString()}`);
        });
      }, fresh);
    await until(`no gap since ${new Date(back).toISOString()}`, missing, (gaps) => gaps.length === 0);
  });
});
