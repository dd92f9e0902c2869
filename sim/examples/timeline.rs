use ranging::frame::native::{Frame, Message};
use sim::BoardProfile;
use sim::scenario::{Scenario, Simulation};
use std::cell::RefCell;
use std::rc::Rc;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let slow: f64 = a.get(1).map_or(1.0, |s| s.parse().unwrap());
    let from: f64 = a.get(2).map_or(4.0, |s| s.parse().unwrap());
    let len: f64 = a.get(3).map_or(0.1, |s| s.parse().unwrap());
    let (an, tg): (usize, usize) =
        (a.get(4).map_or(4, |s| s.parse().unwrap()), a.get(5).map_or(1, |s| s.parse().unwrap()));
    let mut s = Scenario::rooms(an, tg);
    s.board = BoardProfile::DWM1001_LEAN.slowed(slow);
    let mut sim = Simulation::new(s);
    let last = Rc::new(RefCell::new(0.0f64));
    sim.sniff(move |seen| {
        let t = seen.marker.as_secs_f64();
        if t < from || t > from + len {
            return;
        }
        let bytes = &seen.bytes[..seen.bytes.len().saturating_sub(2)];
        let Some(f) = Frame::parse(bytes) else { return };
        let what = match &f.message {
            Message::Poll(p) => format!("poll {} wish {:?}", p.round, p.wish.listen_again.duration().as_micros()),
            Message::Response(r) => format!("response {}", r.round),
            Message::Beacon(b) => format!(
                "beacon n {} slot {} layout {} {} {:?} new {} cd {} v {} wish {} {} members {}",
                b.superframe,
                b.slot,
                b.layout.answer.duration().as_micros(),
                b.layout.listen_again.duration().as_micros(),
                b.layout.scheme,
                b.layout_is_new,
                b.countdown,
                b.version,
                b.wish.answer.duration().as_micros(),
                b.wish.listen_again.duration().as_micros(),
                b.members.len()
            ),
            m => format!("{m:?}"),
        };
        println!("{:.6} +{:.0} {:x} {what}", t, (t - *last.borrow()) * 1e6, f.source);
        *last.borrow_mut() = t;
    });
    sim.run_until(from + len);
}
