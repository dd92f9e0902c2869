//! `baliza station export`: a part of the history as the folder of a recording, as GPX or as MCAP.

use std::path::{Path, PathBuf};

use crate::{Exported, Selection, is_of_export, write_folder, write_gpx};
use anyhow::{Context, Result};
use clap::ValueEnum;
use recording::UserError;
use recording::output::{self, Growing, OutputFolder};
use station_core::store::Span;
use station_core::{Store, Utc};

/// Write a part of the history: as a folder that other commands read, as GPX for maps, or as MCAP for Foxglove
///
/// A folder gets positions.csv, walls.csv and outlines.csv: `baliza plot FOLDER` draws it, and `baliza classify-rooms
/// --positions FOLDER/positions.csv --outlines FOLDER/outlines.csv` finds the rooms again. The column t_s is in seconds
/// since 1970-01-01T00:00:00Z. The store has no ranges, so there is nothing for solve and track; `baliza record` writes
/// those. GPX has a track for each tag, and needs the site's geographic origin; MCAP has the topics of `baliza
/// convert`.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza station export --out everything\n  \
                        baliza station export --from 2026-11-22T08:00:00Z --to 2026-11-22T09:00:00Z --out morning\n  \
                        baliza station export --format gpx --tag 0x1001 --out trolley.gpx\n  \
                        baliza station export --format mcap --out everything.mcap")]
pub struct Arguments {
    /// The station's store: a SQLite file, or postgres://USER:PASSWORD@HOST/DATABASE
    #[arg(long, value_name = "FILE|URL", default_value = "baliza.db")]
    store: String,
    /// The first instant, in RFC 3339 [default: that of the first position]
    #[arg(long, value_name = "TIME")]
    from: Option<Utc>,
    /// The instant after the last one, in RFC 3339 [default: after the last position]
    #[arg(long, value_name = "TIME")]
    to: Option<Utc>,
    /// The site [default: the only one that has tags]
    #[arg(long, value_name = "NAME")]
    site: Option<String>,
    /// Only this tag
    #[arg(long, value_name = "TAG")]
    tag: Option<String>,
    /// What to write
    #[arg(long, value_name = "FORMAT", default_value = "folder")]
    format: Format,
    /// The folder or the file to write to
    #[arg(long, value_name = "FOLDER|FILE")]
    out: PathBuf,
    /// Replace the files of an earlier run in the folder
    #[arg(long)]
    force: bool,
}

/// `--format`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// A recording's folder
    Folder,
    /// A file with tracks in GPX 1.1
    Gpx,
    /// A file in MCAP, not compressed
    Mcap,
}

/// Runs `baliza station export`.
///
/// # Errors
/// The store cannot be read, it has no such positions, or the folder or the file cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { store, from, to, site, tag, format, out, force } = arguments;
    let span = Span { from: from.unwrap_or_default(), to: to.unwrap_or(Utc::clamped(i64::MAX)) };
    if span.from >= span.to {
        return Err(UserError::flag("--to", "it must be later than --from").into());
    }
    let output = Output::begin(*format, out, *force)?;
    let exported = super::run_to_end(async {
        let store = Store::open_existing(store).await.map_err(super::unusable)?;
        let exported = async {
            let selection = Selection::of(&store, site.as_deref(), tag.as_deref(), span).await?;
            output.write(&store, &selection, out).await
        };
        let exported = exported.await;
        store.close().await;
        exported
    })?;
    let Exported { site, tags, positions, measurements, left_out } = exported;
    let measurements = if measurements > 0 { format!(" and {measurements} measurements") } else { String::new() };
    host_tools::cli::note(&format!(
        "{positions} positions{measurements} of {tags} tags of {site}, in {}\n",
        out.display()
    ));
    for (node, count) in left_out {
        let why = "the store does not have its place: name it in the file of serve --site";
        host_tools::cli::note(&format!("{count} measurements to {node} are left out: {why}\n"));
    }
    Ok(())
}

/// Where an export goes to. What is not finished leaves nothing.
enum Output {
    Folder(OutputFolder),
    Gpx(Growing),
    #[cfg(feature = "foxglove")]
    Mcap(Growing),
}

impl Output {
    fn begin(format: Format, out: &Path, force: bool) -> Result<Self> {
        if format == Format::Folder {
            return Ok(Self::Folder(OutputFolder::begin("--out", out, is_of_export, force)?));
        }
        output::check("--out", out)?;
        #[cfg(not(feature = "foxglove"))]
        if format == Format::Mcap {
            anyhow::bail!("this baliza was built without its feature foxglove");
        }
        let file = Growing::create(out).with_context(|| cannot_write(out))?;
        #[cfg(feature = "foxglove")]
        if format == Format::Mcap {
            return Ok(Self::Mcap(file));
        }
        Ok(Self::Gpx(file))
    }

    async fn write(self, store: &Store, selection: &Selection, out: &Path) -> Result<Exported> {
        let (exported, written) = match self {
            Self::Folder(folder) => (write_folder(store, selection, folder.path()).await?, folder.finish()),
            Self::Gpx(file) => {
                let (exported, file) = write_gpx(store, selection, file).await?;
                (exported, file.finish())
            }
            #[cfg(feature = "foxglove")]
            Self::Mcap(file) => {
                let (exported, file) = crate::write_mcap(store, selection, file).await?;
                (exported, file.finish())
            }
        };
        written.with_context(|| cannot_write(out))?;
        Ok(exported)
    }
}

fn cannot_write(out: &Path) -> String {
    format!("cannot write {}", out.display())
}
