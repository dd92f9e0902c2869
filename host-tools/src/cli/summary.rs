//! The summary of a method: figures of its errors, for reading and as JSON.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use analysis::check::Finding;
use baliza_report::{Statistics, mean};
use node_link::provision::SiteNames;
use recording::{Coordinates, Epochs, Position, Solved};

use super::residuals;

/// The summary of a method for `--json`.
#[derive(Debug, serde::Serialize)]
pub struct Summary<'a> {
    method: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    tag: Option<Of<'a>>,
    #[serde(flatten)]
    by_beacons: Option<ByBeacons>,
    epochs: usize,
    fixed: usize,
    rmse_m: Option<f64>,
    mae_m: Option<f64>,
    p50_m: Option<f64>,
    p90_m: Option<f64>,
    #[serde(flatten)]
    horizontal: Option<Horizontal>,
    #[serde(flatten)]
    vertical: Option<Vertical>,
    #[serde(flatten)]
    consistency: Option<Consistency>,
    #[serde(skip_serializing_if = "Option::is_none")]
    time_offset_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    anchors: Option<Vec<residuals::Row<'a>>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    findings: Option<&'a [Finding]>,
    /// The reasons for epochs without a position, with their numbers.
    #[serde(skip)]
    reasons: BTreeMap<&'static str, usize>,
}

/// The tags of a summary, where their names are known. In JSON it is the name, or null.
#[derive(Clone, Copy, Debug, serde::Serialize)]
#[serde(untagged)]
pub enum Of<'a> {
    /// One tag.
    Tag(&'a str),
    /// All tags of the recording.
    All,
}

/// The part of a summary that only positions by beacons have.
#[derive(Debug, serde::Serialize)]
struct ByBeacons {
    k: Option<usize>,
    points: usize,
}

/// The errors in x and y.
#[derive(Debug, serde::Serialize)]
struct Horizontal {
    rmse_xy_m: f64,
    mae_xy_m: f64,
    p50_xy_m: f64,
    p90_xy_m: f64,
}

/// The errors in height, where both heights are known.
#[derive(Debug, serde::Serialize)]
struct Vertical {
    rmse_z_m: f64,
    mae_z_m: f64,
    p50_z_m: f64,
    p90_z_m: f64,
    /// The mean of the squared errors in units of their variance: 1 where the variance is right.
    nees_z: Option<f64>,
}

/// The comparison of the horizontal errors with the uncertainties.
#[derive(Debug, serde::Serialize)]
struct Consistency {
    /// The share of the errors inside the 1σ ellipse: 0.39 where the covariance is right.
    inside_1_sigma: f64,
    /// The mean of the squared errors in units of their covariance: 2 where the covariance is right.
    nees: f64,
}

/// A position and its true position.
type Known<'a> = (&'a Position, Coordinates);

impl Horizontal {
    fn of<'a>(known: impl Iterator<Item = Known<'a>>) -> Option<Self> {
        let errors = known.map(|(position, truth)| position.place.horizontal_m(&truth));
        let Statistics { rmse, mae, p50, p90 } = Statistics::of(&errors.collect::<Vec<_>>())?;
        Some(Self { rmse_xy_m: rmse, mae_xy_m: mae, p50_xy_m: p50, p90_xy_m: p90 })
    }
}

impl Vertical {
    fn of<'a>(known: impl Iterator<Item = Known<'a>>) -> Option<Self> {
        let heights = known.filter_map(|(Position { place, sigma, .. }, truth)| {
            let error_m = (place.z_m? - truth.z_m?).abs();
            Some((error_m, (error_m / sigma.z_m?).powi(2)))
        });
        let (errors, squares): (Vec<f64>, Vec<f64>) = heights.unzip();
        let Statistics { rmse, mae, p50, p90 } = Statistics::of(&errors)?;
        let nees_z = mean(squares.into_iter().filter(|square| square.is_finite()));
        let nees_z = nees_z.is_finite().then_some(nees_z);
        Some(Self { rmse_z_m: rmse, mae_z_m: mae, p50_z_m: p50, p90_z_m: p90, nees_z })
    }
}

impl Consistency {
    fn of<'a>(known: impl Iterator<Item = Known<'a>>) -> Option<Self> {
        let squares = known.map(|(position, truth)| position.normalised_square(&truth));
        let squares: Vec<f64> = squares.filter(|square| square.is_finite()).collect();
        let count = squares.len() as f64;
        let inside = squares.iter().filter(|square| **square <= 1.0).count() as f64;
        (!squares.is_empty()).then(|| Self { inside_1_sigma: inside / count, nees: mean(squares.iter().copied()) })
    }
}

