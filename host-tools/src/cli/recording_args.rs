//! The common arguments of `solve` and `track`: the recording to read, and the space.

use std::path::PathBuf;

use analysis::Setup;
use analysis::check::{Finding, Whole, of_rows, of_whole};
use analysis::locate::advice;
use analysis::locate::ble::RssiMethod;
use analysis::locate::residuals::{Reference, residuals};
use analysis::locate::time_offset::{Clocks, REACH_S, clocks};
use anyhow::Result;
use node_link::provision::SiteNames;
use recording::folder::{Folder, RecordingSettings, Weighting};
use recording::output::STANDARD;
use recording::{Files, Half, Height, MeasurementMode, Recording, Solved, Space, Truth, Truths, UserError};
use recording::{Joined, SingleRanges, anchor_rows, drop_repeats, round_s, rounds};

use super::floor_plan::{FloorPlan, FloorPlanArgs};
use super::folder::FolderFiles;
use super::numbers::finite;
use super::piped::Piped;
use super::recording_values::{CornersM, Dims, Side, TimeOffset, deviation, seconds};
use super::report::{Output, OutputArgs, Report, Site, TagReport, flat};
use super::residuals::table;
use super::site_names::SiteNamesArgs;
use super::stream::is_live_stdin;

/// The arguments of a command that computes positions from a recording.
#[derive(clap::Args)]
pub struct RecordingArgs {
    /// A recording: a folder with anchors.csv, ranges.csv (or differences.csv) and, where there are, truth.csv,
    /// walls.csv and recording.toml, which says --dims and --height-m; or with beacons.csv and rssi.csv alone
    #[arg(value_name = "FOLDER")]
    folder: Option<PathBuf>,
    /// Surveyed anchors: CSV with anchor,x_m,y_m,z_m
    #[arg(long, value_name = "FILE", required_unless_present = "folder")]
    anchors: Option<PathBuf>,
    /// Measured ranges: CSV with epoch,t_s,anchor,range_m and, where known, tag,rx_power_dbm,fp_power_dbm,los
    #[arg(long, value_name = "FILE", required_unless_present_any = ["folder", "differences"])]
    ranges: Option<PathBuf>,
    /// Differences of arrivals, of tags that only listen: CSV with epoch,t_s,reference,anchor,difference_m
    #[arg(long, value_name = "FILE", conflicts_with = "ranges")]
    differences: Option<PathBuf>,
    /// Where the tag truly was: CSV with epoch,t_s,x_m,y_m,z_m; gives the errors. It may have its own rate and epochs:
    /// a position is interpolated in time; without times it is that of the same epoch
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Added to the times of the truth, whose clock may differ from that of the ranges: seconds, or `auto`, which
    /// estimates them (at most 2 s) from the positions of each epoch by itself and gives 0 where the tag moves too
    /// little
    #[arg(long, value_name = "SECONDS|auto", default_value = "0", allow_hyphen_values = true)]
    time_offset_s: TimeOffset,
    /// Make rounds of single ranges: a round ends where an anchor repeats, or after these seconds; 0: as in the file
    /// [default: where nearly all epochs have one range, `solve` makes rounds of .1 to .35 s, `track` none]
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    group_s: Option<f64>,
    /// Also print the residuals of the ranges by anchor, against the truth, or else against the positions (in JSON:
    /// anchors)
    #[arg(long)]
    residuals: bool,
    /// Exit with 1 where there is a warning about the recording
    #[arg(long)]
    strict: bool,
    /// The consistency of errors and uncertainties is always printed.
    #[arg(long, hide = true)]
    consistency: bool,
    /// Solve in the plane (2) or in space (3) [default: as recording.toml says, else 3]
    #[arg(long, value_name = "2|3")]
    dims: Option<Dims>,
    /// The tag's height, metres: ranges are flattened to the plane (--dims 2)
    #[arg(long, value_name = "Z", allow_negative_numbers = true, value_parser = finite, conflicts_with = "height_from_truth")]
    height_m: Option<f64>,
    /// The height is known to ± this, metres (standard deviation): it is then estimated, too [default: as recording.toml
    /// says, else exact]
    #[arg(long, value_name = "SIGMA", allow_negative_numbers = true, value_parser = deviation, conflicts_with = "height_from_truth")]
    height_sigma_m: Option<f64>,
    /// Take the tag's height of each epoch from the truth (--dims 2)
    #[arg(long)]
    height_from_truth: bool,
    /// On which side of the anchors the tag is, where they all lie on one plane (--dims 3) [default: below, with an
    /// uncertainty that reaches to the mirror image]
    #[arg(long, value_name = "SIDE")]
    side: Option<Side>,
    /// Where the tag can be at all, metres: the iterated methods stay inside, and a track on this side of a line of anchors
    #[arg(long, value_name = "X0,Y0,X1,Y1", allow_hyphen_values = true, value_parser = CornersM::parse)]
    area: Option<CornersM>,
    #[command(flatten)]
    names: SiteNamesArgs,
    #[command(flatten)]
    floor_plan: FloorPlanArgs,
    #[command(flatten)]
    output: OutputArgs,
}

