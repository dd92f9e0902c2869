// The station's routes. In: paths and objects; out: objects, or `ApiError` with the station's own words
// (problem+json).

import type {
  Campaign,
  CampaignPoint,
  Finding,
  GeographicOrigin,
  Me,
  Node,
  NodeHealth,
  PlanScale,
  Site,
  StationEvent,
  Tag,
  TagMessage,
  TagPosition,
  Wall,
  Zone,
} from './model.js';

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
  // Where the provider of sign-ins ends its session too, if it does.
  logout: async () => {
    const { end_session } = (await (await send('POST', '/logout')).json()) as { end_session: string | null };
    return end_session;
  },

  sites: () => get<Site[]>('/scenarios'),
  // The picture may have been replaced: the browser asks whether it was.
  blueprint: async (site: string) => {
    const response = await fetch(`/blueprints/${part(site)}`, { cache: 'no-cache' });
    if (!response.ok) throw new ApiError(response.status, await messageOf(response));
    return response.blob();
  },
  updates: (site: string) => withQuery('/api/v1/updates', { site }),
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
  putGeographicOrigin: (site: string, origin: GeographicOrigin) =>
    send('PUT', `/api/v1/sites/${part(site)}/geographic-origin`, origin),
  deleteGeographicOrigin: (site: string) => send('DELETE', `/api/v1/sites/${part(site)}/geographic-origin`),

  tags: (site: string) => get<Tag[]>('/api/v1/tags', { site }),
  nodes: (site: string) => get<Node[]>('/api/v1/nodes', { site }),
  nodeHealth: (site: string, node: string, from: string, limit: number) =>
    get<NodeHealth[]>(`/api/v1/nodes/${part(site)}/${part(node)}/health`, { from, limit }),
  findings: (site: string) => get<Finding[]>('/api/v1/findings', { site }),
  zones: (site: string) => get<Zone[]>('/api/v1/rooms', { site }),
  putZone: (zone: Zone) => send('PUT', `/api/v1/rooms/${part(zone.site)}/${part(zone.name)}`, zone),
  deleteZone: (site: string, name: string) => send('DELETE', `/api/v1/rooms/${part(site)}/${part(name)}`),
  events: (site: string, query: { from?: string; to?: string; kind?: string; before?: number; limit?: number }) =>
    get<StationEvent[]>('/api/v1/events', { site, ...query }),
  tagPositions: (site: string, tag: string, from: string, to: string, limit: number) =>
    get<TagPosition[]>(`/api/v1/tags/${part(tag)}/positions`, { site, from, to, limit }),
  trackUrl: (site: string, tag: string, from: string, to: string, limit: number) =>
    withQuery(`/api/v1/tags/${part(tag)}/positions.gpx`, { site, from, to, limit }),

  identify: async (tag: string, seconds: number) => {
    const content = { identify_s: seconds };
    return (await (await send('POST', `/api/v1/tags/${part(tag)}/messages`, { content })).json()) as TagMessage;
  },
  messages: (tag: string) => get<TagMessage[]>(`/api/v1/tags/${part(tag)}/messages`),

  campaigns: () => get<Campaign[]>('/campaigns'),
  createCampaign: (campaign: { name: string; scenario: string; points: Omit<CampaignPoint, 'samples'>[] }) =>
    send('POST', '/campaigns', campaign),
  deleteCampaign: (name: string) => send('DELETE', `/campaigns/${part(name)}`),
  campaignPoints: (name: string) => get<CampaignPoint[]>(`/campaigns/${part(name)}/points`),
  samplesUrl: (name: string, point: string) =>
    `${location.origin}/campaigns/${part(name)}/points/${part(point)}/samples`,
};

/// A page of rows, and the address of the next one, where the station tells one.
export interface Page<T> {
  rows: T[];
  next: string | null;
}

/// The address with `rel="next"` of a header `Link` (RFC 8288).
export function nextOf(link: string | null): string | null {
  for (const entry of (link ?? '').split(/,\s*(?=<)/)) {
    const found = /^<([^>]*)>\s*;.*\brel="?next"?/.exec(entry.trim());
    if (found !== null) return found[1];
  }
  return null;
}

async function page<T>(path: string): Promise<Page<T>> {
  const response = await send('GET', path);
  return { rows: (await response.json()) as T[], next: nextOf(response.headers.get('Link')) };
}

/// All positions of a site in a span, oldest first: page after page, until there are `most`.
export async function allPositions(
  site: string,
  from: string,
  to: string,
  stepS: number,
  most: number,
  read: (path: string) => Promise<Page<TagPosition>> = page,
): Promise<TagPosition[]> {
  const rows: TagPosition[] = [];
  let next: string | null = withQuery('/api/v1/positions', { site, from, to, step_s: stepS, limit: PAGE });
  while (next !== null && rows.length < most) {
    const got: Page<TagPosition> = await read(next);
    for (const row of got.rows) rows.push(row);
    next = got.next;
  }
  return rows;
}
