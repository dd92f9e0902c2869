//! A tag: its last position, its rate, and the rooms and zones that it is in.

use std::time::Duration;

use super::containment::{Gaussian, Outline};
use super::limits::Thresholds;
use super::rate::Rate;
use super::refusals::Refusals;
use super::rooms::{self, RoomShares};
use super::supply::Supply;
use super::user_data::UserData;
use super::{Alarms, NewEvent, StateLimits};
use crate::model::{EventKind, TagPosition, TagStatus, Zone, ZoneKind};
use crate::{SolvedFrom, Utc};

/// A tag's positions are uncertain when they have been so for this time.
const UNCERTAIN_FOR: Duration = Duration::from_secs(5);
/// … and certain again when the standard deviation is below this share of the limit.
const CERTAIN_AGAIN: f64 = 0.8;
/// The estimate of a node's clock is corrected by at most this. A greater step back is a clock that was set.
const GREATEST_CORRECTION: Duration = Duration::from_millis(100);

/// A round is known from elsewhere if it is the tag's last one or at most this many before, and came within this time. A
/// tag that starts again counts from the beginning.
const REPEATED_ROUNDS: u16 = 32;
const REPEATED_WITHIN: Duration = Duration::from_secs(5);

/// A room or a zone, and its outline.
#[derive(Clone, Debug)]
pub(super) struct Area {
    pub(super) zone: Zone,
    pub(super) outline: Outline,
}

impl Area {
    /// Its name, and whether it is a room.
    pub(super) fn key(&self) -> (&str, bool) {
        (&self.zone.name, self.zone.kind == ZoneKind::Room)
    }
}

/// Where a tag is: the index of an area, and since when.
#[derive(Clone, Copy, Debug)]
pub(super) struct Inside {
    pub(super) area: usize,
    pub(super) since: Utc,
}

/// Whether a tag's positions can be trusted.
///
/// ```text
///            σ above the limit              … for UNCERTAIN_FOR
///   Certain ──────────────────▶ Doubtful ─────────────────────▶ Uncertain (an event)
///      ▲ ◀──────────────────────────┘                                │
///      │        σ at most the limit                                  │
///      └─────────────────────────────────────────────────────────────┘
///                    σ below CERTAIN_AGAIN of the limit
/// ```
#[derive(Clone, Copy, Debug)]
enum Certainty {
    /// The standard deviation is below the limit.
    Certain,
    /// It has been above the limit since this time.
    Doubtful { since: Utc },
    /// It was above the limit for too long.
    Uncertain,
}

/// The state of a tag.
#[derive(Debug)]
pub(super) struct TagState {
    first_seen: Utc,
    last_seen: Utc,
    /// When it reported, by the state's clock.
    pub(super) reported: Utc,
    pub(super) is_silent: bool,
    rate: Rate,
    last_position: Option<TagPosition>,
    /// The round of the last position, and when.
    last_round: Option<(u16, Utc)>,
    reason: Option<String>,
    certainty: Certainty,
    pub(super) supply: Supply,
    pub(super) refusals: Refusals,
    pub(super) data: UserData,
    pub(super) room: Option<Inside>,
    pub(super) zones: Vec<Inside>,
    /// While it is located by RSSI alone.
    pub(super) rooms: RoomShares,
}

impl TagState {
    pub(super) fn new(t: Utc) -> Self {
        Self {
            first_seen: t,
            last_seen: t,
            reported: t,
            is_silent: false,
            rate: Rate::default(),
            last_position: None,
            last_round: None,
            reason: None,
            certainty: Certainty::Certain,
            supply: Supply::default(),
            refusals: Refusals::default(),
            data: UserData::default(),
            room: None,
            zones: Vec::new(),
            rooms: RoomShares::default(),
        }
    }

    /// Notes that it reported something. Returns whether it had been silent.
    pub(super) fn note(&mut self, t: Utc, now: Utc) -> bool {
        (self.last_seen, self.reported) = (t, now);
        std::mem::take(&mut self.is_silent)
    }

