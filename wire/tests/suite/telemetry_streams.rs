//! Streams as they occur: from their middle, torn, with noise, text and `defmt` frames in between.

use baliza_wire::telemetry::*;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use rand::SeedableRng;
use rand_pcg::Pcg64;

use crate::drawn;

/// A message with this time, so that frames can be distinguished.
fn message(t_us: u64) -> Message {
    Message::State(State { t_us, is: Condition::Searching })
}

fn frame(message: &Message) -> Vec<u8> {
    encode(message, &mut [0; MAX_FRAME]).to_vec()
}

/// A decoder's output for a stream.
fn read(stream: &[u8]) -> (Vec<Result<Message, DecodeError>>, Counts) {
    let mut decoder = Decoder::new();
    let results = stream.iter().filter_map(|byte| decoder.feed(*byte)).collect();
    (results, *decoder.counts())
}

fn counts(frames: u64) -> Counts {
    Counts { frames, ..Counts::default() }
}

#[test]
fn need_more_is_not_malformed() {
    let (first, second) = (frame(&message(1)), frame(&message(2)));
    let mut decoder = Decoder::new();
    let (last, before) = first.split_last().expect("a frame");
    assert!(before.iter().all(|byte| decoder.feed(*byte).is_none()));
    assert_eq!((*decoder.counts(), decoder.pending()), (counts(0), before.len()));
    assert_eq!(decoder.feed(*last), Some(Ok(message(1))));
    assert!(second[..3].iter().all(|byte| decoder.feed(*byte).is_none()));
    assert_eq!((*decoder.counts(), decoder.pending()), (counts(1), 3));
}

#[test]
fn a_stream_that_begins_in_the_middle_of_a_frame_is_no_fault() {
    let stream = [frame(&message(1)), frame(&message(2))].concat();
    for cut in 1..frame(&message(1)).len() - 1 {
        let lost_bytes = (frame(&message(1)).len() - 1 - cut) as u64;
        let (results, found) = read(&stream[cut..]);
        assert_eq!(results, [Ok(message(2))], "{cut}");
        assert_eq!(found, Counts { torn_at_start: 1, lost_bytes, ..counts(1) });
    }
}

#[test]
fn zeros_between_frames_mean_nothing() {
    let stream = [vec![0; 3], frame(&message(1)), vec![0; 300], frame(&message(2))].concat();
    assert_eq!(read(&stream), (vec![Ok(message(1)), Ok(message(2))], counts(2)));
}

#[test]
fn an_interruption_loses_what_had_not_ended_and_begins_anew() {
    let mut decoder = Decoder::new();
    let mut feed = |bytes: &[u8]| bytes.iter().filter_map(|byte| decoder.feed(*byte)).collect::<Vec<_>>();
    assert_eq!(feed(&frame(&message(1))), [Ok(message(1))]);
    feed(&frame(&message(2))[..4]);
    decoder.interrupted();
    let mut feed = |bytes: &[u8]| bytes.iter().filter_map(|byte| decoder.feed(*byte)).collect::<Vec<_>>();
    assert_eq!(feed(&frame(&message(3))[2..]), []);
    assert_eq!(feed(&frame(&message(4))), [Ok(message(4))]);
    let torn = (frame(&message(3)).len() - 3) as u64;
    assert_eq!(*decoder.counts(), Counts { torn_at_start: 1, lost_bytes: 4 + torn, ..counts(2) });
}

#[test]
fn a_frame_whose_bytes_are_all_there_survives_what_ran_into_it() {
    let whole = frame(&message(2));
    // A frame cut short by a reset, a boot loader's text, and more noise than the length of a frame.
    let torn = &frame(&message(1))[..5];
    let text = b"\x1b[0;32mESP-ROM:esp32c3-api1-20210207\r\n".repeat(40);
    let noise = [0x81].repeat(1000);
    let cases = [
        (torn, Counts { cobs: 1, lost_bytes: 5, ..counts(2) }),
        (&text, Counts { foreign: 1, foreign_bytes: text.len() as u64, ..counts(2) }),
        (&noise, Counts { too_long: 1, lost_bytes: 1000, ..counts(2) }),
    ];
    for (before, expected) in cases {
        let stream = [&frame(&message(0)), before, &whole].concat();
        assert_eq!(read(&stream), (vec![Ok(message(0)), Ok(message(2))], expected), "{before:?}");
    }
}

#[test]
fn defmt_frames_are_foreign() {
    // As espflash sends them: FF 00, rzCOBS, 00. The bytes within do not matter.
    let defmt = [0xFF, 0x00, 0x07, 0x81, 0xC3, 0x01, 0xFE, 0x00];
    let stream = [&defmt[..], &frame(&message(1)), &defmt, &defmt, &frame(&message(2)), b"\xFF\0\0"].concat();
    let expected = Counts { foreign: 3, foreign_bytes: 15, ..counts(2) };
    assert_eq!(read(&stream), (vec![Ok(message(1)), Ok(message(2))], expected));
}