impl RecordingArgs {
    /// The space that the flags select, or else the folder's settings. Flags that cannot be combined are refused.
    fn space(&self, settings: &RecordingSettings) -> Result<Space, UserError> {
        let by_flags = self.height_m.is_some() || self.height_from_truth;
        let dims = self.dims.unwrap_or(match settings.dims {
            Some(2) => Dims::Two,
            Some(_) | None => Dims::Three,
        });
        match dims {
            Dims::Two if self.side.is_some() => Err(UserError::flag("--side", "only with --dims 3")),
            Dims::Two => Ok(Space::Plane(match self.height_m.or(settings.height_m.filter(|_| !by_flags)) {
                Some(height_m) => Height::Fixed(height_m),
                None if self.height_from_truth => Height::FromTruth,
                None => Height::Unknown,
            })),
            Dims::Three if self.height_m.is_some() => Err(UserError::flag("--height-m", "only with --dims 2")),
            Dims::Three if self.height_from_truth => Err(UserError::flag("--height-from-truth", "only with --dims 2")),
            Dims::Three => Ok(Space::Full(self.side.map(|side| match side {
                Side::Below => Half::Below,
                Side::Above => Half::Above,
            }))),
        }
    }

    /// The recording whose ranges come in a pipe, where positions can be written before its end.
    ///
    /// # Errors
    /// Flags cannot be combined, or a file is wrong.
    pub fn piped(&self) -> Result<Option<Piped>, UserError> {
        let is_standard = self.ranges.as_ref().is_some_and(|file| file.as_os_str() == STANDARD);
        let (TimeOffset::Seconds(offset_s), true) = (self.time_offset_s, is_standard && is_live_stdin()) else {
            return Ok(None);
        };
        let Some(is_csv) = self.output.is_csv_of_stdout().filter(|_| !self.residuals) else { return Ok(None) };
        let sources = self.sources()?;
        let setup = self.setup(&sources.settings)?;
        let heights = setup.space == Space::Plane(Height::FromTruth);
        Ok(Some(Piped {
            anchors: anchor_rows(&sources.anchors, setup.space != Space::Plane(Height::Unknown))?,
            setup,
            truths: sources.truth.as_deref().map(|file| Truths::read(file, heights)).transpose()?,
            offset_s,
            longest_s: self.group_s.filter(|group_s| *group_s > 0.0),
            is_csv,
        }))
    }

    /// Reports the positions by beacons, where the folder's tags only received those. Returns whether they did.
    ///
    /// # Errors
    /// A flag is only for ranges, a file is wrong, or an output cannot be written.
    pub fn report_by_beacons(&self, method: RssiMethod, is_method_given: bool) -> Result<bool> {
        let files = [&self.anchors, &self.ranges, &self.differences, &self.truth];
        let folder = self.folder.as_deref().filter(|_| files.iter().all(|file| file.is_none()));
        let Some(folder) = folder.map(Folder::open).transpose()? else { return Ok(false) };
        if !folder.is_of_beacons()? {
            return Ok(false);
        }
        for (flag, is_given) in [
            ("--method", is_method_given),
            ("--residuals", self.residuals),
            ("--height-from-truth", self.height_from_truth),
            ("--side", self.side.is_some()),
            ("--group-s", self.group_s.is_some()),
        ] {
            if is_given {
                return Err(UserError::flag(flag, "only for ranges, and the folder has none").into());
            }
        }
        let area_m = self.area.map(|CornersM(corners)| corners);
        let files = FolderFiles::open(self.folder.as_deref())?;
        super::ble::solve::of_folder(&files, method, self.height_m, area_m, &self.output)?;
        Ok(true)
    }

