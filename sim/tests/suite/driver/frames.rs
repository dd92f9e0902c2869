//! Frames, windows, filter, losses.

use super::*;

/// Sends `count` frames, `gap` after one another (from RMARKER to RMARKER), to a receiver that keeps listening. Returns
/// the times sent and the frames received.
fn burst(count: u8, bytes: usize, gap: RadioDuration) -> (Vec<RadioInstant>, Vec<Received>, Node, Node) {
    let (world, a, b) = two_nodes(5.0);
    let (mut sender, mut receiver) = (driver(a.peripherals(), fast()), driver(b.peripherals(), fast()));
    let (sent, heard) = run(
        &world,
        async move {
            sender.init().await.unwrap();
            let mut at = soon(&mut sender, us(20_000)).await;
            let mut sent = Vec::new();
            for number in 0..count {
                sent.push(sender.transmit(&vec![number; bytes], Start::At(at), false).await.unwrap());
                at = at.plus(gap);
            }
            sent
        },
        async move {
            receiver.init().await.unwrap();
            let mut heard = Vec::new();
            while let Ok(frame) = receive(&mut receiver, Start::Now, us(50_000), true).await {
                heard.push(frame);
            }
            heard
        },
    );
    (sent, heard, a, b)
}

#[test]
fn responses_of_a_round_are_all_heard() {
    // 25 bytes and check: 194 µs of air every 300 µs.
    let (sent, heard, a, b) = burst(20, 25, us(300));
    assert_eq!(heard.len(), 20);
    for (number, (sent, heard)) in sent.windows(2).zip(heard.windows(2)).enumerate() {
        assert_eq!(heard[0].bytes, [number as u8; 25]);
        let (spaced, seen) = (sent[1].since(sent[0]).ticks(), heard[1].rx_time.since(heard[0].rx_time).ticks());
        // 10 ppm of 300 µs are 192 ticks; each stamp is rounded to a tick.
        assert!((seen - spaced).abs() <= 200, "{number}: {spaced} became {seen}");
        assert!((heard[0].ppm - 10.0).abs() < 0.3, "carrier integrator of the frame itself: {}", heard[0].ppm);
    }
    assert_well_treated(&a);
    assert_well_treated(&b);
}

#[test]
fn responses_of_several_anchors_are_heard_from_their_first_symbol_on() {
    // Frames of 27 bytes take 194 µs. An interval of 250 µs leaves 56 µs to switch the receiver on again: 9 µs of
    // interrupt, three transactions of 1.9 µs and 16 bytes, and 16 µs for the receiver to start.
    let world = World::new(7, AirConfig::ideal());
    let tag = node_at(&world, 0.0, 0.0);
    for number in 0..5_u8 {
        let mut config = NodeConfig::at([10.0, f64::from(number), 1.0]);
        // The counters start together, so equal instants are equal times.
        config.chip = ChipConfig { clock: ClockConfig::IDEAL, counter: Some(0), ..ChipConfig::default() };
        let mut anchor = driver(world.add_node(config).peripherals(), fast());
        world.spawn(async move {
            anchor.init().await.unwrap();
            for round in 0..4 {
                let at = us(30_000 + 250 * (5 * round + u32::from(number)));
                let at = RadioInstant::from_ticks(0).plus(at);
                anchor.transmit(&[number; 25], Start::At(at), false).await.unwrap();
            }
        });
    }
    let mut radio = driver(tag.peripherals(), fast());
    let (heard, ()) = run(
        &world,
        async move {
            radio.init().await.unwrap();
            let mut buffer = [0; MAX_FRAME];
            let mut heard = Vec::new();
            while let Ok(frame) = radio.receive(&mut buffer, Start::Now, us(50_000), true).await {
                heard.push((frame.bytes[0], frame.diagnostics.preamble_count));
            }
            heard
        },
        async {},
    );
    assert_eq!(heard.iter().map(|h| h.0).collect::<Vec<_>>(), [0, 1, 2, 3, 4].repeat(4));
    // The receiver had been on for long when it received the first frame. No later frame was received with fewer
    // symbols.
    assert!(heard.iter().all(|h| h.1 == heard[0].1), "{heard:?}");
    assert_well_treated(&tag);
}

#[test]
fn a_late_transmission_is_told_and_the_next_one_goes_out() {
    let (world, a, b) = two_nodes(0.0);
    let (mut sender, mut receiver) = (driver(a.peripherals(), fast()), driver(b.peripherals(), fast()));
    let clock = a.peripherals().delay;
    let (_, heard) = run(
        &world,
        async move {
            sender.init().await.unwrap();
            clock.pause_ms(20).await;
            // The preamble should have begun 139 µs before the RMARKER.
            for span in [-1_000_000_000, 0, us(100).ticks()] {
                let at = soon(&mut sender, RadioDuration::from_ticks(span)).await;
                let late = sender.transmit(b"late", Start::At(at), true).await;
                assert_eq!(late, Err(TransmitError::Late), "{span}");
            }
            let at = soon(&mut sender, us(400)).await;
            sender.transmit(b"in time", Start::At(at), false).await.unwrap();
        },
        async move {
            receiver.init().await.unwrap();
            let first = receive(&mut receiver, Start::Now, us(60_000), true).await;
            (first, receive(&mut receiver, Start::Now, us(10_000), false).await)
        },
    );
    assert_eq!(heard.0.map(|h| h.bytes), Ok(b"in time".to_vec()));
    assert_eq!(heard.1, Err(ReceiveError::Timeout));
    assert_well_treated(&a);
}

