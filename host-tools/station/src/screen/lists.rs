//! The lists of tags and of anchors.

use std::time::Duration;

use ratatui::Frame;
use ratatui::layout::{Constraint, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::widgets::{Block, Borders, Row, Table, TableState};
use station_core::Utc;
use station_core::model::{Doubt, NodeRole, NodeStatus, TagStatus};

use super::Screen;

/// The list beside the map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum List {
    /// Where each tag is.
    #[default]
    Tags,
    /// The health of anchors and beacons.
    Anchors,
    /// The map alone.
    Hidden,
}

impl List {
    pub(super) fn next(self) -> Self {
        match self {
            Self::Tags => Self::Anchors,
            Self::Anchors => Self::Hidden,
            Self::Hidden => Self::Tags,
        }
    }
}

/// A column of a list of `T`.
struct Column<T> {
    title: &'static str,
    width: u16,
    /// Columns with a greater number are left out first.
    order: u8,
    value: fn(&T, Utc) -> String,
}

/// The columns of tags.
const OF_TAGS: [Column<TagStatus>; 9] = [
    Column { title: "tag", width: 10, order: 0, value: |tag, _| label_of_tag(tag).to_owned() },
    Column { title: "    x m", width: 7, order: 1, value: |tag, _| number(position(tag, |p| Some(p.x_m)), 7, 2) },
    Column { title: "    y m", width: 7, order: 1, value: |tag, _| number(position(tag, |p| Some(p.y_m)), 7, 2) },
    Column { title: "   z m", width: 6, order: 5, value: |tag, _| number(position(tag, |p| p.z_m), 6, 2) },
    Column {
        title: "  ± m",
        width: 5,
        order: 2,
        value: |tag, _| number(position(tag, |p| Some(p.sigma_x_m.hypot(p.sigma_y_m))), 5, 2),
    },
    Column { title: "room", width: 10, order: 3, value: |tag, _| room(tag).to_owned() },
    Column { title: "  Hz", width: 4, order: 6, value: |tag, _| number(Some(tag.rate_hz), 4, 1) },
    Column { title: "   V", width: 4, order: 7, value: |tag, _| number(tag.supply_v, 4, 2) },
    Column { title: "state", width: 12, order: 4, value: state_of_tag },
];

/// The columns of anchors.
const OF_NODES: [Column<NodeStatus>; 9] = [
    Column { title: "anchor", width: 10, order: 0, value: |node, _| label_of_node(node).to_owned() },
    Column {
        title: "  ok",
        width: 4,
        order: 1,
        value: |node, _| node.health.success_rate.map_or_else(String::new, |rate| format!("{:3.0}%", 100.0 * rate)),
    },
    Column { title: "error m", width: 7, order: 2, value: |node, _| number(node.health.residual_mean_m, 7, 2) },
    Column { title: "  ± m", width: 5, order: 4, value: |node, _| number(node.health.residual_sigma_m, 5, 2) },
    Column {
        title: "FP-RX dB",
        width: 8,
        order: 5,
        value: |node, _| number(node.health.first_path_minus_received_db, 8, 1),
    },
    Column { title: "  ppm", width: 5, order: 8, value: |node, _| number(node.health.clock_offset_ppm, 5, 1) },
    Column { title: "   Hz", width: 5, order: 6, value: |node, _| number(Some(node.health.rate_hz), 5, 1) },
    Column { title: "   V", width: 4, order: 7, value: |node, _| number(node.health.supply_v, 4, 2) },
    Column { title: "state", width: 12, order: 3, value: state_of_node },
];

fn position(tag: &TagStatus, of: impl Fn(&station_core::model::TagPosition) -> Option<f64>) -> Option<f64> {
    tag.last_position.as_ref().and_then(of)
}

fn room(tag: &TagStatus) -> &str {
    tag.last_position.as_ref().and_then(|position| position.room.as_deref()).unwrap_or_default()
}

/// A number in this width; nothing where it is unknown.
fn number(value: Option<f64>, width: usize, decimals: usize) -> String {
    value.map_or_else(String::new, |value| format!("{value:width$.decimals$}"))
}

/// A duration in its greatest unit.
fn age(age: Duration) -> String {
    match age.as_secs() {
        s @ 0..120 => format!("{s} s"),
        s @ 120..7200 => format!("{} min", s / 60),
        s => format!("{} h", s / 3600),
    }
}

/// The name of a tag, or its address.
pub(super) fn label_of_tag(tag: &TagStatus) -> &str {
    tag.name.as_deref().unwrap_or(&tag.tag)
}

/// The name of an anchor, or its address.
pub(super) fn label_of_node(node: &NodeStatus) -> &str {
    node.name.as_deref().unwrap_or(&node.node)
}

fn state_of_tag(tag: &TagStatus, now: Utc) -> String {
    match &tag.reason {
        _ if tag.silent => format!("silent {}", age(now.since(tag.last_seen))),
        Some(reason) => reason.clone(),
        None => match tag.last_position.as_ref().and_then(|position| position.doubt) {
            Some(Doubt::Ambiguous { alternative_m: [x, y, _] }) => format!("or {x:.1}, {y:.1}"),
            Some(Doubt::Suspect) => "suspect".to_owned(),
            None => tag.zones.join(", "),
        },
    }
}

