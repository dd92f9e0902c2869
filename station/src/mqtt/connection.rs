//! The connection to the broker: what is in the outbox goes out, subscriptions come in.
//!
//! Each connection is a client of its own, with a clean session. What the broker has not confirmed stays in the outbox,
//! so a lost connection loses nothing. A connection that does not move for some time is given up, and the next one is
//! tried after a pause that grows.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use rumqttc::tokio_rustls::rustls::{self, CertificateError};
use rumqttc::{
    AsyncClient, ConnectReturnCode, ConnectionError, Event, EventLoop, LastWill, Packet, PublishNoticeError,
    PublishOptions, QoS, SubscribeFilterInput, SubscribeNoticeError,
};
use tokio::sync::watch;
use tokio::time::{sleep, timeout};

use super::broker::{Broker, KEEP_ALIVE_S};
use super::inbox::Inbox;
use super::outbox::{Message, Outbox};
use super::topics::{Topics, identifier};

/// Messages that are on their way together.
const TOGETHER: usize = 256;
/// A connection on which nothing moves for this time is stuck: pings go out and come back in between.
const STUCK: Duration = Duration::from_secs(2 * KEEP_ALIVE_S as u64);
/// The first pause after a lost connection, and the longest one.
const PAUSES: [Duration; 2] = [Duration::from_millis(250), Duration::from_secs(2)];
/// The longest pause where the broker refuses: a person has to do something.
const REFUSED: Duration = Duration::from_secs(30);
/// The last messages of a station that stops have this time.
const FAREWELL: Duration = Duration::from_secs(2);

/// What a connection works for.
pub(super) struct Connection {
    pub(super) broker: Broker,
    pub(super) topics: Topics,
    pub(super) outbox: Arc<Outbox>,
    pub(super) inbox: Inbox,
}

/// Why a connection ended.
struct Lost {
    text: String,
    /// Only a person can change it.
    is_refused: bool,
}

impl Connection {
    /// Keeps a connection until the station stops.
    pub(super) async fn run(mut self, mut stop: watch::Receiver<bool>) {
        let (mut pause, mut last) = (PAUSES[0], String::new());
        loop {
            let (connected, is_connected) = watch::channel(false);
            let lost = self.connect(connected, &stop).await;
            if *stop.borrow() {
                return;
            }
            if *is_connected.borrow() {
                (pause, last) = (PAUSES[0], String::new());
            }
            // Once, and once more where a person has to do something.
            if last.is_empty() || (lost.is_refused && lost.text != last) {
                log::warn!("mqtt: {}: {}; trying again", self.broker, lost.text);
                last.clone_from(&lost.text);
            }
            tokio::select! {
                () = until(&mut stop) => return,
                () = sleep(pause) => {}
            }
            pause = (2 * pause).min(if lost.is_refused { REFUSED } else { PAUSES[1] });
        }
    }

    /// One connection.
    async fn connect(&mut self, connected: watch::Sender<bool>, stop: &watch::Receiver<bool>) -> Lost {
        let client_id = identifier(&["baliza", self.topics.prefix()]);
        let mut options = self.broker.options(&client_id);
        options.set_last_will(LastWill::new(self.topics.status(), "offline", QoS::AtLeastOnce, true, None));
        let (client, events) = AsyncClient::builder(options).capacity(TOGETHER).build();
        let send = Sender {
            client,
            status: self.topics.status(),
            filters: self.inbox.filters(),
            outbox: &self.outbox,
            connected: connected.subscribe(),
            stop: stop.clone(),
        };
        tokio::select! {
            lost = receive(events, &connected, &self.broker, &mut self.inbox) => lost,
            why = send.run() => Lost { text: why.to_owned(), is_refused: false },
        }
    }
}

/// Drives the connection and passes on what comes, until it is lost.
async fn receive(mut events: EventLoop, connected: &watch::Sender<bool>, broker: &Broker, inbox: &mut Inbox) -> Lost {
    loop {
        let event = match timeout(STUCK, events.poll()).await {
            Ok(Ok(event)) => event,
            Ok(Err(error)) => return lost(&error, broker),
            Err(_) => return Lost { text: "the broker does not answer".to_owned(), is_refused: false },
        };
        match event {
            Event::Incoming(Packet::ConnAck(_)) => {
                log::info!("mqtt: connected to {broker}");
                connected.send_replace(true);
            }
            Event::Incoming(Packet::Publish(publish)) => {
                inbox.take(&publish.topic, &publish.payload, publish.retain).await;
            }
            Event::Incoming(_) | Event::Outgoing(_) | Event::Auth(_) => {}
        }
    }
}

