// How old positions are at the first frame of the page that may show them, for `cargo xtask promises station`: arguments
// URL SECONDS. A position tells in its height when it was made: 1 m is a second of the host's clock, and the heights
// begin again after 1000 m. Prints the ages in milliseconds as JSON.

import { chromiumPath, launch } from './chromium.js';
import { live, type Inside } from './page.js';

const AGAIN_MS = 1_000_000;

const [url, seconds] = process.argv.slice(2);
const path = chromiumPath();
if (path === null) throw new Error('no chromium (apt-get install chromium, or CHROMIUM=…)');
const browser = await launch(path);
const page = await browser.newPage({ viewport: { width: 1280, height: 800 } });
await page.goto(url);
await live(page);
const ages = await page.evaluate(
  ([span, again]) =>
    new Promise<number[]>((resolve) => {
      const { store } = (window as unknown as Inside).baliza;
      const found: number[] = [];
      let waiting: number[] = [];
      const add = store.addPosition.bind(store);
      // Only what comes live: the history of the first seconds is older.
      store.addPosition = (position) => {
        const isNewest = add(position);
        if (isNewest && position.z_m !== null) waiting.push(position.z_m * 1000);
        return isNewest;
      };
      const begun = performance.now();
      const next = () => {
        const now = (performance.timeOrigin + performance.now()) % again;
        for (const made of waiting) found.push((((now - made) % again) + again) % again);
        waiting = [];
        if (performance.now() - begun < span) requestAnimationFrame(next);
        else resolve(found);
      };
      requestAnimationFrame(next);
    }),
  [Number(seconds) * 1000, AGAIN_MS] as const,
);
console.log(JSON.stringify(ages));
await browser.close();
