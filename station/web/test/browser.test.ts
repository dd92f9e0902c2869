// The page in Chromium against the mock: what a real station makes too late or not at all (an anchor that was moved, a
// connection that breaks while tags go on moving, no site, 500 tags). The rest is in station.test.ts.

import assert from 'node:assert/strict';
import { readFileSync, readdirSync } from 'node:fs';
import { after, before, describe, test, type TestContext } from 'node:test';
import { fileURLToPath } from 'node:url';
import { gzipSync } from 'node:zlib';
import type { Browser, BrowserContextOptions, Page } from 'playwright-core';
import { chromiumPath, launch } from './chromium.js';
import { Mock, rooms, type Options } from './mock.js';
import { live, visit, type Inside } from './page.js';

const dist = fileURLToPath(new URL('../../dist', import.meta.url));
const axe = readFileSync(fileURLToPath(new URL('../../node_modules/axe-core/axe.min.js', import.meta.url)), 'utf8');

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

  /// Opens the page of a station of simulated tags.
  async function open(
    t: TestContext,
    options: Partial<Options> & { context?: BrowserContextOptions } = {},
    prepare: (mock: Mock) => void = () => {},
  ): Promise<{ page: Page; mock: Mock }> {
    const { context, ...rest } = options;
    const mock = new Mock({ tags: 8, rateHz: 10, ...rest }, dist);
    prepare(mock);
    await mock.start();
    t.after(() => mock.stop());
    return { page: await visit(t, browser, mock.url, context), mock };
  }

  test('an anchor that was moved is the first of the table', async (t) => {
    const { page } = await open(t);
    await live(page);
    await page.click('#tab-health');
    const first = page.locator('#health tbody tr').first();
    await first.waitFor();
    const cells = await first.locator('th, td').allTextContents();
    assert.deepEqual(cells.slice(0, 6), ['0x0103', 'was it moved?', '95 %', '+0.83 ± 0.08 m', '-2.6 dB', '-0.2 ppm']);
    assert.equal(await page.locator('#health tbody tr').count(), 6);
  });

  test('what the ranges say against the site stands above the anchors until it is gone', async (t) => {
    const finding = (message: string) => {
      const [site, since] = ['office', '2026-01-01T10:00:00Z'];
      return { site, since, code: 'anchors-exchanged', message, subjects: [], evidence: { residual_m: 2.9 } };
    };
    const { page, mock } = await open(t, {}, (mock) => {
      mock.findings = [finding('Door and 0x0103 look exchanged'), finding('<b>0x0104</b> moved')];
    });
    await live(page);
    await page.click('#tab-health');
    const findings = page.locator('#findings');
    await findings.waitFor();
    assert.equal(await findings.textContent(), 'Door and 0x0103 look exchanged\n<b>0x0104</b> moved');
    mock.findings = [];
    await findings.waitFor({ state: 'hidden' });
  });

  test('the last 24 hours of an anchor are loaded when they are opened, and told in words', async (t) => {
    const { page, mock } = await open(t);
    const asked = () => mock.requests.filter((request) => request.endsWith('/health'));
    await live(page);
    await page.click('#tab-health');
    const anchor = page.getByRole('button', { name: '0x0103' });
    await anchor.waitFor();
    assert.equal(await anchor.getAttribute('aria-expanded'), 'false');
    assert.deepEqual(asked(), []);
    await anchor.focus();
    await page.keyboard.press('Enter');
    const day = page.locator('#health-day');
    await day.locator('.uplot').waitFor();
    assert.deepEqual(asked(), ['GET /api/v1/nodes/office/0x0103/health']);
    assert.equal(await anchor.getAttribute('aria-expanded'), 'true');
    assert.ok(await anchor.evaluate((button) => button === document.activeElement));
    // It is so since two hours ago: 119 minutes before the newest row.
    const words = /Lowest success rate: 95 % at (\d\d:\d\d)\. Residual farthest from zero: \+0\.83 m at \1\./;
    await day.getByRole('img', { name: words }).waitFor();
    await day.getByRole('status').filter({ hasText: words }).waitFor();
    await page.selectOption('#language', 'es');
    await day.getByRole('img', { name: '0x0103: las últimas 24 horas' }).waitFor();
    await day.getByText('Menor tasa de éxito: 95 %').waitFor();
    assert.equal(asked().length, 1);
    await anchor.click();
    await day.waitFor({ state: 'hidden' });
    mock.nodes[0].success_rate = null;
    await page.getByRole('button', { name: 'Door' }).click();
    await day.getByText('No se sabe nada de las últimas 24 horas de Door').waitFor();
    assert.ok(await day.locator('.chart').isHidden());
  });

  test('the supply voltage of a tag is in the table', async (t) => {
    const { page } = await open(t);
    await live(page);
    await page.getByText('As a table').click();
    const cells = await page.locator('#table tbody tr').first().locator('th, td').allTextContents();
    assert.equal(cells[7], '3.10 V');
  });

  test('after a break the page connects again and fills the gap', async (t) => {
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
      const { store } = (window as unknown as Inside).baliza;
      const steps = store.steps.get('0x1001') ?? [];
      const newest = steps.filter((step) => step.t > Date.now() - 4000);
      return newest.length > 20 && newest.every((step, i) => i === 0 || step.t - newest[i - 1].t < 400);
    });
  });

  test('without a site or a tag the page says what to do', async (t) => {
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

  test('a wrong geographic origin is told at its field, and the station’s own words where it refuses', async (t) => {
    const { page, mock } = await open(t, { tags: 1 });
    await live(page);
    await page.click('#tab-plan');
    await page.getByRole('button', { name: 'Set the geographic origin' }).click();
    const latitude = page.getByLabel('Latitude (°, north)');
    await latitude.fill('91');
    await page.getByLabel('Longitude (°, east)').fill('-3.766');
    await page.getByLabel(/^Azimuth/).fill('12.5');
    await page.keyboard.press('Enter');
    const problem = page.getByRole('alert').filter({ hasText: 'Latitude (°, north): type a number from -90 to 90.' });
    await problem.waitFor();
    assert.equal(await latitude.getAttribute('aria-invalid'), 'true');
    assert.equal(await latitude.getAttribute('aria-describedby'), await problem.getAttribute('id'));
    assert.ok(await latitude.evaluate((input) => input === document.activeElement));
    assert.ok(!mock.requests.some((request) => request.startsWith('PUT')));
    await latitude.fill('40.332');
    mock.down = true;
    await page.getByRole('button', { name: 'Save', exact: true }).click();
    await page.getByText('That failed: the station is down').waitFor();
    assert.ok(await latitude.isVisible());
    mock.down = false;
    await page.getByRole('button', { name: 'Save', exact: true }).click();
    await page.getByText('Saved: Geographic origin').waitFor();
    const origin = { latitude_deg: 40.332, longitude_deg: -3.766, y_azimuth_deg: 12.5 };
    assert.deepEqual(mock.site.geographic_origin, origin);
    assert.ok(await latitude.isHidden());
    await page.selectOption('#language', 'es');
    const text = 'x = 0, y = 0 está en la latitud 40,3320000°, longitud -3,7660000° · acimut del eje y 12,50°';
    await page.getByText(text, { exact: true }).waitFor();
    await page.getByRole('button', { name: 'Cambiar el origen geográfico' }).waitFor();
  });

  for (const colorScheme of ['light', 'dark'] as const) {
    test(`axe finds nothing serious (${colorScheme})`, async (t) => {
      const { page, mock } = await open(t, { context: { colorScheme } }, (m) => {
        m.zones = rooms();
        m.site.geographic_origin = { latitude_deg: 40.332, longitude_deg: -3.766, y_azimuth_deg: 12.5 };
      });
      await live(page);
      mock.happen('moved', '0x0103', null, true);
      await page.evaluate(axe);
      for (const tab of ['tags', 'zones', 'history', 'health', 'events', 'survey', 'plan']) {
        await page.click(`#tab-${tab}`);
        if (tab === 'zones') await page.getByRole('button', { name: 'Draw', exact: true }).click();
        if (tab === 'history') {
          await page.getByRole('button', { name: 'Last 10 minutes' }).click();
          await page.locator('.chart .uplot').waitFor();
          await page.getByRole('link', { name: 'Track for maps (GPX)' }).waitFor();
        }
        if (tab === 'health') {
          await page.getByRole('button', { name: '0x0103' }).click();
          await page.locator('#health-day .uplot').waitFor();
        }
        if (tab === 'plan') {
          await page.getByRole('button', { name: 'Change the geographic origin' }).click();
          await page.getByLabel('Latitude (°, north)').fill('north');
          await page.keyboard.press('Enter');
          await page.getByText('type a number from -90 to 90').waitFor();
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
    test(`${tags} tags at ${rateHz} positions a second move smoothly`, async (t) => {
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
