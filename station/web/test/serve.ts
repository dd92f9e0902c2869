// Serves the page with simulated tags until it is stopped: for work on the page without a station.

import { fileURLToPath } from 'node:url';
import { Mock, rooms } from './mock.js';

const dist = fileURLToPath(new URL('../../dist', import.meta.url));
const mock = new Mock({ tags: Number(process.argv[2] ?? 8), rateHz: 10 }, dist);
mock.zones = rooms();
await mock.start(Number(process.env.PORT ?? 8090));
console.log(mock.url);