#[test]
fn a_start_at_any_instant_leaves_the_next_one_in_time() {
    let (world, a, _b) = two_nodes(0.0);
    let mut sender = driver(a.peripherals(), fast());
    let clock = a.peripherals().delay;
    run(
        &world,
        async move {
            sender.init().await.unwrap();
            clock.pause_ms(20).await;
            let mut too_near = 0;
            // The start varies from before the time that writing the frame takes until after it, through the
            // microseconds in which the transmitter cannot power up.
            for ahead in 60..260 {
                let at = soon(&mut sender, us(ahead)).await;
                too_near += u32::from(sender.transmit(b"near", Start::At(at), false).await == Err(TransmitError::Late));
                let at = soon(&mut sender, us(2_000)).await;
                assert!(sender.transmit(b"far", Start::At(at), false).await.is_ok(), "after one {ahead} us ahead");
            }
            assert!((20..180).contains(&too_near), "{too_near}");
        },
        async {},
    );
}

#[test]
fn windows_are_kept() {
    let (world, a, b) = two_nodes(0.0);
    let mut radio = driver(a.peripherals(), fast());
    run(
        &world,
        async move {
            radio.init().await.unwrap();
            // The window ends by the chip's timer, by the delay alone, with a delayed start, and with a receiver that
            // is on already.
            for window in [us(300), us(5_000), us(66_000), us(200_000)] {
                let begin = radio.now().await.unwrap();
                assert_eq!(receive(&mut radio, Start::Now, window, true).await, Err(ReceiveError::Timeout));
                let took = radio.now().await.unwrap().since(begin).as_micros() - window.as_micros();
                assert!((0..300).contains(&took), "{window:?}: {took} µs more");
            }
            let begin = soon(&mut radio, us(3_000)).await;
            assert_eq!(receive(&mut radio, Start::At(begin), us(2_000), false).await, Err(ReceiveError::Timeout));
            let took = radio.now().await.unwrap().since(begin).as_micros();
            assert!((2_000..2_300).contains(&took), "{took}");
            radio.transmit(b"?", Start::Now, true).await.unwrap();
            let begin = radio.now().await.unwrap();
            assert_eq!(receive(&mut radio, Start::Now, us(2_000), false).await, Err(ReceiveError::Timeout));
            let took = radio.now().await.unwrap().since(begin).as_micros();
            assert!((2_000..2_300).contains(&took), "{took}");
            // Late.
            let past = soon(&mut radio, us(0)).await;
            assert_eq!(receive(&mut radio, Start::At(past), us(2_000), false).await, Err(ReceiveError::Late));
        },
        async {},
    );
    assert_well_treated(&a);
    drop(b);
}

#[test]
fn a_delayed_receiver_is_deaf_before_its_time() {
    let (world, a, b) = two_nodes(0.0);
    let (mut sender, mut receiver) = (driver(a.peripherals(), fast()), driver(b.peripherals(), fast()));
    let clock = a.peripherals().delay;
    let (_, heard) = run(
        &world,
        async move {
            sender.init().await.unwrap();
            for millis in [30, 20] {
                clock.pause_ms(millis).await;
                sender.transmit(&[millis as u8], Start::Now, false).await.unwrap();
            }
        },
        async move {
            receiver.init().await.unwrap();
            let start = Start::At(soon(&mut receiver, us(40_000)).await);
            receive(&mut receiver, start, us(30_000), false).await
        },
    );
    assert_eq!(heard.map(|h| h.bytes), Ok(vec![20]));
}

#[test]
fn the_filter_lets_its_own_through_and_the_window_stays_open() {
    let (world, a, b) = two_nodes(0.0);
    let filtered =
        Config { pan: 0xDECA, short_address: 0x0001, filter: FrameFilter::DATA.and(FrameFilter::TYPE_5), ..fast() };
    let (mut sender, mut receiver) = (driver(a.peripherals(), fast()), driver(b.peripherals(), filtered));
    let clock = a.peripherals().delay;
    // Data frames: frame control, sequence, PAN, destination, source, payload; and a blink.
    let data = |destination: u16, pan: u16, mark: u8| {
        let ([d0, d1], [p0, p1]) = (destination.to_le_bytes(), pan.to_le_bytes());
        vec![0x41, 0x88, mark, p0, p1, d0, d1, 0x09, 0x00, mark]
    };
    let frames = [
        data(0x0002, 0xDECA, 1),
        data(0x0001, 0xBEEF, 2),
        data(0x0001, 0xDECA, 3),
        data(0x0002, 0xDECA, 4),
        data(0xFFFF, 0xDECA, 5),
        vec![0xC5, 6, 1, 2, 3, 4, 5, 6, 7, 8],
        data(0x0042, 0xDECA, 7),
        data(0x0042, 0xDECA, 8),
    ];
    let (_, heard) = run(
        &world,
        async move {
            sender.init().await.unwrap();
            let mut at = soon(&mut sender, us(20_000)).await;
            for frame in frames {
                sender.transmit(&frame, Start::At(at), false).await.unwrap();
                at = at.plus(us(2_000));
            }
        },
        async move {
            receiver.init().await.unwrap();
            let mut marks = Vec::new();
            for expected in 0..4 {
                marks.push(receive(&mut receiver, Start::Now, us(60_000), true).await.map(|h| h.bytes[2]));
                if expected == 2 {
                    // The node has joined and has another address; it does not receive frame 7.
                    clock.pause_ms(3).await;
                    receiver.set_address(0xDECA, 0x0042).await.unwrap();
                }
            }
            marks
        },
    );
    // The byte after a blink's sequence number is the first byte of its address.
    assert_eq!(heard, [Ok(3), Ok(5), Ok(1), Ok(8)]);
    assert_well_treated(&b);
}