    /// The space, and what the flags or else the folder's settings know of the tag's place.
    fn setup(&self, settings: &RecordingSettings) -> Result<Setup, UserError> {
        let space = self.space(settings)?;
        // A deviation belongs to its height.
        let of_folder = settings.height_sigma_m.filter(|_| self.height_m.is_none());
        let height_sigma_m = match space {
            Space::Plane(Height::Fixed(_)) => self.height_sigma_m.or(of_folder).unwrap_or(0.0),
            Space::Plane(_) | Space::Full(_) if self.height_sigma_m.is_some() => {
                return Err(UserError::flag("--height-sigma-m", "only with --dims 2 --height-m Z"));
            }
            Space::Plane(_) | Space::Full(_) => 0.0,
        };
        let area_m = self.area.map(|CornersM(corners)| corners).or(settings.area_m);
        Ok(Setup { space, height_sigma_m, area_m })
    }

    /// The files that the flags name, or else those of the folder.
    fn sources(&self) -> Result<Sources, UserError> {
        let folder = FolderFiles::open(self.folder.as_deref())?;
        let settings = folder.settings();
        let (mode, measured) = match (&self.ranges, &self.differences) {
            (Some(file), _) => (MeasurementMode::Ranges, file.clone()),
            (None, Some(file)) => (MeasurementMode::Differences, file.clone()),
            (None, None) => folder.measured()?,
        };
        let anchors = folder.file(&self.anchors, "anchors.csv")?;
        let truth = folder.find(&self.truth, "truth.csv");
        for (flag, given) in [
            ("--height-from-truth", self.height_from_truth),
            ("--time-offset-s", !matches!(self.time_offset_s, TimeOffset::Seconds(0.0))),
        ] {
            if given && truth.is_none() {
                return Err(UserError::flag(flag, "only with --truth"));
            }
        }
        Ok(Sources { anchors, mode, measured, truth, walls: folder.find(&None, "walls.csv"), settings })
    }

