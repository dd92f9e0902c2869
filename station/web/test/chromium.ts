// Debian's Chromium, driven by playwright-core; null where there is none.

import { existsSync } from 'node:fs';
import { chromium, type Browser } from 'playwright-core';

const PLACES = ['/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome'];

export function chromiumPath(): string | null {
  const wanted = process.env.CHROMIUM;
  return [...(wanted === undefined ? [] : [wanted]), ...PLACES].find((place) => existsSync(place)) ?? null;
}

export function launch(executablePath: string): Promise<Browser> {
  // Chromium's sandbox does not work for root, as whom tests in a container run.
  const args = process.getuid?.() === 0 ? ['--no-sandbox'] : [];
  return chromium.launch({ executablePath, args: [...args, '--disable-dev-shm-usage'] });
}
