//! The shape of the sources: lines by purpose, names that are used too often, long functions and long files, and the
//! manifests' switches for tests. Each is held to its budget in [`budgets`].

mod budgets;
mod manifests;
mod source;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::{printed, root};
use budgets::{Budget, CratePurpose};

/// The arguments of `cargo xtask shape`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Also list what is long or used too often where it is within its budget
    #[arg(long)]
    list: bool,
}

/// A Rust file of the repository.
struct File {
    /// Its path from the root, with slashes.
    path: String,
    text: String,
    bare: String,
    /// For each line whether it is of a test.
    is_test: Vec<bool>,
}

impl File {
    fn read(path: &str) -> Result<Self> {
        let text = fs::read_to_string(root().join(path)).with_context(|| format!("cannot read {path}"))?;
        let bare = source::bare(&text);
        let mut is_test = source::tests(&bare);
        if is_of_tests(path) {
            is_test.fill(true);
        }
        Ok(Self { path: path.to_owned(), text, bare, is_test })
    }

    /// Whether a line, from 0, is of the product.
    fn is_product(&self, line: usize) -> bool {
        !self.is_test.get(line).copied().unwrap_or(true)
    }

    /// The number of lines of code without tests.
    fn code(&self) -> usize {
        let lines = self.bare.lines().enumerate();
        lines.filter(|(line, text)| self.is_product(*line) && !text.trim().is_empty()).count()
    }

    /// The number of all lines without those of tests.
    fn lines_without_tests(&self) -> usize {
        self.text.lines().enumerate().filter(|(line, _)| self.is_product(*line)).count()
    }

    fn purpose(&self) -> Option<CratePurpose> {
        let fitting = budgets::PURPOSES.iter().filter(|(folder, _)| self.path.starts_with(folder));
        fitting.max_by_key(|(folder, _)| folder.len()).map(|(_, purpose)| *purpose)
    }
}

/// Whether all of a file is tests.
fn is_of_tests(path: &str) -> bool {
    let parts: Vec<_> = path.split('/').collect();
    let name = parts.last().copied().unwrap_or_default();
    parts.contains(&"tests") || name == "tests.rs" || name.ends_with("_tests.rs") || name.starts_with("testing")
}

/// Measures, prints, and compares with the budgets.
///
/// # Errors
/// A budget is exceeded, a folder has no purpose, or a manifest switches tests off that are there.
pub fn run(&Arguments { list: lists_all }: &Arguments) -> Result<()> {
    let mut list = Command::new("git");
    list.args(["ls-files", "--cached", "--others", "--exclude-standard", "*.rs"]).current_dir(root());
    let names = printed(&mut list)?;
    // A file that is deleted, but not committed, is still listed.
    let files: Vec<_> =
        names.lines().filter(|name| root().join(name).is_file()).map(File::read).collect::<Result<_>>()?;
    let mut wrong = Vec::new();
    println!("{:>7} {:>7} {:>7}", "is", "budget", "reach");
    for (purpose, budget) in budgets::LINES {
        let code = files.iter().filter(|file| file.purpose() == Some(purpose) && is_source(&file.path));
        wrong.extend(compare(budget, code.map(File::code).sum(), &[], lists_all));
    }
    let strangers = files.iter().filter(|file| file.purpose().is_none());
    wrong.extend(strangers.map(|file| format!("{}: its folder has no purpose in shape/budgets.rs", file.path)));
    let types = type_names(&files);
    wrong.extend(compare(budgets::TYPE_NAMES, types.len(), &types, lists_all));
    let modules = module_names(&files);
    wrong.extend(compare(budgets::MODULE_NAMES, modules.len(), &modules, lists_all));
    let functions = long_functions(&files);
    wrong.extend(compare(budgets::FUNCTIONS, functions.len(), &functions, lists_all));
    let long = files.iter().map(|file| (file, file.lines_without_tests()));
    let long = long.filter(|(_, lines)| *lines > budgets::MOST_LINES_OF_FILE);
    let long: Vec<_> = long.map(|(file, lines)| format!("{}: {lines} lines", file.path)).collect();
    wrong.extend(compare(budgets::FILES, long.len(), &long, lists_all));
    wrong.extend(manifests::wrong(&files)?);
    if !wrong.is_empty() {
        bail!("the sources are out of shape:\n{}", wrong.join("\n"));
    }
    Ok(())
}