    /// Checks the destinations of the report, and reads the recording.
    ///
    /// # Errors
    /// Flags cannot be combined, an output cannot be written, or a file is wrong; the error names the first wrong line.
    pub fn read(&self, singles: SingleRanges) -> Result<Input<'_>, UserError> {
        let sources = self.sources()?;
        let setup = self.setup(&sources.settings)?;
        let output = self.output.check()?;
        let recordings = Recording::read(&Files {
            anchors: &sources.anchors,
            measured: &sources.measured,
            mode: sources.mode,
            truth: None,
            anchor_heights: setup.space != Space::Plane(Height::Unknown),
            truth_heights: false,
        })?;
        let heights = setup.space == Space::Plane(Height::FromTruth);
        let truths = sources.truth.as_deref().map(|file| Truths::read(file, heights)).transpose()?;
        let names = self.names.read(self.folder.as_deref())?;
        let floor_plan = self.floor_plan.read(sources.walls.as_deref())?;
        let mut notes = Vec::new();
        let mut tags = Vec::new();
        for mut recording in recordings {
            let truth = truths.as_ref().map(|truths| truths.of(recording.tag.as_deref())).transpose()?.flatten();
            let repeats = drop_repeats(&mut recording.epochs);
            let mut findings = of_rows(&recording, setup.space, repeats);
            let of = recording.tag.as_ref().map(|tag| format!("tag {}: ", names.node(tag))).unwrap_or_default();
            let mut notes_of_tag = Vec::new();
            let mut tag = self.joined(recording, truth, setup, singles, &mut notes_of_tag);
            let whole = of_whole(&tag.recording, &setup);
            findings.extend(whole.findings.iter().cloned());
            tag.whole = whole;
            let warnings = findings.iter().map(|finding| format!("warning: {}", finding.message));
            for line in warnings.chain(notes_of_tag) {
                if let Some(warning) = line.strip_prefix("warning: ") {
                    super::json::warned(&format!("{of}{warning}"));
                }
                notes.push(of.clone() + &line);
            }
            tag.findings = findings;
            tags.push(tag);
        }
        if sources.mode == MeasurementMode::Differences && self.residuals {
            return Err(UserError::flag("--residuals", "only for ranges"));
        }
        Ok(Input {
            tags,
            mode: sources.mode,
            setup,
            weighting: sources.settings.nlos.unwrap_or_default(),
            source: sources.measured.display().to_string(),
            names,
            floor_plan,
            with_errors: truths.is_some(),
            residuals: self.residuals,
            strict: self.strict,
            truths: truths.filter(|_| self.residuals),
            notes,
            output,
        })
    }

    /// A tag's recording in rounds, with its true positions. Lines for the user go to `notes`.
    fn joined(
        &self,
        mut recording: Recording,
        truth: Option<&Truth>,
        setup: Setup,
        singles: SingleRanges,
        notes: &mut Vec<String>,
    ) -> OfTag {
        let usual_s = round_s(&recording.epochs);
        let longest_s = singles.longest_s(self.group_s, &recording.epochs);
        let of_rounds = |recording: &Recording, longest_s| Recording {
            tag: recording.tag.clone(),
            anchors: recording.anchors.clone(),
            epochs: rounds(&recording.epochs, longest_s),
        };
        if let Some(longest_s) = longest_s {
            recording = of_rounds(&recording, longest_s);
            if self.group_s.is_none() {
                notes.push(format!("single ranges are made into rounds of at most {longest_s:.3} s (see --group-s)"));
            }
        }
        let offset_s = truth.and_then(|truth| {
            let offset_s = match (self.time_offset_s, longest_s, usual_s) {
                (TimeOffset::Seconds(offset_s), _, _) => offset_s,
                // The offset comes from fixes, which single ranges do not make.
                (TimeOffset::Auto, None, Some(usual_s)) => {
                    offset_s(clocks(&of_rounds(&recording, usual_s), setup, truth), notes)
                }
                (TimeOffset::Auto, _, _) => offset_s(clocks(&recording, setup, truth), notes),
            };
            let joined = truth.join(&mut recording.epochs, offset_s);
            if joined == Joined::ByEpochDespiteTimes {
                notes.push("the truth has no time in common with the ranges: joined by epoch".to_owned());
            }
            if recording.epochs.iter().all(|epoch| epoch.truth.is_none()) {
                notes.push(format!("warning: {}", advice::without_truth(&recording.epochs, truth)));
            }
            (joined == Joined::ByTime).then_some(offset_s)
        });
        OfTag { recording, offset_s, findings: Vec::new(), whole: Whole::default() }
    }
}

/// The files of a recording, and its settings.
struct Sources {
    anchors: PathBuf,
    mode: MeasurementMode,
    measured: PathBuf,
    truth: Option<PathBuf>,
    walls: Option<PathBuf>,
    settings: RecordingSettings,
}

/// The offset of the truth's clock, seconds. Adds a line about it to the notes.
fn offset_s(clocks: Clocks, notes: &mut Vec<String>) -> f64 {
    let found = match clocks {
        Clocks::Differ { offset_s, deviation_s } => {
            format!("{offset_s:.3} ± {deviation_s:.3} s is added to the times of the truth")
        }
        Clocks::Agree { deviation_s } => format!("0 s: the clocks agree, ± {deviation_s:.3} s"),
        Clocks::Vague { offset_s, deviation_s } => {
            format!("0 s: the tag moves too little to be sure of {offset_s:.2} ± {deviation_s:.2} s")
        }
        Clocks::Unknown => "0 s: the tag rests, or too few positions have a time and a truth".to_owned(),
        Clocks::NoneFits => format!("0 s: none within {REACH_S} s fits"),
    };
    notes.push(format!("time offset: {found}"));
    clocks.offset_s()
}

