//! What is at which character of the terminal.

use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::Buffer;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use station_core::model::{Doubt, HealthFigures, NodeRole, TagPosition, ZoneKind};

use super::*;

fn at(s: u64) -> Utc {
    "2026-01-01T10:00:00Z".parse::<Utc>().expect("a time") + Duration::from_secs(s)
}

fn tag(address: &str, name: Option<&str>, at_m: [f64; 2], s: u64) -> TagStatus {
    TagStatus {
        tag: address.to_owned(),
        site: "hall".to_owned(),
        name: name.map(str::to_owned),
        first_seen: at(0),
        last_seen: at(s),
        last_position: Some(TagPosition {
            site: "hall".to_owned(),
            tag: address.to_owned(),
            t: at(s),
            x_m: at_m[0],
            y_m: at_m[1],
            z_m: Some(1.25),
            sigma_x_m: 0.3,
            sigma_y_m: 0.4,
            sigma_z_m: None,
            cov_xy_m2: 0.0,
            room: Some("lab".to_owned()),
            used: 5,
            doubt: None,
        }),
        rate_hz: 10.0,
        silent: false,
        reason: None,
        zones: Vec::new(),
        supply_v: Some(3.01),
    }
}

fn anchor(address: &str, at_m: [f64; 2]) -> NodeStatus {
    NodeStatus {
        node: address.to_owned(),
        site: "hall".to_owned(),
        name: None,
        role: NodeRole::Anchor,
        position_m: Some([at_m[0], at_m[1], 2.5]),
        rssi_1m_dbm: None,
        path_loss_exponent: None,
        last_seen: Some(at(0)),
        health: HealthFigures {
            success_rate: Some(0.97),
            residual_mean_m: Some(0.61),
            residual_sigma_m: Some(0.08),
            first_path_minus_received_db: Some(-3.2),
            clock_offset_ppm: Some(-2.4),
            moved: true,
            supply_v: Some(2.87),
            ..HealthFigures { rate_hz: 25.0, ..HealthFigures::default() }
        },
    }
}

fn room(side_m: f64) -> Zone {
    Zone {
        site: "hall".to_owned(),
        name: "lab".to_owned(),
        kind: ZoneKind::Room,
        corners_m: vec![[0.0, 0.0], [side_m, 0.0], [side_m, side_m], [0.0, side_m]],
        alarm: false,
    }
}

fn snapshot(tags: Vec<TagStatus>) -> Snapshot {
    Snapshot { now: at(0), tags, nodes: vec![anchor("0x0101", [0.0, 10.0])], zones: vec![room(10.0)] }
}

fn screen(tags: Vec<TagStatus>) -> Screen {
    let mut screen = Screen::new(Vec::new(), true);
    screen.take(snapshot(tags));
    screen
}

fn drawn(screen: &mut Screen, width: u16, height: u16) -> Buffer {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).expect("a terminal in memory");
    terminal.draw(|frame| screen.draw(frame)).expect("drawn");
    terminal.backend().buffer().clone()
}

fn rows(buffer: &Buffer) -> Vec<String> {
    let row = |y| (0..buffer.area.width).map(|x| buffer[(x, y)].symbol()).collect();
    (0..buffer.area.height).map(row).collect()
}

fn text(screen: &mut Screen, width: u16, height: u16) -> String {
    rows(&drawn(screen, width, height)).join("\n")
}

fn press(screen: &mut Screen, keys: &str) {
    for key in keys.chars() {
        assert_eq!(screen.key(KeyEvent::new(KeyCode::Char(key), KeyModifiers::NONE)), Then::GoOn);
    }
}

fn press_code(screen: &mut Screen, code: KeyCode) {
    assert_eq!(screen.key(KeyEvent::new(code, KeyModifiers::NONE)), Then::GoOn);
}

/// The map alone on 60 by 32 characters: 30 rows of the map, 120 dots in both directions.
fn map_alone(tags: Vec<TagStatus>) -> Screen {
    let mut screen = screen(tags);
    screen.list = List::Hidden;
    screen
}

