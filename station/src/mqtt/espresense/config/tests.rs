//! The companion's file, with the forms of its example.

use super::*;

const FLAT: &str = r#"
mqtt:
  host:
  port: 1883
floors:
  - id: first
    name: First Floor
    bounds: [[0, 0, 0], [10, 8, 3]]
    rooms:
      - name: Kitchen
        points:
          - [0, 0]
          - [4, 0]
          - [4, 3]
          - [0, 3]
          - [0, 0]
  - id: second
    name: Second Floor
    bounds: [[-1, 0, 3], [10, 8, 5.5]]
    rooms:
      - name: Kitchen
        points: [[0, 0], [4, 0], [4, 3]]
nodes:
  - name: Upstairs Hallway
    point: [1, 2, 4]
    floors: ["second"]
  - name: Dining
    point: [6, 2, 1.3]
    floors: ["first", "second"]
  - name: VW EOS
    stationary: false
    point: [-2, 15, 0.5]
devices:
  - name: "Ana*"
  - id: "tile:*"
  - id: "iBeacon:e5ca1ade-f007-ba11-0000-000000000000-1-2"
    name: Keys
    rssi@1m: -63
exclude_devices:
  - id: "tile:bad*"
"#;

fn house(text: &str) -> House {
    House::read(text).expect("a house")
}

#[test]
fn floors_lie_side_by_side_and_rooms_keep_unique_names() {
    let house = house(FLAT);
    // The first floor ends at x = 10; 3 m on, at 13, begins the second one, whose left edge is -1 in the file.
    assert_eq!(house.floors, [("First Floor".to_owned(), 0.0), ("Second Floor".to_owned(), 14.0)]);
    let zones = house.zones("home");
    let names: Vec<_> = zones.iter().map(|zone| zone.name.as_str()).collect();
    assert_eq!(names, ["Kitchen", "Kitchen (Second Floor)"]);
    // The outline of the file is closed.
    assert_eq!(zones[0].corners_m, [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]]);
    assert_eq!(zones[1].corners_m, [[14.0, 0.0], [18.0, 0.0], [18.0, 3.0]]);
}

#[test]
fn receivers_are_on_their_floors_under_the_names_of_their_topics() {
    let house = house(FLAT);
    let nodes: Vec<_> = house
        .nodes("home", Utc::default())
        .into_iter()
        .map(|report| match report.what {
            ReportKind::Node { node, position_m: Some([x, y, z]), role: NodeRole::Receiver, .. } => (node, x, y, z),
            other => panic!("{other:?}"),
        })
        .collect();
    let hall = ("upstairs_hallway".to_owned(), 15.0, 2.0, 4.0);
    let dining = [("dining".to_owned(), 6.0, 2.0, 1.3), ("dining@2".to_owned(), 20.0, 2.0, 1.3)];
    // What is in a car is at no known place.
    assert_eq!(nodes, [dining[0].clone(), hall, dining[1].clone()]);
    assert_eq!(key("Upstairs Hallway"), key("upstairs_hallway"));
    // The companion makes another name of capitals than the receivers do.
    assert_eq!(key("VW EOS"), key("v_w_e_o_s"));
}

#[test]
fn devices_are_wanted_by_id_name_and_pattern() {
    let house = house(FLAT);
    let wanted = |id: &str, name: Option<&str>| {
        house.device(id, name).map(|wanted| (wanted.name.map(str::to_owned), wanted.rssi_1m_dbm))
    };
    let keys = "iBeacon:e5ca1ade-f007-ba11-0000-000000000000-1-2";
    assert_eq!(wanted(keys, None), Some((Some("Keys".to_owned()), Some(-63.0))));
    assert_eq!(wanted("tile:d1", None), Some((None, None)));
    assert_eq!(wanted("tile:bad1", None), None);
    assert_eq!(wanted("apple:1005:9-24", Some("Ana's watch")), Some((None, None)));
    assert_eq!(wanted("apple:1005:9-24", Some("Eva")), None);
    assert_eq!(wanted("node:dining", Some("Ana")), None);
    assert!(self::house("nodes: [{name: a, point: [0, 0, 0]}]").device("anything", None).is_some());
}

#[test]
fn a_star_stands_for_anything() {
    for (pattern, text, is_match) in [
        ("a*", "abc", true),
        ("*", "", true),
        ("a*c", "abc", true),
        ("a*c", "ac", true),
        ("a*b*c", "a1b2b3c", true),
        ("abc", "abcd", false),
        ("a*c", "abcd", false),
        // The middle and the end are not the same letters.
        ("a*bc*c", "abc", false),
        ("ñ*", "ñandú", true),
    ] {
        assert_eq!(matches(pattern, text), is_match, "{pattern} {text}");
    }
}

#[test]
fn files_that_make_no_house_are_refused_with_what_to_do() {
    let nodes = "nodes: [{name: a, point: [0, 0, 0]}]\n";
    for (text, expected) in [
        ("floors: []".to_owned(), "`point`"),
        ("nodes: [{name: a, point: [0, 0]}]".to_owned(), "[x, y, z]"),
        ("nodes: [{name: a, point: [0, 0, .nan]}]".to_owned(), "[x, y, z]"),
        ("nodes: [{name: a, point: [0, 0, 1e9]}]".to_owned(), "[x, y, z]"),
        ("nodes: [{name: a, point: [0, 0, 0]}, {name: A, point: [1, 0, 0]}]".to_owned(), "another node"),
        ("nodes: [{name: '!', point: [0, 0, 0]}]".to_owned(), "another node"),
        (format!("{nodes}floors: [{{name: f, rooms: [{{name: r, points: [[0, 0], [1, 1]]}}]}}]"), "three corners"),
        (format!("{nodes}floors: [{{name: f, rooms: [{{name: r, points: [[0], [1, 1]]}}]}}]"), "[x, y]"),
        (
            "nodes: [{name: a, point: [0, 0, 0], floors: [attic]}]\nfloors: [{id: first}]".to_owned(),
            "no floor of the file",
        ),
        (format!("nodes: [{{name: {}, point: [0, 0, 0]}}]", "a".repeat(65)), "64 bytes"),
    ] {
        let error = House::read(&text).expect_err(&text).to_string();
        assert!(error.contains(expected), "{text}: {error}");
    }
    for text in ["floors: [", "just a text", "nodes: 7", "a: &a [*a, *a]", "- 1\n- 2"] {
        let error = House::read(text).expect_err(text);
        assert_eq!(error.to_string().lines().count(), 1, "{error}");
    }
    let NoHouse::Yaml { line, .. } = House::read("mqtt:\n  host: x\nnodes: 7\n").expect_err("no list") else {
        panic!("it is YAML");
    };
    assert_eq!(line, Some(3));
}
