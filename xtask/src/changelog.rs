//! `cargo xtask changelog --version X.Y.Z --date YYYY-MM-DD`: the fragments of the folder `changes`, one a change, become
//! the list of a release in CHANGELOG.md, and are removed. A fragment `NAME.KIND.md` holds the text of one list item.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use crate::root;

/// The heading under which changes without a version stand.
const UNRELEASED: &str = "## [Unreleased]\n";
/// The lists of a release, in their order, after Keep a Changelog.
const KINDS: [&str; 6] = ["Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"];

#[derive(clap::Args)]
pub struct Arguments {
    /// The version of the release: three numbers
    #[arg(long, value_parser = version)]
    version: String,
    /// The day of the release: YYYY-MM-DD
    #[arg(long, value_parser = date)]
    date: String,
}

/// A change: its file, the index of its list in [`KINDS`], and its list item.
struct Fragment {
    path: PathBuf,
    kind: usize,
    item: String,
}

/// Joins the fragments into CHANGELOG.md and removes them.
///
/// # Errors
/// A fragment is malformed, the changelog has the version or no list for it, or a file cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let count = join(root(), &arguments.version, &arguments.date)?;
    println!("CHANGELOG.md: version {}, with {count} changes of changes/", arguments.version);
    Ok(())
}

fn join(root: &Path, version: &str, date: &str) -> Result<usize> {
    let (path, fragments) = (root.join("CHANGELOG.md"), fragments(&root.join("changes"))?);
    let changelog = fs::read_to_string(&path).context("CHANGELOG.md")?;
    fs::write(&path, released(&changelog, &fragments, version, date)?)?;
    for fragment in &fragments {
        fs::remove_file(&fragment.path).with_context(|| fragment.path.display().to_string())?;
    }
    Ok(fragments.len())
}

/// The fragments of a folder, by their names. Its README.md is none.
fn fragments(folder: &Path) -> Result<Vec<Fragment>> {
    let entries = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    paths.retain(|path| !path.ends_with("README.md"));
    paths.sort();
    paths.into_iter().map(|path| Fragment::read(&path).with_context(|| path.display().to_string())).collect()
}

impl Fragment {
    fn read(path: &Path) -> Result<Self> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let kind = name.strip_suffix(".md").and_then(|name| name.rsplit_once('.')).map(|(_, kind)| kind);
        let is_it = |known: &&str| kind.is_some_and(|kind| known.to_lowercase() == kind);
        let kind = KINDS.iter().position(is_it);
        let kind =
            kind.with_context(|| format!("not NAME.KIND.md with a KIND of {}", KINDS.join(", ").to_lowercase()))?;
        let text = fs::read_to_string(path)?;
        let text = text.trim();
        ensure!(!text.is_empty(), "it is empty");
        ensure!(
            !text.starts_with(['-', '*', '#']),
            "it begins with a mark of a list or heading: write the sentence alone"
        );
        Ok(Self { path: path.to_owned(), kind, item: format!("- {}\n", text.replace('\n', "\n  ")) })
    }
}

/// The changelog with the unreleased changes and the fragments as those of a version.
fn released(changelog: &str, fragments: &[Fragment], version: &str, date: &str) -> Result<String> {
    ensure!(!changelog.contains(&format!("\n## [{version}]")), "CHANGELOG.md has version {version} already");
    let (before, rest) = changelog.split_once(UNRELEASED).context("CHANGELOG.md has no ## [Unreleased]")?;
    let (open, after) = rest.split_at(rest.find("\n## ").map_or(rest.len(), |at| at + 1));
    let mut lists = KINDS.map(|_| String::new());
    for part in open.split("### ").skip(1) {
        let (heading, items) = part.split_once('\n').unwrap_or((part, ""));
        let Some(kind) = KINDS.iter().position(|kind| *kind == heading) else { bail!("CHANGELOG.md: ### {heading}?") };
        lists[kind] = format!("{}\n", items.trim());
    }
    fragments.iter().for_each(|fragment| lists[fragment.kind].push_str(&fragment.item));
    let lists = KINDS.iter().zip(lists).filter(|(_, list)| !list.is_empty());
    let lists: String = lists.map(|(kind, list)| format!("\n### {kind}\n{list}")).collect();
    ensure!(!lists.is_empty(), "there are no changes");
    let gap = if after.is_empty() { "" } else { "\n" };
    Ok(format!("{before}{UNRELEASED}\n## [{version}] - {date}\n{lists}{gap}{after}"))
}

