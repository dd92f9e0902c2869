//! What keys do.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

use super::Screen;
use super::lists::List;

/// The list of keys.
pub const HELP: &str = "\
arrows        move the map
PgUp PgDn     move it by a page
+ -           zoom in and out
0             show all of the site
Tab           tags, anchors, map alone
j k           select the next, the one before
Enter         follow the selected tag, or not
/             search; Esc ends the search
s             next site
space         pause, go on
q             quit";

/// What the program does after a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Then {
    /// It draws and goes on.
    GoOn,
    /// It ends.
    Quit,
}

/// The share of the map by which an arrow moves it.
const ARROW: f64 = 0.1;
/// The share by which a page moves it.
const PAGE: f64 = 0.8;
/// The most characters of a search.
const LONGEST_SEARCH: usize = 64;

impl Screen {
    /// A key.
    pub fn key(&mut self, key: KeyEvent) -> Then {
        if key.kind == KeyEventKind::Release {
            return Then::GoOn;
        }
        let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
        // In raw mode the terminal makes no signal of it.
        if is_control && matches!(key.code, KeyCode::Char('c' | 'C')) {
            return Then::Quit;
        }
        if self.is_searching {
            self.search_key(key.code, is_control);
            return Then::GoOn;
        }
        // Whatever key closes the help.
        if std::mem::take(&mut self.shows_help) {
            return if key.code == KeyCode::Char('q') { Then::Quit } else { Then::GoOn };
        }
        match key.code {
            KeyCode::Char('q') => return Then::Quit,
            KeyCode::Char('?') => self.shows_help = true,
            KeyCode::Left => self.pan(-ARROW, 0.0),
            KeyCode::Right => self.pan(ARROW, 0.0),
            KeyCode::Up => self.pan(0.0, ARROW),
            KeyCode::Down => self.pan(0.0, -ARROW),
            KeyCode::PageUp => self.pan(0.0, PAGE),
            KeyCode::PageDown => self.pan(0.0, -PAGE),
            KeyCode::Char('+' | '=') => self.view.zoom(1),
            KeyCode::Char('-' | '_') => self.view.zoom(-1),
            KeyCode::Char('0') | KeyCode::Home => {
                self.view.reset();
                self.follows = false;
            }
            KeyCode::Tab => self.show_list(self.list.next()),
            KeyCode::BackTab => self.show_list(self.list.next().next()),
            KeyCode::Char('j') => self.select(1),
            KeyCode::Char('k') => self.select(-1),
            KeyCode::Enter => self.follows = !self.follows && self.list == List::Tags && self.selected.is_some(),
            KeyCode::Char('/') => {
                self.is_searching = true;
                self.search.clear();
            }
            KeyCode::Esc => self.search.clear(),
            KeyCode::Char('s') => self.next_site(),
            KeyCode::Char(' ') => self.is_paused = !self.is_paused,
            _ => {}
        }
        Then::GoOn
    }

    fn search_key(&mut self, code: KeyCode, is_control: bool) {
        match code {
            KeyCode::Enter => self.is_searching = false,
            KeyCode::Esc => {
                self.is_searching = false;
                self.search.clear();
            }
            KeyCode::Backspace => {
                self.search.pop();
            }
            KeyCode::Char(character) if !is_control && self.search.chars().count() < LONGEST_SEARCH => {
                self.search.push(character);
            }
            _ => {}
        }
    }

    /// A person who moves the map does not want it to move with a tag.
    fn pan(&mut self, right: f64, up: f64) {
        self.follows = false;
        self.view.pan(right, up);
    }

    fn show_list(&mut self, list: List) {
        (self.list, self.selected, self.follows) = (list, None, false);
    }

    fn next_site(&mut self) {
        let names = self.site_names();
        let at = names.iter().position(|name| self.is_here(name)).map_or(0, |at| at + 1);
        let next = names.get(at).or(names.first()).map(|name| (*name).to_owned());
        if next.is_some() && next != self.site {
            (self.site, self.selected, self.follows) = (next, None, false);
            self.view.reset();
        }
    }
}
