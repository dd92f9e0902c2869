//! What waits for the broker.
//!
//! Of each retained topic only the latest document waits, so a broker that is away costs no memory that grows. Events
//! wait in a queue, which is bounded: the oldest ones are dropped. Messages that are on their way are known until the
//! broker has them; after a lost connection, these events and all retained documents are sent again.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

/// Events that wait at most.
const EVENTS: usize = 10_000;

/// A message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Message {
    pub(super) topic: Arc<str>,
    /// Empty: the broker forgets the topic.
    pub(super) payload: Arc<str>,
    /// The broker keeps it; otherwise it is an event.
    pub(super) is_retained: bool,
}

#[derive(Debug)]
struct Retained {
    payload: Arc<str>,
    /// It is in the queue.
    is_waiting: bool,
}

#[derive(Debug, Default)]
struct Content {
    retained: HashMap<Arc<str>, Retained>,
    /// Retained topics to send.
    waiting: VecDeque<Arc<str>>,
    events: VecDeque<Message>,
    /// On their way.
    sending: Vec<Message>,
    dropped: u64,
}

impl Content {
    fn not_sent(&mut self) {
        let Self { retained, waiting, events, sending, .. } = self;
        for message in sending.drain(..).rev() {
            if !message.is_retained {
                events.push_front(message);
            } else if let Some(known) = retained.get_mut(&message.topic)
                && !std::mem::replace(&mut known.is_waiting, true)
            {
                waiting.push_front(message.topic);
            }
        }
    }
}

/// What waits for the broker.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    content: Mutex<Content>,
    filled: Notify,
}

impl Outbox {
    fn content(&self) -> MutexGuard<'_, Content> {
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets a retained document. Nothing is sent where the broker has it already.
    pub(super) fn retain(&self, topic: String, payload: String) {
        let mut content = self.content();
        let Content { retained, waiting, .. } = &mut *content;
        match retained.get_mut(topic.as_str()) {
            Some(known) if *known.payload == *payload => return,
            Some(known) => {
                known.payload = payload.into();
                if std::mem::replace(&mut known.is_waiting, true) {
                    return;
                }
                waiting.push_back(topic.into());
            }
            None => {
                let topic: Arc<str> = topic.into();
                retained.insert(topic.clone(), Retained { payload: payload.into(), is_waiting: true });
                waiting.push_back(topic);
            }
        }
        drop(content);
        self.filled.notify_one();
    }

    /// Makes the broker forget a document.
    pub(super) fn clear(&self, topic: String) {
        self.retain(topic, String::new());
    }

    /// Whether there is a document of this topic.
    pub(super) fn has(&self, topic: &str) -> bool {
        self.content().retained.get(topic).is_some_and(|retained| !retained.payload.is_empty())
    }

    /// Adds an event.
    pub(super) fn push(&self, topic: String, payload: String) {
        let mut content = self.content();
        if content.events.len() >= EVENTS {
            content.events.pop_front();
            if content.dropped == 0 {
                log::warn!("mqtt: more than {EVENTS} events wait for the broker; the oldest ones are dropped");
            }
            content.dropped += 1;
        }
        content.events.push_back(Message { topic: topic.into(), payload: payload.into(), is_retained: false });
        drop(content);
        self.filled.notify_one();
    }

    /// Takes messages to send, at most `most`; waits for the first one. They are on their way until [`Outbox::sent`].
    pub(super) async fn next(&self, most: usize) -> Vec<Message> {
        loop {
            let filled = self.filled.notified();
            {
                let mut content = self.content();
                let Content { retained, waiting, events, sending, .. } = &mut *content;
                sending.extend(events.drain(..events.len().min(most)));
                while sending.len() < most {
                    let Some(topic) = waiting.pop_front() else { break };
                    if let Some(known) = retained.get_mut(&topic) {
                        known.is_waiting = false;
                        let payload = known.payload.clone();
                        sending.push(Message { topic, payload, is_retained: true });
                    }
                }
                if !sending.is_empty() {
                    return sending.clone();
                }
            }
            filled.await;
        }
    }