/// Whether a file is a source of a program or library: no bench, no example.
fn is_source(path: &str) -> bool {
    path.contains("/src/") || path.ends_with("/build.rs")
}

/// Prints what is measured, and what it consists of where that is too much or asked for. A line where it is too much.
fn compare(budget: Budget, is: usize, items: &[String], lists_all: bool) -> Option<String> {
    let Budget { what, most, reach } = budget;
    println!("{is:7} {most:7} {reach:7}  {what}");
    if is > most || lists_all {
        items.iter().for_each(|item| println!("{:25}{item}", ""));
    }
    (is > most).then(|| format!("{what}: {is} are more than {most}, the budget in xtask/src/shape/budgets.rs"))
}

/// The package of a file, as a folder, and the path of its source in it.
fn within_package(path: &str) -> Option<(&str, &str)> {
    path.split_once("/src/")
}

/// The names of public types that more than two types bear. Boards are never linked together: what all of them have is
/// counted once.
fn type_names(files: &[File]) -> Vec<String> {
    let mut places: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for file in files {
        let types = source::public_types(&file.bare);
        for (name, line) in types.into_iter().filter(|(_, line)| file.is_product(*line)) {
            let place =
                if file.path.starts_with("boards/") { "boards".to_owned() } else { format!("{}:{line}", file.path) };
            places.entry(name).or_default().insert(place);
        }
    }
    places.retain(|name, places| places.len() > 2 && !budgets::COMMON_TYPE_NAMES.contains(name));
    let mut names: Vec<_> = places.into_iter().map(|(name, places)| (places.len(), name)).collect();
    names.sort_by_key(|(count, name)| (std::cmp::Reverse(*count), *name));
    names.into_iter().map(|(count, name)| format!("{name} {count}")).collect()
}

/// The names of modules that stand in more than two rooms.
fn module_names(files: &[File]) -> Vec<String> {
    let mut rooms: BTreeMap<&str, BTreeSet<(&str, &str)>> = BTreeMap::new();
    let is_counted = |file: &&File| !is_of_tests(&file.path) && file.purpose() != Some(CratePurpose::Tools);
    for file in files.iter().filter(is_counted) {
        let Some((package, inner)) = within_package(&file.path) else { continue };
        let package = if package.starts_with("boards/") { "boards" } else { package };
        let mut modules: Vec<_> = inner.trim_end_matches(".rs").split('/').collect();
        if modules[0] == "bin" || budgets::COMMANDS.contains(&modules[0]) {
            continue;
        }
        modules.retain(|module| !["mod", "lib", "main"].contains(module));
        for (depth, module) in modules.iter().enumerate() {
            rooms.entry(module).or_default().insert((package, if depth == 0 { "" } else { modules[0] }));
        }
    }
    rooms.retain(|name, _| !budgets::SHARED_MODULE_NAMES.contains(name));
    let many = rooms.into_iter().filter(|(_, rooms)| rooms.len() > 2);
    let shown = |(package, room): &(&str, &str)| {
        if room.is_empty() { (*package).to_owned() } else { format!("{package}/{room}") }
    };
    many.map(|(name, rooms)| format!("{name}: {}", rooms.iter().map(shown).collect::<Vec<_>>().join(", "))).collect()
}

/// Functions that are too long.
fn long_functions(files: &[File]) -> Vec<String> {
    let mut found = Vec::new();
    for file in files {
        for (name, line, lines) in source::functions(&file.bare) {
            let is_wiring = budgets::WIRING.contains(&(file.path.as_str(), name));
            if file.is_product(line) && lines > budgets::MOST_LINES && !is_wiring {
                found.push(format!("{}:{}: {name}, {lines} lines", file.path, line + 1));
            }
        }
    }
    found
}
