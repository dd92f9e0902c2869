//! The anchors that a tag receives, and which of them it asks.
//!
//! If the tag receives more anchors than a round has places, it asks those whose ranges give most information about the
//! position. It selects one anchor after the other: always the one that adds most information to those chosen (the
//! largest determinant of the information matrix Σ w·u·uᵀ; u is the direction to the anchor, and w depends on received
//! power and on the share of answered polls). The other anchors take turns in the last place, so that a better one is
//! found.

use heapless::Vec;

use super::MAX_ROUND;
use super::anchor_position::{AnchorPosition, is_own_slot};
use super::authentication::Forged;
use super::clock::ClockModel;
use super::sync::SyncUpdate;
use crate::RadioInstant;
use wire::uwb::native::{AnchorAt, Relay, SyncFrame};

/// Anchors that a tag remembers.
pub const MAX_NEIGHBOURS: usize = 24;
/// An anchor that was silent for this many superframes is forgotten.
const FORGOTTEN_AFTER: u16 = 6;
/// One without a sync slot of its own sends seldom: it is forgotten after this many, …
const SELDOM_FORGOTTEN_AFTER: u16 = 600;
/// … or if it has not answered this many times in a row.
const MOST_MISSES: u8 = 4;
/// Weight of a new value in the mean power and in the share of answers.
const SMOOTHING: f32 = 0.1;
/// The same for the reliability, and the reliability of an anchor that was not asked yet.
const RELIABILITY_SMOOTHING: f32 = 0.2;
const UNKNOWN_RELIABILITY: f32 = 0.5;
/// Who is more reliable by a step, or is received better by a step below this power, passes on what polls carry, also by a
/// longer way: at 6.81 Mbit/s a receiver loses frames below some −93 dBm.
const RELIABILITY_STEP: f32 = 0.05;
const AMPLE_DBM: f32 = -84.0;
const POWER_STEP_DB: f32 = 4.0;
/// An anchor that never answers counts as one that is received weaker by this.
const WEAKNESS_DB: f32 = POWER_STEP_DB / RELIABILITY_STEP;

/// An anchor that the tag receives.
#[derive(Clone, Debug)]
pub struct Neighbour {
    /// Short address.
    pub address: u16,
    /// The position that it reports.
    pub position: AnchorPosition,
    /// Its clock.
    pub clock: ClockModel,
    /// The last distance, metres.
    pub distance_m: Option<f32>,
    /// How far a gateway is from it, if it knows a way.
    cost: Option<u8>,
    /// Mean received power, dBm.
    power_dbm: f32,
    /// Share of polls that were answered.
    answers: f32,
    /// The share of the last polls that it surely answers: little as long as it was asked seldom.
    reliability: f32,
    /// Superframes since its last frame.
    unheard: u16,
    /// Superframes since it was last asked.
    unasked: u16,
    /// It has a sync slot of its own.
    has_slot: bool,
    /// A frame of it was received; else another anchor has said where it is.
    is_heard: bool,
    /// How often it has not answered in a row.
    missed: u8,
}

/// What a tag received and refused since it was created. A growing count is a sign of forged frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Refused {
    /// Sync frames with another position of an anchor than the known one.
    pub positions: u32,
    /// Sync frames of a coordinator whose term prevails but which is not followed, because frames of the followed one
    /// are received.
    pub coordinators: u32,
    /// Sync frames with a list of members that was not announced in time, or that the coordinator does not know.
    pub lists: u32,
    /// Responses that came outside their slot, or reported a departure outside it.
    pub off_slot: u32,
    /// Responses whose carrier does not fit the anchor's crystal.
    pub carriers: u32,
    /// Frames without the code that the network's key gives them.
    pub codes: u32,
}

impl Refused {
    /// All of them, wrapping.
    pub fn total(&self) -> u32 {
        let Self { positions, coordinators, lists, off_slot, carriers, codes } = *self;
        [positions, coordinators, lists, off_slot, carriers, codes].into_iter().fold(0, u32::wrapping_add)
    }
}

