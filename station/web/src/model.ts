// The objects of the station's API: the page's names for the types of schema.ts, which types.mjs makes of the station's
// own description. Lengths are metres in the frame of the anchors, times are RFC 3339 in UTC.

import type { Plan } from './schema.js';

export { EventKinds as EVENT_KINDS } from './schema.js';
export type {
  Campaign,
  CampaignPoint,
  Event as StationEvent,
  EventKind,
  Finding,
  GeographicOrigin,
  Me,
  Node,
  NodeHealth,
  Plan,
  Site,
  Tag,
  TagMessage,
  TagPosition,
  UserRole as Access,
  WallLine as Wall,
  Zone,
} from './schema.js';

/// Where a picture is.
export type PlanScale = Pick<Plan, 'origin_m' | 'metres_per_pixel' | 'rotation_rad'>;

/// Whether a time of the API is after another one. As texts they do not compare: whole seconds have no fraction.
export function isLater(a: string, b: string): boolean {
  return Date.parse(a) > Date.parse(b);
}
