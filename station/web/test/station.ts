// A real station: `baliza serve` of this checkout, with a store of its own. BALIZA names the program.

import { spawn, type ChildProcess } from 'node:child_process';
import { createHash } from 'node:crypto';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { createInterface } from 'node:readline';
import { PATIENCE_MS } from './page.js';

/// The program; null where it is not named.
export const program = process.env.BALIZA ?? null;

/// The secrets of a station with tokens, by the role that they give.
export const SECRETS = { view: 'look-around', operate: 'draw-a-zone', administer: 'change-the-plan' };

export class Station {
  readonly folder = mkdtempSync(join(tmpdir(), 'baliza-page-'));
  url = '';
  /// What it has written to standard error, line by line.
  readonly said: string[] = [];
  private child: ChildProcess | null = null;

  /// Arguments of `serve` besides the address and the store.
  constructor(private readonly args: readonly string[]) {}

  /// One that asks for tokens: those of `SECRETS`.
  static withTokens(args: readonly string[]): Station {
    const station = new Station([...args, '--tokens', 'tokens.toml']);
    const tables = Object.entries(SECRETS).map(([role, secret]) => {
      const sha256 = createHash('sha256').update(secret).digest('hex');
      return `[[token]]\nname = "${role}"\nrole = "${role}"\nsha256 = "${sha256}"\n`;
    });
    writeFileSync(join(station.folder, 'tokens.toml'), tables.join('\n'));
    return station;
  }

  /// Starts it, at its former address where it has run before, and waits until it listens.
  async start(): Promise<this> {
    if (program === null) throw new Error('BALIZA does not name the program');
    const address = this.url === '' ? '127.0.0.1:0' : this.url.replace('http://', '');
    const args = ['serve', '--listen', address, '--store', 'station.db', ...this.args];
    const child = spawn(program, args, { cwd: this.folder, stdio: ['ignore', 'ignore', 'pipe'] });
    this.child = child;
    const said = this.said;
    await new Promise<void>((resolve, reject) => {
      const late = setTimeout(() => reject(new Error(`it does not listen: ${said.join('\n')}`)), PATIENCE_MS);
      child.on('error', reject);
      child.on('exit', (code) => reject(new Error(`it ended with ${code}: ${said.join('\n')}`)));
      createInterface({ input: child.stderr }).on('line', (line) => {
        said.push(line);
        const found = /^listening on (http:\S+)/.exec(line);
        if (found === null) return;
        this.url = found[1];
        clearTimeout(late);
        resolve();
      });
    });
    return this;
  }

  /// Ends it without any warning (SIGKILL).
  async kill(): Promise<void> {
    const child = this.child;
    this.child = null;
    if (child === null || child.exitCode !== null || child.signalCode !== null) return;
    const ended = new Promise((resolve) => child.once('exit', resolve));
    child.kill('SIGKILL');
    await ended;
  }

  /// Ends it, and deletes its store.
  async stop(): Promise<void> {
    await this.kill();
    rmSync(this.folder, { recursive: true, force: true });
  }
}
