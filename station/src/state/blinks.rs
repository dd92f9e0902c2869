//! The positions of tags that blink: anchors report when frames arrived, and the station computes where they came from.

use ::blinks::Solved;
use wire::telemetry::{Address, Arrival};

use super::{LiveState, Update};
use crate::Utc;
use crate::input::{ReportKind, SolvedFrom};
use crate::model::Doubt;

/// Seconds since 1970.
fn seconds(t: Utc) -> f64 {
    t.us() as f64 / 1e6
}

/// The position of a blink as a report, or why there is none.
fn report(solved: &Solved) -> ReportKind {
    let (tag, round) = (Address(solved.tag).to_string(), Some(solved.number));
    let found = match &solved.outcome {
        Ok(found) => found,
        Err(reason) => return ReportKind::NoPosition { tag, round, reason: reason.as_str().to_owned() },
    };
    let [x_m, y_m, z_m] = found.position_m.map(f64::from);
    let [sigma_x_m, sigma_y_m, sigma_z_m] = found.deviation_m().map(f64::from);
    ReportKind::Position {
        tag,
        round,
        position_m: [x_m, y_m],
        z_m: Some(z_m),
        sigma_m: [sigma_x_m, sigma_y_m],
        sigma_z_m: (!found.height_is_given()).then_some(sigma_z_m),
        cov_xy_m2: f64::from(found.covariance_m2[0][1]),
        // Of n differences, n + 1 anchors.
        used: u8::try_from(found.used.count_ones()).unwrap_or(u8::MAX).saturating_add(1),
        solved_from: SolvedFrom::Ranges,
        doubt: match (found.alternative_m, found.flag) {
            (Some(alternative_m), _) => Some(Doubt::Ambiguous { alternative_m: alternative_m.map(f64::from) }),
            (None, Some(_)) => Some(Doubt::Suspect),
            (None, None) => None,
        },
    }
}

impl LiveState {
    /// A frame arrived at an anchor.
    pub(super) fn arrival(
        &mut self,
        t: Utc,
        site: &str,
        anchor: u16,
        arrival: &Arrival,
        updates: &mut Vec<Update>,
    ) -> Option<()> {
        let now = self.clock.unwrap_or(t);
        self.sites.get_mut(site)?.blinks.take(seconds(now), seconds(t), anchor, arrival);
        self.solve_blinks(site, now, updates);
        Some(())
    }

    /// Takes the positions of the blinks of a site that all anchors have reported by now.
    pub(super) fn solve_blinks(&mut self, site: &str, now: Utc, updates: &mut Vec<Update>) {
        let Some(solved) = self.sites.get_mut(site).map(|site| site.blinks.advance(seconds(now))) else { return };
        for solved in solved {
            let t = Utc::clamped((solved.t_s * 1e6) as i64);
            if self.take(t, site, &report(&solved), updates).is_none() {
                self.refused = self.refused.saturating_add(1);
            }
        }
    }
}
