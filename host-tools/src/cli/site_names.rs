//! `--site`: the names of nodes, beacons and rooms.

use std::path::{Path, PathBuf};

use node_link::provision::{SITE, SiteNames};
use node_link::recorder::folders;
use recording::UserError;

/// The argument of a command that shows names.
#[derive(Clone, Debug, clap::Args)]
pub struct SiteNamesArgs {
    /// The names of nodes, beacons and rooms, which people read in place of addresses: the file that provision reads
    /// [default: site.toml in the folder of a recording]
    #[arg(long, value_name = "FILE")]
    site: Option<PathBuf>,
}

impl SiteNamesArgs {
    /// The names of the flag's file, or else of the folder's, where the input is the folder of a recording.
    ///
    /// # Errors
    /// The file is wrong.
    pub fn read(&self, input: Option<&Path>) -> Result<SiteNames, UserError> {
        let parts = input.filter(|input| input.is_dir()).map(folders);
        // All parts of a recording have the same.
        let of_folder = parts.and_then(|parts| parts.first().map(|part| part.join(SITE))).filter(|file| file.is_file());
        self.site.clone().or(of_folder).map_or_else(|| Ok(SiteNames::default()), |file| SiteNames::read(&file))
    }
}
