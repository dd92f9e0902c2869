import assert from 'node:assert/strict';
import test from 'node:test';
import { Live, type Connection, type Listener, type Source, type Timers } from '../src/live.js';
import type { TagPosition } from '../src/model.js';
import { Store } from '../src/store.js';

class FakeSource implements Source {
  onopen: Source['onopen'] = null;
  onerror: Source['onerror'] = null;
  closed = false;
  private readonly listeners = new Map<string, (message: { data: string }) => void>();
  addEventListener(type: string, listener: (message: { data: string }) => void): void {
    this.listeners.set(type, listener);
  }
  close(): void {
    this.closed = true;
  }
  send(type: string, data: unknown): void {
    this.sendText(type, JSON.stringify(data));
  }
  sendText(type: string, data: string): void {
    this.listeners.get(type)?.({ data });
  }
  opens(): void {
    this.onopen?.(new Event('open'));
  }
  breaks(): void {
    this.onerror?.(new Event('error'));
  }
}

class FakeTimers implements Timers {
  waits: number[] = [];
  time = 0;
  private next: (() => void) | null = null;
  set(run: () => void, ms: number): unknown {
    this.waits.push(ms);
    this.next = run;
    return run;
  }
  clear(): void {
    this.next = null;
  }
  now(): number {
    return this.time;
  }
  pass(): void {
    const run = this.next;
    this.next = null;
    run?.();
  }
}

function position(tag: string, t: string, x = 0): TagPosition {
  return {
    site: 'office', tag, t, x_m: x, y_m: 0, z_m: null,
    sigma_x_m: 0.1, sigma_y_m: 0.1, sigma_z_m: null, cov_xy_m2: 0, room: null, used: 4, doubt: null,
  };
}

function setUp(fill: (since: string | null) => Promise<void> = async () => {}) {
  const sources: FakeSource[] = [];
  const timers = new FakeTimers();
  const states: Connection[] = [];
  const positions: string[] = [];
  const fills: (string | null)[] = [];
  const listener: Listener = {
    position: (p) => positions.push(p.tag),
    event: () => {},
    changed: () => {},
    fill: (since) => (fills.push(since), fill(since)),
    connection: (state) => states.push(state),
  };
  const open = () => {
    const source = new FakeSource();
    sources.push(source);
    return source;
  };
  const live = new Live(open, listener, timers);
  live.start();
  return { live, sources, timers, states, positions, fills };
}

const settled = () => new Promise((resolve) => setImmediate(resolve));

test('the first connection fills from nothing', () => {
  const { sources, states, fills } = setUp();
  sources[0].opens();
  assert.deepEqual(states, ['connecting', 'live']);
  assert.deepEqual(fills, [null]);
});

test('after a break the gap is filled from the last position that was received', async () => {
  const { sources, timers, states, fills } = setUp();
  sources[0].opens();
  await settled();
  sources[0].send('position', position('a', '2026-01-01T00:00:01.000Z'));
  sources[0].send('position', position('b', '2026-01-01T00:00:02.000Z'));
  sources[0].breaks();
  assert.ok(sources[0].closed);
  timers.pass();
  sources[1].opens();
  assert.deepEqual(states, ['connecting', 'live', 'reconnecting', 'live']);
  assert.deepEqual(fills, [null, '2026-01-01T00:00:02.000Z']);
});

test('tries to connect are further and further apart, up to two and a half seconds, until one succeeds', () => {
  const { sources, timers } = setUp();
  for (let i = 0; i < 6; i++) {
    sources[i].breaks();
    timers.pass();
  }
  assert.deepEqual(timers.waits, [500, 1000, 2000, 2500, 2500, 2500]);
  sources[6].opens();
  sources[6].breaks();
  assert.equal(timers.waits[6], 500);
});

test('a gap that could not be filled is filled at the next connection', async () => {
  let works = true;
  const { sources, timers, fills, states } = setUp(async () => {
    if (!works) throw new Error('no history');
  });
  sources[0].opens();
  await settled();
  sources[0].send('position', position('a', '2026-01-01T00:00:01.000Z'));
  works = false;
  sources[0].breaks();
  timers.pass();
  sources[1].opens();
  // Live positions come during the filling: they are shown, but do not close the gap.
  sources[1].send('position', position('a', '2026-01-01T00:00:09.000Z'));
  await settled();
  assert.equal(states.at(-1), 'reconnecting');
  works = true;
  timers.pass();
  sources[2].opens();
  assert.deepEqual(fills, [null, '2026-01-01T00:00:01.000Z', '2026-01-01T00:00:01.000Z']);
});

test('a gap whose filling never ends is filled at the next connection', async () => {
  let answers = false;
  const { sources, timers, fills, states } = setUp(() => (answers ? Promise.resolve() : new Promise(() => {})));
  sources[0].opens();
  await settled();
  sources[0].send('position', position('a', '2026-01-01T00:00:01Z'));
  sources[0].breaks();
  answers = true;
  timers.pass();
  sources[1].opens();
  await settled();
  sources[1].send('position', position('a', '2026-01-01T00:00:02Z'));
  sources[1].breaks();
  timers.pass();
  sources[2].opens();
  // The first connection filled nothing: the second one begins where it did, the third one after what it received.
  assert.deepEqual(fills, [null, null, '2026-01-01T00:00:02Z']);
  assert.deepEqual(states, ['connecting', 'live', 'reconnecting', 'live', 'reconnecting', 'live']);
});

