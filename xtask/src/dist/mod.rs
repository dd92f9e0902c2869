//! `cargo xtask dist`: the folder of a release. It has the images of all boards, `baliza` with completions and manual
//! pages, licences and parts lists of third-party crates, udev rules, and the SHA-256 of each file.
//!
//! Nothing of the machine or of the time goes into a file, so that equal sources make equal bytes: `--verify` builds
//! the images twice, in two folders, and compares them.

mod papers;
mod sums;
mod verify;

use std::collections::BTreeSet;
use std::env::consts::EXE_SUFFIX;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use crate::{cargo, firmware, root, succeed, target_directory, toolchain};

/// The arguments of `cargo xtask dist`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The folder of the release [default: target/dist, made again].
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Only images whose names contain this, such as `dwm1001`.
    #[arg(long, value_name = "PART")]
    images: Option<String>,
    /// Build nothing: no images, and the `baliza` that `cargo build --release` made. Continuous integration does so.
    #[arg(long, conflicts_with_all = ["images", "verify"])]
    without_builds: bool,
    /// Instead, build the images of the last commit here and in another folder, and compare their bytes.
    #[arg(long, conflicts_with = "out")]
    verify: bool,
}

/// Files of the repository that go into a release.
const COPIED: [&str; 6] =
    ["README.md", "CHANGELOG.md", "SECURITY.md", "LICENSE-MIT", "LICENSE-APACHE", "host-tools/assets/70-baliza.rules"];

/// Files of the repository that run the station as a service; they go into a folder of the release.
const DEPLOYED: [&str; 6] = [
    "deploy/baliza.service",
    "deploy/baliza.default",
    "deploy/nginx.conf",
    "deploy/grafana/postgresql.json",
    "deploy/grafana/prometheus.json",
    "docs/use/station/service.md",
];

/// Makes the folder of a release, or verifies that images can be built again.
///
/// # Errors
/// A tool is missing, a build fails, a file cannot be written, or two builds differ.
pub fn run(arguments: &Arguments) -> Result<()> {
    let filter = arguments.images.as_deref();
    if arguments.verify {
        return verify::run(filter);
    }
    papers::check_tools()?;
    let folder = folder(arguments.out.as_deref())?;
    for file in COPIED.map(Path::new) {
        copy(&root().join(file), &folder)?;
    }
    for file in DEPLOYED {
        copy(&root().join(file), &folder.join("deploy"))?;
    }
    let programs = if arguments.without_builds { built()? } else { build()? };
    for program in PROGRAMS {
        copy(&programs.join(format!("{}{EXE_SUFFIX}", program.name)), &folder.join("bin"))?;
    }
    papers::manual(&programs.join(format!("baliza{EXE_SUFFIX}")), &folder)?;
    papers::of_program(&folder)?;
    if !arguments.without_builds {
        let images = firmware::release(filter)?;
        for image in &images {
            copy(&image.elf, &folder.join("firmware"))?;
            copy(&image.flashable, &folder.join("firmware"))?;
        }
        for (package, target) in images.iter().map(|image| (&image.package, image.target)).collect::<BTreeSet<_>>() {
            papers::of_images(package, target, &folder)?;
        }
    }
    let files = sums::write(&folder)?;
    println!("{files} files and SHA256SUMS in {}", folder.display());
    Ok(())
}

/// The release's folder, empty.
fn folder(out: Option<&Path>) -> Result<PathBuf> {
    let folder = match out {
        Some(folder) => {
            let is_free = !folder.exists() || fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none());
            ensure!(is_free, "--out: {} is not empty", folder.display());
            std::path::absolute(folder)?
        }
        None => {
            let usual = target_directory().join("dist");
            if usual.exists() {
                fs::remove_dir_all(&usual).with_context(|| format!("cannot empty {}", usual.display()))?;
            }
            usual
        }
    };
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    Ok(folder)
}

/// A program of the release: its name, its package and the features that it has.
struct Program {
    name: &'static str,
    package: &'static str,
    features: &'static str,
}

/// The programs of a release. `baliza` starts the others, which lie beside it.
const PROGRAMS: [Program; 3] = [
    Program { name: "baliza", package: "host-tools", features: "defmt foxglove parquet training" },
    Program { name: "baliza-station", package: "baliza-station", features: "foxglove" },
    Program { name: "baliza-probe", package: "baliza-probe", features: "" },
];

/// Builds the programs, without the folders of this machine in their messages. Returns the folder that they are in.
fn build() -> Result<PathBuf> {
    println!("building {}", PROGRAMS.map(|program| program.name).join(", "));
    let directory = target_directory().join("dist-build");
    let mut command = cargo();
    command.args(["build", "--quiet", "--release", "--locked"]);
    for Program { package, features, .. } in PROGRAMS {
        command.args(["--package", package]);
        for feature in features.split_whitespace() {
            command.args(["--features", &format!("{package}/{feature}")]);
        }
    }
    command.arg("--target-dir").arg(&directory).env("CARGO_ENCODED_RUSTFLAGS", toolchain::remapped());
    succeed(&mut command)?;
    Ok(directory.join("release"))
}

/// The folder with the programs of an earlier `cargo build --release`.
fn built() -> Result<PathBuf> {
    let folder = target_directory().join("release");
    for Program { name, package, .. } in PROGRAMS {
        let file = folder.join(format!("{name}{EXE_SUFFIX}"));
        ensure!(file.is_file(), "there is no {}: `cargo build --release --package {package}` first", file.display());
    }
    Ok(folder)
}

/// Copies a file into a folder, which is made where it does not exist.
fn copy(file: &Path, folder: &Path) -> Result<()> {
    let name = file.file_name().with_context(|| format!("{} has no name", file.display()))?;
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    fs::copy(file, folder.join(name)).with_context(|| format!("cannot copy {}", file.display()))?;
    Ok(())
}
