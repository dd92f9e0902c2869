//! Distances measured over the air, in all modes.

use super::*;

/// Poll and answer, single-sided. Returns the distance from the four time stamps and the carrier integrator, metres.
fn ranged(config: Config, ppm: f64, reply: RadioDuration) -> (f64, Received, Node, Node) {
    let (world, a, b) = two_nodes(ppm);
    let (mut tag, mut anchor) = (driver(a.peripherals(), config), driver(b.peripherals(), config));
    let ((poll_tx, response), (poll_rx, response_tx)) = run(
        &world,
        async move {
            tag.init().await.unwrap();
            let at = soon(&mut tag, us(20_000)).await;
            let poll_tx = tag.transmit(b"poll", Start::At(at), true).await.unwrap();
            (poll_tx, receive(&mut tag, Start::Now, us(30_000), false).await.unwrap())
        },
        async move {
            anchor.init().await.unwrap();
            let poll = receive(&mut anchor, Start::Now, us(60_000), false).await.unwrap();
            assert_eq!(poll.bytes, b"poll");
            let at = poll.rx_time.plus(reply);
            let promised = anchor.departure(at);
            let response_tx = anchor.transmit(b"response", Start::At(at), false).await.unwrap();
            assert_eq!(response_tx, promised);
            (poll.rx_time, response_tx)
        },
    );
    assert_eq!(response.bytes, b"response");
    let round = response.rx_time.since(poll_tx).ticks() as f64;
    let reply = response_tx.since(poll_rx).ticks() as f64;
    // A. Linde's thesis, equation 3. The reply time is converted to the tag's clock by the anchor's clock offset.
    let tof = (round - reply * (1.0 - f64::from(response.ppm) * 1e-6)) / 2.0;
    (tof * METRES_PER_TICK, response, a, b)
}

/// A configuration with the antenna delays of simulated chips at every pulse frequency.
fn as_built(phy: PhyConfig) -> Config {
    Config { tx_antenna_delay: Some(16_436), rx_antenna_delay: Some(16_436), ..Config::new(phy) }
}

#[test]
fn two_chips_measure_their_distance() {
    let (metres, response, a, b) = ranged(fast(), 10.0, us(500));
    // The carrier integrator has an error of 0.05 ppm: 500 µs × 0.05e-6 / 2 × c = 4 mm. A tick is 4.7 mm.
    assert!((metres - 10.0).abs() < 0.02, "{metres}");
    // The anchor's clock runs 20 ppm slower than the tag's.
    assert!((response.ppm + 20.0).abs() < 0.3, "{}", response.ppm);
    assert_well_treated(&a);
    assert_well_treated(&b);
}

#[test]
fn every_mode_of_the_evk1000_measures_it_too() {
    for mode in 1..=8 {
        let phy = PhyConfig::evk1000_mode(mode).unwrap();
        let reply = RadioDuration::from_ticks(phy.airtime(10).ticks() + us(600).ticks());
        let (metres, _, a, b) = ranged(as_built(phy), 2.0, reply);
        // 0.05 ppm over 5 ms at 110 kbit/s: 4 cm.
        assert!((metres - 10.0).abs() < 0.1, "mode {mode}: {metres}");
        assert_well_treated(&a);
        assert_well_treated(&b);
    }
}

#[test]
fn rates_and_preambles_beside_the_evk1000s() {
    for (channel, prf, rate, preamble) in [
        (Channel::Ch2, Prf::Mhz64, DataRate::Kbps6810, PreambleLength::Symbols64),
        (Channel::Ch5, Prf::Mhz64, DataRate::Kbps850, PreambleLength::Symbols256),
        (Channel::Ch3, Prf::Mhz16, DataRate::Kbps850, PreambleLength::Symbols512),
        (Channel::Ch4, Prf::Mhz64, DataRate::Kbps6810, PreambleLength::Symbols512),
        (Channel::Ch7, Prf::Mhz16, DataRate::Kbps110, PreambleLength::Symbols2048),
    ] {
        let phy = PhyConfig::new(channel, prf, rate, preamble).unwrap();
        let reply = RadioDuration::from_ticks(phy.airtime(10).ticks() + us(600).ticks());
        let (metres, ..) = ranged(as_built(phy), 2.0, reply);
        assert!((metres - 10.0).abs() < 0.1, "{phy:?}: {metres}");
    }
}

#[test]
fn power_can_be_calibrated() {
    let heard_at = |tx_power| {
        let (_, response, ..) = ranged(Config { tx_power, ..fast() }, 0.0, us(500));
        response.rx_power_dbm
    };
    let smart = heard_at(TxPower::Smart);
    let constant = heard_at(TxPower::Constant);
    assert!(smart > constant + 1.0, "short frames are boosted: {smart} against {constant}");
    // 0x85 without smart power is the default of channel 5.
    assert_eq!(heard_at(TxPower::Calibrated { register: 0x8585_8585, smart: false }), constant);
}