    /// Whether the position of this round is already known: from another anchor that received it, or from the tag itself.
    /// Otherwise it is from now on.
    pub(super) fn is_repeated(&mut self, t: Utc, round: Option<u16>) -> bool {
        let Some(round) = round else { return false };
        let is_known = self.last_round.is_some_and(|(last, at)| {
            last.wrapping_sub(round) < REPEATED_ROUNDS && t < at + REPEATED_WITHIN && at < t + REPEATED_WITHIN
        });
        if !is_known {
            self.last_round = Some((round, t));
        }
        is_known
    }

    /// Notes that its round gave no position. Returns whether the reason is a new one.
    pub(super) fn lose(&mut self, reason: &str) -> bool {
        let is_new = self.reason.as_deref() != Some(reason);
        if is_new {
            self.reason = Some(reason.to_owned());
        }
        is_new
    }

    /// The height that it is configured to have, by its last position, metres.
    pub(super) fn height_m(&self) -> Option<f64> {
        let position = self.last_position.as_ref()?;
        position.z_m.filter(|_| position.sigma_z_m.is_none())
    }

    /// The time of its position that was reported as of `t`: in a later millisecond than its last position, because
    /// positions are stored by milliseconds.
    pub(super) fn time_of_position(&self, t: Utc) -> Utc {
        let Some(last) = &self.last_position else { return t };
        let free = Utc::of_ms(last.t.ms() + 1);
        if free.since(t) <= GREATEST_CORRECTION { t.max(free) } else { t }
    }

    /// Takes a position and finds its room and zones.
    pub(super) fn find(
        &mut self,
        position: &mut TagPosition,
        solved_from: SolvedFrom,
        areas: &[Area],
        limits: &StateLimits,
        happened: &mut Vec<NewEvent>,
    ) {
        self.rate.count(position.t);
        self.reason = None;
        let covariance_m2 = [position.sigma_x_m.powi(2), position.cov_xy_m2, position.sigma_y_m.powi(2)];
        let gaussian = Gaussian { mean_m: [position.x_m, position.y_m], covariance_m2 };
        let greatest_m = match solved_from {
            SolvedFrom::Ranges => limits.uncertain_m,
            SolvedFrom::Rssi => limits.uncertain_rssi_m,
        };
        let share = greatest_sigma_m(covariance_m2) / greatest_m;
        self.check_certainty(position.t, share, &limits.alarms, happened);
        let probabilities: Vec<f64> = areas.iter().map(|area| area.outline.probability(&gaussian)).collect();
        self.enter_and_leave_zones(position.t, &probabilities, areas, limits.thresholds(), happened);
        let of_rooms = areas.iter().zip(probabilities);
        let of_rooms = of_rooms.map(|(area, of)| if area.zone.kind == ZoneKind::Room { of } else { 0.0 });
        let mut of_rooms: Vec<f64> = of_rooms.collect();
        let thresholds = match solved_from {
            SolvedFrom::Ranges => {
                self.rooms.clear();
                limits.thresholds()
            }
            SolvedFrom::Rssi => {
                of_rooms = self.rooms.take(position.t, &of_rooms).to_vec();
                rooms::THRESHOLDS
            }
        };
        self.change_room(position.t, &of_rooms, areas, thresholds, happened);
        position.room = self.room.and_then(|room| Some(areas.get(room.area)?.zone.name.clone()));
        self.last_position = Some(position.clone());
    }

    /// `share` is the standard deviation divided by its limit.
    fn check_certainty(&mut self, t: Utc, share: f64, alarms: &Alarms, happened: &mut Vec<NewEvent>) {
        self.certainty = match self.certainty {
            Certainty::Uncertain if share < CERTAIN_AGAIN => Certainty::Certain,
            Certainty::Uncertain => Certainty::Uncertain,
            Certainty::Certain | Certainty::Doubtful { .. } if share <= 1.0 => Certainty::Certain,
            Certainty::Certain => Certainty::Doubtful { since: t },
            Certainty::Doubtful { since } if t.since(since) >= UNCERTAIN_FOR => {
                happened.push(NewEvent::of(EventKind::Uncertain, alarms));
                Certainty::Uncertain
            }
            // A clock that was set back begins anew.
            Certainty::Doubtful { since } => Certainty::Doubtful { since: since.min(t) },
        };
    }

