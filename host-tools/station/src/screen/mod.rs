//! The live map in a terminal.
//!
//! [`Screen`] holds what a person sees: the last [`Snapshot`] of the station, the trails of tags, the part of the map,
//! the list and the search. Keys go in by [`Screen::key`]; [`Screen::draw`] draws a frame. It has no clock and no
//! terminal, so tests draw into memory. [`Raw`] is the terminal: it is as it was before when `Raw` is dropped.

mod braille_map;
mod keys;
mod lists;
mod raw;
#[cfg(test)]
mod tests;
mod view;

use std::collections::{HashMap, VecDeque};
use std::time::Duration;

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Clear, Paragraph};
use station_core::model::{NodeStatus, SiteMap, TagStatus, Zone};
use station_core::{LiveState, Utc};

pub use self::keys::Then;
use self::lists::List;
pub use self::raw::{Raw, on_hangup};
use self::view::MapView;

/// How long a trail is.
const TRAIL: Duration = Duration::from_secs(20);
/// The most positions of a trail.
const MOST_OF_TRAIL: usize = 120;
/// From this width, the list is beside the map; otherwise below it.
const WIDE: u16 = 90;
/// Below this height, list and map do not fit together.
const HIGH: u16 = 16;
/// The least terminal in which anything can be read.
const LEAST: (u16, u16) = (20, 5);

/// What the station knows at an instant.
#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    /// When.
    pub now: Utc,
    /// The tags of all sites.
    pub tags: Vec<TagStatus>,
    /// The anchors and beacons of all sites.
    pub nodes: Vec<NodeStatus>,
    /// The rooms and zones of all sites.
    pub zones: Vec<Zone>,
}

impl Snapshot {
    /// The current state.
    pub fn of(live: &LiveState, now: Utc) -> Self {
        Self { now, tags: live.tags(), nodes: live.nodes(), zones: live.zones() }
    }
}

/// A tag's key: its site and address.
type Key = (String, String);

/// What a person sees.
#[derive(Debug)]
pub struct Screen {
    has_colours: bool,
    /// With their walls.
    sites: Vec<SiteMap>,
    /// The name of the site that is shown; none before anything is known.
    site: Option<String>,
    snapshot: Snapshot,
    trails: HashMap<Key, VecDeque<(Utc, [f64; 2])>>,
    is_paused: bool,
    view: MapView,
    list: List,
    /// The address of a tag or an anchor in the list.
    selected: Option<String>,
    /// The map moves with the selected tag.
    follows: bool,
    search: String,
    /// The search is being written.
    is_searching: bool,
    shows_help: bool,
    note: String,
}

impl Screen {
    /// A screen without tags. `sites` has the walls. Without colours, text is bold, dim and reversed at most.
    pub fn new(sites: Vec<SiteMap>, has_colours: bool) -> Self {
        Self {
            has_colours,
            site: sites.first().map(|site| site.name.clone()),
            sites,
            snapshot: Snapshot::default(),
            trails: HashMap::new(),
            is_paused: false,
            view: MapView::default(),
            list: List::default(),
            selected: None,
            follows: false,
            search: String::new(),
            is_searching: false,
            shows_help: false,
            note: String::new(),
        }
    }

    /// Takes a new state. A paused screen stays as it is.
    pub fn take(&mut self, snapshot: Snapshot) {
        if self.is_paused {
            return;
        }
        let positions = snapshot.tags.iter().filter_map(|tag| tag.last_position.as_ref());
        for position in positions {
            let key = (position.site.clone(), position.tag.clone());
            let trail = self.trails.entry(key).or_default();
            if trail.back().is_none_or(|(last, _)| *last != position.t) {
                trail.push_back((position.t, [position.x_m, position.y_m]));
            }
            while trail.len() > MOST_OF_TRAIL || trail.front().is_some_and(|(t, _)| position.t.since(*t) > TRAIL) {
                trail.pop_front();
            }
        }
        self.snapshot = snapshot;
        if self.site.is_none() {
            self.site = self.site_names().first().map(|name| (*name).to_owned());
        }
    }

    /// Shows a message, which stays until the next one.
    pub fn note(&mut self, note: String) {
        self.note = note;
    }

    /// The names of all sites, sorted.
    fn site_names(&self) -> Vec<&str> {
        let Snapshot { tags, nodes, zones, .. } = &self.snapshot;
        let of_tags = tags.iter().map(|tag| tag.site.as_str());
        let of_nodes = nodes.iter().map(|node| node.site.as_str());
        let of_zones = zones.iter().map(|zone| zone.site.as_str());
        let of_sites = self.sites.iter().map(|site| site.name.as_str());
        let mut names: Vec<_> = of_tags.chain(of_nodes).chain(of_zones).chain(of_sites).collect();
        names.sort_unstable();
        names.dedup();
        names
    }

