import assert from 'node:assert/strict';
import test from 'node:test';
import { allPositions, nextOf } from '../src/api.js';
import { chooseLanguage, number, setLanguage, t } from '../src/i18n.js';
import { Motion } from '../src/map/motion.js';
import { lastBefore, Replay } from '../src/map/replay.js';
import { stateOf } from '../src/map/draw.js';
import { isLater, type Node, type NodeHealth, type TagPosition } from '../src/model.js';
import { curvesOf, worstOf } from '../src/panels/health-history.js';
import { localInput, stepFor } from '../src/panels/history.js';
import { parseOrigin } from '../src/panels/origin.js';
import { gridPoints } from '../src/panels/survey.js';
import { parseCorners } from '../src/panels/zones.js';
import { blank } from './blank.js';

function at(seconds: number, x: number): TagPosition {
  const t = new Date(Date.UTC(2026, 0, 1, 0, 0, seconds)).toISOString();
  return {
    site: 'office', tag: 'a', t, x_m: x, y_m: 0, z_m: null,
    sigma_x_m: 0.1, sigma_y_m: 0.1, sigma_z_m: null, cov_xy_m2: 0, room: null, used: 4, doubt: null,
  };
}

test('a tag moves in a straight line for as long as its positions are apart', () => {
  const motion = new Motion();
  const x = (now: number) => [...motion.at(now)][0].x;
  motion.move(at(0, 0), 'a', 1000);
  motion.move(at(1, 4), 'a', 1400);
  // 400 ms were between them: after 100 ms a quarter of the way is done.
  assert.equal(x(1500), 1);
  assert.ok(motion.moving(1700));
  assert.equal(x(1800), 4);
  assert.ok(!motion.moving(1801));
});

test('who wants no motion sees each position at once', () => {
  const motion = new Motion();
  motion.smooth = false;
  motion.move(at(0, 0), 'a', 1000);
  motion.move(at(1, 4), 'a', 1400);
  assert.equal([...motion.at(1400)][0].x, 4);
});

test('the replay shows a tag between two positions, and not where it was away', () => {
  const from = Date.UTC(2026, 0, 1);
  const replay = new Replay([at(0, 0), at(2, 1), at(100, 5)], from, from + 200_000, 10_000, (tag) => tag);
  const x = (seconds: number) => {
    replay.time = from + seconds * 1000;
    return [...replay.at()].map((mark) => mark.x);
  };
  assert.deepEqual(x(1), [0.5]);
  // For ten seconds after its last position it is shown there, then it is away until the next one.
  assert.deepEqual(x(12), [1]);
  assert.deepEqual(x(13), []);
  assert.deepEqual(x(100), [5]);
});

test('an ambiguous position is at two places, live and in the replay', () => {
  const motion = new Motion();
  motion.move({ ...at(0, 0), doubt: { flag: 'ambiguous', alternative_m: [3, -1, 0.5] } }, 'a', 1000);
  assert.deepEqual([...motion.at(1000)][0].other, { x: 3, y: -1 });
  const from = Date.UTC(2026, 0, 1);
  const past: TagPosition[] = [
    { ...at(0, 0), doubt: { flag: 'ambiguous', alternative_m: [3, -1, 0.5] } },
    { ...at(2, 0), doubt: { flag: 'suspect' } },
  ];
  const replay = new Replay(past, from, from + 200_000, 10_000, (tag) => tag);
  const other = (seconds: number) => {
    replay.time = from + seconds * 1000;
    return [...replay.at()][0].other;
  };
  assert.deepEqual(other(1), { x: 3, y: -1 });
  assert.equal(other(2), null);
});

test('the row before a time is found', () => {
  const rows = [{ t: 1 }, { t: 3 }, { t: 3 }, { t: 7 }];
  assert.deepEqual([0, 1, 2, 3, 6, 7, 9].map((time) => lastBefore(rows, time)), [-1, 0, 0, 2, 2, 3, 3]);
});

test('a history of several pages follows the links, up to the greatest number of rows', async () => {
  const pages: Record<string, { rows: TagPosition[]; next: string | null }> = {
    '/2': { rows: [at(2, 2), at(3, 3)], next: '/3' },
    '/3': { rows: [at(4, 4)], next: null },
  };
  const asked: string[] = [];
  const read = async (path: string) => {
    asked.push(path);
    return pages[path] ?? { rows: [at(0, 0), at(1, 1)], next: '/2' };
  };
  const all = await allPositions('a b', 'F', 'T', 1, 100, read);
  assert.deepEqual(all.map((row) => row.x_m), [0, 1, 2, 3, 4]);
  assert.equal(asked[0], '/api/v1/positions?site=a+b&from=F&to=T&step_s=1&limit=5000');
  assert.equal((await allPositions('a b', 'F', 'T', 1, 3, read)).length, 4);
  assert.equal(asked.length, 5);
});

test('the next page is in the header Link', () => {
  assert.equal(nextOf('</a?x=1>; rel="next"'), '/a?x=1');
  assert.equal(nextOf('</a>; rel="first", </b,c>; rel="next"'), '/b,c');
  assert.equal(nextOf('</a>; rel="first"'), null);
  assert.equal(nextOf(null), null);
});

test('the step of a replay fits the span into the rows', () => {
  // A day of 100 tags: 8,640,000 tag seconds into 60,000 rows are 144 s.
  assert.equal(stepFor(86_400, 100, 60_000), 144);
  assert.equal(stepFor(600, 3, 60_000), 1);
});