/// Whether a text is numbers of these lengths between marks; a length of zero is any.
fn is_numbers(text: &str, mark: char, lengths: [usize; 3]) -> bool {
    let parts: Vec<&str> = text.split(mark).collect();
    let is_number = |(part, length): (&&str, usize)| part.parse::<u32>().is_ok() && [0, part.len()].contains(&length);
    parts.len() == lengths.len() && parts.iter().zip(lengths).all(is_number)
}

fn version(text: &str) -> Result<String> {
    ensure!(is_numbers(text, '.', [0; 3]), "not three numbers, as 1.2.3");
    Ok(text.to_owned())
}

fn date(text: &str) -> Result<String> {
    ensure!(is_numbers(text, '-', [4, 2, 2]), "not YYYY-MM-DD");
    Ok(text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        fs::create_dir(folder.path().join("changes")).expect("a folder");
        for (name, text) in files {
            fs::write(folder.path().join(name), text).expect("a file");
        }
        folder
    }

    const OLD: &str =
        "# Changelog\n\n## [Unreleased]\n\n### Fixed\n- Old.\n\n## [0.1.0] - 2026-01-01\n\n### Added\n- All.\n";

    #[test]
    fn fragments_become_the_lists_of_a_version_and_are_removed() {
        let folder = folder(&[
            ("CHANGELOG.md", OLD),
            ("changes/README.md", "How.\n"),
            ("changes/b.fixed.md", "New,\nin two lines.\n"),
            ("changes/a.added.md", "`x`: new.\n"),
        ]);
        assert_eq!(join(folder.path(), "0.2.0", "2026-02-03").expect("joined"), 2);
        let expected = "# Changelog\n\n## [Unreleased]\n\n## [0.2.0] - 2026-02-03\n\n### Added\n- `x`: new.\n\n\
             ### Fixed\n- Old.\n- New,\n  in two lines.\n\n## [0.1.0] - 2026-01-01\n\n### Added\n- All.\n";
        assert_eq!(fs::read_to_string(folder.path().join("CHANGELOG.md")).expect("it is there"), expected);
        let left: Vec<_> = fs::read_dir(folder.path().join("changes")).expect("it is there").collect();
        assert_eq!(left.len(), 1);
        let again = join(folder.path(), "0.2.0", "2026-02-03").expect_err("it is there already");
        assert_eq!(again.to_string(), "CHANGELOG.md has version 0.2.0 already");
        let nothing = join(folder.path(), "0.3.0", "2026-02-03").expect_err("nothing has changed");
        assert_eq!(nothing.to_string(), "there are no changes");
    }

    #[test]
    fn a_malformed_fragment_is_named_and_nothing_is_changed() {
        for (name, text, expected) in [
            ("changes/new.md", "Text.\n", "NAME.KIND.md"),
            ("changes/x.better.md", "Text.\n", "NAME.KIND.md"),
            ("changes/x.added.txt", "Text.\n", "NAME.KIND.md"),
            ("changes/x.added.md", " \n", "empty"),
            ("changes/x.added.md", "- Text.\n", "a mark of a list"),
        ] {
            let folder = folder(&[("CHANGELOG.md", OLD), (name, text)]);
            let error = format!("{:#}", join(folder.path(), "0.2.0", "2026-02-03").expect_err(name));
            assert!(error.contains(name) && error.contains(expected), "{error}");
            assert_eq!(fs::read_to_string(folder.path().join("CHANGELOG.md")).expect("it is there"), OLD);
        }
    }

    #[test]
    fn versions_and_dates_are_numbers() {
        assert!(version("1.20.3").is_ok() && date("2026-02-03").is_ok());
        assert!(version("1.2").is_err() && version("v1.2.3").is_err() && date("3.2.2026").is_err());
    }

    #[test]
    fn the_fragments_of_the_project_can_be_joined() {
        let fragments = fragments(&root().join("changes")).expect("the fragments");
        let text = released(OLD, &fragments, "0.2.0", "2026-02-03").expect("a release");
        assert!(fragments.iter().all(|fragment| text.contains(&fragment.item)));
    }
}
