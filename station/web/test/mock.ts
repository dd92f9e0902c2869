// A station of simulated tags that speaks the API, for the tests of the page in a browser. It serves the page with a
// policy that is as strict as the station's.

import { createServer, type IncomingMessage, type Server, type ServerResponse } from 'node:http';
import { readdirSync, readFileSync } from 'node:fs';
import type { AddressInfo } from 'node:net';
import type {
  Access,
  Campaign,
  EventKind,
  Finding,
  GeographicOrigin,
  Node,
  NodeHealth,
  PlanScale,
  Site,
  StationEvent,
  Tag,
  TagPosition,
  Wall,
  Zone,
} from '../src/model.js';
import { inPolygon } from '../src/map/geometry.js';
import { blank } from './blank.js';

const POLICY =
  "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; font-src 'self'; " +
  "connect-src 'self'; manifest-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'self'; " +
  "frame-ancestors 'none'";
const TYPES: Record<string, string> = {
  html: 'text/html; charset=utf-8',
  js: 'text/javascript; charset=utf-8',
  css: 'text/css; charset=utf-8',
  svg: 'image/svg+xml',
  txt: 'text/plain; charset=utf-8',
};
const NAMES = ['Ana', 'Forklift 1', 'Bruno', 'Pallet 7', 'Carla', 'Trolley', 'Diego', 'Robot', 'Elena', 'Drill'];
/// How far the history goes back, ms.
const PAST_MS = 3_600_000;

export interface Options {
  tags: number;
  rateHz: number;
  /// The roles of tokens; none: nobody is asked.
  tokens?: Record<string, Access>;
  empty?: boolean;
}

export class Mock {
  readonly site: Site = { name: 'office', walls_m: walls(), plan: null, geographic_origin: null };
  zones: Zone[] = [];
  nodes: Node[] = anchors();
  findings: Finding[] = [];
  events: StationEvent[] = [];
  campaigns: Campaign[] = [];
  picture: Buffer | null = null;
  requests: string[] = [];
  /// Answers 503 to all.
  down = false;
  url = '';
  private readonly server: Server;
  private readonly streams = new Set<ServerResponse>();
  private timer: NodeJS.Timeout | undefined;
  private readonly began = Date.now();

  constructor(
    private readonly options: Options,
    private readonly dist: string,
  ) {
    this.server = createServer((request, response) => {
      this.answer(request, response).catch((error: unknown) => {
        if (!response.headersSent) problem(response, 500, String(error));
      });
    });
  }

  async start(port = 0): Promise<this> {
    await new Promise<void>((resolve) => this.server.listen(port, '127.0.0.1', resolve));
    this.url = `http://127.0.0.1:${(this.server.address() as AddressInfo).port}`;
    this.timer = setInterval(() => this.tick(), 1000 / this.options.rateHz);
    return this;
  }

  async stop(): Promise<void> {
    clearInterval(this.timer);
    this.breakStreams();
    this.server.closeAllConnections();
    await new Promise((resolve) => this.server.close(resolve));
  }

  breakStreams(): void {
    for (const stream of this.streams) stream.destroy();
    this.streams.clear();
  }

  happen(kind: EventKind, node: string, zone: string | null, alarm: boolean): void {
    const event: StationEvent = {
      id: this.events.length + 1,
      t: new Date().toISOString(),
      site: this.site.name,
      kind,
      node,
      zone,
      dwell_s: kind === 'left' ? 42 : null,
      alarm,
    };
    this.events.unshift(event);
    this.send('event', event);
  }

  /// Where a tag is at a time: round the rooms, each tag on a way of its own.
  position(i: number, t: number): TagPosition {
    const phase = t / 14_000 + i * 2.399;
    const x = 10 + 8.5 * Math.sin(phase * (0.5 + (i % 5) * 0.13) + i);
    const y = 6 + 4.8 * Math.sin(phase * (0.7 + (i % 3) * 0.17) + i * 0.7);
    const wave = 0.5 + 0.5 * Math.sin(t / 5000 + i);
    const sigmaX = 0.12 + 0.2 * wave;
    const sigmaY = 0.1 + 0.1 * (1 - wave);
    return {
      site: this.site.name,
      tag: address(i),
      t: new Date(t).toISOString(),
      x_m: x,
      y_m: y,
      z_m: null,
      sigma_x_m: sigmaX,
      sigma_y_m: sigmaY,
      sigma_z_m: null,
      cov_xy_m2: 0.6 * sigmaX * sigmaY * Math.sin(t / 7000 + i),
      room: this.zones.find((zone) => zone.kind === 'room' && inPolygon(zone.corners_m, { x, y }))?.name ?? null,
      used: 5,
      doubt: null,
    };
  }

