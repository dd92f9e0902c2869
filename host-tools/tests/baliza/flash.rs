//! `baliza flash` and `provision --write --all` without a board: which image is chosen, and what is refused.

use crate::support::Folder;

fn site() -> Folder {
    let folder = Folder::with(&[]);
    let example = folder.run("provision --example").ok().stdout;
    folder.write("site.toml", example.as_bytes());
    folder
}

fn refused(folder: &Folder, arguments: &str, said: &str) {
    let run = folder.run(arguments);
    assert_eq!((run.code, run.stdout.as_str(), run.stderr.lines().count()), (Some(2), "", 1), "{run:?}");
    assert!(run.stderr.starts_with(said), "{arguments}: {run:?}");
}

#[test]
fn the_image_of_the_board_and_role_is_looked_for() {
    let folder = site();
    let none = "--images: no anchor-dwm1001.elf in images: build it with `cargo xtask firmware dwm1001`";
    refused(&folder, "flash --node anchor-1 --images images", none);
    // The example's tag scans.
    let none = "--images: no tag-dwm1001-ble.elf in images: build it with `cargo xtask firmware dwm1001`";
    refused(&folder, "flash --node tag-1 --images images", none);
    refused(
        &folder,
        "flash --node anchor-1 --board esp32c6 --images images",
        "--images: no anchor-esp32c6.elf in images",
    );
    refused(&folder, "flash --all --images images", "--images: no anchor-dwm1001.elf in images");
}

#[test]
fn those_nodes_are_flashed_that_exist() {
    let folder = site();
    refused(&folder, "flash --node anchor-1,anchor-9 --images images", "--node: there is no node anchor-9");
    refused(&folder, "flash --node tag-1,anchor-2 --images images", "--images: no tag-dwm1001-ble.elf in images");
    refused(&folder, "flash --node anchor-1,anchor-2 --image a.elf", "--image: only with one node");
}

#[test]
fn what_is_no_image_for_the_node_is_refused_before_a_probe_is_asked() {
    let folder = site();
    folder.write("anchor.hex", b":020000040000FA\n");
    refused(
        &folder,
        "flash --node anchor-1 --image anchor.hex",
        "anchor.hex: not an ELF file of a 32-bit chip: give the .elf",
    );
    refused(&folder, "flash --node anchor-1 --image nosuch.elf", "nosuch.elf: cannot open it: ");
    refused(&folder, "flash --config nosuch.toml --node anchor-1", "nosuch.toml: ");
    refused(&folder, "flash --node anchor-9", "--node: there is no node anchor-9");
    refused(&folder, "flash", "--node: the file has 6 nodes");
}

#[test]
fn all_nodes_at_once_need_their_boards_and_a_good_note_of_what_is_written() {
    let folder = site();
    folder.write("site.written", b"x,y,z\n");
    let wrong = "site.written:1: not node,board,sum: delete the file to begin again";
    refused(&folder, "provision --config site.toml --write --all", wrong);
}