/// The anchors that a tag receives.
#[derive(Clone, Debug, Default)]
pub struct AnchorTable {
    anchors: Vec<Neighbour, MAX_NEIGHBOURS>,
    /// Frames of the anchors, or with their addresses, that were refused.
    pub refused: Refused,
}

/// Anchors of a round, in the order of their slots.
pub type Team = Vec<u16, MAX_ROUND>;

impl AnchorTable {
    /// No anchor.
    pub const fn new() -> Self {
        let refused = Refused { positions: 0, coordinators: 0, lists: 0, off_slot: 0, carriers: 0, codes: 0 };
        Self { anchors: Vec::new(), refused }
    }

    /// How many anchors are received.
    pub fn len(&self) -> usize {
        self.anchors.len()
    }

    /// The anchor with an address.
    pub fn get_mut(&mut self, address: u16) -> Option<&mut Neighbour> {
        self.anchors.iter_mut().find(|anchor| anchor.address == address)
    }

    /// The clocks are void: the tag's own radio was restarted.
    pub fn forget_clocks(&mut self) {
        for anchor in &mut self.anchors {
            anchor.clock = ClockModel::new();
        }
    }

    /// The network was lost: its anchors may report new positions.
    pub fn end_session(&mut self) {
        for anchor in &mut self.anchors {
            anchor.position.end_session();
        }
    }

    /// An anchor reported its position in a sync frame of the followed network.
    pub fn on_sync_frame(&mut self, source: u16, sync_frame: &SyncFrame, power_dbm: f32) {
        let is_own_slot = is_own_slot(source, sync_frame);
        let Some(anchor) = self.receive(source, power_dbm) else { return };
        anchor.has_slot = is_own_slot;
        if is_own_slot {
            let takes = |relay: &&Relay| relay.taken >> sync_frame.slot & 1 == 0;
            anchor.cost = sync_frame.relay.as_ref().filter(takes).map(|relay| relay.cost);
        }
        if !anchor.position.receive(sync_frame.position, is_own_slot) {
            self.refused.positions = self.refused.positions.saturating_add(1);
        }
        if let Some(neighbour) = &sync_frame.neighbour {
            self.introduce(neighbour);
        }
    }

    /// An anchor has said where another one is, which has no slot of its own. The tag asks it if it has room for it: it
    /// counts as one in a shared slot does.
    #[cold]
    fn introduce(&mut self, AnchorAt { address, position }: &AnchorAt) {
        if self.get_mut(*address).is_none() {
            // There may be no room.
            let _ = self.anchors.push(Neighbour::new(*address, f32::NEG_INFINITY));
        }
        if let Some(anchor) = self.get_mut(*address).filter(|anchor| !anchor.has_slot) {
            anchor.position.receive(Some(*position), false);
            anchor.unheard = 0;
        }
    }

    /// `superframes` have begun: forgets the anchors that were silent too long.
    pub fn advance(&mut self, superframes: u16) {
        for anchor in &mut self.anchors {
            anchor.unheard = anchor.unheard.saturating_add(superframes);
            anchor.unasked = anchor.unasked.saturating_add(superframes);
        }
        self.anchors.retain(|anchor| match anchor.has_slot {
            true => anchor.unheard <= FORGOTTEN_AFTER,
            false => anchor.unheard <= SELDOM_FORGOTTEN_AFTER && anchor.missed < MOST_MISSES,
        });
    }

    /// A frame of an anchor was received. A new anchor replaces the weakest one if there is no other room. It becomes
    /// known by the first frame whose power is.
    pub fn receive(&mut self, address: u16, power_dbm: f32) -> Option<&mut Neighbour> {
        let known = self.anchors.iter().position(|anchor| anchor.address == address);
        let place = match known {
            Some(place) => place,
            None if !power_dbm.is_finite() => return None,
            None => {
                if self.anchors.is_full() {
                    let weakest = self.weakest()?;
                    if self.anchors.get(weakest)?.power_dbm >= power_dbm {
                        return None;
                    }
                    self.anchors.swap_remove(weakest);
                }
                self.anchors.push(Neighbour::new(address, power_dbm)).ok()?;
                self.anchors.len() - 1
            }
        };
        let anchor = self.anchors.get_mut(place)?;
        if power_dbm.is_finite() {
            if !anchor.is_heard {
                (anchor.power_dbm, anchor.is_heard) = (power_dbm, true);
            }
            anchor.power_dbm += SMOOTHING * (power_dbm - anchor.power_dbm);
        }
        anchor.unheard = 0;
        Some(anchor)
    }