    /// Zones are entered when they are probable and left when they are improbable. `probabilities` are those of all areas.
    fn enter_and_leave_zones(
        &mut self,
        t: Utc,
        probabilities: &[f64],
        areas: &[Area],
        thresholds: Thresholds,
        happened: &mut Vec<NewEvent>,
    ) {
        let zones =
            areas.iter().zip(probabilities).enumerate().filter(|(_, (area, _))| area.zone.kind == ZoneKind::Zone);
        for (index, (area, probability)) in zones {
            match self.zones.iter().position(|inside| inside.area == index) {
                Some(place) if *probability <= thresholds.leave => {
                    let inside = self.zones.swap_remove(place);
                    happened.push(left(area, &inside, t));
                }
                None if *probability >= thresholds.enter => {
                    self.zones.push(Inside { area: index, since: t });
                    happened.push(entered(area));
                }
                Some(_) | None => {}
            }
        }
    }

    /// So are rooms. A tag goes from one room directly to another when that one is clearly the more probable.
    /// `probabilities` are those of all areas, 0 for zones.
    fn change_room(
        &mut self,
        t: Utc,
        probabilities: &[f64],
        areas: &[Area],
        thresholds: Thresholds,
        happened: &mut Vec<NewEvent>,
    ) {
        let own = self.room.map(|room| room.area);
        let stays = own.and_then(|own| probabilities.get(own)).copied().unwrap_or(0.0);
        let others = probabilities.iter().copied().enumerate().filter(|(index, _)| Some(*index) != own);
        let (other, probability) = others.max_by(|(_, a), (_, b)| a.total_cmp(b)).unzip();
        let probability = probability.unwrap_or(0.0);
        let is_changed = own.is_some() && probability >= thresholds.changes && stays <= 1.0 - thresholds.changes;
        if (is_changed || stays <= thresholds.leave)
            && let Some(inside) = self.room.take()
            && let Some(area) = areas.get(inside.area)
        {
            happened.push(left(area, &inside, t));
        }
        if (is_changed || (self.room.is_none() && probability >= thresholds.enter))
            && let Some(index) = other
            && let Some(area) = areas.get(index)
        {
            self.room = Some(Inside { area: index, since: t });
            happened.push(entered(area));
        }
    }

    /// What the API shows of it.
    pub(super) fn show(&self, site: &str, tag: &str, name: Option<&str>, areas: &[Area], now: Utc) -> TagStatus {
        let zone = |inside: &Inside| Some(areas.get(inside.area)?.zone.name.clone());
        let mut zones: Vec<String> = self.zones.iter().filter_map(zone).collect();
        zones.sort_unstable();
        TagStatus {
            tag: tag.to_owned(),
            site: site.to_owned(),
            name: name.map(str::to_owned),
            first_seen: self.first_seen,
            last_seen: self.last_seen,
            last_position: self.last_position.clone(),
            rate_hz: self.rate.hz(now),
            silent: self.is_silent,
            reason: self.reason.clone(),
            zones,
            supply_v: self.supply.volts,
        }
    }
}

fn entered(area: &Area) -> NewEvent {
    let zone = Some(area.zone.name.clone());
    NewEvent { kind: EventKind::Entered, zone, dwell_s: None, alarm: area.zone.alarm }
}

pub(super) fn left(area: &Area, inside: &Inside, t: Utc) -> NewEvent {
    let dwell_s = Some(t.since(inside.since).as_secs_f64());
    NewEvent { kind: EventKind::Left, zone: Some(area.zone.name.clone()), dwell_s, alarm: false }
}

/// The standard deviation along the long axis of the ellipse: the root of the greater eigenvalue.
fn greatest_sigma_m([xx, xy, yy]: [f64; 3]) -> f64 {
    (0.5 * (xx + yy) + (0.5 * (xx - yy)).hypot(xy)).sqrt()
}
