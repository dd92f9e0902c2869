//! Whether the log can be read with the ELF file: what the node says of its build in, what becomes of the lines that waited for it out.

use std::time::Duration;

use super::{Said, Session};
use crate::node::monitor::image::Build;
use crate::node::monitor::source::Channel;

/// Whether the ELF file is the node's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Trust {
    /// Not known yet: the log is kept since then, if any came. `flash`: what was seen in the chip.
    Open { since: Option<Duration>, flash: Option<bool> },
    /// It is.
    Same,
    /// It is another's.
    Other,
}

/// At the start.
pub(super) const OPEN: Trust = Trust::Open { since: None, flash: None };

impl Session {
    /// The node says which build it runs.
    pub(super) fn compare(&mut self, now: Duration, node: Build) {
        let Some(image) = &self.image else { return };
        let Some(build) = image.build else { return };
        if node == build {
            return self.trust_it(now);
        }
        // Whoever flashes while we listen has built before.
        if self.told != Some(node)
            && let Some(Ok(newer)) = (self.reload)(image)
            && newer.build == Some(node)
        {
            self.notes.push_back(format!("{} has been built anew, and is the node's again", newer.file.display()));
            self.image = Some(newer);
            return self.trust_it(now);
        }
        if self.told != Some(node) {
            self.told = Some(node);
            self.notes.push_back(format!(
                "the node runs build {node}, the ELF file {} is {build}: flash it, or give the ELF that was flashed",
                image.file.display()
            ));
        }
        self.distrust(now);
    }

    pub(super) fn trust_it(&mut self, now: Duration) {
        self.told = None;
        if self.trust == Trust::Same {
            return;
        }
        self.trust = Trust::Same;
        self.kept_bytes = 0;
        for (came, frame) in std::mem::take(&mut self.kept) {
            self.log_frame(came.min(now), frame);
        }
    }

    pub(super) fn distrust(&mut self, now: Duration) {
        if self.trust == Trust::Other {
            return;
        }
        self.trust = Trust::Other;
        self.kept_bytes = 0;
        self.counts.log_unreadable += std::mem::take(&mut self.kept).len() as u64;
        self.merger.push(Channel::Log, None, false, now, Said::Unreadable);
    }

    /// No word of the node says which build it runs: what was seen of its flash decides, else the user is believed.
    pub(super) fn settle(&mut self, now: Duration) {
        match self.trust {
            Trust::Open { flash: Some(false), .. } => {
                if let Some(image) = &self.image {
                    let build = image.build.map_or_else(String::new, |build| format!(" (build {build})"));
                    self.notes.push_back(format!(
                        "the chip's flash does not hold the ELF file {}{build}: flash it, or give the ELF that was flashed",
                        image.file.display()
                    ));
                }
                self.distrust(now);
            }
            Trust::Open { .. } => self.trust_it(now),
            Trust::Same | Trust::Other => {}
        }
    }

    /// Another image may run from here on.
    pub(super) fn doubt(&mut self) {
        if self.image.as_ref().is_some_and(|image| image.build.is_some()) && self.kept.is_empty() {
            self.trust = OPEN;
        }
    }
}