    /// Whether a frame counts that was checked: it is refused if it was forged.
    pub fn believe<T>(&mut self, opened: Result<T, Forged>) -> Option<T> {
        if opened.is_err() {
            self.refused.codes = self.refused.codes.saturating_add(1);
        }
        opened.ok()
    }

    /// Whether the network of a sync frame with this effect is followed. Counts what it contradicts.
    pub fn follows(&mut self, update: SyncUpdate) -> bool {
        let Refused { coordinators, lists, .. } = &mut self.refused;
        match update {
            SyncUpdate::Ignored => return false,
            SyncUpdate::Refused => {
                *coordinators = coordinators.saturating_add(1);
                return false;
            }
            SyncUpdate::Contradicted => *lists = lists.saturating_add(1),
            SyncUpdate::Followed | SyncUpdate::Changed | SyncUpdate::Anew => {}
        }
        true
    }

    fn weakest(&self) -> Option<usize> {
        let by_power = |(_, a): &(usize, &Neighbour), (_, b): &(usize, &Neighbour)| a.power_dbm.total_cmp(&b.power_dbm);
        self.anchors.iter().enumerate().min_by(by_power).map(|(place, _)| place)
    }

    /// An anchor was asked, and answered or not.
    pub fn asked(&mut self, address: u16, answered: bool) {
        if let Some(anchor) = self.get_mut(address) {
            anchor.unasked = 0;
            anchor.missed = if answered { 0 } else { anchor.missed.saturating_add(1) };
            let answered = f32::from(u8::from(answered));
            anchor.answers += SMOOTHING * (answered - anchor.answers);
            anchor.reliability += RELIABILITY_SMOOTHING * (answered - anchor.reliability);
        }
    }

    /// The tag's own radio slept for `seconds`.
    pub fn sleep(&mut self, seconds: f32) {
        self.anchors.iter_mut().for_each(|anchor| anchor.clock.sleep(seconds));
    }

    /// The anchors to ask, at most `places`, as seen from `tag_m` if that is known. One of them knows a way to a gateway, if
    /// any does.
    pub fn choose(&self, places: usize, tag_m: Option<[f32; 3]>) -> Team {
        let places = places.min(MAX_ROUND);
        let mut team = Team::new();
        if self.anchors.len() <= places {
            for anchor in self.anchors.iter().take(MAX_ROUND) {
                // There are as many places as a round has.
                let _ = team.push(anchor.address);
            }
            return team;
        }
        let mut information = Information::none();
        let mut lacks_relay = self.anchors.iter().any(|anchor| anchor.cost.is_some());
        while team.len() + 1 < places {
            let must_relay = lacks_relay && team.len() + 2 == places;
            let candidates = self.anchors.iter().filter(|anchor| !team.contains(&anchor.address));
            let candidates = candidates.filter(|anchor| !must_relay || anchor.cost.is_some());
            let gain = |anchor: &&Neighbour| information.gain(anchor.weight(), anchor.direction_from(tag_m));
            let Some(best) = candidates.max_by(|a, b| gain(a).total_cmp(&gain(b))) else { break };
            information.add(best.weight(), best.direction_from(tag_m));
            lacks_relay &= best.cost.is_none();
            let _ = team.push(best.address);
        }
        let others = self.anchors.iter().filter(|anchor| !team.contains(&anchor.address));
        if let Some(longest_unasked) = others.max_by_key(|anchor| anchor.patience()) {
            let _ = team.push(longest_unasked.address);
        }
        team
    }

    /// The anchor that answers most surely, and of equals the one that is received best.
    pub fn surest(&self) -> Option<u16> {
        let rank = |anchor: &Neighbour| anchor.power_dbm.min(AMPLE_DBM) - WEAKNESS_DB * (1.0 - anchor.reliability);
        self.anchors.iter().max_by(|a, b| rank(a).total_cmp(&rank(b))).map(|anchor| anchor.address)
    }