    /// Whether something belongs to the site that is shown.
    fn is_here(&self, site: &str) -> bool {
        self.site.as_deref() == Some(site)
    }

    /// The tags of the site.
    fn tags(&self) -> impl Iterator<Item = &TagStatus> {
        self.snapshot.tags.iter().filter(|tag| self.is_here(&tag.site))
    }

    /// The anchors and beacons of the site.
    fn nodes(&self) -> impl Iterator<Item = &NodeStatus> {
        self.snapshot.nodes.iter().filter(|node| self.is_here(&node.site))
    }

    /// A style with this colour, or without any.
    fn style(&self, colour: Color) -> Style {
        if self.has_colours { Style::new().fg(colour) } else { Style::new() }
    }

    /// Draws a frame.
    pub fn draw(&mut self, frame: &mut Frame) {
        let area = frame.area();
        if area.width < LEAST.0 || area.height < LEAST.1 {
            let text = format!("enlarge the terminal: at least {} x {}", LEAST.0, LEAST.1);
            return frame.render_widget(Paragraph::new(text).wrap(ratatui::widgets::Wrap { trim: true }), area);
        }
        let rows = Layout::vertical([Constraint::Length(1), Constraint::Fill(1), Constraint::Length(1)]);
        let [head, middle, foot] = rows.areas(area);
        frame.render_widget(self.head(), head);
        match (self.list, middle.width >= WIDE, middle.height >= HIGH) {
            (List::Hidden, _, _) => self.draw_map(frame, middle),
            (List::Tags | List::Anchors, true, _) => {
                let [map, list] =
                    Layout::horizontal([Constraint::Fill(1), Constraint::Max(76.min(middle.width / 2))]).areas(middle);
                self.draw_map(frame, map);
                self.draw_list(frame, list);
            }
            (List::Tags | List::Anchors, false, true) => {
                let [map, list] = Layout::vertical([Constraint::Fill(3), Constraint::Fill(2)]).areas(middle);
                self.draw_map(frame, map);
                self.draw_list(frame, list);
            }
            (List::Tags | List::Anchors, false, false) => self.draw_list(frame, middle),
        }
        frame.render_widget(self.foot(), foot);
        if self.shows_help {
            self.draw_help(frame, middle);
        }
    }

    fn head(&self) -> Line<'static> {
        let tags = self.tags().count();
        let silent = self.tags().filter(|tag| tag.silent).count();
        let moved = self.nodes().filter(|node| node.health.moved).count();
        let site = self.site.as_deref().unwrap_or("no site yet");
        // RFC 3339: the time of day.
        let time = self.snapshot.now.to_string();
        let time = time.get(11..19).unwrap_or_default();
        let bold = Style::new().add_modifier(Modifier::BOLD);
        let mut spans = vec![Span::styled(format!(" {site}"), bold), Span::raw(format!("  {tags} tags"))];
        if silent > 0 {
            spans.push(Span::styled(format!("  {silent} silent"), self.style(Color::Red)));
        }
        if moved > 0 {
            spans.push(Span::styled(format!("  {moved} moved"), self.style(Color::Red)));
        }
        spans.push(Span::raw(format!("  {time} UTC")));
        if self.is_paused {
            spans.push(Span::styled("  PAUSED", bold.add_modifier(Modifier::REVERSED)));
        }
        Line::from(spans)
    }

    fn foot(&self) -> Line<'static> {
        if self.is_searching {
            return Line::from(format!(" search: {}_", self.search));
        }
        let searched = if self.search.is_empty() { String::new() } else { format!(" [search: {}]", self.search) };
        let text = format!(" ? help  q quit{searched}  {}", self.note);
        Line::from(text).style(Style::new().add_modifier(Modifier::DIM))
    }

    fn draw_help(&self, frame: &mut Frame, within: Rect) {
        let (width, height) = (52.min(within.width), (keys::HELP.lines().count() + 2).min(within.height.into()));
        let height = u16::try_from(height).unwrap_or(within.height);
        let area = Rect {
            x: within.x + (within.width - width) / 2,
            y: within.y + (within.height - height) / 2,
            width,
            height,
        };
        frame.render_widget(Clear, area);
        frame.render_widget(Paragraph::new(keys::HELP).block(Block::bordered().title(" Keys ")), area);
    }
}
