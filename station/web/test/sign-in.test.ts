// Sign-in in Chromium: a real station, and a certified provider of OpenID Connect with its own forms.

import assert from 'node:assert/strict';
import { writeFileSync } from 'node:fs';
import { createServer, type AddressInfo } from 'node:net';
import { join } from 'node:path';
import { after, before, describe, test, type TestContext } from 'node:test';
import type { Browser, BrowserContextOptions, Page } from 'playwright-core';
import { chromiumPath, launch } from './chromium.js';
import { live, visit } from './page.js';
import { CLIENT, Provider } from './provider.js';
import { program, Station } from './station.js';

/// The provider's form asks for it; there is no server behind it.
const FONTS = 'https://fonts.googleapis.com';

const chromium = chromiumPath();
const isPossible = chromium !== null && program !== null;
if (!isPossible) {
  const missing = 'no chromium, or BALIZA does not name the program: the tests of sign-in are left out';
  if (process.env.CI === 'true') throw new Error(missing);
  console.log(missing);
}

async function freePort(): Promise<number> {
  const server = createServer();
  await new Promise<void>((resolve) => server.listen(0, '127.0.0.1', resolve));
  const { port } = server.address() as AddressInfo;
  await new Promise((resolve) => server.close(resolve));
  return port;
}

describe('sign-in at a provider', { skip: !isPossible }, () => {
  let browser: Browser;
  let provider: Provider;
  let station: Station;
  before(async () => {
    browser = await launch(chromium ?? '');
    station = new Station(['--simulate', '--oidc', 'oidc.toml']);
    // The provider must know where to send browsers before the station starts.
    station.url = `http://127.0.0.1:${await freePort()}`;
    provider = await Provider.start(station.url);
    const settings = `
      issuer = "${provider.issuer}"
      client_id = "${CLIENT.id}"
      client_secret = "${CLIENT.secret}"
      public_url = "${station.url}"
      end_session = true
      [roles]
      view = ["staff"]
      operate = ["leads"]
      administer = ["admins"]
    `;
    writeFileSync(join(station.folder, 'oidc.toml'), settings, { mode: 0o600 });
    await station.start();
  });
  after(async () => {
    await browser.close();
    await station.stop();
    await provider.stop();
  });

  const open = async (t: TestContext, context: BrowserContextOptions = {}): Promise<Page> => {
    const page = await visit(t, browser, station.url, context, [provider.issuer, FONTS]);
    await page.route(`${FONTS}/**`, (route) => route.abort());
    await page.locator('#login').waitFor();
    return page;
  };

  /// Passes the provider's forms.
  const signIn = async (page: Page, account: string) => {
    await page.locator('#login').getByRole('button', { name: 'Sign in' }).click();
    await page.fill('input[name=login]', account);
    await page.fill('input[name=password]', 'anything');
    await page.getByRole('button', { name: 'Sign-in' }).click();
    await page.getByRole('button', { name: 'Continue' }).click();
    await page.waitForURL(`${station.url}/**`);
  };

  const me = (page: Page) =>
    page.evaluate(async () => (await (await fetch('/api/v1/me')).json()) as { name: string | null; role: string | null });

  test('a person signs in with the role of their group, stays so through a reload, and logs out', async (t) => {
    for (const [account, role, mayDraw, mayPlan] of [
      ['ana@staff', 'view', false, false],
      ['eva@staff@leads', 'operate', true, false],
      ['leo@admins', 'administer', true, true],
    ] as const) {
      const page = await open(t);
      await signIn(page, account);
      await live(page);
      await page.reload();
      await live(page);
      assert.deepEqual([(await me(page)).name, (await me(page)).role], [`oidc:${account.split('@')[0]}`, role]);
      await page.click('#tab-zones');
      assert.equal(await page.getByRole('button', { name: 'Draw', exact: true }).isEnabled(), mayDraw, role);
      await page.click('#tab-plan');
      assert.equal(await page.locator('#plan-file').isEnabled(), mayPlan, role);
      const put = await page.evaluate(async (name) => {
        const zone = { site: 'simulation', name, kind: 'zone', corners_m: [[0, 0], [1, 0], [1, 1]] }; // prettier-ignore
        const headers = { 'Content-Type': 'application/json' };
        const path = `/api/v1/rooms/simulation/${name}`;
        return (await fetch(path, { method: 'PUT', headers, body: JSON.stringify(zone) })).status;
      }, role);
      assert.equal(put, mayDraw ? 201 : 403);
      const cookies = await page.context().cookies(station.url);
      assert.deepEqual(
        cookies.map(({ name, httpOnly, sameSite }) => [name, httpOnly, sameSite]),
        [['baliza_session', true, 'Strict']],
      );
      await page.getByRole('button', { name: 'Log out' }).click();
      await page.getByRole('button', { name: 'Yes, sign me out' }).click();
      await page.locator('#login').waitFor();
      assert.equal((await me(page)).role, null);
      // The next person at this browser is asked for a name.
      await page.locator('#login').getByRole('button', { name: 'Sign in' }).click();
      await page.waitForSelector('input[name=login]');
    }
    // The log names them.
    const log = station.said.join('\n');
    assert.match(log, /"oidc:eva" signs in as Operate, subject "eva@staff@leads"/);
    assert.match(log, /"oidc:leo" PUT \/api\/v1\/rooms\/simulation\/administer 201/);
    assert.ok(!log.includes(CLIENT.secret));
  });

  test('a person without a role is told so, and can try as another one', async (t) => {
    const page = await open(t);
    await signIn(page, 'eve@visitors');
    await page.locator('#login .problem', { hasText: 'you have no role at this station' }).waitFor();
    assert.equal(page.url(), `${station.url}/`);
    assert.equal((await me(page)).role, null);
    await page.context().clearCookies();
    await signIn(page, 'ana@staff');
    await live(page);
  });

  test('a person who cancels at the provider is told so', async (t) => {
    const page = await open(t);
    await page.locator('#login').getByRole('button', { name: 'Sign in' }).click();
    await page.getByText('[ Cancel ]').click();
    await page.locator('#login .problem', { hasText: 'The provider has refused the sign-in' }).waitFor();
  });

  test('a forged or replayed return from the provider signs nobody in', async (t) => {
    const page = await open(t);
    // Another person's return, which this browser has not begun.
    await page.goto(`${station.url}/oidc/callback?code=x&state=forged`);
    await page.locator('#login .problem', { hasText: 'That sign-in has ended' }).waitFor();
    const returns: string[] = [];
    page.on('request', (request) => {
      if (request.url().includes('/oidc/callback?')) returns.push(request.url());
    });
    await signIn(page, 'ana@staff');
    await live(page);
    await page.context().clearCookies();
    assert.equal(returns.length, 1);
    await page.goto(returns[0]);
    await page.locator('#login .problem', { hasText: 'That sign-in has ended' }).waitFor();
    assert.equal((await me(page)).role, null);
  });

  test('the dialog speaks Spanish', async (t) => {
    const page = await open(t, { locale: 'es-ES' });
    await page.locator('#login').getByRole('button', { name: 'Iniciar sesión' }).waitFor();
    await page.goto(`${station.url}/oidc/callback?error=access_denied`);
    await page.locator('#login .problem', { hasText: 'Ese inicio de sesión ha terminado' }).waitFor();
  });
});