    /// Whether nothing waits.
    pub(super) fn is_empty(&self) -> bool {
        let content = self.content();
        content.waiting.is_empty() && content.events.is_empty()
    }

    /// The broker has what was on its way.
    pub(super) fn sent(&self) {
        let mut content = self.content();
        let Content { retained, sending, .. } = &mut *content;
        for message in sending.drain(..).filter(|message| message.is_retained && message.payload.is_empty()) {
            if retained.get(&message.topic).is_some_and(|known| known.payload.is_empty()) {
                retained.remove(&message.topic);
            }
        }
    }

    /// What was on its way is sent again.
    pub(super) fn not_sent(&self) {
        self.content().not_sent();
        self.filled.notify_one();
    }

    /// For a new connection: what was on its way is sent again, and so is each retained document. Returns how many
    /// events were dropped since the last call.
    pub(super) fn again(&self) -> u64 {
        let mut content = self.content();
        content.not_sent();
        let Content { retained, waiting, dropped, .. } = &mut *content;
        for (topic, known) in retained {
            if !std::mem::replace(&mut known.is_waiting, true) {
                waiting.push_back(topic.clone());
            }
        }
        let dropped = std::mem::take(dropped);
        drop(content);
        self.filled.notify_one();
        dropped
    }

    /// Sends the retained documents below a prefix again.
    pub(super) fn again_below(&self, prefix: &str) {
        let mut content = self.content();
        let Content { retained, waiting, .. } = &mut *content;
        for (topic, known) in retained {
            let is_below = topic.strip_prefix(prefix).is_some_and(|rest| rest.starts_with('/'));
            if is_below && !std::mem::replace(&mut known.is_waiting, true) {
                waiting.push_back(topic.clone());
            }
        }
        drop(content);
        self.filled.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(messages: &[Message]) -> Vec<(String, String)> {
        messages.iter().map(|message| (message.topic.to_string(), message.payload.to_string())).collect()
    }

    fn pair(topic: &str, payload: &str) -> (String, String) {
        (topic.to_owned(), payload.to_owned())
    }

    #[tokio::test]
    async fn of_a_retained_topic_the_latest_document_is_sent_once() {
        let outbox = Outbox::default();
        for payload in ["1", "2", "3"] {
            outbox.retain("a".to_owned(), payload.to_owned());
        }
        assert_eq!(text(&outbox.next(10).await), [pair("a", "3")]);
        outbox.sent();
        // The broker has it.
        outbox.retain("a".to_owned(), "3".to_owned());
        assert!(outbox.is_empty());
    }

    #[tokio::test]
    async fn after_a_lost_connection_events_keep_their_order_and_all_documents_are_sent_again() {
        let outbox = Outbox::default();
        outbox.retain("a".to_owned(), "1".to_owned());
        outbox.next(10).await;
        outbox.sent();
        for event in ["x", "y", "z"] {
            outbox.push("events".to_owned(), event.to_owned());
        }
        assert_eq!(outbox.next(2).await.len(), 2);
        assert_eq!(outbox.again(), 0);
        let again = [pair("events", "x"), pair("events", "y"), pair("events", "z"), pair("a", "1")];
        assert_eq!(text(&outbox.next(10).await), again);
    }

    #[tokio::test]
    async fn a_cleared_topic_is_sent_empty_and_then_forgotten() {
        let outbox = Outbox::default();
        outbox.retain("a".to_owned(), "1".to_owned());
        outbox.next(10).await;
        outbox.sent();
        outbox.clear("a".to_owned());
        assert_eq!(text(&outbox.next(10).await), [pair("a", "")]);
        outbox.sent();
        outbox.again();
        assert!(outbox.is_empty() && !outbox.has("a"));
    }

    #[tokio::test]
    async fn events_that_wait_are_bounded_and_the_oldest_are_dropped() {
        let outbox = Outbox::default();
        for event in 0..EVENTS + 3 {
            outbox.push("events".to_owned(), event.to_string());
        }
        assert_eq!(text(&outbox.next(1).await), [pair("events", "3")]);
        assert_eq!(outbox.again(), 3);
    }
}