test('the time of an input is the local one', () => {
  assert.equal(localInput(new Date(2026, 2, 4, 5, 6, 7).getTime()), '2026-03-04T05:06:07');
});

test('typed corners may have decimal commas, and are refused where they are no numbers', () => {
  assert.deepEqual(parseCorners('0 0\n 4,5 0\n\n4.5;3'), [[0, 0], [4.5, 0], [4.5, 3]]);
  assert.equal(parseCorners('0 0\nfour 0'), null);
  assert.equal(parseCorners('0 0 0'), null);
});

test('a typed geographic origin has what is known, and the first wrong value is named', () => {
  const typed = {
    latitude_deg: ' 40,332', longitude_deg: '-3.766', y_azimuth_deg: '0', height_m: '', geoid_separation_m: ' ',
  };
  const origin = { latitude_deg: 40.332, longitude_deg: -3.766, y_azimuth_deg: 0 };
  assert.deepEqual(parseOrigin(typed), origin);
  const full = { ...typed, height_m: '650', geoid_separation_m: '50.1' };
  assert.deepEqual(parseOrigin(full), { ...origin, height_m: 650, geoid_separation_m: 50.1 });
  assert.equal(parseOrigin({ ...typed, latitude_deg: '' }), 'latitude_deg');
  assert.equal(parseOrigin({ ...typed, latitude_deg: '40.332, -3.766' }), 'latitude_deg');
  assert.equal(parseOrigin({ ...typed, longitude_deg: '180.1', height_m: 'high' }), 'longitude_deg');
  assert.equal(parseOrigin({ ...typed, y_azimuth_deg: 'north' }), 'y_azimuth_deg');
  assert.equal(parseOrigin({ ...typed, height_m: '-5001' }), 'height_m');
  assert.equal(parseOrigin({ ...typed, geoid_separation_m: '650' }), 'geoid_separation_m');
});

test('the grid of a campaign goes there and back, and stays in the rooms', () => {
  const bounds = { min: { x: 0, y: 0 }, max: { x: 4, y: 4 } };
  const points = gridPoints(bounds, 2, []);
  assert.deepEqual(points.map((p) => [p.x_m, p.y_m]), [[1, 1], [3, 1], [3, 3], [1, 3]]);
  const corners: [number, number][] = [[0, 0], [2, 0], [2, 4], [0, 4]];
  const left = gridPoints(bounds, 2, [{ site: 's', name: 'left', kind: 'room', corners_m: corners, alarm: false }]);
  assert.deepEqual(left.map((p) => [p.id, p.x_m, p.y_m, p.room]), [['p1', 1, 1, 'left'], ['p2', 1, 3, 'left']]);
});

test('an anchor that was moved is told before anything else', () => {
  const node = blank<Node>('Node', {
    last_seen: '2026-01-01T00:00:00Z', success_rate: 0.98, first_path_minus_received_db: -3,
  });
  assert.equal(stateOf(node), 'good');
  assert.equal(stateOf({ ...node, moved: true, success_rate: 0.1 }), 'moved');
  assert.equal(stateOf({ ...node, success_rate: 0.5 }), 'weak');
  assert.equal(stateOf({ ...node, first_path_minus_received_db: -14 }), 'nlos');
  assert.equal(stateOf({ ...node, last_seen: null }), 'unseen');
});

test('the language is the first one that the page speaks', () => {
  assert.equal(chooseLanguage(['ca', 'es-MX', 'en']), 'es');
  assert.equal(chooseLanguage(['en-GB', 'es']), 'en');
  assert.equal(chooseLanguage(['fr']), 'en');
  assert.equal(chooseLanguage([]), 'en');
});

test('texts and numbers follow the language, and names stay as they are', () => {
  setLanguage('es');
  assert.equal(t('events.entered', { node: '<b>{zone}</b>', zone: 'Sala 1' }), '<b>{zone}</b> ha entrado en Sala 1');
  assert.equal(number(1.5, 2), '1,50');
  setLanguage('en');
  assert.equal(number(1.5, 2), '1.50');
});

test('a time with a fraction of a second is after that of the whole second', () => {
  assert.ok(isLater('2026-01-01T00:00:01.25Z', '2026-01-01T00:00:01Z'));
  assert.ok(!isLater('2026-01-01T00:00:01Z', '2026-01-01T00:00:01.25Z'));
  assert.ok(!isLater('2026-01-01T00:00:01Z', '2026-01-01T00:00:01.000Z'));
});

test('the health of an anchor has a gap where minutes are missing, and its worst minutes are told', () => {
  const row = (minute: number, success_rate: number | null, residual_mean_m: number | null): NodeHealth =>
    blank<NodeHealth>('NodeHealth', { t: new Date(2026, 0, 1, 10, minute).toISOString(), success_rate, residual_mean_m });
  const minutes = (rows: NodeHealth[]) => curvesOf(rows).times.map((at) => new Date(at).getMinutes());
  // Newest first, as the station gives them; the minutes 3 and 4 are missing.
  const rows = [row(5, 0.5, 0.25), row(2, 0.5, -0.75), row(1, 0.75, null)];
  assert.deepEqual(minutes(rows), [1, 2, 3, 5]);
  const { success, residual } = curvesOf(rows);
  assert.deepEqual([success, residual], [[75, 50, null, 50], [null, -0.75, null, 0.25]]);
  setLanguage('en');
  const words = worstOf(curvesOf(rows));
  assert.match(words, /^Lowest success rate: 50 % at 10:02\b.* Residual farthest from zero: -0\.75 m at 10:02\b/);
  assert.equal(worstOf(curvesOf([row(1, null, null)])), '');
});
