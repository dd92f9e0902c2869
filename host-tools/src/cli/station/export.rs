//! `baliza station export`: a part of the history as the folder of a recording.

use std::path::PathBuf;

use anyhow::{Context, Result};
use baliza_station::store::Span;
use baliza_station::{Store, Utc};
use host_tools::UserError;
use host_tools::files::output::OutputFolder;
use host_tools::station::{Exported, is_of_export};

/// Write a part of the history as a folder that other commands read
///
/// The folder gets positions.csv, walls.csv and outlines.csv: `baliza plot FOLDER` draws it, and `baliza classify-rooms
/// --positions FOLDER/positions.csv --outlines FOLDER/outlines.csv` finds the rooms again. The column t_s is in seconds
/// since 1970-01-01T00:00:00Z. The store has no ranges, so there is nothing for solve and track; `baliza record` writes
/// those.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza station export --out everything\n  \
                        baliza station export --from 2026-11-22T08:00:00Z --to 2026-11-22T09:00:00Z --out morning")]
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
    /// The folder to write to
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Replace the files of an earlier run
    #[arg(long)]
    force: bool,
}

/// Runs `baliza station export`.
///
/// # Errors
/// The store cannot be read, it has no such positions, or the folder cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { store, from, to, site, tag, out, force } = arguments;
    let span = Span { from: from.unwrap_or_default(), to: to.unwrap_or(Utc::clamped(i64::MAX)) };
    if span.from >= span.to {
        return Err(UserError::flag("--to", "it must be later than --from").into());
    }
    let output = OutputFolder::begin("--out", out, is_of_export, *force)?;
    let exported = super::run_to_end(async {
        let store = Store::open_existing(store).await.map_err(super::unusable)?;
        let exported = Exported::write(&store, site.as_deref(), tag.as_deref(), span, output.path()).await;
        store.close().await;
        exported
    })?;
    output.finish().with_context(|| format!("cannot write {}", out.display()))?;
    let Exported { site, tags, positions } = exported;
    crate::cli::note(&format!("{positions} positions of {tags} tags of {site}, in {}\n", out.display()));
    Ok(())
}
