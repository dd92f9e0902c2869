use sim::BoardProfile;
use sim::scenario::{Scenario, Simulation};
fn main() {
    let seconds: f64 = std::env::args().nth(1).map_or(6.0, |s| s.parse().unwrap());
    for (board, name) in [
        (BoardProfile::DWM1001_LEAN, "dwm1001"),
        (BoardProfile::EVB1000, "evk1000"),
        (BoardProfile::ESP32C3, "esp32c3"),
    ] {
        for (anchors, tags) in [(4usize, 1usize), (8, 1), (16, 15)] {
            for slow in [1.0, 2.0, 4.0] {
                for scheme in [ranging::native::Scheme::SingleSided, ranging::native::Scheme::DoubleSided] {
                    if tags > 1 && (slow > 1.0 || scheme == ranging::native::Scheme::DoubleSided) {
                        continue;
                    }
                    let mut s = Scenario::rooms(anchors, tags);
                    s.board = board.slowed(slow);
                    s.tag.scheme = scheme;
                    let mut sim = Simulation::new(s);
                    let records = sim.run_until(seconds);
                    let mut per: std::collections::BTreeMap<usize, u32> = Default::default();
                    for r in &records {
                        if let Some(e) = r.epoch() {
                            *per.entry(e.ranges.len()).or_default() += 1;
                        }
                    }
                    let sum = sim.summary();
                    println!(
                        "{name} {anchors}/{tags} x{slow} {scheme:?}: {per:?}, fixes/s {:.0}, p50 {:.3}, frames {}",
                        sum.fixes as f64 / seconds,
                        sum.p50_m.unwrap_or(9.9),
                        sum.frames_sent
                    );
                }
            }
        }
    }
}
