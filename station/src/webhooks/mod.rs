//! Webhooks: events to other programs, as HTTP requests.
//!
//! Input: the hub's events ([`Hub::events`]). Each hook that wants an event puts it into a queue of its own, which is
//! bounded in number and age, and sends one after the other: `POST` with the event's JSON, as `/api/v1/events` has it.
//! An answer of 2xx ends an event; anything else is tried again, after pauses that grow. So a receiver gets each event
//! at least once and in their order, and never holds up the hub or another hook. What is not sent when the station ends
//! is lost; a receiver that needs all of them reads the rest from `/api/v1/events`.
//!
//! | module | what is in it |
//! |---|---|
//! | `queue` | the events that wait |
//! | `request` | an event to a request, signed as [Standard Webhooks](https://www.standardwebhooks.com) asks, and its answer |
//!
//! The address of a hook can be a secret, so that the log has its name only.

mod queue;
mod request;

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use serde::Deserialize;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

use self::queue::Queue;
use self::request::Requests;
pub use self::request::WebhookError;
use crate::model::{EventKind, StationEvent};
use crate::{Hub, Utc};

/// A hook, as a person describes it.
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WebhookSettings {
    /// Unique; what the log calls it.
    pub name: String,
    /// Where events go: `http://…` or `https://…`.
    pub url: String,
    /// Signs the requests: `whsec_` and Base64 of 24 to 64 bytes.
    pub secret: Option<String>,
    /// PEM with the authorities that an `https` server's certificate may be from, in place of those of the system.
    pub ca: Option<PathBuf>,
    /// The kinds of events; None: all.
    pub kinds: Option<Vec<EventKind>>,
    /// The sites; None: all.
    pub sites: Option<Vec<String>>,
    /// The rooms and zones; None: all, and events without any.
    pub zones: Option<Vec<String>>,
    /// Alarms only.
    #[serde(default)]
    pub alarms_only: bool,
}

impl fmt::Debug for WebhookSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("WebhookSettings").field("name", &self.name).finish_non_exhaustive()
    }
}

impl WebhookSettings {
    fn wants(&self, event: &StationEvent) -> bool {
        fn is_among<T: PartialEq>(some: Option<&Vec<T>>, one: &T) -> bool {
            some.is_none_or(|some| some.contains(one))
        }
        (event.alarm || !self.alarms_only)
            && is_among(self.kinds.as_ref(), &event.kind)
            && is_among(self.sites.as_ref(), &event.site)
            && self.zones.as_ref().is_none_or(|zones| event.zone.as_ref().is_some_and(|zone| zones.contains(zone)))
    }
}

/// How long, and how many.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patience {
    /// Events that wait for a hook. One more replaces the oldest.
    pub events: usize,
    /// An event that waits for longer is given up.
    pub oldest: Duration,
    /// A request has this time until its answer.
    pub request: Duration,
    /// The pause after the first failure, and the longest one. Each is up to a half shorter, by chance.
    pub pauses: [Duration; 2],
    /// When the station ends, what waits is sent for this time.
    pub end: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            events: 10_000,
            oldest: Duration::from_secs(24 * 3600),
            request: Duration::from_secs(10),
            pauses: [Duration::from_secs(1), Duration::from_secs(60)],
            end: Duration::from_secs(5),
        }
    }
}

/// A hook that is ready to send.
#[derive(Clone, Debug)]
pub struct Webhook {
    settings: WebhookSettings,
    requests: Requests,
}

impl Webhook {
    /// Checks the settings.
    ///
    /// # Errors
    /// Address, secret or certificates are wrong.
    pub fn new(settings: WebhookSettings) -> Result<Self, WebhookError> {
        let requests = Requests::new(&settings)?;
        Ok(Self { settings, requests })
    }
}

/// What a hook has done since its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WebhookCounts {
    /// Events that wait now.
    pub waiting: usize,
    /// Events that the receiver has taken.
    pub sent: u64,
    /// Events that were lost: too many waited, or for too long.
    pub lost: u64,
    /// Requests without success.
    pub failures: u64,
}

/// The counts of all hooks.
#[derive(Clone, Debug, Default)]
pub struct Watch(Vec<(String, Arc<Queue>)>);

impl Watch {
    /// Each hook's name, and what it has done.
    pub fn counts(&self) -> impl Iterator<Item = (&str, WebhookCounts)> {
        self.0.iter().map(|(name, queue)| (name.as_str(), queue.counts()))
    }
}

/// The hooks at work.
#[derive(Debug)]
pub struct Webhooks {
    running: JoinSet<()>,
    watch: Watch,
    end: Duration,
}

