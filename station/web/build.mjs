// Builds the page: src/ to dist/. Equal sources give equal bytes: file names carry the hash of what is in them, nothing
// carries a time or a path.

import { createHash } from 'node:crypto';
import { mkdir, readFile, rm, writeFile } from 'node:fs/promises';
import { fileURLToPath } from 'node:url';
import { build } from 'esbuild';

const here = fileURLToPath(new URL('.', import.meta.url));
const dist = `${here}dist/`;

const result = await build({
  absWorkingDir: here,
  entryPoints: ['src/main.ts'],
  outdir: 'dist',
  entryNames: '[name]-[hash]',
  bundle: true,
  format: 'esm',
  target: ['es2022'],
  minify: true,
  charset: 'utf8',
  legalComments: 'inline',
  metafile: true,
  write: false,
});

await rm(dist, { recursive: true, force: true });
await mkdir(dist);
const names = {};
const put = async (name, content) => {
  names[name.replace(/^.*\./, '')] = name;
  await writeFile(dist + name, content);
};
for (const file of result.outputFiles) await put(file.path.replace(/^.*[/\\]/, ''), file.contents);

const icon = await readFile(`${here}src/icon.svg`);
const hash = createHash('sha256').update(icon).digest('hex').slice(0, 8);
await put(`icon-${hash}.svg`, icon);

const html = await readFile(`${here}src/index.html`, 'utf8');
const filled = html.replace('ICON', names.svg).replace('STYLE', names.css).replace('SCRIPT', names.js);
await put('index.html', filled);

// What is in the page from others, with its licence.
const uplot = await readFile(`${here}node_modules/uplot/LICENSE`, 'utf8');
await put('licences.txt', `This page contains uPlot (https://github.com/leeoniya/uPlot):\n\n${uplot}`);