  changed(): void {
    this.send('changed', {});
  }

  private tick(): void {
    const now = Date.now();
    if (this.streams.size === 0) return;
    let text = '';
    for (let i = 0; i < this.options.tags; i++) text += message('position', this.position(i, now));
    for (const stream of this.streams) stream.write(text);
  }

  private send(type: string, data: unknown): void {
    for (const stream of this.streams) stream.write(message(type, data));
  }

  private tags(): Tag[] {
    const now = Date.now();
    return Array.from({ length: this.options.tags }, (_, i) => {
      const last = this.position(i, now);
      const zones = this.zones.filter((zone) => inPolygon(zone.corners_m, { x: last.x_m, y: last.y_m }));
      return {
        tag: address(i),
        site: this.site.name,
        name: i < NAMES.length ? NAMES[i] : null,
        first_seen: new Date(this.began - PAST_MS).toISOString(),
        last_seen: last.t,
        last_position: last,
        rate_hz: this.options.rateHz,
        silent: false,
        reason: null,
        zones: zones.map((zone) => zone.name),
        supply_v: 3.1,
      };
    });
  }

  private who(request: IncomingMessage): Access | null {
    if (this.options.tokens === undefined) return 'administer';
    const token = /baliza_session=([^;]*)/.exec(request.headers.cookie ?? '')?.[1] ?? '';
    return this.options.tokens[token] ?? null;
  }

  private async answer(request: IncomingMessage, response: ServerResponse): Promise<void> {
    const url = new URL(request.url ?? '/', 'http://mock');
    const path = url.pathname.split('/').slice(1).map(decodeURIComponent);
    const method = request.method ?? 'GET';
    this.requests.push(`${method} ${url.pathname}`);
    if (this.down) return problem(response, 503, 'the station is down');
    if (method === 'GET' && this.file(url.pathname, response)) return;
    const route = `${method} ${path[0]}/${path[1] ?? ''}/${path[2] ?? ''}`;
    const who = this.who(request);
    if (route === 'GET api/v1/me') {
      return json(response, { name: null, role: who, tokens: this.options.tokens !== undefined, sign_in: null });
    }
    if (route === 'POST login//') return this.login(await body(request), response);
    if (route === 'POST logout//') {
      response.setHeader('Set-Cookie', 'baliza_session=; Path=/; Max-Age=0');
      return json(response, { end_session: null });
    }
    if (who === null) return problem(response, 401, 'a token is needed');
    if (method !== 'GET' && who === 'view') return problem(response, 403, 'this needs the role operate');
    if (path[0] === 'campaigns') return this.campaign(method, path, request, response);
    const query = url.searchParams;
    switch (route) {
      case 'GET scenarios//':
        return json(response, this.options.empty === true ? [] : [this.site]);
      case 'GET api/v1/tags':
        return path[4] === 'positions' ? this.history(path[3], query, response) : json(response, this.tags());
      case 'GET api/v1/positions':
        return this.replay(url, response);
      case 'GET api/v1/nodes':
        return json(response, path[5] === 'health' ? this.health(path[4], query) : this.nodes);
      case 'GET api/v1/findings':
        return json(response, this.findings);
      case 'GET api/v1/rooms':
        return json(response, this.zones);
      case 'GET api/v1/events':
        return json(response, this.eventsOf(query));
      case 'GET api/v1/updates':
        return this.stream(response);
      case 'PUT api/v1/rooms': {
        const zone = JSON.parse(String(await body(request))) as Zone;
        if (zone.name !== path[4] || zone.corners_m.length < 3) return problem(response, 422, 'no outline');
        this.zones = [...this.zones.filter((other) => other.name !== path[4]), zone];
        return json(response, zone);
      }
      case 'DELETE api/v1/rooms':
        this.zones = this.zones.filter((zone) => zone.name !== path[4]);
        return done(response, 204);
      case 'PUT api/v1/sites':
        return this.putSite(path.slice(4).join('/'), query, await body(request), response);
      default:
        if (method === 'GET' && path[0] === 'blueprints' && this.picture !== null) {
          response.setHeader('Content-Type', 'image/png');
          response.end(this.picture);
          return;
        }
        return problem(response, 404, `there is no ${url.pathname}`);
    }
  }

