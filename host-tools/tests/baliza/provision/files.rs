//! The files of records, and what a debug probe needs.

use super::{ANCHOR, EVERYTHING, provisioned, refused};
use crate::support::Folder;

#[test]
fn intel_hex_is_the_same_record_with_its_address() {
    let folder = Folder::with(&[("site.toml", ANCHOR)]);
    folder.run("provision --config site.toml --format hex --out a.hex").ok();
    folder.run("provision --config site.toml --format bin --out a.bin").ok();
    let text = String::from_utf8(folder.read("a.hex")).expect("text");
    assert!(text.starts_with(":020000040803EF\n:10F00000424C5A52"), "{text}");
    let show = |file: &str| folder.run(&format!("provision --show {file}")).ok().stdout;
    assert_eq!(show("a.hex"), show("a.bin"));
    folder.run("provision --check a.hex").ok();
    folder.write("bad.hex", text.replacen("424C", "424D", 1).as_bytes());
    refused(&folder.run("provision --check bad.hex"), "bad.hex:2: ");
    refused(&folder.run("provision --show bad.hex"), "bad.hex:2: ");
}

/// Sets the checksum of the record at the beginning of a page, by the definition of CRC-32.
fn seal(page: &mut [u8]) {
    let length = usize::from(u16::from_le_bytes([page[6], page[7]]));
    let covered = page[..12].iter().chain(&page[16..16 + length]);
    let crc = covered.fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
    });
    page[12..16].copy_from_slice(&(!crc).to_le_bytes());
}

#[test]
fn each_kind_of_damaged_file_has_its_own_error() {
    let folder = provisioned(ANCHOR);
    let good = folder.read("records/a.bin");
    let check = |bytes: &[u8], said: &str| {
        folder.write("x.bin", bytes);
        let run = folder.run("provision --check x.bin");
        refused(&run, &format!("x.bin: {said}"));
        assert_eq!(run.stdout, "");
        let json = folder.run("provision --check x.bin --json");
        assert_eq!((json.code, &json.object()["good"]), (Some(2), &serde_json::json!(false)));
    };
    let mut old = good.clone();
    for page in old.chunks_mut(2048) {
        page[4] = 0;
        seal(page);
    }
    check(&old, "the record is of version 0, this program reads versions 1 to 4");
    check(&good[..3000], "the file is cut short: 3000 bytes are no whole pages");
    check(&good[..50], "the record is damaged or cut short: its checksum is wrong");
    check(&[], "there is no record: the flash is erased");
    check(&[0xFF; 8192], "there is no record: the flash is erased");
    check(b"not a record", "this is no node record: it does not begin as one");
    for bit in (0..69 * 8).step_by(37) {
        let mut flipped = good.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        check(
            &flipped,
            "page 1 of 2: the record is damaged or cut short: its checksum is wrong; the other page is whole",
        );
        // A node would continue with the other page, and so does --show.
        folder.run("provision --show x.bin").ok();
    }
    let mut both = good.clone();
    both[20] ^= 1;
    both[2048 + 20] ^= 1;
    check(&both, "the record is damaged or cut short: its checksum is wrong");
    refused(&folder.run("provision --show x.bin"), "x.bin: the record is damaged");
    refused(&folder.run("provision --check missing.bin"), "missing.bin: ");
    let run = folder.run("provision --check records/a.bin --json").ok().object();
    assert_eq!((&run["good"], &run["sequence"]), (&serde_json::json!(true), &serde_json::json!(1)));
}

#[test]
fn a_good_record_may_be_for_another_board() {
    let folder = provisioned(EVERYTHING);
    folder.run("provision --check records/tag.bin --board dwm1001").ok();
    let run = folder.run("provision --check records/tag.bin --board evk1000");
    refused(&run, "records/tag.bin: a good record, but not for evk1000: tag.scan.interval_ms is 100: ");
}

#[test]
fn reading_a_record_needs_a_board_that_a_probe_can_read() {
    let folder = Folder::with(&[]);
    refused(&folder.run("provision --read --board esp32c3"), "--read: a probe does not read an ESP's flash: ");
    refused(&folder.run("provision --read"), "the following required arguments were not provided: --board");
}

#[test]
fn all_records_of_a_folder_are_of_one_file() {
    let folder = Folder::with(&[]);
    folder.run("provision --example --out site.toml").ok();
    folder.run("provision --config site.toml --all --out records").ok();
    folder.write("records/notes.bin", b"mine");
    folder.run("provision --config site.toml --node tag-1 --out records/spare.bin").ok();
    // Without --force, a record of a node that the file does not have is no reason to go on.
    let site = String::from_utf8(folder.read("site.toml")).expect("text");
    folder.write("renamed.toml", site.replace("name = \"anchor-4\"", "name = \"door\"").as_bytes());
    let again = "provision --config renamed.toml --all --out records";
    refused(&folder.run(again), "--out: records has anchor-1.bin already; --force replaces it");
    folder.run(&format!("{again} --force")).ok();
    let mut names: Vec<_> = std::fs::read_dir(folder.path("records"))
        .expect("the folder")
        .map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8"))
        .collect();
    names.sort();
    // Neither anchor-4 nor the spare record is left; what is no record stays.
    let expected = ["anchor-1", "anchor-2", "anchor-3", "beacon-1", "door", "notes", "tag-1"];
    assert_eq!(names, expected.map(|name| format!("{name}.bin")));
}
