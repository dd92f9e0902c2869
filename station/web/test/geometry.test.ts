import assert from 'node:assert/strict';
import test from 'node:test';
import * as geometry from '../src/map/geometry.js';
import { heatOf } from '../src/map/heat.js';

const near = (a: number, b: number, most = 1e-9) => assert.ok(Math.abs(a - b) <= most, `${a} is not ${b}`);
const nearPoint = (a: geometry.Point, x: number, y: number) => (near(a.x, x), near(a.y, y));

const view: geometry.View = { centre: { x: 10, y: 5 }, pixelsPerMetre: 20, width: 800, height: 600 };

test('the centre of the view is in the middle of the screen, and y goes up', () => {
  nearPoint(geometry.toScreen(view, { x: 10, y: 5 }), 400, 300);
  // Two metres to the right are 40 pixels, one metre up 20.
  nearPoint(geometry.toScreen(view, { x: 12, y: 6 }), 440, 280);
  nearPoint(geometry.toMetres(view, { x: 440, y: 280 }), 12, 6);
});

test('zooming keeps what is under the pointer', () => {
  const before: geometry.View = { centre: { x: 0, y: 0 }, pixelsPerMetre: 10, width: 200, height: 100 };
  // The pointer is 50 pixels right of the middle: at 5 m. At 20 pixels per metre, 50 pixels are 2.5 m.
  const after = geometry.zoomed(before, 2, { x: 150, y: 50 });
  assert.equal(after.pixelsPerMetre, 20);
  nearPoint(after.centre, 2.5, 0);
});

test('a fitted view shows all of the bounds', () => {
  // 20 m by 4 m into 800 by 600 pixels with 100 at each side: 600 pixels for 20 m.
  const fitted = geometry.fitted(view, { min: { x: 0, y: 0 }, max: { x: 20, y: 4 } }, 100);
  assert.equal(fitted.pixelsPerMetre, 30);
  nearPoint(fitted.centre, 10, 2);
});

test('the scale of a plan is the distance by the pixels between two points', () => {
  // 300 to the right and 400 down are 500 pixels; 12.5 m / 500 px.
  near(geometry.scaleFromTwoPoints({ x: 100, y: 100 }, { x: 400, y: 500 }, 12.5) ?? 0, 0.025);
});

test('equal points and distances that are no length give no scale', () => {
  const p = { x: 7, y: 7 };
  assert.equal(geometry.scaleFromTwoPoints(p, p, 5), null);
  for (const bad of [0, -1, NaN, Infinity]) assert.equal(geometry.scaleFromTwoPoints(p, { x: 90, y: 7 }, bad), null);
});

test('a point of the plan is where the model of the station says', () => {
  const plan = { origin_m: [2, 10] as [number, number], metres_per_pixel: 0.05, rotation_rad: 0 };
  // 100 px right are 5 m, 40 px down are 2 m.
  nearPoint(geometry.planToMetres(plan, { x: 100, y: 40 }), 7, 8);
  // A quarter turn anticlockwise: right becomes up, down becomes right.
  const turned = { ...plan, rotation_rad: Math.PI / 2 };
  nearPoint(geometry.planToMetres(turned, { x: 100, y: 40 }), 4, 15);
  nearPoint(geometry.metresToPlan(turned, { x: 4, y: 15 }), 100, 40);
});

test('the origin puts a known point at its place', () => {
  const plan = { origin_m: [0, 0] as [number, number], metres_per_pixel: 0.025, rotation_rad: 0 };
  // The point is 1 m right of the upper left corner and 5 m below it.
  assert.deepEqual(geometry.originFor(plan, { x: 40, y: 200 }, { x: 1, y: 2 }), [0, 7]);
});

test('the ellipse has the roots of the eigenvalues as semi-axes', () => {
  // [[5, 2], [2, 2]]: trace 7, determinant 6, eigenvalues 6 and 1; the major axis at atan2(1, 2) = 26.565°.
  const e = geometry.ellipse(Math.sqrt(5), Math.sqrt(2), 2);
  near(e.major, 4.898979485566356, 1e-12);
  near(e.minor, 2, 1e-12);
  near(e.angle, 0.4636476090008061, 1e-12);
});

test('the ellipse of equal deviations and a covariance is turned by 45 degrees', () => {
  // [[2, 1], [1, 2]]: eigenvalues 3 and 1.
  const e = geometry.ellipse(Math.SQRT2, Math.SQRT2, 1);
  near(e.major, 3.4641016151377544, 1e-9);
  near(e.minor, 2, 1e-9);
  near(e.angle, Math.PI / 4, 1e-9);
});

test('an ellipse without covariance lies along its greater deviation', () => {
  near(geometry.ellipse(0.3, 0.1, 0).angle, 0);
  near(geometry.ellipse(0.1, 0.3, 0).angle, Math.PI / 2);
  near(geometry.ellipse(0.1, 0.3, 0).major, 0.6);
});

test('a covariance that is greater than its deviations allow gives a flat ellipse, not NaN', () => {
  assert.equal(geometry.ellipse(1, 1, 5).minor, 0);
});

test('points are in a polygon or not, whichever way it goes round', () => {
  // An L: the square from (2, 2) to (4, 4) is missing.
  const l: [number, number][] = [[0, 0], [4, 0], [4, 2], [2, 2], [2, 4], [0, 4]];
  for (const corners of [l, [...l].reverse()]) {
    assert.ok(geometry.inPolygon(corners, { x: 3, y: 1 }));
    assert.ok(geometry.inPolygon(corners, { x: 1, y: 3 }));
    assert.ok(!geometry.inPolygon(corners, { x: 3, y: 3 }));
    assert.ok(!geometry.inPolygon(corners, { x: 5, y: 1 }));
  }
});

test('the middle of a triangle is the mean of its corners', () => {
  nearPoint(geometry.middle([[0, 0], [3, 0], [0, 3]]), 1, 1);
  nearPoint(geometry.middle([[0, 0], [2, 2]]), 1, 1);
});

test('the scale bar has a round length', () => {
  // 120 pixels at 40 pixels per metre are 3 m.
  assert.equal(geometry.roundLength(40, 120), 2);
  assert.equal(geometry.roundLength(20, 120), 5);
});

test('the heat map counts each position until the next one, and no longer than the limit', () => {
  const at = (t: number, x: number) => ({ t: t * 1000, x, y: 0.1 });
  // In the first cell 4 s and 2 s; in the third one 94 s, of which 10 count.
  const heat = heatOf([[at(0, 0.1), at(4, 0.1), at(6, 1.1), at(100, 1.1)]], 10);
  assert.deepEqual([...(heat?.seconds ?? [])], [6, 0, 10]);
  assert.equal(heat?.max, 10);
});

test('far outliers make the cells of the heat map greater, not their number', () => {
  const heat = heatOf([[{ t: 0, x: 0, y: 0 }, { t: 1000, x: 1e6, y: 1e6 }]], 10);
  assert.ok(heat !== null && heat.columns * heat.rows <= 40_000);
});

test('no position, no heat map', () => {
  assert.equal(heatOf([], 10), null);
});