  private putSite(what: string, query: URLSearchParams, content: Buffer, response: ServerResponse): void {
    if (what === 'walls') this.site.walls_m = JSON.parse(String(content)) as Wall[];
    else if (what === 'geographic-origin') {
      this.site.geographic_origin = JSON.parse(String(content)) as GeographicOrigin;
    } else if (what === 'plan/scale') {
      if (this.site.plan === null) return problem(response, 404, 'there is no plan');
      Object.assign(this.site.plan, JSON.parse(String(content)) as PlanScale);
    } else if (what === 'plan') {
      if (content.readUInt32BE(0) !== 0x89504e47) return problem(response, 415, 'this is no PNG');
      const number = (name: string) => Number(query.get(name));
      this.picture = content;
      this.site.plan = {
        origin_m: [number('origin_x_m'), number('origin_y_m')],
        metres_per_pixel: number('metres_per_pixel'),
        rotation_rad: number('rotation_rad'),
        width_px: content.readUInt32BE(16),
        height_px: content.readUInt32BE(20),
        media_type: 'image/png',
      };
    }
    json(response, this.site);
  }

  private login(content: Buffer, response: ServerResponse): void {
    const { token } = JSON.parse(String(content)) as { token: string };
    const role = this.options.tokens?.[token];
    if (role === undefined) return problem(response, 401, 'this token is not known');
    response.setHeader('Set-Cookie', `baliza_session=${token}; Path=/; HttpOnly; SameSite=Strict`);
    json(response, { name: 'someone', role, tokens: true });
  }

  private eventsOf(query: URLSearchParams): StationEvent[] {
    const before = Number(query.get('before') ?? Infinity);
    const kind = query.get('kind');
    const all = this.events.filter((event) => event.id < before && (kind === null || event.kind === kind));
    return all.slice(0, Number(query.get('limit') ?? 1000));
  }

  /// A row a minute since `from`: like today for two hours, without a row for an hour, and well before.
  private health(of: string, query: URLSearchParams): NodeHealth[] {
    const node = this.nodes.find((one) => one.node === of);
    const now = Math.floor(Date.now() / 60_000);
    const minutes = Array.from({ length: Number(query.get('limit')) }, (_, i) => i);
    if (node === undefined || node.success_rate === null) return [];
    return minutes
      .filter((ago) => ago < 120 || ago >= 180)
      .map((ago) => ({
        ...node,
        t: new Date((now - ago) * 60_000).toISOString(),
        success_rate: ago < 120 ? node.success_rate : 0.99,
        residual_mean_m: ago < 120 ? node.residual_mean_m : -0.02,
      }));
  }

  private span(query: URLSearchParams): [number, number] {
    const from = Math.max(Date.parse(query.get('from') ?? ''), this.began - PAST_MS);
    return [from, Math.min(Date.parse(query.get('to') ?? ''), Date.now())];
  }

  private replay(url: URL, response: ServerResponse): void {
    const [from, to] = this.span(url.searchParams);
    const asked = Number(url.searchParams.get('step_s') ?? 1) * 1000;
    const step = asked === 0 ? 1000 / this.options.rateHz : asked;
    const limit = Number(url.searchParams.get('limit') ?? 1000);
    const rows: TagPosition[] = [];
    for (let t = from; t < to; t += step) {
      if (rows.length + this.options.tags > limit && rows.length > 0) {
        url.searchParams.set('from', new Date(t).toISOString());
        response.setHeader('Link', `<${url.pathname}${url.search}>; rel="next"`);
        break;
      }
      for (let i = 0; i < this.options.tags; i++) rows.push(this.position(i, t));
    }
    json(response, rows);
  }

  private history(tag: string, query: URLSearchParams, response: ServerResponse): void {
    const [from, to] = this.span(query);
    const i = Array.from({ length: this.options.tags }, (_, n) => address(n)).indexOf(tag);
    if (i < 0) return problem(response, 404, `there is no tag ${tag}`);
    const rows: TagPosition[] = [];
    const limit = Number(query.get('limit') ?? 1000);
    for (let t = to - 1; t >= from && rows.length < limit; t -= 1000 / this.options.rateHz)
      rows.push(this.position(i, t));
    json(response, rows);
  }

  private async campaign(
    method: string,
    path: string[],
    request: IncomingMessage,
    response: ServerResponse,
  ): Promise<void> {
    const campaign = this.campaigns.find((one) => one.name === path[1]);
    if (method === 'POST' && path.length === 1) {
      const made = JSON.parse(String(await body(request))) as Campaign;
      made.created = new Date().toISOString();
      made.points = made.points.map((point) => ({ ...point, samples: 0 }));
      this.campaigns.push(made);
      return json(response, made, 201);
    }
    if (path.length === 1) return json(response, this.campaigns);
    if (campaign === undefined) return problem(response, 404, `there is no campaign ${path[1]}`);
    if (method === 'DELETE') {
      this.campaigns = this.campaigns.filter((one) => one !== campaign);
      return done(response, 204);
    }
    const point = campaign.points.find((one) => one.id === path[3]);
    if (method === 'POST' && point !== undefined) {
      const samples = JSON.parse(String(await body(request))) as unknown[];
      point.samples += samples.length;
      return json(response, { added: samples.length, samples: point.samples }, 201);
    }
    json(response, path[2] === 'points' ? campaign.points : campaign);
  }