    /// Which two of these anchors are to pass on what polls carry, the better one first: they answer, and are near to a
    /// gateway. Of equals another one is first in each turn. None if nobody knows a way.
    pub fn relays_of(&self, team: &Team, turn: u16) -> [Option<u16>; 2] {
        let mut best = [None; 2];
        for (place, address) in team.iter().enumerate() {
            let Some(anchor) = self.anchors.iter().find(|anchor| anchor.address == *address) else { continue };
            let Some(hops) = anchor.cost.map(|cost| cost / Relay::HOP) else { continue };
            let lost = ((1.0 - anchor.reliability) / RELIABILITY_STEP) as u8;
            let weak = ((AMPLE_DBM - anchor.power_dbm) / POWER_STEP_DB).clamp(0.0, 9.0) as u8;
            let rank = Some((lost + weak, hops, (place + usize::from(turn)) % team.len(), *address));
            let [first, second] = best;
            if first.is_none() || rank < first {
                best = [rank, first];
            } else if second.is_none() || rank < second {
                best[1] = rank;
            }
        }
        best.map(|rank| rank.map(|(.., address)| address))
    }

    /// Adds an anchor with a position: for tests.
    #[cfg(test)]
    fn place(&mut self, address: u16, power_dbm: f32, position_m: [f32; 3]) {
        use wire::uwb::native::Position;
        self.receive(address, power_dbm).unwrap().position.receive(Position::from_metres(position_m), true);
    }
}

impl Neighbour {
    #[cold]
    fn new(address: u16, power_dbm: f32) -> Self {
        Self {
            address,
            position: AnchorPosition::default(),
            clock: ClockModel::new(),
            distance_m: None,
            cost: None,
            power_dbm,
            answers: 1.0,
            reliability: UNKNOWN_RELIABILITY,
            unheard: 0,
            unasked: u16::MAX,
            has_slot: false,
            is_heard: false,
            missed: 0,
        }
    }

    /// It cannot pass on what polls carry, until it says otherwise.
    #[cold]
    pub fn passes_nothing_on(&mut self) {
        self.cost = None;
    }

    /// How long it has waited for its turn: one that was never received waits longer, the more often it has not answered.
    fn patience(&self) -> u16 {
        if self.is_heard { self.unasked } else { self.unasked >> self.missed.min(15) }
    }

    /// The anchor is there, although the tag listens to few of its sync frames.
    pub fn keep(&mut self) {
        self.unheard = 0;
    }

    /// The weight of a range to it: less with low power, less if responses are lost.
    fn weight(&self) -> f32 {
        if !self.is_heard {
            return 0.0;
        }
        // From the receiver's limit, some −105 dBm, to the power above which timestamps do not improve.
        ((self.power_dbm + 105.0) / 25.0).clamp(0.05, 1.0) * self.answers.max(0.01)
    }

    /// Direction to it (not of unit length, any scale). None without both positions.
    fn direction_from(&self, tag_m: Option<[f32; 3]>) -> Option<[f32; 3]> {
        let (anchor, tag) = (self.position.metres()?, tag_m?);
        Some(core::array::from_fn(|i| anchor[i] - tag[i]))
    }

    /// Mean of the received power, dBm.
    pub fn power_dbm(&self) -> f32 {
        self.power_dbm
    }

    /// A response reported a poll that left at `sent` and arrived at `heard` in the anchor's clock, and its carrier
    /// gave the rate. Returns false if that carrier is of another crystal; then nothing of the response counts.
    pub fn compare_clocks(&mut self, sent: RadioInstant, heard: RadioInstant, clock_offset_ppm: f32) -> bool {
        let is_of_anchor = self.clock.expects(clock_offset_ppm);
        if is_of_anchor {
            self.clock.poll(sent, heard);
            self.clock.carrier(clock_offset_ppm);
        }
        is_of_anchor
    }
}

/// The inverse of the information matrix of the chosen anchors, I/ε if there are none.
struct Information([[f32; 3]; 3]);

impl Information {
    fn none() -> Self {
        const INVERSE: f32 = 1e3;
        Self([[INVERSE, 0.0, 0.0], [0.0, INVERSE, 0.0], [0.0, 0.0, INVERSE]])
    }

