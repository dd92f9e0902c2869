// The objects of the station's API, as `station/src/model.rs` has them. Lengths are metres in the frame of the anchors,
// times are RFC 3339 in UTC.

/// Whether a time of the API is after another one. As texts they do not compare: whole seconds have no fraction.
export function isLater(a: string, b: string): boolean {
  return Date.parse(a) > Date.parse(b);
}

export interface TagPosition {
  site: string;
  tag: string;
  t: string;
  x_m: number;
  y_m: number;
  z_m: number | null;
  sigma_x_m: number;
  sigma_y_m: number;
  sigma_z_m: number | null;
  cov_xy_m2: number;
  room: string | null;
  used: number;
}

export interface Tag {
  tag: string;
  site: string;
  name: string | null;
  first_seen: string;
  last_seen: string;
  last_position: TagPosition | null;
  rate_hz: number;
  silent: boolean;
  reason: string | null;
  zones: string[];
  supply_v: number | null;
}

export interface Node {
  node: string;
  site: string;
  name: string | null;
  role: 'anchor' | 'tag' | 'beacon' | 'receiver';
  position_m: [number, number, number] | null;
  last_seen: string | null;
  rate_hz: number;
  success_rate: number | null;
  residual_mean_m: number | null;
  residual_sigma_m: number | null;
  first_path_minus_received_db: number | null;
  clock_offset_ppm: number | null;
  moved: boolean;
  supply_v: number | null;
}

/// What a node's health was in a minute of the past.
export interface NodeHealth extends Omit<Node, 'name' | 'role' | 'position_m' | 'last_seen'> {
  t: string;
}

export interface Zone {
  site: string;
  name: string;
  kind: 'room' | 'zone';
  corners_m: [number, number][];
  alarm: boolean;
}

export type EventKind = 'entered' | 'left' | 'silent' | 'back' | 'moved' | 'uncertain' | 'low-supply';

export const EVENT_KINDS: readonly EventKind[] = [
  'entered',
  'left',
  'silent',
  'back',
  'moved',
  'uncertain',
  'low-supply',
];

export interface StationEvent {
  id: number;
  t: string;
  site: string;
  kind: EventKind;
  node: string;
  zone: string | null;
  dwell_s: number | null;
  alarm: boolean;
}

/// Where a picture is: its point (u, v), in pixels from the upper left corner, is at
/// `origin_m + metres_per_pixel * (cos a * u + sin a * v, sin a * u - cos a * v)` with `a` = `rotation_rad`.
export interface PlanScale {
  origin_m: [number, number];
  metres_per_pixel: number;
  rotation_rad: number;
}

export interface Plan extends PlanScale {
  width_px: number;
  height_px: number;
  media_type: string;
}

export type Wall = [[number, number], [number, number]];

/// Where the point x = 0, y = 0 is on the earth, and how the axes are turned. What is unknown is missing.
export interface GeographicOrigin {
  latitude_deg: number;
  longitude_deg: number;
  y_azimuth_deg: number;
  height_m?: number;
  geoid_separation_m?: number;
}

export interface Site {
  name: string;
  walls_m: Wall[];
  plan: Plan | null;
  geographic_origin: GeographicOrigin | null;
}

export interface CampaignPoint {
  id: string;
  x_m: number;
  y_m: number;
  z_m: number | null;
  room: string | null;
  samples: number;
}

export interface Campaign {
  name: string;
  scenario: string;
  created: string;
  points: CampaignPoint[];
}

export type Access = 'view' | 'operate' | 'administer';

/// Who one is. `role` is null when a token is asked for and none was given.
export interface Me {
  role: Access | null;
  tokens: boolean;
  /// Where one signs in at a provider; null: there is none.
  sign_in: string | null;
}