  private stream(response: ServerResponse): void {
    response.writeHead(200, { 'Content-Type': 'text/event-stream', 'Cache-Control': 'no-store' });
    response.write(': here\n\n');
    this.streams.add(response);
    response.on('close', () => this.streams.delete(response));
  }

  private file(path: string, response: ServerResponse): boolean {
    const name = path === '/' ? 'index.html' : path.slice(1);
    if (!readdirSync(this.dist).includes(name)) return false;
    response.setHeader('Content-Security-Policy', POLICY);
    response.setHeader('Content-Type', TYPES[name.replace(/^.*\./, '')] ?? 'application/octet-stream');
    response.end(readFileSync(`${this.dist}/${name}`));
    return true;
  }
}

function address(i: number): string {
  return `0x${(0x1001 + i).toString(16)}`;
}

function message(type: string, data: unknown): string {
  return `event: ${type}\ndata: ${JSON.stringify(data)}\n\n`;
}

function json(response: ServerResponse, value: unknown, status = 200): void {
  response.writeHead(status, { 'Content-Type': 'application/json' });
  response.end(JSON.stringify(value));
}

function done(response: ServerResponse, status: number): void {
  response.writeHead(status);
  response.end();
}

function problem(response: ServerResponse, status: number, detail: string): void {
  response.writeHead(status, { 'Content-Type': 'application/problem+json' });
  response.end(JSON.stringify({ type: 'about:blank', title: 'refused', status, detail }));
}

async function body(request: IncomingMessage): Promise<Buffer> {
  const parts: Buffer[] = [];
  for await (const part of request) parts.push(part as Buffer);
  return Buffer.concat(parts);
}

function walls(): Wall[] {
  return [
    [
      [0, 0],
      [20, 0],
    ],
    [
      [20, 0],
      [20, 12],
    ],
    [
      [20, 12],
      [0, 12],
    ],
    [
      [0, 12],
      [0, 0],
    ],
    [
      [8, 0],
      [8, 3.5],
    ],
    [
      [8, 5],
      [8, 12],
    ],
    [
      [8, 7],
      [12.5, 7],
    ],
    [
      [14, 7],
      [20, 7],
    ],
  ];
}

function anchors(): Node[] {
  const places: [number, number][] = [
    [0.3, 0.3],
    [19.7, 0.3],
    [19.7, 11.7],
    [0.3, 11.7],
    [8.2, 6.5],
    [14, 11.7],
  ];
  const anchor = ([x, y]: [number, number], i: number) => ({
    node: `0x010${i + 1}`,
    site: 'office',
    name: i === 0 ? 'Door' : null,
    role: 'anchor' as const,
    position_m: [x, y, 2.6] as [number, number, number],
    last_seen: new Date().toISOString(),
    rate_hz: 80 - 7 * i,
    success_rate: i === 4 ? 0.52 : 0.99 - 0.02 * i,
    residual_mean_m: i === 2 ? 0.83 : 0.01 * (i - 2),
    residual_sigma_m: 0.06 + 0.01 * i,
    first_path_minus_received_db: i === 3 ? -13.4 : -1.8 - 0.4 * i,
    clock_offset_ppm: 1.6 - 0.9 * i,
    moved: i === 2,
    supply_v: 3.29 - 0.01 * i,
  });
  return places.map((place, i) => blank<Node>('Node', anchor(place, i)));
}

export function rooms(): Zone[] {
  const box = (x0: number, y0: number, x1: number, y1: number): [number, number][] => [
    [x0, y0],
    [x1, y0],
    [x1, y1],
    [x0, y1],
  ];
  const zone = { site: 'office', alarm: false };
  return [
    { ...zone, name: 'Workshop', kind: 'room', corners_m: box(0, 0, 8, 12) },
    { ...zone, name: 'Store', kind: 'room', corners_m: box(8, 0, 20, 7) },
    { ...zone, name: 'Office', kind: 'room', corners_m: box(8, 7, 20, 12) },
    {
      ...zone,
      name: 'Press',
      kind: 'zone',
      corners_m: [
        [1.5, 2],
        [4.5, 1.6],
        [5.2, 4.4],
        [2, 5],
      ],
      alarm: true,
    },
  ];
}