impl<'a> Summary<'a> {
    /// The summary of a method's positions of epochs. `neighbours` is `None` where positions come from ranges, else the
    /// number of neighbours that the method has, if it has neighbours.
    pub fn of(
        method: &'a str,
        tag: Option<Of<'a>>,
        parts: &[(&'a Epochs, &'a [Solved])],
        neighbours: Option<Option<usize>>,
    ) -> Self {
        let all = || parts.iter().flat_map(|(_, solved)| *solved);
        let both = parts.iter().flat_map(|(epochs, solved)| epochs.iter().zip(*solved));
        let known = both.filter_map(|(epoch, solved)| Some((solved.outcome.as_ref().ok()?, epoch.truth?)));
        let errors: Vec<f64> = all().filter_map(|solved| solved.error_m).collect();
        let figures = Statistics::of(&errors);
        let of = |figure: fn(&Statistics) -> f64| figures.as_ref().map(figure);
        let mut reasons = BTreeMap::new();
        for reason in all().filter_map(|solved| solved.outcome.as_ref().err()) {
            *reasons.entry(reason.as_str()).or_insert(0_usize) += 1;
        }
        // Positions by beacons are horizontal, and so are their errors.
        let of_ranges = neighbours.is_none();
        Self {
            method,
            tag,
            by_beacons: neighbours.map(|k| ByBeacons { k, points: all().count() }),
            epochs: all().count(),
            fixed: all().filter(|solved| solved.outcome.is_ok()).count(),
            rmse_m: of(|figures| figures.rmse),
            mae_m: of(|figures| figures.mae),
            p50_m: of(|figures| figures.p50),
            p90_m: of(|figures| figures.p90),
            horizontal: Horizontal::of(known.clone()).filter(|_| of_ranges),
            vertical: Vertical::of(known.clone()).filter(|_| of_ranges),
            consistency: Consistency::of(known),
            time_offset_s: None,
            anchors: None,
            findings: None,
            reasons,
        }
    }

    /// The summary with the offset of the truth's clock, seconds, the residuals of the anchors, and what is odd about the
    /// recording.
    pub fn with(
        self,
        time_offset_s: Option<f64>,
        anchors: Option<Vec<residuals::Row<'a>>>,
        findings: Option<&'a [Finding]>,
    ) -> Self {
        Self { time_offset_s, anchors, findings, ..self }
    }
}

/// The summaries as text, with the names of tags and the reasons for epochs without a position. Errors in the plane and
/// in height are apart where heights are compared.
pub fn table(summaries: &[Summary], names: &SiteNames) -> String {
    let heights = summaries.iter().any(|summary| summary.vertical.is_some());
    let tags = summaries.iter().any(|summary| summary.tag.is_some());
    let tag = |name: &str| if tags { format!("{name:<16} ") } else { String::new() };
    let mut text = format!(
        "{:<16} {}{:>7} {:>7} {:>8} {:>8} {:>8} {:>8}",
        "method",
        tag("tag"),
        "epochs",
        "fixed",
        "rmse_m",
        "mae_m",
        "p50_m",
        "p90_m"
    );
    if heights {
        let _ = write!(text, " {:>9} {:>8}", "rmse_xy_m", "rmse_z_m");
    }
    text.push('\n');
    let metres = |figure: Option<f64>| figure.map_or_else(|| "-".to_owned(), |metres| format!("{metres:.3}"));
    for summary in summaries {
        let of = match summary.tag {
            Some(Of::Tag(key)) => names.node(key),
            Some(Of::All) => "all",
            None => "",
        };
        let _ = write!(text, "{:<16} {}{:>7} {:>7}", summary.method, tag(of), summary.epochs, summary.fixed);
        for figure in [summary.rmse_m, summary.mae_m, summary.p50_m, summary.p90_m] {
            let _ = write!(text, " {:>8}", metres(figure));
        }
        let vertical = summary.vertical.as_ref();
        if heights {
            let horizontal = metres(summary.horizontal.as_ref().map(|horizontal| horizontal.rmse_xy_m));
            let _ = write!(text, " {horizontal:>9} {:>8}", metres(vertical.map(|vertical| vertical.rmse_z_m)));
        }
        if let Some(Consistency { inside_1_sigma, nees }) = summary.consistency {
            let _ = write!(text, "  {:.0} % inside 1 sigma, NEES {nees:.2}", 100.0 * inside_1_sigma);
        }
        if let Some(nees_z) = vertical.and_then(|vertical| vertical.nees_z) {
            let _ = write!(text, ", of z {nees_z:.2}");
        }
        for (reason, count) in &summary.reasons {
            let _ = write!(text, "  {count} {reason}");
        }
        text.push('\n');
    }
    text
}