impl Webhooks {
    /// Sends the hub's events from now on, until the hub's end.
    pub fn start(hooks: Vec<Webhook>, patience: Patience, hub: &Hub) -> Self {
        let mut running = JoinSet::new();
        let mut wanted = Vec::new();
        let mut queues = Vec::new();
        for Webhook { settings, requests } in hooks {
            let queue = Arc::new(Queue::new(patience.events));
            queues.push((settings.name.clone(), queue.clone()));
            wanted.push((settings.clone(), queue.clone()));
            let hook = Hook { name: settings.name, requests, queue, patience, lost_before: 0, is_lost_noted: false };
            running.spawn(hook.run());
        }
        if !wanted.is_empty() {
            running.spawn(distribute(hub.events(), wanted));
        }
        Self { running, watch: Watch(queues), end: patience.end }
    }

    /// What the hooks do.
    pub fn watch(&self) -> Watch {
        self.watch.clone()
    }

    /// Waits, for a short time, until all is sent. The hub must have ended.
    pub async fn finish(mut self) {
        if timeout(self.end, async { while self.running.join_next().await.is_some() {} }).await.is_err() {
            for (name, WebhookCounts { waiting, .. }) in self.watch.counts().filter(|(_, counts)| counts.waiting > 0) {
                log::error!("webhook {name:?}: {waiting} events were not sent");
            }
        }
    }
}

/// Puts each event into the queues of those that want it.
async fn distribute(mut events: mpsc::UnboundedReceiver<StationEvent>, hooks: Vec<(WebhookSettings, Arc<Queue>)>) {
    while let Some(event) = events.recv().await {
        for (settings, queue) in &hooks {
            if settings.wants(&event) {
                queue.push(event.clone());
            }
        }
    }
    for (_, queue) in &hooks {
        queue.end();
    }
}

/// The task of a hook.
struct Hook {
    name: String,
    requests: Requests,
    queue: Arc<Queue>,
    patience: Patience,
    /// Events that were lost before the hook failed.
    lost_before: u64,
    /// The log says that events are being lost.
    is_lost_noted: bool,
}

impl Hook {
    async fn run(mut self) {
        let [first, longest] = self.patience.pauses;
        let mut pause = first;
        let mut is_failing = false;
        while let Some((event, since)) = self.queue.first().await {
            if since.elapsed() > self.patience.oldest {
                self.queue.lose(event.id);
                self.note_lost();
                continue;
            }
            let sent = timeout(self.patience.request, self.requests.send(&event, Utc::now())).await;
            self.note_lost();
            let failure = match sent.unwrap_or_else(|_| Err(request::Failure::Slow(self.patience.request))) {
                Ok(()) => {
                    self.queue.done(event.id);
                    if is_failing || self.is_lost_noted {
                        self.note_back();
                    }
                    (pause, is_failing) = (first, false);
                    continue;
                }
                Err(failure) => failure,
            };
            if !is_failing {
                log::warn!("webhook {:?}: {failure}; it is tried again", self.name);
            }
            self.queue.failed();
            is_failing = true;
            let asked = failure.retry_after().unwrap_or_default();
            if self.queue.is_ended() {
                sleep(first).await;
            } else {
                tokio::select! {
                    () = sleep(by_chance(pause).max(asked).min(longest)) => {}
                    () = self.queue.ended() => {}
                }
                pause = (2 * pause).min(longest);
            }
        }
    }

    /// The log says that events are being lost, once.
    fn note_lost(&mut self) {
        if self.queue.lost() > self.lost_before && !self.is_lost_noted {
            self.is_lost_noted = true;
            let (events, hours) = (self.patience.events, self.patience.oldest.as_secs() / 3600);
            log::error!(
                "webhook {:?}: it has failed for so long that events are lost: at most {events}, and those of {hours} h, wait",
                self.name
            );
        }
    }

    /// The log says that the hook works again.
    fn note_back(&mut self) {
        let (waiting, lost) = (self.queue.waiting(), self.queue.lost());
        let lost_now = lost - self.lost_before;
        log::info!("webhook {:?}: it answers again; {waiting} events wait, {lost_now} were lost", self.name);
        (self.lost_before, self.is_lost_noted) = (lost, false);
    }
}

/// A pause that is up to a half shorter: hooks that failed together are not tried together.
fn by_chance(pause: Duration) -> Duration {
    let share = getrandom::u32().map_or(1.0, |number| f64::from(number) / f64::from(u32::MAX));
    pause.mul_f64(0.5 + 0.5 * share)
}

#[cfg(test)]
mod tests;
