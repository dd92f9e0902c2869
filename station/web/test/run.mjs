// Bundles the tests and runs them with node's own test runner. `--mock` serves the page with simulated tags instead,
// `--screenshots` writes the pictures of docs/use/station/, `--frames` measures what a frame costs, `--ages` how
// old positions are when a frame shows them.

import { spawn } from 'node:child_process';
import { readdir, rm } from 'node:fs/promises';
import { fileURLToPath } from 'node:url';
import { build } from 'esbuild';
import '../types.mjs';

const here = fileURLToPath(new URL('.', import.meta.url));
const out = `${here}.build`;
const sources = (await readdir(here)).filter((name) => name.endsWith('.ts') && !name.endsWith('.d.ts'));

await rm(out, { recursive: true, force: true });
await build({
  absWorkingDir: here,
  entryPoints: sources,
  outdir: out,
  outExtension: { '.js': '.mjs' },
  bundle: true,
  packages: 'external',
  platform: 'node',
  format: 'esm',
  target: 'node20',
  loader: { '.css': 'empty' },
  sourcemap: 'inline',
});

const [mode] = process.argv.slice(2);
const tests = sources.filter((name) => name.endsWith('.test.ts')).map((name) => `${out}/${name.replace('.ts', '.mjs')}`);
const program = { '--mock': ['serve'], '--screenshots': ['screenshots'], '--frames': ['frames'], '--ages': ['ages'] }[mode];
const parameters =
  program === undefined
    ? ['--enable-source-maps', '--test', '--test-reporter=spec', '--test-concurrency=1', ...tests]
    : ['--enable-source-maps', `${out}/${program}.mjs`, ...process.argv.slice(3)];
const child = spawn(process.execPath, parameters, { stdio: 'inherit' });
child.on('exit', (code) => process.exit(code ?? 1));
