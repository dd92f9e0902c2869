// The station's routes. In: paths and objects; out: objects, or `ApiError` with the station's own words
// (problem+json).

import type { Campaign, CampaignPoint, Me, Node, PlanScale, Site, StationEvent, Tag, TagPosition, Wall, Zone } from './model.js';

export class ApiError extends Error {
  constructor(
    readonly status: number,
    message: string,
  ) {
    super(message);
  }
}

type Query = Record<string, string | number | null | undefined>;

function withQuery(path: string, query: Query = {}): string {
  const parameters = new URLSearchParams();
  for (const [key, value] of Object.entries(query)) {
    if (value !== null && value !== undefined) parameters.set(key, String(value));
  }
  const text = parameters.toString();
  return text === '' ? path : `${path}?${text}`;
}

async function messageOf(response: Response): Promise<string> {
  const text = await response.text().catch(() => '');
  try {
    const problem = JSON.parse(text) as { detail?: unknown; title?: unknown };
    const said = problem.detail ?? problem.title;
    if (typeof said === 'string' && said !== '') return said;
  } catch {
    // Not JSON: a proxy's page, or nothing. The status says enough.
  }
  return `${response.status} ${response.statusText}`.trim();
}

async function send(method: string, path: string, body?: unknown, type = 'application/json'): Promise<Response> {
  const headers: Record<string, string> = { Accept: 'application/json' };
  if (body !== undefined) headers['Content-Type'] = type;
  const response = await fetch(path, {
    method,
    headers,
    body: body === undefined ? undefined : body instanceof Blob ? body : JSON.stringify(body),
  });
  if (!response.ok) throw new ApiError(response.status, await messageOf(response));
  return response;
}

async function get<T>(path: string, query?: Query): Promise<T> {
  return (await (await send('GET', withQuery(path, query))).json()) as T;
}

const part = encodeURIComponent;

export const PAGE = 5000;

export const api = {
  me: () => get<Me>('/api/v1/me'),
  login: (token: string) => send('POST', '/login', { token }),
  logout: () => send('POST', '/logout'),

  sites: () => get<Site[]>('/scenarios'),
  blueprint: (site: string, version: string) => withQuery(`/blueprints/${part(site)}`, { v: version }),
  putPlan: (site: string, scale: PlanScale, picture: Blob) =>
    send(
      'PUT',
      withQuery(`/api/v1/sites/${part(site)}/plan`, {
        origin_x_m: scale.origin_m[0],
        origin_y_m: scale.origin_m[1],
        metres_per_pixel: scale.metres_per_pixel,
        rotation_rad: scale.rotation_rad,
      }),
      picture,
      picture.type,
    ),
  putScale: (site: string, scale: PlanScale) => send('PUT', `/api/v1/sites/${part(site)}/plan/scale`, scale),
  putWalls: (site: string, walls: Wall[]) => send('PUT', `/api/v1/sites/${part(site)}/walls`, walls),

  tags: (site: string) => get<Tag[]>('/api/v1/tags', { site }),
  nodes: (site: string) => get<Node[]>('/api/v1/nodes', { site }),
  zones: (site: string) => get<Zone[]>('/api/v1/rooms', { site }),
  putZone: (zone: Zone) => send('PUT', `/api/v1/rooms/${part(zone.site)}/${part(zone.name)}`, zone),
  deleteZone: (site: string, name: string) => send('DELETE', `/api/v1/rooms/${part(site)}/${part(name)}`),
  events: (site: string, query: { from?: string; to?: string; kind?: string; before?: number; limit?: number }) =>
    get<StationEvent[]>('/api/v1/events', { site, ...query }),
  tagPositions: (site: string, tag: string, from: string, to: string, limit: number) =>
    get<TagPosition[]>(`/api/v1/tags/${part(tag)}/positions`, { site, from, to, limit }),
  positions: (site: string, from: string, to: string, stepS: number, limit: number) =>
    get<TagPosition[]>('/api/v1/positions', { site, from, to, step_s: stepS, limit }),

  campaigns: () => get<Campaign[]>('/campaigns'),
  createCampaign: (campaign: { name: string; scenario: string; points: Omit<CampaignPoint, 'samples'>[] }) =>
    send('POST', '/campaigns', campaign),
  deleteCampaign: (name: string) => send('DELETE', `/campaigns/${part(name)}`),
  campaignPoints: (name: string) => get<CampaignPoint[]>(`/campaigns/${part(name)}/points`),
  samplesUrl: (name: string, point: string) =>
    `${location.origin}/campaigns/${part(name)}/points/${part(point)}/samples`,
};

/// All positions of a site in a span, oldest first: page after page, at most `most`. A page begins at the time of the
/// last row of the page before; rows that were there already are left out.
export async function allPositions(
  site: string,
  from: string,
  to: string,
  stepS: number,
  most: number,
  page: (from: string) => Promise<TagPosition[]> = (start) => api.positions(site, start, to, stepS, PAGE),
): Promise<TagPosition[]> {
  const rows: TagPosition[] = [];
  let start = from;
  let seen = new Set<string>();
  while (rows.length < most) {
    const fresh = (await page(start)).filter((row) => !seen.has(`${row.tag} ${row.t}`));
    if (fresh.length === 0) break;
    for (const row of fresh) rows.push(row);
    start = fresh[fresh.length - 1].t;
    seen = new Set(rows.filter((row) => row.t === start).map((row) => `${row.tag} ${row.t}`));
  }
  return rows;
}