test('what the station says it left out is read from the history', async () => {
  const { sources, fills } = setUp();
  sources[0].opens();
  await settled();
  sources[0].send('position', position('a', '2026-01-01T00:00:05.000Z'));
  sources[0].send('missed', { missed: 12 });
  assert.deepEqual(fills, [null, '2026-01-01T00:00:05.000Z']);
});

test('a message that is no JSON is left out', () => {
  const { sources, positions } = setUp();
  sources[0].opens();
  sources[0].sendText('position', '{"tag": ');
  sources[0].send('position', position('a', '2026-01-01T00:00:05.000Z'));
  assert.deepEqual(positions, ['a']);
});

test('a connection that was closed says nothing any more', () => {
  const { sources, timers, positions } = setUp();
  sources[0].opens();
  sources[0].breaks();
  timers.pass();
  sources[1].opens();
  sources[0].send('position', position('a', '2026-01-01T00:00:05.000Z'));
  assert.deepEqual(positions, []);
});

test('a page that slept opens the connection again, one that did not keeps it', () => {
  const { live, sources, timers } = setUp();
  sources[0].opens();
  timers.time = 10_000;
  live.refresh(45_000);
  assert.ok(!sources[0].closed);
  timers.time = 60_000;
  live.refresh(45_000);
  timers.pass();
  assert.ok(sources[0].closed);
  assert.equal(sources.length, 2);
});

test('nothing is opened after the end', () => {
  const { live, sources, timers } = setUp();
  sources[0].breaks();
  live.stop();
  timers.pass();
  assert.equal(sources.length, 1);
});

function storeOfOffice(): Store {
  const store = new Store();
  store.setSites([{ name: 'office', walls_m: [], plan: null, geographic_origin: null }], null);
  return store;
}

test('positions that fill a gap come between those that are there, once each', () => {
  const store = storeOfOffice();
  assert.ok(store.addPosition(position('a', '2026-01-01T00:00:01Z', 1)));
  assert.ok(store.addPosition(position('a', '2026-01-01T00:00:09Z', 9)));
  // The gap of five seconds, and the two that were there already.
  for (const s of [1, 3, 5, 9]) assert.ok(!store.addPosition(position('a', `2026-01-01T00:00:0${s}Z`, s)));
  assert.deepEqual(store.steps.get('a')?.map((step) => step.x), [1, 3, 5, 9]);
  assert.equal(store.tags.get('a')?.last_position?.x_m, 9);
});

test('positions of other sites and without numbers are left out', () => {
  const store = storeOfOffice();
  assert.ok(!store.addPosition({ ...position('a', '2026-01-01T00:00:01Z'), site: 'shop' }));
  assert.ok(!store.addPosition(position('a', 'yesterday')));
  assert.ok(!store.addPosition(position('a', '2026-01-01T00:00:01Z', NaN)));
  assert.equal(store.tags.size, 0);
});

test('an answer that was overtaken by a live position does not set the tag back', () => {
  const store = storeOfOffice();
  store.addPosition(position('a', '2026-01-01T00:00:09Z', 9));
  const tag = store.tags.get('a');
  assert.ok(tag !== undefined);
  store.setTags([{ ...tag, name: 'Ana', last_position: position('a', '2026-01-01T00:00:08Z', 8) }]);
  assert.equal(store.tags.get('a')?.last_position?.x_m, 9);
  assert.equal(store.nameOf('a'), 'Ana');
});

test('an event that comes live and from the history is there once', () => {
  const store = storeOfOffice();
  const event = {
    id: 7, t: '2026-01-01T00:00:01Z', site: 'office', kind: 'silent' as const,
    node: 'a', zone: null, dwell_s: null, alarm: false,
  };
  assert.equal(store.addEvents([event]).length, 1);
  assert.deepEqual(store.addEvents([event, { ...event, id: 9 }]).map((e) => e.id), [9]);
  assert.deepEqual(store.events.map((e) => e.id), [9, 7]);
});

test('entering, leaving and falling silent are known at once', () => {
  const store = storeOfOffice();
  store.addPosition(position('a', '2026-01-01T00:00:01Z'));
  const event = { id: 1, t: '2026-01-01T00:00:02Z', site: 'office', node: 'a', dwell_s: null, alarm: false };
  const tag = () => store.tags.get('a');
  store.applyEvent({ ...event, kind: 'entered', zone: 'Press' });
  store.applyEvent({ ...event, kind: 'entered', zone: 'Press' });
  assert.deepEqual(tag()?.zones, ['Press']);
  store.applyEvent({ ...event, kind: 'left', zone: 'Press' });
  assert.deepEqual(tag()?.zones, []);
  store.applyEvent({ ...event, kind: 'silent', zone: null });
  assert.equal(tag()?.silent, true);
  store.applyEvent({ ...event, kind: 'back', zone: null });
  assert.equal(tag()?.silent, false);
});