#[test]
fn collisions_are_told_and_the_next_stamp_is_right() {
    let world = World::new(3, AirConfig::ideal());
    let (left, middle, right) = (node_at(&world, -10.0, 0.0), node_at(&world, 0.0, 0.0), node_at(&world, 10.0, 0.0));
    let (mut one, mut two) = (driver(left.peripherals(), fast()), driver(right.peripherals(), fast()));
    let mut receiver = driver(middle.peripherals(), fast());
    world.spawn(async move {
        two.init().await.unwrap();
        // One sends every 5 ms, the other every 5.107 ms, so each collides with the other at some time.
        let mut at = soon(&mut two, us(32_000)).await;
        for _ in 0..50 {
            two.transmit(&[2; 100], Start::At(at), false).await.unwrap();
            at = at.plus(us(5_000));
        }
    });
    let (sent, heard) = run(
        &world,
        async move {
            one.init().await.unwrap();
            let mut at = soon(&mut one, us(30_000)).await;
            let mut sent = Vec::new();
            for _ in 0..40 {
                sent.push(one.transmit(&[1; 60], Start::At(at), false).await.unwrap());
                at = at.plus(us(5_107));
            }
            sent
        },
        async move {
            receiver.init().await.unwrap();
            let mut heard = Vec::new();
            loop {
                match receive(&mut receiver, Start::Now, us(50_000), true).await {
                    Err(ReceiveError::Timeout) => return heard,
                    other => heard.push(other),
                }
            }
        },
    );
    let corrupt = heard.iter().filter(|h| **h == Err(ReceiveError::Corrupt)).count();
    assert!(corrupt > 0, "frames met");
    // Every received frame has the time stamp of its sender's clock, up to one constant offset between the clocks.
    let ones: Vec<_> = heard.iter().flatten().filter(|h| h.bytes[0] == 1).collect();
    assert!(ones.len() >= 20, "{}", ones.len());
    let mut offset = None;
    for frame in ones {
        let since = |t: &RadioInstant| frame.rx_time.since(*t).ticks();
        let offsets: Vec<_> = sent.iter().map(since).collect();
        let reference = *offset.get_or_insert(offsets[0]);
        // The first frame collides with no other, so the first received frame is the first sent.
        let nearest = offsets.iter().map(|o| (o - reference).abs()).min().unwrap();
        // The clocks have no drift, so only a tick of rounding at each end remains.
        assert!(nearest <= 2, "a stamp is {nearest} ticks off");
    }
    assert_well_treated(&middle);
}

#[test]
fn abandoned_operations_leave_a_radio_that_works() {
    let (world, a, b) = two_nodes(0.0);
    let (mut sender, mut receiver) = (driver(a.peripherals(), fast()), driver(b.peripherals(), fast()));
    let clock = a.peripherals().delay;
    let other_clock = clock.clone();
    let (_, heard) = run(
        &world,
        async move {
            sender.init().await.unwrap();
            clock.pause_ms(20).await;
            for number in 0..200_u8 {
                sender.transmit(&[number; 20], Start::Now, false).await.unwrap();
                clock.pause_ms(1).await;
            }
        },
        async move {
            receiver.init().await.unwrap();
            other_clock.pause_ms(20).await;
            let mut heard = 0;
            // Receptions are cancelled at any point, after times that drift through the frames.
            for round in 0..150_u64 {
                let mut buffer = [0; MAX_FRAME];
                let attempt = receiver.receive(&mut buffer, Start::Now, us(5_000), round % 2 == 0);
                let limit = other_clock.pause(Duration::from_micros(50 + round * 13));
                if let embassy_futures::select::Either::First(frame) =
                    embassy_futures::select::select(attempt, limit).await
                {
                    frame.unwrap();
                    heard += 1;
                }
            }
            let last = receive(&mut receiver, Start::Now, us(5_000), false).await;
            (heard, last.map(|h| h.bytes.len()))
        },
    );
    assert!(heard.0 > 20, "{}", heard.0);
    assert_eq!(heard.1, Ok(20));
    assert_well_treated(&a);
}