    /// The factor by which the determinant grows: det(M + w·u·uᵀ) / det M − 1 = w·uᵀ·M⁻¹·u. Without a direction: the
    /// weight alone.
    fn gain(&self, weight: f32, direction: Option<[f32; 3]>) -> f32 {
        let Some(direction) = direction else { return weight };
        weight * dot(direction, self.times(direction)) / dot(direction, direction).max(1e-6)
    }

    /// M + w·u·uᵀ, by Sherman and Morrison.
    fn add(&mut self, weight: f32, direction: Option<[f32; 3]>) {
        let Some(direction) = direction else { return };
        let scaled = self.times(direction);
        let denominator = dot(direction, direction).max(1e-6) + weight * dot(direction, scaled);
        for (i, row) in self.0.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry -= weight * scaled[i] * scaled[j] / denominator;
            }
        }
    }

    fn times(&self, v: [f32; 3]) -> [f32; 3] {
        self.0.map(|row| dot(row, v))
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn anchors_around_the_tag_are_preferred_to_many_on_one_side() {
        let mut anchors = AnchorTable::new();
        for (address, x) in [(1, 9.0), (2, 9.5), (3, 10.0), (4, 10.5)] {
            anchors.place(address, -75.0, [x, 0.0, 1.0]);
        }
        anchors.place(5, -80.0, [0.0, 10.0, 1.0]);
        anchors.place(6, -80.0, [0.0, 0.0, 4.0]);
        // Three anchors are chosen by geometry, the fourth is one of the others.
        let team = anchors.choose(4, Some([0.0, 0.0, 1.0]));
        assert_eq!(team.len(), 4);
        assert!(team[..3].contains(&5) && team[..3].contains(&6), "{team:?}");
    }

    #[test]
    fn one_of_those_asked_knows_a_way_to_a_gateway() {
        let mut anchors = AnchorTable::new();
        for address in 1..=9 {
            anchors.place(address, -75.0, [f32::from(address), f32::from(address % 3), 1.0]);
        }
        // The weakest one.
        anchors.place(10, -95.0, [5.0, 1.0, 1.0]);
        let knows = |team: &Team| team[..3].contains(&10);
        assert!(!knows(&anchors.choose(4, Some([5.0, 5.0, 1.0]))));
        anchors.get_mut(10).unwrap().cost = Some(8);
        let team = anchors.choose(4, Some([5.0, 5.0, 1.0]));
        assert_eq!((team.len(), knows(&team)), (4, true), "{team:?}");
        // Another one that is chosen anyway is enough.
        anchors.get_mut(team[0]).unwrap().cost = Some(8);
        assert!(!knows(&anchors.choose(4, Some([5.0, 5.0, 1.0]))));
    }

    #[test]
    fn the_last_place_goes_round() {
        let mut anchors = AnchorTable::new();
        for address in 1..=7 {
            anchors.place(address, -60.0 - f32::from(address), [f32::from(address), 0.0, 0.0]);
        }
        let mut seen = std::collections::BTreeSet::new();
        for _ in 0..8 {
            let team = anchors.choose(3, None);
            // By power alone: all powers are above −80 dBm, so all weights are equal and any two anchors are chosen.
            assert_eq!(team.len(), 3);
            for &address in &team {
                anchors.asked(address, true);
                seen.insert(address);
            }
            anchors.advance(1);
            for address in 1..=7 {
                anchors.receive(address, -60.0 - f32::from(address));
            }
        }
        assert_eq!(seen.len(), 7, "{seen:?}");
    }

    /// A sync frame in slot 0 of anchor 1, at x = 1 m, that says where another one is.
    fn introducing(address: u16, x_m: f32) -> SyncFrame {
        use wire::uwb::native::Position;
        let mut sync_frame = SyncFrame { slot: 0, ..crate::native::blank_sync_frame() };
        sync_frame.slot_owners[0] = super::super::anchor_position::hash(1);
        sync_frame.position = Position::from_metres([1.0, 0.0, 0.0]);
        let position = Position::from_metres([x_m, 0.0, 0.0]).unwrap();
        SyncFrame { neighbour: Some(AnchorAt { address, position }), ..sync_frame }
    }

    fn position_of(anchors: &mut AnchorTable, address: u16) -> Option<[f32; 3]> {
        anchors.get_mut(address)?.position.metres()
    }

    #[test]
    fn an_anchor_without_a_slot_is_asked_where_another_one_says_that_it_is() {
        let mut anchors = AnchorTable::new();
        anchors.on_sync_frame(1, &introducing(2, 5.0), -75.0);
        assert_eq!(position_of(&mut anchors, 2), Some([5.0, 0.0, 0.0]));
        // It takes the last place only, as long as it was not received.
        (3..6).for_each(|address| anchors.place(address, -75.0, [f32::from(address), 3.0, 0.0]));
        [1, 3, 4, 5].into_iter().for_each(|address| anchors.asked(address, true));
        assert_eq!(anchors.choose(3, None)[..2].iter().filter(|address| **address == 2).count(), 0);
        assert_eq!(anchors.choose(3, None)[2], 2);
        // It answers: its power is the first one. Then it stays, without further sync frames, for a minute.
        anchors.receive(2, -80.0);
        anchors.asked(2, true);
        assert_eq!(anchors.get_mut(2).map(|anchor| anchor.power_dbm()), Some(-80.0));
        anchors.advance(600);
        assert!(anchors.get_mut(1).is_none(), "it has a slot, and is silent");
        assert_eq!(position_of(&mut anchors, 2), Some([5.0, 0.0, 0.0]));
        anchors.advance(1);
        assert!(anchors.get_mut(2).is_none());
    }

    #[test]
    fn an_anchor_that_never_answers_waits_longer_and_longer_and_is_forgotten() {
        let mut anchors = AnchorTable::new();
        anchors.on_sync_frame(1, &introducing(2, 5.0), -75.0);
        (3..7).for_each(|address| anchors.place(address, -75.0, [f32::from(address), 3.0, 0.0]));
        let mut asked = 0;
        for round in 0..200 {
            for address in anchors.choose(3, None) {
                anchors.asked(address, address != 2);
                asked += u32::from(address == 2);
            }
            anchors.on_sync_frame(1, &introducing(2, 5.0), -75.0);
            (3..7).for_each(|address| assert!(anchors.receive(address, -75.0).is_some()));
            anchors.advance(1);
            if anchors.get_mut(2).is_none() {
                // The others are asked every fourth or fifth round; 4 · (1 + 2 + 4 + 8) = 60.
                assert!(asked == 4 && (30..100).contains(&round), "asked {asked} times in {round} rounds");
                return;
            }
        }
        panic!("asked {asked} times");
    }

    #[test]
    fn what_another_one_says_moves_no_anchor_that_has_a_slot() {
        let mut anchors = AnchorTable::new();
        anchors.on_sync_frame(1, &introducing(1, 9.0), -75.0);
        assert_eq!(position_of(&mut anchors, 1), Some([1.0, 0.0, 0.0]));
        // Nor one in a shared slot, once it is known.
        anchors.on_sync_frame(1, &introducing(2, 5.0), -75.0);
        anchors.on_sync_frame(1, &introducing(2, 8.0), -75.0);
        assert_eq!(position_of(&mut anchors, 2), Some([5.0, 0.0, 0.0]));
        // Who cannot pass anything on is no relay until it says its way again.
        let relay = Some(Relay { cost: 0, next: 0, taken: 0, taken_frames: 0, heard: 0, entries: Vec::new() });
        let team: Team = [1].into_iter().collect();
        anchors.on_sync_frame(1, &SyncFrame { relay, ..introducing(2, 5.0) }, -75.0);
        assert_eq!(anchors.relays_of(&team, 0)[0], Some(1));
        anchors.get_mut(1).unwrap().passes_nothing_on();
        assert_eq!(anchors.relays_of(&team, 0)[0], None);
    }

    #[test]
    fn silent_anchors_give_their_place_up() {
        let mut anchors = AnchorTable::new();
        for address in 1..=4 {
            anchors.place(address, -75.0, [f32::from(address), 1.0, 0.0]);
        }
        for _ in 0..30 {
            anchors.asked(1, false);
        }
        let team = anchors.choose(3, None);
        assert!(!team[..2].contains(&1), "{team:?}");
        // The anchor is not received any more: forgotten.
        anchors.advance(4);
        for address in 2..=4 {
            anchors.receive(address, -75.0);
        }
        anchors.advance(4);
        assert_eq!(anchors.len(), 3);
    }

    #[test]
    fn what_polls_carry_goes_to_an_anchor_that_answers_near_to_a_gateway() {
        use super::super::anchor_position::hash;
        let relay = |hops: u8| {
            Some(Relay {
                cost: hops * Relay::HOP + 3,
                next: 0,
                taken: 0,
                taken_frames: 0,
                heard: 0,
                entries: Vec::new(),
            })
        };
        // In a slot of the anchor's own.
        let own = |address, relay| SyncFrame {
            slot: 0,
            slot_owners: core::array::from_fn(|_| hash(address)),
            relay,
            ..crate::native::blank_sync_frame()
        };
        let mut anchors = AnchorTable::new();
        for (address, hops) in [(1, Some(3)), (2, Some(1)), (3, Some(2)), (4, None)] {
            anchors.on_sync_frame(address, &own(address, hops.and_then(relay)), -75.0);
            // One in a shared slot has no way.
            anchors.on_sync_frame(address, &SyncFrame { slot: 16, ..own(address, None) }, -75.0);
        }
        let relays =
            |anchors: &AnchorTable, team: &[u16], turn| anchors.relays_of(&team.iter().copied().collect(), turn);
        assert_eq!(relays(&anchors, &[1, 2, 3, 4], 0), [Some(2), Some(3)]);
        assert_eq!(relays(&anchors, &[4, 1], 0), [Some(1), None]);
        assert_eq!(relays(&anchors, &[4, 9], 0), [None, None]);
        // All answer, but two of ten answers of the nearest one are lost.
        for address in [1, 2, 3] {
            (0..20).for_each(|_| anchors.asked(address, true));
        }
        (0..10).for_each(|i| anchors.asked(2, i % 5 > 0));
        assert_eq!(relays(&anchors, &[1, 2, 3, 4], 0), [Some(3), Some(1)]);
        assert_eq!(relays(&anchors, &[2], 0), [Some(2), None], "the only one");
        let mut tell = |address, hops, power_dbm| {
            anchors.on_sync_frame(address, &own(address, relay(hops)), power_dbm);
        };
        // A gateway that is hardly received, and one that was never asked.
        tell(5, 0, -93.0);
        tell(6, 0, -75.0);
        tell(1, 2, -75.0);
        (0..20).for_each(|_| anchors.asked(5, true));
        assert_eq!(relays(&anchors, &[5, 6, 3], 0), [Some(3), Some(5)]);
        // Two that are as near take turns.
        let turns = (0..4).map(|turn| relays(&anchors, &[1, 4, 3], turn)[0]);
        assert_eq!(turns.collect::<std::vec::Vec<_>>(), [Some(1), Some(3), Some(3), Some(1)]);
    }

    #[test]
    fn an_unknown_power_leaves_the_mean_as_it_is() {
        let mut anchors = AnchorTable::new();
        assert!(anchors.receive(1, f32::NAN).is_none());
        // A tenth of the difference: −80 + 0.1·10.
        let means = [-80.0, f32::NAN, -70.0].map(|power_dbm| anchors.receive(1, power_dbm).unwrap().power_dbm());
        assert_eq!(means, [-80.0, -80.0, -79.0]);
    }

    #[test]
    fn a_stronger_anchor_takes_the_weakest_ones_place() {
        let mut anchors = AnchorTable::new();
        for address in 0..MAX_NEIGHBOURS as u16 {
            assert!(anchors.receive(address, -70.0 - f32::from(address)).is_some());
        }
        assert!(anchors.receive(100, -99.0).is_none());
        assert!(anchors.receive(101, -60.0).is_some());
        assert!(anchors.get_mut(MAX_NEIGHBOURS as u16 - 1).is_none());
        assert_eq!(anchors.len(), MAX_NEIGHBOURS);
    }
}