#[test]
fn a_frame_that_ends_like_the_marker_of_a_defmt_frame_is_a_frame() {
    let ends_so = |t_us: &u64| frame(&message(*t_us)).ends_with(&[0xFF, 0]);
    let first = (0..).find(ends_so).expect("one in 256");
    let stream = [frame(&message(first)), frame(&message(7))].concat();
    assert_eq!(read(&stream), (vec![Ok(message(first)), Ok(message(7))], counts(2)));
}

#[test]
fn whole_frames_of_other_builds_are_no_losses() {
    // Schema 2 and message 99, from the golden bytes.
    let stream = b"\x0B\x02\x04\x80\x89\x7A\x04\x81\x02\x27\xDF\0\x06\x01\x63\x05\x70\xF5\0";
    let (results, found) = read(stream);
    assert_eq!(results, [Err(DecodeError::Schema(2)), Err(DecodeError::Unknown)]);
    assert_eq!(found, Counts { schema: 1, unknown: 1, ..counts(0) });
    assert_eq!((found.malformed(), found.newer()), (0, 2));
}

#[test]
fn each_kind_of_damage_has_its_count() {
    // The golden state: whole, a bit of its time flipped, its distance too long; then one whose body ends early, and
    // 300 bytes of noise.
    let stream = [
        &b"\x0B\x01\x04\x80\x89\x7A\x04\x81\x02\x52\x17\0"[..],
        b"\x0B\x01\x04\x81\x89\x7A\x04\x81\x02\x52\x17\0",
        b"\x0C\x01\x04\x80\x89\x7A\x04\x81\x02\x52\x17\0",
        b"\x09\x01\x04\x80\x89\x7A\x04\x53\x1D\0",
        &[0x81; 300],
        b"\0",
    ]
    .concat();
    let (results, found) = read(&stream);
    let expected = Counts { checksum: 1, cobs: 1, body: 1, too_long: 1, lost_bytes: 11 + 11 + 9 + 300, ..counts(1) };
    assert_eq!(found, expected);
    let torn: Vec<_> = results.into_iter().skip(1).collect();
    assert_eq!(torn, [DecodeError::Checksum, DecodeError::Cobs, DecodeError::Body, DecodeError::TooLong].map(Err));
}

/// Any message at all.
fn any_message() -> impl Strategy<Value = Message> {
    any::<u64>().prop_map(|seed| drawn::value(&mut Pcg64::seed_from_u64(seed)))
}

proptest! {
    // Always the same cases: one damage in 65536 has a correct checksum.
    #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]

    #[test]
    fn any_message_comes_back_as_it_was(messages in proptest::collection::vec(any_message(), 1..20)) {
        let stream: Vec<u8> = messages.iter().flat_map(frame).collect();
        prop_assert!(messages.iter().all(|message| frame(message).iter().filter(|byte| **byte == 0).count() == 1));
        let (results, found) = read(&stream);
        prop_assert_eq!(found, counts(messages.len() as u64));
        prop_assert_eq!(results, messages.into_iter().map(Ok).collect::<Vec<_>>());
    }

    /// Whatever bytes flip: frames whose own bytes are whole are decoded, in order, nothing else is, and every byte is
    /// counted.
    #[test]
    fn flipped_bytes_cost_the_frames_that_they_are_in(
        messages in proptest::collection::vec(any_message(), 1..20),
        flips in proptest::collection::vec((any::<proptest::sample::Index>(), 1..=255_u8), 0..10),
    ) {
        let frames: Vec<Vec<u8>> = messages.iter().map(frame).collect();
        let whole = frames.concat();
        let mut stream = whole.clone();
        for (at, mask) in flips {
            let at = at.index(stream.len());
            stream[at] ^= mask;
        }
        let mut begin = 0;
        let untouched: Vec<Message> = frames.iter().zip(&messages).filter_map(|(frame, message)| {
            let place = begin..begin + frame.len();
            begin = place.end;
            (stream[place.clone()] == whole[place]).then_some(*message)
        }).collect();
        let (results, _) = read(&stream);
        let read: Vec<Message> = results.into_iter().filter_map(Result::ok).collect();
        prop_assert_eq!(read, untouched);
    }

    #[test]
    fn after_any_noise_the_next_whole_frame_is_read(noise in proptest::collection::vec(any::<u8>(), 0..1000), message in any_message()) {
        let (results, _) = read(&[&noise[..], &frame(&message)].concat());
        prop_assert_eq!(results.last(), Some(&Ok(message)));
    }

    #[test]
    fn every_byte_of_noise_is_accounted_for(noise in proptest::collection::vec(any::<u8>(), 0..2000)) {
        let mut decoder = Decoder::new();
        let results = noise.iter().filter(|byte| decoder.feed(**byte).is_some()).count() as u64;
        let found = *decoder.counts();
        prop_assert_eq!(results, found.frames + found.malformed() + found.newer());
        let zeros = noise.iter().filter(|byte| **byte == 0).count();
        // A chunk that ends with FF is counted as a marker.
        let markers = noise.windows(2).filter(|pair| **pair == [0xFF, 0]).count();
        let told = found.lost_bytes + found.foreign_bytes + decoder.pending() as u64 + zeros as u64;
        prop_assert!((told..=told + markers as u64).contains(&(noise.len() as u64)), "{} of {}", told, noise.len());
    }
}
