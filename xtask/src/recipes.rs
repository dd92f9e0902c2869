//! Recipes of docs/build/extend.md, proven: each patch in examples/recipes follows one. It must apply to the sources as they
//! are, touch no more files than its first lines say, and build. Where it touches the station, the committed description
//! of the API must be that of the code, and the types of the page must fit.

use std::env::consts::EXE_EXTENSION;
use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

use crate::toolchain::is_installed;
use crate::{cargo, printed, root, succeed, target_directory};

/// The folder of the patches.
const FOLDER: &str = "examples/recipes/";
/// The folder of the station.
const STATION: &str = "station/";

/// What a patch says of itself.
#[derive(Debug, PartialEq, Eq)]
struct Recipe<'a> {
    /// The packages that must build with it, by cargo's names.
    packages: Vec<&'a str>,
    /// What it adds.
    title: &'a str,
    /// How many files it may touch.
    most_files: usize,
}

impl<'a> Recipe<'a> {
    /// Reads the first two lines: `Packages: baliza-wire host-tools` and `Recipe: a telemetry message, at most 5 files`.
    fn parse(patch: &'a str) -> Option<Self> {
        let mut lines = patch.lines();
        let packages: Vec<_> = lines.next()?.strip_prefix("Packages: ")?.split_whitespace().collect();
        let (title, files) = lines.next()?.strip_prefix("Recipe: ")?.split_once(", at most ")?;
        let most_files = files.strip_suffix(" files")?.parse().ok()?;
        (!packages.is_empty()).then_some(Self { packages, title, most_files })
    }
}

/// Applies each patch to a copy of the sources, one at a time, and builds its packages.
///
/// # Errors
/// There is no patch, or one does not prove its recipe.
pub fn run() -> Result<()> {
    let mut list = Command::new("git");
    list.args(["ls-files", "--cached", "--others", "--exclude-standard"]).current_dir(root());
    let sources = printed(&mut list)?;
    // A file that is deleted, but not committed, is still listed.
    let sources: Vec<_> = sources.lines().filter(|source| root().join(source).is_file()).collect();
    let tree = target_directory().join("recipes");
    copy(&sources, &tree)?;
    let is_patch = |source: &&&str| source.starts_with(FOLDER) && source.ends_with(".patch");
    let patches: Vec<_> = sources.iter().filter(is_patch).collect();
    ensure!(!patches.is_empty(), "{FOLDER} has no patch");
    let mut wrong = Vec::new();
    for patch in &patches {
        match prove(patch, &tree) {
            Ok(proven) => println!("{patch}: {proven}"),
            Err(error) => wrong.push(format!("{patch}: {error:#}")),
        }
    }
    if !wrong.is_empty() {
        bail!("{} of {} recipes are not proven:\n{}", wrong.len(), patches.len(), wrong.join("\n"));
    }
    Ok(())
}

/// Copies the sources to a folder without other files. As the files are new, cargo builds nothing from an earlier copy.
fn copy(sources: &[&str], tree: &Path) -> Result<()> {
    match fs::remove_dir_all(tree) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            return Err(error).with_context(|| format!("cannot remove {}", tree.display()));
        }
        Ok(()) | Err(_) => {}
    }
    for source in sources {
        let file = tree.join(source);
        let copied =
            file.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::copy(root().join(source), &file));
        copied.with_context(|| format!("cannot make {}", file.display()))?;
    }
    Ok(())
}

/// Applies a patch, builds its packages, and takes it back. Returns what it adds and how many files that takes.
///
/// # Errors
/// The patch has no head, touches too many files, does not apply, or does not build.
fn prove(patch: &str, tree: &Path) -> Result<String> {
    let file = root().join(patch);
    let text = fs::read_to_string(&file)?;
    let Recipe { packages, title, most_files } = Recipe::parse(&text)
        .context("its first lines must be `Packages: NAME …` and `Recipe: what it adds, at most N files`")?;
    let apply = |option: &[&str]| {
        let mut command = Command::new("git");
        // The copy is no repository; git must not take it for a folder of this one.
        command.env("GIT_CEILING_DIRECTORIES", target_directory()).current_dir(tree);
        command.arg("apply").args(option).arg(&file);
        command
    };
    let touched = printed(&mut apply(&["--numstat"]))?;
    let touched: Vec<_> = touched.lines().filter_map(|line| line.split('\t').next_back()).collect();
    ensure!(
        touched.len() <= most_files,
        "{title} takes {} files instead of {most_files}: {}. Simplify what it extends, or change its number there and \
         in docs/build/extend.md",
        touched.len(),
        touched.join(", ")
    );
    succeed(&mut apply(&[])).context("it does not apply: follow the recipe again, and keep its `git diff`")?;
    let mut check = cargo();
    // Third-party crates are those of the lints' step. The copy's own packages have other paths than the repository's,
    // so neither replaces the other's.
    check.current_dir(tree).args(["check", "--quiet", "--locked", "--target-dir"]).arg(target_directory());
    check.args(packages.iter().flat_map(|package| ["--package", package]));
    let built =
        succeed(&mut check).with_context(|| format!("with it {} do not build: correct it", packages.join(", ")));
    let is_of_station = touched.iter().any(|file| file.starts_with(STATION));
    let also = built.and_then(|()| if is_of_station { check_station(tree) } else { Ok("") });
    succeed(&mut apply(&["--reverse"]))?;
    Ok(format!("{title} takes {} of at most {most_files} files, and builds{}", touched.len(), also?))
}

/// Compares the description of the station's API with the code, and checks the types of the page, which are made of it.
/// Returns what was checked.
fn check_station(tree: &Path) -> Result<&'static str> {
    let (file, example) = ("station/openapi.json", "openapi");
    let mut build = cargo();
    // With the features of the whole workspace: third-party crates are those of the tests' step.
    build.current_dir(tree).args(["build", "--quiet", "--locked", "--workspace", "--example", example]);
    succeed(build.arg("--target-dir").arg(target_directory()))?;
    let program = target_directory().join("debug/examples").join(example).with_extension(EXE_EXTENSION);
    let described = printed(&mut Command::new(program))?;
    ensure!(described == fs::read_to_string(tree.join(file))?, "{file} is not what the code describes: make it anew");
    if !is_installed("npm") {
        return Ok("; the types of the page are not checked, as there is no npm");
    }
    let npm = |arguments: &[&str]| succeed(Command::new("npm").args(arguments).current_dir(tree.join("station/web")));
    npm(&["ci", "--silent", "--no-audit", "--no-fund"])?;
    npm(&["run", "--silent", "check"]).context("the types of the page do not fit")?;
    Ok(", and the types of the page fit")
}

#[cfg(test)]
mod tests {
    use super::Recipe;

    #[test]
    fn a_patch_names_packages_and_the_number_of_files() {
        let patch =
            "Packages: baliza-wire host-tools\nRecipe: a telemetry message, at most 5 files\n\ndiff --git a/x b/x\n";
        let recipe =
            Recipe { packages: vec!["baliza-wire", "host-tools"], title: "a telemetry message", most_files: 5 };
        assert_eq!(Recipe::parse(patch), Some(recipe));
    }

    #[test]
    fn a_patch_without_packages_or_number_is_refused() {
        for head in
            ["diff --git a/x b/x\n", "Packages: \nRecipe: a, at most 5 files\n", "Packages: wire\nRecipe: a route\n"]
        {
            assert_eq!(Recipe::parse(head), None, "{head}");
        }
    }
}
