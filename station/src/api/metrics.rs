//! Counts of the station to the text format of Prometheus, version 0.0.4.

use std::fmt::Write;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::Shared;
use crate::webhooks;

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(metrics))
}

/// Counts of the API.
#[derive(Debug, Default)]
pub struct RequestCounts {
    /// Answers by the first digit of their status, from 1.
    answers: [AtomicU64; 5],
    listeners: AtomicI64,
}

impl RequestCounts {
    /// An answer was given.
    pub fn answer(&self, status: StatusCode) {
        if let Some(count) = self.answers.get(usize::from(status.as_u16() / 100).wrapping_sub(1)) {
            count.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// A listener came (1) or went (-1).
    pub fn listener(&self, change: i64) {
        self.listeners.fetch_add(change, Ordering::Relaxed);
    }
}

/// Counts, for Prometheus.
#[utoipa::path(get, path = "/metrics", tag = "health", security(("token" = ["view"])),
    responses((status = 200, content_type = "text/plain; version=0.0.4", body = String)))]
async fn metrics(State(station): State<Shared>) -> Response {
    let mut text = String::new();
    let mut family = |name: &str, kind: &str, help: &str, rows: &[(String, f64)]| {
        let name = format!("baliza_{name}");
        // Writing to a String cannot fail.
        let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {kind}");
        for (labels, value) in rows {
            let _ = writeln!(text, "{name}{labels} {value}");
        }
    };
    let one = |value: f64| [(String::new(), value)];
    let (tags, nodes, findings) = station.app.hub.read(|live| (live.tags(), live.nodes(), live.findings().len()));
    let silent = tags.iter().filter(|tag| tag.silent).count();
    let by_state = [("silent", silent), ("reporting", tags.len() - silent)];
    let by_state = by_state.map(|(state, tags)| (format!("{{state=\"{state}\"}}"), tags as f64));
    family("tags", "gauge", "Tags that are known.", &by_state);
    family("nodes", "gauge", "Anchors, beacons and receivers that are known.", &one(nodes.len() as f64));
    let moved = nodes.iter().filter(|node| node.health.moved).count();
    family("nodes_moved", "gauge", "Anchors that were probably moved.", &one(moved as f64));
    family("findings", "gauge", "What ranges say against their sites now.", &one(findings as f64));
    let counts = station.app.hub.counts();
    for (name, help, count) in [
        ("reports_total", "Reports that were taken.", counts.reports),
        ("reports_refused_total", "Reports whose content was refused.", counts.refused),
        ("positions_total", "Positions of tags.", counts.positions),
        ("events_total", "Events.", counts.events),
        ("rows_written_total", "Rows that the store has.", counts.rows_written),
        ("rows_dropped_total", "Rows that were lost because the store failed for too long.", counts.dropped),
        ("store_failures_total", "Operations of the store that failed.", counts.store_failures),
        ("updates_missed_total", "Updates that slow listeners have missed.", counts.missed),
    ] {
        family(name, "counter", help, &one(count as f64));
    }
    family("rows_backlog", "gauge", "Rows that wait for the store.", &one(counts.backlog as f64));
    let hooks: Vec<_> = station.app.webhooks.counts().collect();
    let by_hook = |count: fn(&webhooks::WebhookCounts) -> u64| {
        let row = |(name, counts): &(&str, _)| (format!("{{webhook=\"{}\"}}", label(name)), count(counts) as f64);
        hooks.iter().map(row).collect::<Vec<_>>()
    };
    if !hooks.is_empty() {
        let waiting = by_hook(|counts| counts.waiting as u64);
        family("webhook_events_waiting", "gauge", "Events that wait for a webhook.", &waiting);
        let sent = by_hook(|counts| counts.sent);
        family("webhook_events_sent_total", "counter", "Events that a webhook has taken.", &sent);
        let lost = by_hook(|counts| counts.lost);
        family("webhook_events_lost_total", "counter", "Events that a webhook has not taken for too long.", &lost);
        let failures = by_hook(|counts| counts.failures);
        family("webhook_failures_total", "counter", "Requests to a webhook without success.", &failures);
    }
    let listeners = station.counts.listeners.load(Ordering::Relaxed);
    family("listeners", "gauge", "Listeners at WebSockets and event streams.", &one(listeners as f64));
    family("connections", "gauge", "Open connections.", &one(station.connections.open_now() as f64));
    let answers: Vec<_> = (1..).zip(&station.counts.answers).collect();
    let answers = answers
        .into_iter()
        .map(|(class, count)| (format!("{{status=\"{class}xx\"}}"), count.load(Ordering::Relaxed) as f64));
    family("http_answers_total", "counter", "Answers to requests.", &answers.collect::<Vec<_>>());
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text).into_response()
}

/// A text as the value of a label: the format escapes three characters.
fn label(text: &str) -> String {
    text.replace('\\', r"\\").replace('"', r#"\""#).replace('\n', r"\n")
}

#[cfg(test)]
mod tests {
    use super::label;

    #[test]
    fn labels_are_escaped_as_the_text_format_says() {
        // The example of the format's documentation: path="C:\\DIR\\FILE.TXT",error="Cannot find file:\n\"FILE.TXT\"".
        assert_eq!(label("C:\\DIR\\FILE.TXT"), r"C:\\DIR\\FILE.TXT");
        assert_eq!(label("Cannot find file:\n\"FILE.TXT\""), r#"Cannot find file:\n\"FILE.TXT\""#);
    }
}
