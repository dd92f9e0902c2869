//! Positions in and out.

use super::*;

on_both! {
    async fn a_position_is_read_as_it_was_written_to_a_millimetre_and_a_millisecond(place) {
        let store = place.open().await;
        let written = TagPosition {
            t: at(61_234) + Duration::from_micros(900),
            x_m: -12.345_6,
            y_m: 7.000_4,
            z_m: Some(1.5),
            sigma_z_m: Some(0.3),
            // 0.1 m * 0.2 m * 0.6.
            cov_xy_m2: 0.012,
            room: Some("kitchen".to_owned()),
            ..position("0x1001", 0)
        };
        let plane = position("0x1001", 70_000);
        store.write(&[written.clone(), plane.clone()], &[]).await.unwrap();
        for _ in 0..2 {
            let read = store.positions("hall", "0x1001", EVER(), 10).await.unwrap();
            // 0.6 is stored as 76/127.
            let cov_xy_m2 = 76.0 / 127.0 * 0.02;
            assert!((read[1].cov_xy_m2 - cov_xy_m2).abs() < 1e-9);
            let expected = TagPosition {
                t: at(61_234), x_m: -12.346, y_m: 7.0, cov_xy_m2: read[1].cov_xy_m2, ..written.clone()
            };
            assert_eq!(read, [plane.clone(), expected]);
            store.compact(at(1_000_000)).await.unwrap();
        }
    }

    async fn a_doubt_is_read_as_it_was_written(place) {
        let store = place.open().await;
        let two_places = Doubt::Ambiguous { alternative_m: [-12.345, 7.0, 0.5] };
        let written: Vec<_> = [(1000, Some(two_places)), (2000, Some(Doubt::Suspect)), (3000, None)]
            .into_iter()
            .map(|(ms, doubt)| TagPosition { doubt, ..position("a", ms) })
            .collect();
        store.write(&written, &[]).await.unwrap();
        for _ in 0..2 {
            let mut read = store.positions("hall", "a", EVER(), 10).await.unwrap();
            read.reverse();
            assert_eq!(read, written);
            store.compact(at(1_000_000)).await.unwrap();
        }
    }

    async fn positions_of_a_tag_come_newest_first_from_both_tables(place) {
        let store = place.open().await;
        // Five minutes of two tags, one a second, in an order that is not that of time; the last minute is not over.
        let mut rows: Vec<_> = (0..300).map(|s| position(if s % 2 == 0 { "a" } else { "b" }, s * 1000)).collect();
        rows.reverse();
        store.write(&rows, &[]).await.unwrap();
        store.compact(at(250_000)).await.unwrap();
        let read = store.positions("hall", "a", span(10_000, 290_000), 1000).await.unwrap();
        let expected: Vec<i64> = (5..145).rev().map(|i| i * 2000).collect();
        assert_eq!(times(&read), expected);
        for limit in [0, 1, 30, 77] {
            let read = store.positions("hall", "a", span(10_000, 290_000), limit).await.unwrap();
            assert_eq!(times(&read), expected[..usize::try_from(limit).unwrap()]);
        }
        for (site, tag) in [("hall", "c"), ("yard", "a")] {
            assert_eq!(store.positions(site, tag, EVER(), 10).await.unwrap(), []);
        }
        assert_eq!(store.positions("hall", "a", span(200_000, 100_000), 10).await.unwrap(), []);
    }

    async fn a_gap_of_months_does_not_end_the_history(place) {
        let store = place.open().await;
        let month = 30 * 24 * 3600 * 1000;
        let rows: Vec<_> = (0..40).map(|i| position("a", i * month / 10)).collect();
        store.write(&rows, &[]).await.unwrap();
        store.compact(at(5 * month)).await.unwrap();
        let expected: Vec<i64> = (0..40).rev().map(|i| i * month / 10).collect();
        assert_eq!(times(&store.positions("hall", "a", EVER(), 100).await.unwrap()), expected);
    }

    async fn what_is_written_again_is_read_once_before_and_after_compaction(place) {
        let store = place.open().await;
        let rows: Vec<_> = (0..20).map(|i| position("a", i * 100)).collect();
        let later = TagPosition { y_m: 9.0, ..position("a", 0) };
        let events = [event(1, 0, EventKind::Entered)];
        for _ in 0..3 {
            for _ in 0..2 {
                store.write(&rows, &events).await.unwrap();
                let read = store.positions("hall", "a", EVER(), 100).await.unwrap();
                assert_eq!((read.len(), store.events(None, EVER(), &[], None, 10).await.unwrap().len()), (20, 1));
                assert_eq!(read[19].y_m, 0.0);
                assert_eq!(store.replay("hall", EVER(), Duration::from_millis(100), 100).await.unwrap().len(), 20);
            }
            store.write(std::slice::from_ref(&later), &[]).await.unwrap();
            store.compact(at(1_000_000)).await.unwrap();
        }
    }

    async fn late_and_early_rows_go_to_their_minute(place) {
        let store = place.open().await;
        let now = 600_000;
        store.write(&[position("a", now - 60_000)], &[]).await.unwrap();
        store.compact(at(now + 5_000)).await.unwrap();
        // A clock that is a year ahead, one that is ten minutes late, the current minute.
        let year = 365 * 24 * 3600 * 1000;
        store.write(&[position("a", now + year), position("a", 5), position("a", now)], &[]).await.unwrap();
        store.compact(at(now + 5_000)).await.unwrap();
        let left: i64 = sqlx::query_scalar("SELECT COUNT(*) FROM recent").fetch_one(&store.pool).await.unwrap();
        assert_eq!(left, 1);
        let read = store.positions("hall", "a", EVER(), 10).await.unwrap();
        assert_eq!(times(&read), [now + year, now, now - 60_000, 5]);
        assert_eq!(times(&store.replay("hall", EVER(), Duration::from_secs(1), 10).await.unwrap()), [
            5, now - 60_000, now, now + year
        ]);
    }

    async fn a_late_row_is_not_taken_for_the_newest(place) {
        let store = place.open().await;
        store.write(&[position("a", 600_000)], &[]).await.unwrap();
        store.compact(at(1_000_000)).await.unwrap();
        store.write(&[position("a", 5)], &[]).await.unwrap();
        assert_eq!(times(&store.positions("hall", "a", EVER(), 1).await.unwrap()), [600_000]);
    }

    async fn a_position_that_is_no_number_is_left_out_and_the_rest_is_kept(place) {
        let store = place.open().await;
        let rows = [TagPosition { x_m: f64::NAN, ..position("a", 0) }, position("a", 1)];
        store.write(&rows, &[]).await.unwrap();
        assert_eq!(times(&store.positions("hall", "a", EVER(), 10).await.unwrap()), [1]);
    }

    async fn a_replay_has_one_position_a_tag_and_step_oldest_first(place) {
        let store = place.open().await;
        // Tag a at 10 Hz, b once every 1.5 s, over three minutes; the last one is not over. Another site is not seen.
        let a = (0..1800).map(|i| position("a", i * 100));
        let b = (0..120).map(|i| position("b", i * 1500 + 50));
        let c = (0..10).map(|i| TagPosition { site: "yard".to_owned(), ..position("a", i * 100) });
        store.write(&a.chain(b).chain(c).collect::<Vec<_>>(), &[]).await.unwrap();
        store.compact(at(150_000)).await.unwrap();
        // What the steps' first positions are is found here by going through all of them.
        for step in [100, 1000, 7000, 60_000, 100_000, 3_600_000] {
            let (from, to) = (30_000, 170_000);
            let mut expected = Vec::new();
            for tag in ["a", "b"] {
                let (every, offset) = if tag == "a" { (100, 0) } else { (1500, 50) };
                let all = (0..180_000 / every).map(|i| i * every + offset);
                let base = 1_767_225_600_000;
                let mut last = None;
                for t in all.filter(|t| (from..to).contains(t)) {
                    if last.replace((base + t) / step) != Some((base + t) / step) {
                        expected.push((t, tag));
                    }
                }
            }
            expected.sort_unstable();
            let step = Duration::from_millis(u64::try_from(step).unwrap());
            let read = store.replay("hall", span(from, to), step, 100_000).await.unwrap();
            let found: Vec<_> = times(&read).into_iter().zip(read.iter().map(|p| p.tag.as_str())).collect();
            assert_eq!(found, expected, "{step:?}");
            let some = store.replay("hall", span(from, to), step, 7).await.unwrap();
            assert_eq!(some, read[..read.len().min(7)], "{step:?}");
        }
        assert_eq!(store.replay("hall", EVER(), Duration::MAX, 10).await.unwrap().len(), 2);
        assert_eq!(store.replay("hall", EVER(), Duration::ZERO, 10).await.unwrap().len(), 10);
    }

    async fn tags_have_the_times_of_their_first_and_last_position_and_the_last_one(place) {
        let store = place.open().await;
        store.write(&[position("b", 5_000), position("a", 1_000)], &[]).await.unwrap();
        store.write(&[position("a", 500), position("a", 130_000)], &[]).await.unwrap();
        for _ in 0..2 {
            let tags = store.tags().await.unwrap();
            let found: Vec<_> = tags.iter().map(|tag| (tag.tag.as_str(), tag.first_seen, tag.last_seen)).collect();
            assert_eq!(found, [("a", at(500), at(130_000)), ("b", at(5_000), at(5_000))]);
            assert_eq!(tags[0].last_position, Some(position("a", 130_000)));
            store.compact(at(150_000)).await.unwrap();
        }
        assert_eq!(place.open().await.tags().await.unwrap(), store.tags().await.unwrap());
    }

    async fn a_reader_sees_every_position_once_while_they_are_moved(place) {
        let store = place.open().await;
        let reader = store.clone();
        let (stop, mut stopped) = tokio::sync::oneshot::channel::<()>();
        let reading = tokio::spawn(async move {
            let (mut reads, mut least) = (0, 0);
            while stopped.try_recv().is_err() {
                let read = reader.positions("hall", "a", EVER(), 10_000).await.unwrap();
                let times = times(&read);
                assert!(times.windows(2).all(|pair| pair[0] == pair[1] + 100), "a gap or a double");
                assert!(read.len() >= least);
                (reads, least) = (reads + 1, read.len());
            }
            reads
        });
        for minute in 0..10 {
            for part in 0..6 {
                let first = minute * 600 + part * 100;
                let rows: Vec<_> = (first..first + 100).map(|i| position("a", i * 100)).collect();
                store.write(&rows, &[]).await.unwrap();
            }
            store.compact(at((minute + 1) * 60_000 + 5_000)).await.unwrap();
        }
        stop.send(()).unwrap();
        assert!(reading.await.unwrap() > 0);
        assert_eq!(store.positions("hall", "a", EVER(), 10_000).await.unwrap().len(), 6000);
    }
}
