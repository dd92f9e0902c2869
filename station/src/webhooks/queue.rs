//! The events that wait for a hook: bounded, the oldest are lost first.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;
use tokio::time::Instant;

use super::WebhookCounts;
use crate::model::StationEvent;

/// A queue of events.
#[derive(Debug)]
pub(super) struct Queue {
    waiting: Mutex<Waiting>,
    most: usize,
    /// What the hook's task waits for.
    state: watch::Sender<State>,
}

#[derive(Debug, Default)]
struct Waiting {
    /// Each with the time since which it waits.
    events: VecDeque<(StationEvent, Instant)>,
    sent: u64,
    lost: u64,
    failures: u64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct State {
    is_empty: bool,
    is_ended: bool,
}

impl Queue {
    /// An empty queue for this number of events.
    pub fn new(most: usize) -> Self {
        let state = watch::Sender::new(State { is_empty: true, is_ended: false });
        Self { waiting: Mutex::default(), most, state }
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds an event; the oldest is lost where there are too many.
    pub fn push(&self, event: StationEvent) {
        let mut waiting = self.lock();
        waiting.events.push_back((event, Instant::now()));
        while waiting.events.len() > self.most {
            waiting.events.pop_front();
            waiting.lost += 1;
        }
        self.state.send_modify(|state| state.is_empty = waiting.events.is_empty());
    }

    /// No more events come.
    pub fn end(&self) {
        self.state.send_modify(|state| state.is_ended = true);
    }

    /// Whether no more events come.
    pub fn is_ended(&self) -> bool {
        self.state.borrow().is_ended
    }

    /// Waits until no more events come.
    pub async fn ended(&self) {
        // The sender is here: an error cannot come, and would mean the same.
        let _ = self.state.subscribe().wait_for(|state| state.is_ended).await;
    }

    /// Waits for the oldest event, and since when it waits. It stays until it is `done` or lost. None: there is none,
    /// and no more come.
    pub async fn first(&self) -> Option<(StationEvent, Instant)> {
        let mut state = self.state.subscribe();
        loop {
            if let Some(first) = self.lock().events.front() {
                return Some(first.clone());
            }
            let now = state.wait_for(|state| !state.is_empty || state.is_ended).await.map(|state| *state);
            if now.is_ok_and(|state| state.is_empty) {
                return None;
            }
        }
    }

    /// Counts this event as sent, and removes it, if it is still the oldest.
    pub fn done(&self, id: i64) {
        self.lock().sent += 1;
        self.remove(id);
    }

    /// Counts a try that failed.
    pub fn failed(&self) {
        self.lock().failures += 1;
    }

    /// Removes this event, and counts it as lost.
    pub fn lose(&self, id: i64) {
        if self.remove(id) {
            self.lock().lost += 1;
        }
    }

    fn remove(&self, id: i64) -> bool {
        let mut waiting = self.lock();
        let is_first = waiting.events.front().is_some_and(|(event, _)| event.id == id);
        if is_first {
            waiting.events.pop_front();
        }
        self.state.send_modify(|state| state.is_empty = waiting.events.is_empty());
        is_first
    }

    /// The number of events that wait.
    pub fn waiting(&self) -> usize {
        self.lock().events.len()
    }

    /// The number of events that were lost.
    pub fn lost(&self) -> u64 {
        self.lock().lost
    }

    /// What was done since the start.
    pub fn counts(&self) -> WebhookCounts {
        let waiting = self.lock();
        let Waiting { sent, lost, failures, .. } = *waiting;
        WebhookCounts { waiting: waiting.events.len(), sent, lost, failures }
    }
}