#[test]
fn tags_anchors_and_rooms_are_where_their_coordinates_are() {
    let mut screen = map_alone(vec![tag("0x1001", Some("Ana"), [5.0, 5.0], 0)]);
    let buffer = drawn(&mut screen, 60, 32);
    // The middle of the room is the middle of the map: dot 59.5, rounded to 60, is in character 30 across, and in row
    // 15 of the map, which begins below one line.
    assert_eq!(buffer[(30, 16)].symbol(), "●");
    assert_eq!((31..34).map(|x| buffer[(x, 16)].symbol()).collect::<String>(), "Ana");
    // The room's 10 m and 6 % on each side are 119 steps of 0.0941 m. Its corner is 53.1 dots left of and above the
    // middle: dot 6.4, which is in character 3 across, and in row 1 of the map.
    assert_eq!(buffer[(3, 2)].symbol(), "▲");
    assert_eq!((4..10).map(|x| buffer[(x, 2)].symbol()).collect::<String>(), "0x0101");
    // The name of the room is below its corner; its left wall goes down to dot 112.6, in row 28.
    assert_eq!((4..7).map(|x| buffer[(x, 3)].symbol()).collect::<String>(), "lab");
    for y in 4..29 {
        let symbol = buffer[(3, y)].symbol().chars().next().expect("a symbol");
        assert!(('\u{2801}'..='\u{28ff}').contains(&symbol), "{y}: {symbol}");
        assert_eq!(buffer[(1, y)].symbol(), " ");
    }
    assert_eq!(buffer[(3, 10)].fg, Color::Blue);
    // Two standard deviations: 0.6 m across, 6.4 dots: characters 26 or 27 and 33; 0.8 m up, 8.5 dots: rows 12 to 17.
    let is_dotted = |x, y| buffer[(x, y)].symbol().starts_with(|c| ('\u{2801}'..='\u{28ff}').contains(&c));
    assert!(is_dotted(26, 16) || is_dotted(27, 16), "{}", rows(&buffer).join("\n"));
    assert!(is_dotted(30, 13) || is_dotted(30, 14) && !is_dotted(30, 11), "{}", rows(&buffer).join("\n"));
}

#[test]
fn a_trail_follows_a_tag_and_is_forgotten_after_twenty_seconds() {
    let mut screen = map_alone(vec![tag("0x1001", None, [1.0, 5.0], 0)]);
    // No ellipse: what is left of the tag is its trail.
    let moved = |x_m: f64, s: u64| {
        let mut tag = tag("0x1001", None, [x_m, 5.0], s);
        let position = tag.last_position.as_mut().expect("a position");
        (position.sigma_x_m, position.sigma_y_m) = (0.0, 0.0);
        snapshot(vec![tag])
    };
    screen.take(moved(2.0, 10));
    screen.take(moved(8.0, 15));
    // 1 m is 10.6 dots: x = 2 m is at dot 59.5 - 31.9 = 27.6, in character 14; x = 1 m at dot 17, in character 8.
    let dots = |buffer: &Buffer| [8, 14].map(|x| buffer[(x, 16)].symbol() != " ");
    assert_eq!(dots(&drawn(&mut screen, 60, 32)), [true, true]);
    screen.take(moved(8.0, 25));
    assert_eq!(dots(&drawn(&mut screen, 60, 32)), [false, true]);
}

