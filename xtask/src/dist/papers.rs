//! The papers of a release: completions, manual pages, licences of third-party crates, and parts lists (CycloneDX).

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::toolchain::is_installed;
use crate::workspace::{self, Package};
use crate::{cargo, printed, root, succeed};

/// A shell, and the name under which it looks for completions.
const SHELLS: [(&str, &str); 3] = [("bash", "baliza"), ("zsh", "_baliza"), ("fish", "baliza.fish")];

/// The name of a parts list while cargo-cyclonedx writes one beside each manifest.
const PARTS: &str = "baliza-dist-parts";

/// Asserts that the tools are there.
///
/// # Errors
/// One is missing.
pub fn check_tools() -> Result<()> {
    for tool in ["cargo-about", "cargo-cyclonedx"] {
        ensure!(is_installed(tool), "there is no {tool} here: `cargo install --locked {tool}` installs it");
    }
    Ok(())
}

/// Writes completions and manual pages with the program itself.
///
/// # Errors
/// The program fails, or a file cannot be written.
pub fn manual(baliza: &Path, folder: &Path) -> Result<()> {
    let completions = folder.join("completions");
    fs::create_dir_all(&completions)?;
    for (shell, name) in SHELLS {
        fs::write(completions.join(name), printed(Command::new(baliza).args(["completions", shell]))?)?;
    }
    succeed(Command::new(baliza).arg("man").arg("--out").arg(folder.join("man")))
}

/// Licences and parts of the programs.
///
/// # Errors
/// A licence is not accepted, or a tool fails.
pub fn of_program(folder: &Path) -> Result<()> {
    for (package, name) in
        [("host-tools", "baliza"), ("baliza-station", "baliza-station"), ("baliza-probe", "baliza-probe")]
    {
        papers(package, name, &["--all-features"], folder)?;
    }
    Ok(())
}

/// Licences and parts of the images of a board's crate, with all of its features.
///
/// # Errors
/// As for [`of_program`].
pub fn of_images(package: &str, target: &str, folder: &Path) -> Result<()> {
    papers(package, package, &["--all-features", "--target", target], folder)
}

fn papers(package: &str, name: &str, options: &[&str], folder: &Path) -> Result<()> {
    println!("licences and parts of {name}");
    let packages = workspace::packages()?;
    let Package { manifest_path, .. } =
        packages.iter().find(|other| other.name == package).with_context(|| format!("no crate {package}"))?;
    let licences = folder.join("licences");
    fs::create_dir_all(&licences)?;
    let mut about = cargo();
    about.args(["about", "generate", "--locked", "--offline", "--fail", "--config"]).arg(root().join("about.toml"));
    about.arg("--manifest-path").arg(manifest_path).args(options);
    about.arg("--output-file").arg(licences.join(format!("{name}.txt"))).arg(root().join("about.hbs"));
    succeed(&mut about)?;

    let mut cyclonedx = cargo();
    cyclonedx.args(["cyclonedx", "--quiet", "--format", "json", "--spec-version", "1.5", "--no-build-deps"]);
    cyclonedx.arg("--manifest-path").arg(manifest_path).args(options).args(["--override-filename", PARTS]);
    // No time and no random number of its own.
    cyclonedx.env("SOURCE_DATE_EPOCH", "0");
    let done = succeed(&mut cyclonedx);
    let mut parts = Err(anyhow::anyhow!("cargo-cyclonedx wrote no parts of {package}"));
    for other in &packages {
        let file = other.manifest_path.with_file_name(format!("{PARTS}.json"));
        if other.name == package && file.is_file() {
            parts = fs::read_to_string(&file).context("parts list");
        }
        if file.is_file() {
            fs::remove_file(&file)?;
        }
    }
    done?;
    // The names of this project's own crates in the list are folders of this machine.
    let parts = parts?.replace(&format!("file://{}", root().display()), "file://");
    let file = folder.join("parts").join(format!("{name}.cdx.json"));
    fs::create_dir_all(folder.join("parts"))?;
    fs::write(&file, parts).with_context(|| format!("cannot write {}", file.display()))
}
