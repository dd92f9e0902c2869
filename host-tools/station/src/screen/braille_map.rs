//! The map: walls, rooms and zones, anchors, tags with trails and ellipses, in dots of Braille characters. Names are
//! written where they cover no other name.

use ratatui::Frame;
use ratatui::buffer::Buffer;
use ratatui::layout::{Position, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::widgets::canvas::{Canvas, Line, Points};
use station_core::model::{NodeRole, TagPosition, TagStatus, ZoneKind};

use super::lists::{label_of_node, label_of_tag};
use super::view::{DOTS, Part};
use super::{List, Screen};
use pictures::{Dot, SIGMAS, ellipse};

/// The colours of tags, which can be read on dark and light.
const COLOURS: [Color; 4] = [Color::Cyan, Color::Yellow, Color::Magenta, Color::Green];
/// The colour of walls.
const WALLS: Color = Color::Gray;
/// The colour of rooms and zones.
const ZONES: Color = Color::Blue;

/// A text on the map, at a dot.
struct Mark {
    at_m: [f64; 2],
    symbol: &'static str,
    name: String,
    style: Style,
}

impl Screen {
    pub(super) fn draw_map(&mut self, frame: &mut Frame, area: Rect) {
        if area.is_empty() {
            return;
        }
        let points: Vec<_> = self.points().collect();
        points.into_iter().for_each(|point| self.view.include(point));
        let dots = [f64::from(area.width) * f64::from(DOTS[0]), f64::from(area.height) * f64::from(DOTS[1])];
        let followed = self.selected_tag().filter(|_| self.follows).and_then(place);
        let part = self.view.part(dots, followed);
        let [x_bounds, y_bounds] = part.bounds(dots);
        let lines = self.lines();
        let trails = self.trail_points();
        let canvas = Canvas::default().marker(Marker::Braille).x_bounds(x_bounds).y_bounds(y_bounds).paint(|canvas| {
            for (ends, colour) in &lines {
                let [[x1, y1], [x2, y2]] = *ends;
                canvas.draw(&Line { x1, y1, x2, y2, color: *colour });
            }
            for (coords, color) in &trails {
                let coords: Vec<_> = coords.iter().map(|[x, y]| (*x, *y)).collect();
                canvas.draw(&Points { coords: &coords, color: *color });
            }
        });
        frame.render_widget(canvas, area);
        write(&self.marks(), part, dots, area, frame.buffer_mut());
        let scale = scale(part, area.width / 3);
        frame.buffer_mut().set_stringn(area.x, area.bottom() - 1, &scale, area.width.into(), Style::new());
    }

    /// What the map should show at first.
    fn points(&self) -> impl Iterator<Item = [f64; 2]> {
        let walls = self.sites.iter().filter(|site| self.is_here(&site.name)).flat_map(|site| &site.walls_m).flatten();
        let zones = self.snapshot.zones.iter().filter(|zone| self.is_here(&zone.site)).flat_map(|zone| &zone.corners_m);
        let nodes = self.nodes().filter_map(|node| node.position_m.map(|[x, y, _]| [x, y]));
        walls.chain(zones).copied().chain(nodes).chain(self.tags().filter_map(place))
    }

    /// The tag that is selected in the list.
    fn selected_tag(&self) -> Option<&TagStatus> {
        let selected = self.selected.as_ref().filter(|_| self.list == List::Tags)?;
        self.tags().find(|tag| tag.tag == *selected)
    }

    /// Walls, outlines and ellipses: the ends of lines, and their colours.
    fn lines(&self) -> Vec<([[f64; 2]; 2], Color)> {
        let mut lines = Vec::new();
        let zones = self.snapshot.zones.iter().filter(|zone| self.is_here(&zone.site));
        for zone in zones {
            lines.extend(closed(&zone.corners_m).map(|ends| (ends, self.colour(ZONES))));
        }
        for site in self.sites.iter().filter(|site| self.is_here(&site.name)) {
            lines.extend(site.walls_m.iter().map(|ends| (*ends, self.colour(WALLS))));
        }
        for tag in self.tags().filter(|tag| !tag.silent) {
            let Some(position) = &tag.last_position else { continue };
            let outline = ellipse(&dot(position), SIGMAS).unwrap_or_default();
            lines.extend(closed(&outline).map(|ends| (ends, self.colour(colour_of(&tag.tag)))));
        }
        lines
    }

    /// The trails of the tags, and their colours.
    fn trail_points(&self) -> Vec<(Vec<[f64; 2]>, Color)> {
        let of = |tag: &TagStatus| {
            let trail = self.trails.get(&(tag.site.clone(), tag.tag.clone()))?;
            Some((trail.iter().map(|(_, at_m)| *at_m).collect(), self.colour(colour_of(&tag.tag))))
        };
        self.tags().filter_map(of).collect()
    }

    /// What is written on the map. The first ones have their names for sure.
    fn marks(&self) -> Vec<Mark> {
        let selected = self.selected_tag().map(|tag| tag.tag.as_str());
        let mut marks = Vec::new();
        let found: Vec<_> = self.found_tags().map(|tag| tag.tag.as_str()).collect();
        for tag in self.tags() {
            let Some(at_m) = place(tag) else { continue };
            let is_selected = selected == Some(&tag.tag);
            let mut style = self.style(colour_of(&tag.tag)).add_modifier(Modifier::BOLD);
            if is_selected {
                style = style.add_modifier(Modifier::REVERSED);
            }
            if tag.silent {
                style = self.style(Color::Red).add_modifier(Modifier::DIM);
            }
            // The search is about tags where they are the list.
            let is_named = self.list != List::Tags || found.binary_search(&tag.tag.as_str()).is_ok();
            let name = if is_named { label_of_tag(tag).to_owned() } else { String::new() };
            let mark = Mark { at_m, symbol: if tag.silent { "○" } else { "●" }, name, style };
            if is_selected { marks.insert(0, mark) } else { marks.push(mark) }
        }
        for node in self.nodes() {
            let Some([x, y, _]) = node.position_m else { continue };
            let symbol = match node.role {
                NodeRole::Anchor | NodeRole::Tag => "▲",
                NodeRole::Beacon => "◆",
                NodeRole::Receiver => "■",
            };
            let colour = if node.health.moved { Color::Red } else { Color::Green };
            let (name, style) = (label_of_node(node).to_owned(), self.style(colour));
            marks.push(Mark { at_m: [x, y], symbol, name, style });
        }
        for zone in self.snapshot.zones.iter().filter(|zone| self.is_here(&zone.site)) {
            let Some(at_m) = upper_left(&zone.corners_m) else { continue };
            let style = match zone.kind {
                ZoneKind::Room => self.style(ZONES).add_modifier(Modifier::BOLD),
                ZoneKind::Zone => self.style(ZONES),
            };
            marks.push(Mark { at_m, symbol: "", name: zone.name.clone(), style });
        }
        marks
    }

    fn colour(&self, colour: Color) -> Color {
        if self.has_colours { colour } else { Color::Reset }
    }
}

/// Where a tag was last.
fn place(tag: &TagStatus) -> Option<[f64; 2]> {
    tag.last_position.as_ref().map(|position| [position.x_m, position.y_m])
}

fn dot(position: &TagPosition) -> Dot {
    let TagPosition { x_m, y_m, sigma_x_m, sigma_y_m, cov_xy_m2, .. } = *position;
    let covariance_m2 = Some([sigma_x_m * sigma_x_m, cov_xy_m2, sigma_y_m * sigma_y_m]);
    Dot { at_m: [x_m, y_m], covariance_m2, ..Dot::default() }
}

/// The sides of an outline.
fn closed(corners_m: &[[f64; 2]]) -> impl Iterator<Item = [[f64; 2]; 2]> {
    let next = corners_m.iter().cycle().skip(1);
    corners_m.iter().zip(next).map(|(from, to)| [*from, *to])
}

/// The upper left corner of what encloses an outline.
fn upper_left(corners_m: &[[f64; 2]]) -> Option<[f64; 2]> {
    corners_m.iter().copied().reduce(|[x, y], [other_x, other_y]| [x.min(other_x), y.max(other_y)])
}

/// The colour of a tag: always the same one.
fn colour_of(tag: &str) -> Color {
    let sum = tag.bytes().fold(0_usize, |sum, byte| sum.wrapping_mul(31).wrapping_add(byte.into()));
    COLOURS[sum % COLOURS.len()]
}

/// Writes marks and names. A mark is always there, a name where there is room for it.
fn write(marks: &[Mark], part: Part, dots: [f64; 2], area: Rect, buffer: &mut Buffer) {
    let mut taken = vec![false; usize::from(area.width) * usize::from(area.height)];
    let index = |x: u16, y: u16| usize::from(y) * usize::from(area.width) + usize::from(x);
    let cells: Vec<_> = marks.iter().map(|mark| cell(part.dot(mark.at_m, dots), area)).collect();
    for (mark, at) in marks.iter().zip(&cells) {
        if let (Some((x, y)), false) = (at, mark.symbol.is_empty()) {
            taken[index(*x, *y)] = true;
        }
    }
    for (mark, at) in marks.iter().zip(&cells) {
        let Some((x, y)) = *at else { continue };
        // A name begins beside its mark, or, of a room, below the corner.
        let (name_x, name_y) = if mark.symbol.is_empty() { (x + 1, y + 1) } else { (x + 1, y) };
        let width = u16::try_from(ratatui::text::Span::raw(&mark.name).width()).unwrap_or(u16::MAX);
        let fits = width > 0
            && name_y < area.height
            && name_x.checked_add(width).is_some_and(|end| end <= area.width)
            && (name_x..name_x + width).all(|x| !taken[index(x, name_y)]);
        if fits {
            (name_x..name_x + width).for_each(|x| taken[index(x, name_y)] = true);
            buffer.set_stringn(area.x + name_x, area.y + name_y, &mark.name, width.into(), mark.style);
        }
    }
    // The first mark is the selected one: it covers others.
    for (mark, at) in marks.iter().zip(&cells).rev() {
        if let (Some((x, y)), false) = (*at, mark.symbol.is_empty()) {
            let position = Position { x: area.x + x, y: area.y + y };
            if let Some(cell) = buffer.cell_mut(position) {
                cell.set_symbol(mark.symbol).set_style(mark.style);
            }
        }
    }
}

/// The character in which a dot is; none outside.
fn cell([x, y]: [f64; 2], area: Rect) -> Option<(u16, u16)> {
    let at = |dot: f64, dots: u16, size: u16| {
        let cell = (dot.round() / f64::from(dots)).floor();
        (cell >= 0.0 && cell < f64::from(size)).then_some(cell as u16)
    };
    Some((at(x, DOTS[0], area.width)?, at(y, DOTS[1], area.height)?))
}

/// A line of a round length of at most this number of characters, with the length.
fn scale(part: Part, most: u16) -> String {
    let character_m = part.metres_per_dot * f64::from(DOTS[0]);
    let longest_m = f64::from(most.max(1)) * character_m;
    let power_m = 10_f64.powf(longest_m.log10().floor());
    let length_m = [5.0, 2.0, 1.0].map(|factor| factor * power_m).into_iter().find(|m| *m <= longest_m);
    let length_m = length_m.unwrap_or(power_m);
    let characters = (length_m / character_m).round().max(1.0) as usize;
    let unit = if length_m >= 1.0 { format!("{length_m} m") } else { format!("{} cm", (100.0 * length_m).round()) };
    format!("{}{unit}", "─".repeat(characters.min(most.max(1).into())))
}