#[test]
fn the_list_has_positions_and_says_why_there_is_none() {
    let mut lost = tag("0x1002", None, [1.0, 1.0], 0);
    (lost.last_position, lost.reason) = (None, Some("too few ranges".to_owned()));
    let mut silent = tag("0x1003", Some("cart"), [2.0, 2.0], 0);
    silent.silent = true;
    let doubtful = |address: &str, doubt| {
        let mut tag = tag(address, None, [3.0, 3.0], 0);
        tag.last_position.as_mut().expect("a position").doubt = Some(doubt);
        tag
    };
    let two_places = doubtful("0x1004", Doubt::Ambiguous { alternative_m: [-3.12, 2.0, 0.0] });
    let suspect = doubtful("0x1005", Doubt::Suspect);
    let mut screen = screen(vec![tag("0x1001", Some("Ana"), [5.0, 5.0], 0), lost, silent, two_places, suspect]);
    screen.snapshot.now = at(45);
    // Wide enough for all columns.
    let text = text(&mut screen, 160, 20);
    let row = |word: &str| {
        // In the list, behind the map.
        let row = text.lines().find(|row| row.chars().skip(80).collect::<String>().contains(word));
        row.unwrap_or_else(|| panic!("{word}: {text}")).to_owned()
    };
    // hypot(0.3, 0.4) = 0.5.
    for field in ["5.00", "1.25", "0.50", "lab", "10.0", "3.01"] {
        assert!(text.lines().any(|line| line.contains("Ana ") && line.contains(field)), "{field}: {text}");
    }
    assert!(row("0x1002").contains("too few range"), "{text}");
    assert!(row("0x1004").contains("or -3.1, 2.0") && row("0x1005").contains("suspect"), "{text}");
    assert!(text.contains("silent 45 s") && text.contains("5 tags  1 silent"), "{text}");
}

#[test]
fn the_health_of_anchors_is_a_list_of_its_own() {
    let mut screen = screen(Vec::new());
    press_code(&mut screen, KeyCode::Tab);
    let text = text(&mut screen, 150, 20);
    let row = text.lines().find(|line| line.contains("97%")).unwrap_or_else(|| panic!("{text}"));
    for field in ["0x0101", "0.61", "0.08", "-3.2", "25.0", "2.87", "moved?"] {
        assert!(row.contains(field), "{field}: {row}");
    }
    assert!(text.contains("1 moved"), "{text}");
}

#[test]
fn the_map_follows_the_selected_tag_until_it_is_moved_by_hand() {
    let mut screen = screen(vec![tag("0x1001", None, [2.0, 2.0], 0), tag("0x1002", None, [9.0, 9.0], 0)]);
    press(&mut screen, "jj");
    press_code(&mut screen, KeyCode::Enter);
    // Below 90 columns the list is below: 40 rows have 38 for both, 23 or 22 for the map.
    let buffer = drawn(&mut screen, 60, 40);
    let found = (1..24).find_map(|y| (0..60).find(|x| buffer[(*x, y)].symbol() == "●" && y.abs_diff(12) <= 1));
    assert!(found.is_some_and(|x| x.abs_diff(30) <= 1), "{}", rows(&buffer).join("\n"));
    assert!(rows(&buffer).iter().any(|row| row.starts_with("> 0x1002")), "{}", rows(&buffer).join("\n"));
    press_code(&mut screen, KeyCode::Left);
    assert!(!screen.follows);
}

#[test]
fn a_search_finds_names_addresses_and_rooms_in_any_case() {
    let mut screen = screen(vec![tag("0x1001", Some("Ana"), [5.0, 5.0], 0), tag("0x1002", None, [1.0, 1.0], 0)]);
    let found = |screen: &Screen| screen.found_tags().map(|tag| tag.tag.clone()).collect::<Vec<_>>();
    press(&mut screen, "/aNx");
    press_code(&mut screen, KeyCode::Backspace);
    assert!(text(&mut screen, 80, 24).contains("search: aN_"));
    // Letters are not commands while one searches.
    press(&mut screen, "q");
    press_code(&mut screen, KeyCode::Backspace);
    press_code(&mut screen, KeyCode::Enter);
    assert_eq!(found(&screen), ["0x1001"]);
    press(&mut screen, "/LAB");
    assert_eq!(found(&screen).len(), 2);
    press_code(&mut screen, KeyCode::Esc);
    press(&mut screen, "/1002");
    assert_eq!(found(&screen), ["0x1002"]);
}

