// What the page knows: the sites, and the tags, nodes, zones, events of the chosen one. In: rows of the API and live
// updates. Out: `on(topic, …)` tells who draws them. There is no drawing and no request here.

import { isLater, type Me, type Node, type Site, type StationEvent, type Tag, type TagPosition, type Zone } from './model.js';

export type Topic = 'site' | 'tags' | 'nodes' | 'zones' | 'events' | 'selection' | 'language' | 'me' | 'mode';

/// A tag's last positions in the order of their times (ms).
export interface Step {
  t: number;
  x: number;
  y: number;
  s: number;
}

/// How long trails are, ms.
export const TRAIL_MS = 20_000;
/// The most positions of a trail: it is shorter where a tag has more than 60 positions a second.
const MOST_STEPS = 1200;
/// New tags that come together are told together.
const SOON_MS = 50;
const MOST_EVENTS = 500;

export class Store {
  sites: Site[] = [];
  site: Site | null = null;
  readonly tags = new Map<string, Tag>();
  readonly steps = new Map<string, Step[]>();
  nodes: Node[] = [];
  zones: Zone[] = [];
  events: StationEvent[] = [];
  selected: string | null = null;
  me: Me = { name: null, role: 'administer', tokens: false, sign_in: null };
  /// The map shows the past.
  past = false;
  private readonly soon = new Set<Topic>();
  private readonly listeners = new Map<Topic, Set<() => void>>();

  on(topics: Topic | readonly Topic[], run: () => void): void {
    for (const topic of typeof topics === 'string' ? [topics] : topics) {
      const set = this.listeners.get(topic) ?? new Set();
      set.add(run);
      this.listeners.set(topic, set);
    }
  }

  private tellSoon(topic: Topic): void {
    if (this.soon.has(topic)) return;
    this.soon.add(topic);
    setTimeout(() => {
      this.soon.delete(topic);
      this.tell(topic);
    }, SOON_MS);
  }

  tell(topic: Topic): void {
    for (const run of this.listeners.get(topic) ?? []) run();
  }

  /// Zones and campaigns.
  get mayChange(): boolean {
    return this.me.role === 'operate' || this.me.role === 'administer';
  }

  /// Plans, walls and geographic origins.
  get mayAdminister(): boolean {
    return this.me.role === 'administer';
  }

  setSites(sites: Site[], wanted: string | null): void {
    this.sites = sites;
    const site = sites.find((s) => s.name === wanted) ?? sites[0] ?? null;
    if (site?.name !== this.site?.name) {
      this.tags.clear();
      this.steps.clear();
      this.nodes = [];
      this.zones = [];
      this.events = [];
      this.selected = null;
    }
    this.site = site;
    this.tell('site');
  }

  setTags(tags: Tag[]): void {
    const before = new Map(this.tags);
    this.tags.clear();
    for (const tag of tags) {
      // A position that came live may be newer than the one of this answer.
      const last = before.get(tag.tag)?.last_position ?? null;
      if (last !== null && (tag.last_position === null || isLater(last.t, tag.last_position.t))) tag.last_position = last;
      this.tags.set(tag.tag, tag);
    }
    this.tell('tags');
  }

  setNodes(nodes: Node[]): void {
    this.nodes = nodes;
    this.tell('nodes');
  }

  setZones(zones: Zone[]): void {
    this.zones = zones;
    this.tell('zones');
  }

  /// Takes a position, live or from the history, in any order and any number of times; whether it is the newest.
  addPosition(position: TagPosition): boolean {
    if (position.site !== this.site?.name) return false;
    const t = Date.parse(position.t);
    if (!Number.isFinite(t) || !Number.isFinite(position.x_m) || !Number.isFinite(position.y_m)) return false;
    const steps = this.steps.get(position.tag) ?? [];
    this.steps.set(position.tag, steps);
    const step = { t, x: position.x_m, y: position.y_m, s: Math.hypot(position.sigma_x_m, position.sigma_y_m) };
    let at = steps.length;
    while (at > 0 && steps[at - 1].t > t) at--;
    if (at > 0 && steps[at - 1].t === t) return false;
    steps.splice(at, 0, step);
    const newest = steps[steps.length - 1].t;
    let old = 0;
    while (old < steps.length && (steps[old].t < newest - TRAIL_MS || steps.length - old > MOST_STEPS)) old++;
    if (old > 0) steps.splice(0, old);
    if (t < newest) return false;
    const tag = this.tags.get(position.tag);
    if (tag === undefined) {
      this.tags.set(position.tag, {
        tag: position.tag,
        site: position.site,
        name: null,
        first_seen: position.t,
        last_seen: position.t,
        last_position: position,
        rate_hz: 0,
        silent: false,
        reason: null,
        zones: [],
        supply_v: null,
      });
      this.tellSoon('tags');
    } else {
      if (tag.last_position !== null && isLater(tag.last_position.t, position.t)) return false;
      tag.last_position = position;
      tag.last_seen = position.t;
      tag.silent = false;
      tag.reason = null;
    }
    return true;
  }

  /// Takes events, live or from the history; those that are new.
  addEvents(events: StationEvent[]): StationEvent[] {
    const known = new Set(this.events.map((event) => event.id));
    const fresh = events.filter((event) => !known.has(event.id) && event.site === this.site?.name);
    if (fresh.length === 0) return fresh;
    this.events = [...this.events, ...fresh].sort((a, b) => b.id - a.id).slice(0, MOST_EVENTS);
    this.tell('events');
    return fresh;
  }

  /// A live event changes what is known of its tag before the tags are read again.
  applyEvent(event: StationEvent): void {
    const tag = this.tags.get(event.node);
    if (tag === undefined || event.site !== this.site?.name) return;
    const { kind, zone } = event;
    if (kind === 'silent' || kind === 'back') tag.silent = kind === 'silent';
    else if (zone !== null && (kind === 'entered' || kind === 'left')) {
      tag.zones = tag.zones.filter((name) => name !== zone);
      if (kind === 'entered') tag.zones.push(zone);
    }
    this.tellSoon('tags');
  }

  select(tag: string | null): void {
    this.selected = tag;
    this.tell('selection');
  }

  /// What people call a tag or an anchor.
  nameOf(node: string): string {
    return this.tags.get(node)?.name ?? this.nodes.find((n) => n.node === node)?.name ?? node;
  }
}