/// The recordings of all tags, the settings for solving them, and the destination of the report.
pub struct Input<'a> {
    /// One a tag.
    pub tags: Vec<OfTag>,
    /// What was measured.
    pub mode: MeasurementMode,
    pub setup: Setup,
    /// How the tags used the powers of receptions.
    pub weighting: Weighting,
    /// The file of what was measured.
    source: String,
    names: SiteNames,
    floor_plan: FloorPlan,
    /// Whether there is a truth.
    with_errors: bool,
    residuals: bool,
    strict: bool,
    /// The truth, where residuals need it.
    truths: Option<Truths>,
    /// Lines for the user.
    notes: Vec<String>,
    output: Output<'a>,
}

/// The recording of a tag.
pub struct OfTag {
    pub recording: Recording,
    /// What was added to the times of the truth, seconds; `None` where it was joined by the epochs' names, or there is
    /// none.
    offset_s: Option<f64>,
    /// What is odd about it.
    findings: Vec<Finding>,
    /// What the whole of it says.
    whole: Whole,
}

impl Input<'_> {
    /// Reports positions: for each tag, those of its epochs by each method.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn report(&self, methods: Vec<String>, mut solved: Vec<Vec<Vec<Solved>>>) -> Result<()> {
        for (of, solved) in self.tags.iter().zip(&mut solved) {
            solved.iter_mut().for_each(|by_method| of.whole.widen(by_method));
        }
        let tags = self.tags.iter().zip(&solved).map(|(of, solved)| self.tag_report(of, solved));
        let tags = tags.collect::<Result<Vec<_>, UserError>>()?;
        let anchors = self.tags.first().map_or(&[][..], |of| &of.recording.anchors);
        let report = Report {
            methods,
            site: Site {
                source: self.source.clone(),
                names: self.names.clone(),
                anchors: anchors.iter().map(|anchor| (anchor.name.clone(), flat(&anchor.place))).collect(),
                floor_plan: self.floor_plan.clone(),
                ..Site::default()
            },
            with_errors: self.with_errors,
            height: self.setup.space.height(),
            neighbours: None,
            tags,
        };
        report.write(&self.output)?;
        if !self.output.is_json() {
            self.print_residuals(&report);
        }
        for line in &self.notes {
            super::note(&format!("{line}\n"));
        }
        let found = self.tags.iter().map(|of| of.findings.len()).sum();
        if self.strict {
            super::check::refuse(found)?;
        }
        let in_space = matches!(self.setup.space, Space::Full(_));
        let why = advice::nothing_solved(solved.iter().flatten().flatten(), "anchors", in_space);
        super::report::some_position(why)
    }

    fn tag_report<'a>(&self, of: &'a OfTag, solved: &'a [Vec<Solved>]) -> Result<TagReport<'a>, UserError> {
        let OfTag { recording: Recording { tag, anchors, epochs }, offset_s, findings, whole: _ } = of;
        let against = |reference| residuals(anchors, epochs, &self.setup, reference);
        let truth = self.truths.as_ref().map(|truths| truths.of(tag.as_deref())).transpose()?.flatten();
        let residuals = self.residuals.then(|| match truth {
            Some(truth) => vec![against(Reference::Truth(truth, offset_s.unwrap_or(0.0))); solved.len()],
            None => solved.iter().map(|solved| against(Reference::Solved(solved))).collect(),
        });
        let findings = Some(findings.as_slice());
        Ok(TagReport { tag: tag.as_deref(), epochs, solved, time_offset_s: *offset_s, residuals, findings })
    }

    fn print_residuals(&self, report: &Report) {
        for of in &report.tags {
            let residuals = of.residuals.iter().flatten().zip(&report.methods);
            // Residuals against the truth are the same for all methods.
            for (anchors, method) in residuals.take(if self.with_errors { 1 } else { usize::MAX }) {
                let against = if self.with_errors { "the truth" } else { method };
                let tag = of.tag.map_or_else(String::new, |tag| format!(" of tag {}", self.names.node(tag)));
                super::note(&format!(
                    "\nresiduals of the ranges{tag} against {against}:\n{}",
                    table(anchors, &self.names)
                ));
            }
        }
    }
}
