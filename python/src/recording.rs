//! A recorded folder: its tables as arrays, its positions by the solvers and by the track.

use std::path::PathBuf;

use analysis::locate::track::{Tracker, settings, settings_of_single_epochs};
use analysis::{Setup, Solver};
use positioning_core::Method;
use positioning_core::nlos::Feature;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use recording::folder::{Folder, RecordingSettings};
use recording::{Epochs, Height, Solved, Space, Truth, Truths, UserError};
use recording::{Files, MeasurementMode, SingleRanges, rounds};

use crate::arguments::{Within, needs_heights};
use crate::arrays::{OfTag, metres, numbers, positions, vectors};
use crate::errors::{input_error, value_error};
use crate::methods::method;
use crate::track::weighting;

/// How epochs are made of the rows of a file.
#[derive(Clone, Copy, FromPyObject)]
#[pyo3(from_item_all)]
struct Grouping {
    /// The longest round of single ranges, seconds; 0: as in the file.
    group_s: Option<f64>,
    /// Added to the times of the truth, seconds.
    time_offset_s: f64,
}

/// The recordings of all tags of a folder.
#[pyclass(frozen, module = "baliza._native")]
pub(crate) struct Recording {
    /// One a tag; at least one.
    tags: Vec<recording::Recording>,
    truths: Option<Truths>,
    settings: RecordingSettings,
    mode: MeasurementMode,
    anchors: PathBuf,
}

#[pymethods]
impl Recording {
    /// Reads the files of a folder.
    #[new]
    fn read(py: Python<'_>, folder: PathBuf) -> PyResult<Self> {
        Self::of(&folder).map_err(|error| input_error(py, &error))
    }

    /// The tags' names; `None` where the file has none.
    fn tags(&self) -> Vec<Option<&str>> {
        self.tags.iter().map(|of| of.tag.as_deref()).collect()
    }

    /// `anchor`, `position_m`.
    fn anchors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        // All tags have the same ones.
        let anchors = self.tags.first().map_or(&[][..], |of| &of.anchors);
        let dict = PyDict::new(py);
        dict.set_item("anchor", anchors.iter().map(|anchor| anchor.name.as_str()).collect::<Vec<_>>())?;
        dict.set_item("position_m", vectors(py, anchors.iter().map(|anchor| metres(&anchor.place)))?)?;
        Ok(dict)
    }

    /// `tag`, `epoch` (its name), `anchor` (its index), `t_s`, `range_m`, `los`, `rx_power_dbm`, `power_difference_db`.
    fn ranges<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let rows = || {
            let epochs = self.tags.iter().flat_map(|of| of.epochs.iter().map(|epoch| (of.tag.as_deref(), epoch)));
            epochs.flat_map(|(tag, epoch)| epoch.ranges.iter().map(move |row| (tag, epoch, row)))
        };
        let dict = PyDict::new(py);
        dict.set_item("tag", rows().map(|(tag, _, _)| tag).collect::<Vec<_>>())?;
        dict.set_item("epoch", rows().map(|(_, epoch, _)| epoch.name).collect::<Vec<_>>())?;
        dict.set_item("anchor", numbers(py, rows().map(|(_, _, row)| row.anchor as i64)))?;
        dict.set_item("t_s", numbers(py, rows().map(|(_, epoch, row)| row.t_s.or(epoch.t_s).unwrap_or(f64::NAN))))?;
        dict.set_item("range_m", numbers(py, rows().map(|(_, _, row)| row.range_m)))?;
        let sight = |los: Option<bool>| los.map_or(f64::NAN, |los| f64::from(u8::from(los)));
        dict.set_item("los", numbers(py, rows().map(|(_, _, row)| sight(row.line_of_sight))))?;
        let powers = rows().map(|(_, _, row)| f64::from(row.diagnostics.power_dbm));
        dict.set_item("rx_power_dbm", numbers(py, powers))?;
        let differences = rows()
            .map(|(_, _, row)| row.diagnostics.features.get(Feature::PowerDifference).map_or(f64::NAN, f64::from));
        dict.set_item("power_difference_db", numbers(py, differences))?;
        Ok(dict)
    }

    /// `tag`, `epoch`, `t_s`, `position_m`; `None` without a truth.
    fn truth<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(truths) = &self.truths else { return Ok(None) };
        let rows = || truths.by_tag().flat_map(|(tag, truth)| truth.rows().map(move |row| (tag, row)));
        let dict = PyDict::new(py);
        dict.set_item("tag", rows().map(|(tag, _)| tag).collect::<Vec<_>>())?;
        dict.set_item("epoch", rows().map(|(_, (epoch, _, _))| epoch).collect::<Vec<_>>())?;
        dict.set_item("t_s", numbers(py, rows().map(|(_, (_, t_s, _))| t_s.unwrap_or(f64::NAN))))?;
        dict.set_item("position_m", vectors(py, rows().map(|(_, (_, _, place))| metres(place)))?)?;
        Ok(Some(dict))
    }

    /// Whether differences of arrivals were measured, and no ranges.
    #[getter]
    fn differences(&self) -> bool {
        self.mode == MeasurementMode::Differences
    }

    /// Solves each epoch by itself.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        method_name: &str,
        within: Within,
        grouping: Grouping,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (method, setup): (Method, _) = (method(method_name)?, self.setup(within)?);
        self.positions(py, grouping, SingleRanges::Group, |anchors, epochs| {
            if self.mode == MeasurementMode::Differences {
                let mut tracker = Tracker::new(anchors, setup, settings_of_single_epochs(&setup), None);
                return epochs.iter().map(|epoch| tracker.follow(&epoch)).collect();
            }
            Solver::new(anchors, setup).solve_all(method, epochs, |_| ())
        })
    }

    /// Follows each tag from epoch to epoch, and back again where `smooth`.
    fn track<'py>(
        &self,
        py: Python<'py>,
        nlos: Option<&str>,
        smooth: bool,
        within: Within,
        grouping: Grouping,
    ) -> PyResult<Bound<'py, PyDict>> {
        let recorded = self.settings.nlos.unwrap_or_default();
        let (weighting, setup) = (nlos.map_or(Ok(recorded), weighting)?, self.setup(within)?);
        self.positions(py, grouping, SingleRanges::Keep, |anchors, epochs| {
            let mut tracker = Tracker::new(anchors, setup, settings(&setup, weighting), None);
            if smooth { tracker.smooth_all(epochs, || ())[1].clone() } else { tracker.follow_all(epochs, || ()) }
        })
    }
}