/// What a person needs to know of an error.
fn lost(error: &ConnectionError, broker: &Broker) -> Lost {
    let refused = |text: String| Lost { text, is_refused: true };
    if let ConnectionError::ConnectionRefused(
        ConnectReturnCode::BadUserNamePassword | ConnectReturnCode::NotAuthorized,
    ) = error
    {
        return refused(match broker.user() {
            Some(user) => format!("the broker refuses the user {user}: the name or the password is wrong"),
            None => "the broker wants a user and a password: mqtt://USER@HOST, and --mqtt-password-file".to_owned(),
        });
    }
    if let Some(rustls::Error::InvalidCertificate(why)) = of_tls(error) {
        return refused(match why {
            // An authority of the same name has another key.
            CertificateError::UnknownIssuer | CertificateError::BadSignature => {
                "the broker's certificate is not signed by an authority that is trusted: --mqtt-ca names the right one"
                    .to_owned()
            }
            CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. } => {
                "the broker's certificate is for another name than the one in the address".to_owned()
            }
            other => format!("the broker's certificate is not valid: {other}"),
        });
    }
    if let ConnectionError::ConnectionRefused(code) = error {
        return refused(format!("the broker refuses the connection ({code:?})"));
    }
    Lost { text: error.to_string(), is_refused: false }
}

/// The error of TLS behind an error.
fn of_tls(error: &ConnectionError) -> Option<&rustls::Error> {
    let mut next: Option<&(dyn std::error::Error + 'static)> = Some(error);
    while let Some(error) = next {
        if let Some(tls) = error.downcast_ref::<rustls::Error>() {
            return Some(tls);
        }
        // An I/O error does not name what it wraps as its source.
        let inner = error.downcast_ref::<io::Error>().and_then(io::Error::get_ref);
        next = match inner {
            Some(inner) => Some(inner),
            None => error.source(),
        };
    }
    None
}

/// Waits until it is true, or until nobody can make it so.
async fn until(flag: &mut watch::Receiver<bool>) {
    let _ = flag.wait_for(|flag| *flag).await;
}

/// The sending side of a connection.
struct Sender<'a> {
    client: AsyncClient,
    status: String,
    filters: Vec<SubscribeFilterInput>,
    outbox: &'a Outbox,
    connected: watch::Receiver<bool>,
    stop: watch::Receiver<bool>,
}

impl Sender<'_> {
    /// Sends until the station stops, and tells the broker so then. Returns why it ended.
    async fn run(mut self) -> &'static str {
        const STOPPED: &str = "the station stops";
        tokio::select! {
            () = until(&mut self.stop) => return STOPPED,
            () = until(&mut self.connected) => {}
        }
        let dropped = self.outbox.again();
        if dropped > 0 {
            log::warn!("mqtt: {dropped} events were dropped while the broker was away");
        }
        let filters = std::mem::take(&mut self.filters);
        let mut stop = self.stop.clone();
        let sending = async {
            let status = self.client.publish(self.status.clone(), "online", PublishOptions::at_least_once().retained());
            if status.await.is_err() {
                return;
            }
            // Who answers a document is answered in turn: the subscriptions come first.
            let Ok(subscribed) = self.client.subscribe_many_tracked(filters).await else { return };
            match subscribed.wait_completion_async().await {
                Ok(_) => {}
                Err(SubscribeNoticeError::V5SubAckFailure(reasons)) => {
                    log::warn!("mqtt: the broker refuses a subscription: {reasons:?}");
                }
                Err(_) => return,
            }
            while self.send(self.outbox.next(TOGETHER).await).await.is_some() {}
        };
        tokio::select! {
            () = sending => {
                // The receiving side knows why, and comes first.
                sleep(PAUSES[0]).await;
                return "the broker does not take messages";
            }
            () = until(&mut stop) => {}
        }
        // What was on its way is sent a second time at worst.
        self.outbox.not_sent();
        let farewell = async {
            while !self.outbox.is_empty() {
                self.send(self.outbox.next(TOGETHER).await).await?;
            }
            let offline = PublishOptions::at_least_once().retained();
            let offline = self.client.publish_tracked(self.status.clone(), "offline", offline).await.ok()?;
            offline.wait_completion_async().await.ok()?;
            self.client.disconnect().await.ok()
        };
        if timeout(FAREWELL, farewell).await.ok().flatten().is_some() {
            // The receiving side ends the connection.
            sleep(FAREWELL).await;
        }
        STOPPED
    }

    /// Sends messages and waits until the broker has them. None where it cannot have them.
    async fn send(&self, messages: Vec<Message>) -> Option<()> {
        let mut notices = Vec::with_capacity(messages.len());
        for Message { topic, payload, is_retained } in messages {
            let options =
                if is_retained { PublishOptions::at_most_once().retained() } else { PublishOptions::at_least_once() };
            notices.push(self.client.publish_tracked(&*topic, &*payload, options).await.ok()?);
        }
        for notice in notices {
            match notice.wait_completion_async().await {
                Ok(()) => {}
                Err(PublishNoticeError::V5PubAck(reason)) => {
                    log::warn!("mqtt: the broker refuses an event: {reason:?}")
                }
                Err(_) => return None,
            }
        }
        self.outbox.sent();
        Some(())
    }
}