fn state_of_node(node: &NodeStatus, now: Utc) -> String {
    if node.health.moved {
        return "moved?".to_owned();
    }
    match (node.role, node.last_seen) {
        (_, None) => "never seen".to_owned(),
        (_, Some(seen)) if now.since(seen) > Duration::from_secs(30) => format!("seen {} ago", age(now.since(seen))),
        (NodeRole::Anchor | NodeRole::Tag, Some(_)) => String::new(),
        (NodeRole::Beacon, Some(_)) => "beacon".to_owned(),
        (NodeRole::Receiver, Some(_)) => "receiver".to_owned(),
    }
}

/// The columns that fit, and their widths. The last one takes what is left.
fn fitting<T>(columns: &[Column<T>], width: u16) -> Vec<(&Column<T>, u16)> {
    let mut order: Vec<_> = columns.iter().collect();
    order.sort_by_key(|column| column.order);
    let (mut left, mut most) = (width, None);
    for column in order {
        let needed = if most.is_none() { column.width } else { column.width + 1 };
        if needed > left && most.is_some() {
            break;
        }
        left = left.saturating_sub(needed);
        most = Some(column.order);
    }
    let is_in = |column: &&Column<T>| most.is_some_and(|most| column.order <= most);
    let mut fitting: Vec<_> = columns.iter().filter(is_in).map(|column| (column, column.width)).collect();
    if let Some((_, width)) = fitting.last_mut() {
        *width += left;
    }
    fitting
}

/// What is to be seen of a row.
struct Shown {
    key: String,
    fields: Vec<String>,
    style: Style,
}

impl Screen {
    /// The tags that the search finds.
    pub(super) fn found_tags(&self) -> impl Iterator<Item = &TagStatus> {
        let search = self.search.to_lowercase();
        self.tags().filter(move |tag| {
            [label_of_tag(tag), &tag.tag, room(tag)].iter().any(|text| text.to_lowercase().contains(&search))
        })
    }

    /// The anchors and beacons that the search finds.
    fn found_nodes(&self) -> impl Iterator<Item = &NodeStatus> {
        let search = self.search.to_lowercase();
        self.nodes().filter(move |node| {
            [label_of_node(node), &node.node].iter().any(|text| text.to_lowercase().contains(&search))
        })
    }

    /// The addresses in the list.
    fn listed(&self) -> Vec<String> {
        match self.list {
            List::Tags => self.found_tags().map(|tag| tag.tag.clone()).collect(),
            List::Anchors => self.found_nodes().map(|node| node.node.clone()).collect(),
            List::Hidden => Vec::new(),
        }
    }

    /// Selects the row that is this number of rows further down.
    pub(super) fn select(&mut self, rows: isize) {
        let listed = self.listed();
        let Some(last) = listed.len().checked_sub(1) else { return };
        let at = self.selected.as_ref().and_then(|selected| listed.iter().position(|key| key == selected));
        let next = at.map_or(0, |at| at.saturating_add_signed(rows).min(last));
        self.selected = listed.get(next).cloned();
    }

    pub(super) fn draw_list(&self, frame: &mut Frame, area: Rect) {
        let block = Block::new().borders(Borders::TOP);
        // Two columns are left to the mark of the selected row.
        let width = area.width.saturating_sub(2);
        let now = self.snapshot.now;
        let (title, header, rows): (_, Vec<(&str, u16)>, Vec<Shown>) = match self.list {
            List::Hidden => return,
            List::Tags => {
                let columns = fitting(&OF_TAGS, width);
                let row = |tag: &TagStatus| Shown {
                    key: tag.tag.clone(),
                    fields: columns.iter().map(|(column, _)| (column.value)(tag, now)).collect(),
                    style: if tag.silent { self.style(Color::Red) } else { Style::new() },
                };
                let rows = self.found_tags().map(row).collect();
                (" Tags ", columns.iter().map(|(column, width)| (column.title, *width)).collect(), rows)
            }
            List::Anchors => {
                let columns = fitting(&OF_NODES, width);
                let row = |node: &NodeStatus| Shown {
                    key: node.node.clone(),
                    fields: columns.iter().map(|(column, _)| (column.value)(node, now)).collect(),
                    style: if node.health.moved { self.style(Color::Red) } else { Style::new() },
                };
                let rows = self.found_nodes().map(row).collect();
                (" Anchors ", columns.iter().map(|(column, width)| (column.title, *width)).collect(), rows)
            }
        };
        let selected = rows.iter().position(|row| self.selected.as_ref() == Some(&row.key));
        let widths: Vec<_> = header.iter().map(|(_, width)| Constraint::Length(*width)).collect();
        let titles = Row::new(header.iter().map(|(title, _)| *title)).style(Style::new().add_modifier(Modifier::BOLD));
        let rows = rows.into_iter().map(|row| Row::new(row.fields).style(row.style));
        let table = Table::new(rows, widths)
            .header(titles)
            .block(block.title(title))
            .highlight_symbol("> ")
            .highlight_spacing(ratatui::widgets::HighlightSpacing::Always)
            .row_highlight_style(Style::new().add_modifier(Modifier::REVERSED));
        frame.render_stateful_widget(table, area, &mut TableState::new().with_selected(selected));
    }
}