impl Recording {
    fn of(path: &std::path::Path) -> Result<Self, UserError> {
        let folder = Folder::open(path)?;
        let anchors = folder.file("anchors.csv")?;
        let (mode, measured) = folder.measured()?;
        let files = Files {
            anchors: &anchors,
            measured: &measured,
            mode,
            truth: None,
            anchor_heights: false,
            truth_heights: false,
        };
        let tags = recording::Recording::read(&files)?;
        let truths = folder.find("truth.csv").map(|file| Truths::read(&file, false)).transpose()?;
        Ok(Self { tags, truths, settings: folder.settings, mode, anchors })
    }

    fn setup(&self, within: Within) -> PyResult<Setup> {
        let setup = within.or(&self.settings).setup()?;
        if setup.space == Space::Plane(Height::FromTruth) && self.truths.is_none() {
            return Err(value_error("height_from_truth: the recording has no truth"));
        }
        let mut anchors = self.tags.iter().flat_map(|of| &of.anchors);
        let lacking = anchors.find(|anchor| anchor.place.z_m.is_none());
        if let Some(anchor) = lacking.filter(|_| needs_heights(&setup)) {
            let file = self.anchors.display();
            return Err(value_error(format!("{file}: anchor {:?} has no z_m; dims=2 needs none", anchor.name)));
        }
        Ok(setup)
    }

    /// The positions of all tags.
    fn positions<'py>(
        &self,
        py: Python<'py>,
        grouping: Grouping,
        singles: SingleRanges,
        solve: impl Fn(&[recording::Anchor], &Epochs) -> Vec<Solved> + Sync,
    ) -> PyResult<Bound<'py, PyDict>> {
        let mut tags = Vec::new();
        for of in &self.tags {
            let truth = self.truths.as_ref().map(|truths| truths.of(of.tag.as_deref())).transpose();
            let truth = truth.map_err(|error| input_error(py, &error))?.flatten();
            let epochs = epochs(&of.epochs, truth, grouping, singles)?;
            let solved = py.detach(|| solve(&of.anchors, &epochs));
            tags.push(OfTag { tag: of.tag.clone(), epochs, solved });
        }
        positions(py, &tags)
    }
}

/// The epochs with their true positions, in rounds where the user asks for them or they are usual.
fn epochs(epochs: &Epochs, truth: Option<&Truth>, grouping: Grouping, singles: SingleRanges) -> PyResult<Epochs> {
    let Grouping { group_s, time_offset_s } = grouping;
    if !(group_s.is_none_or(|group_s| group_s >= 0.0) && time_offset_s.is_finite()) {
        return Err(value_error("group_s must not be below 0, and time_offset_s must be finite"));
    }
    let mut epochs = match singles.longest_s(group_s, epochs) {
        Some(longest_s) => rounds(epochs, longest_s),
        None => epochs.clone(),
    };
    if let Some(truth) = truth {
        truth.join(&mut epochs, time_offset_s);
    }
    Ok(epochs)
}