#[test]
fn a_paused_screen_stays_as_it_is() {
    let mut screen = map_alone(vec![tag("0x1001", None, [2.0, 2.0], 0)]);
    press(&mut screen, " ");
    let before = text(&mut screen, 60, 32);
    assert!(before.contains("PAUSED"), "{before}");
    screen.take(snapshot(vec![tag("0x1001", None, [8.0, 8.0], 1)]));
    assert_eq!(text(&mut screen, 60, 32), before);
    press(&mut screen, " ");
    screen.take(snapshot(vec![tag("0x1001", None, [8.0, 8.0], 1)]));
    assert_ne!(text(&mut screen, 60, 32), before);
}

#[test]
fn sites_are_shown_one_after_the_other() {
    let mut screen = screen(vec![tag("0x1001", None, [2.0, 2.0], 0)]);
    let mut other = tag("0x2002", None, [500.0, 2.0], 0);
    "attic".clone_into(&mut other.site);
    screen.snapshot.tags.push(other);
    let first = text(&mut screen, 60, 32);
    assert!(first.contains(" hall") && !first.contains("0x2002"), "{first}");
    press(&mut screen, "s");
    let second = text(&mut screen, 60, 32);
    assert!(second.contains(" attic") && second.contains("0x2002") && !second.contains("0x1001"), "{second}");
    press(&mut screen, "s");
    assert!(text(&mut screen, 60, 32).contains(" hall"));
}

#[test]
fn without_colours_nothing_is_coloured() {
    let mut screen = Screen::new(Vec::new(), false);
    let mut silent = tag("0x1003", None, [2.0, 2.0], 0);
    silent.silent = true;
    screen.take(snapshot(vec![tag("0x1001", Some("Ana"), [5.0, 5.0], 0), silent]));
    for list in ["", "\t"] {
        if !list.is_empty() {
            press_code(&mut screen, KeyCode::Tab);
        }
        let buffer = drawn(&mut screen, 120, 40);
        assert!(buffer.content.iter().all(|cell| cell.fg == Color::Reset && cell.bg == Color::Reset));
    }
}

#[test]
fn any_size_of_terminal_and_any_coordinates_can_be_drawn() {
    let far = tag("0x1002", Some("a name that is much longer than most terminals are wide 漢字"), [1e6, -1e6], 0);
    let mut screen = screen(vec![tag("0x1001", None, [0.0, 0.0], 0), far]);
    screen.snapshot.zones.push(Zone { corners_m: Vec::new(), ..room(1.0) });
    for (width, height) in [(1, 1), (19, 40), (20, 5), (40, 8), (89, 17), (90, 18), (300, 100)] {
        for _ in 0..3 {
            press_code(&mut screen, KeyCode::Tab);
            drawn(&mut screen, width, height);
        }
        press(&mut screen, "?");
        drawn(&mut screen, width, height);
        press(&mut screen, "+");
    }
    assert!(text(&mut screen, 19, 5).contains("enlarge"));
    press(&mut screen, "?");
    assert!(text(&mut screen, 80, 24).contains("zoom in and out"));
}

#[test]
fn narrow_lists_leave_out_what_matters_least() {
    let mut screen = screen(vec![tag("0x1001", Some("Ana"), [5.0, 5.0], 0)]);
    // 40 columns, less 2 for the mark: tag, x, y, deviation need 10 + 8 + 8 + 6 = 32; the room 11 more.
    let narrow = text(&mut screen, 40, 24);
    assert!(narrow.contains("± m") && !narrow.contains("Hz") && !narrow.contains("state"), "{narrow}");
    let wide = text(&mut screen, 80, 24);
    assert!(wide.contains("Hz") && wide.contains("state"), "{wide}");
}

#[test]
fn q_and_control_c_end_it() {
    let mut screen = screen(Vec::new());
    assert_eq!(screen.key(KeyEvent::new(KeyCode::Char('q'), KeyModifiers::NONE)), Then::Quit);
    press(&mut screen, "/");
    assert_eq!(screen.key(KeyEvent::new(KeyCode::Char('c'), KeyModifiers::CONTROL)), Then::Quit);
}
