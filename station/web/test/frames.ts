// What a frame of the map costs: the time of the page's main thread, by Chromium's own count, with 100 tags at ten
// positions a second and 500 at two. Prints a line of JSON for each. Frames a second depend on what else the machine
// does; the cost of a frame depends less on it.

import { fileURLToPath } from 'node:url';
import { chromiumPath, launch } from './chromium.js';
import { Mock, rooms } from './mock.js';

const dist = fileURLToPath(new URL('../../dist', import.meta.url));
const SPAN_MS = 8000;

const path = chromiumPath();
if (path === null) throw new Error('no chromium (apt-get install chromium, or CHROMIUM=…)');
const browser = await launch(path);
for (const [tags, rateHz] of [
  [100, 10],
  [500, 2],
]) {
  const mock = new Mock({ tags, rateHz }, dist);
  mock.zones = rooms();
  await mock.start();
  const page = await browser.newPage({ viewport: { width: 1280, height: 800 } });
  const cdp = await page.context().newCDPSession(page);
  await cdp.send('Performance.enable', { timeDomain: 'threadTicks' });
  await page.goto(mock.url);
  await page.waitForFunction((n) => document.querySelectorAll('#tags li').length === n, tags);
  const metrics = async () => {
    const { metrics: all } = await cdp.send('Performance.getMetrics');
    return Object.fromEntries(all.map(({ name, value }) => [name, value])) as Record<string, number>;
  };
  // The trails of the first seconds are short.
  const frames = () =>
    page.evaluate(
      (span) =>
        new Promise<{ frames: number; ms: number }>((resolve) => {
          const begun = performance.now();
          let count = 0;
          const next = () => {
            count++;
            const ms = performance.now() - begun;
            if (ms < span) requestAnimationFrame(next);
            else resolve({ frames: count, ms });
          };
          requestAnimationFrame(next);
        }),
      SPAN_MS,
    );
  await frames();
  const before = await metrics();
  const { frames: count, ms } = await frames();
  const after = await metrics();
  const each = (name: string) => (1000 * (after[name] - before[name])) / count;
  const main_thread_ms = each('TaskDuration');
  const script_ms = each('ScriptDuration');
  console.log(JSON.stringify({ tags, rate_hz: rateHz, main_thread_ms, script_ms, frames_per_s: (1000 * count) / ms }));
  await page.close();
  await mock.stop();
}
await browser.close();
