//! The boards on the desk: one TOML file each, and the file of their site.

use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::Deserialize;

use super::{word, words};

/// The file of the site.
const SITE: &str = "site.toml";

/// A board.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardUnderTest {
    /// Its node in the site's file.
    pub node: String,
    /// What it is, in the words of `baliza provision --board`.
    pub board: String,
    pub role: RoleUnderTest,
    /// Its debug probe, `VID:PID[:SERIAL]` …
    pub probe: Option<String>,
    /// … or its serial port.
    pub port: Option<String>,
    /// Its image [default: ROLE-BOARD in target/firmware].
    pub image: Option<PathBuf>,
    /// How it is wired, for the report: what `docs/use/hardware.md` says, or otherwise.
    #[serde(default)]
    pub wiring: String,
}

/// The role of a board.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum RoleUnderTest {
    Anchor,
    Tag,
}

/// All boards.
#[derive(Clone, Debug)]
pub struct Desk {
    /// The site's file.
    pub site: PathBuf,
    pub boards: Vec<BoardUnderTest>,
}

impl Desk {
    /// Reads a folder.
    ///
    /// # Errors
    /// A file cannot be read, or is wrong.
    pub fn read(folder: &Path) -> Result<Self> {
        let site = folder.join(SITE);
        ensure!(site.is_file(), "no {}: `baliza provision --example > {SITE}` makes one", site.display());
        let entries = folder.read_dir().with_context(|| format!("cannot read {}", folder.display()))?;
        let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        files.retain(|file| file.extension().is_some_and(|ending| ending == "toml") && *file != site);
        files.sort();
        let boards = files.iter().map(|file| BoardUnderTest::read(file)).collect::<Result<Vec<_>>>()?;
        ensure!(!boards.is_empty(), "no board in {}: one TOML file each, beside {SITE}", folder.display());
        Ok(Self { site, boards })
    }

    /// The boards of a role.
    pub fn of(&self, role: RoleUnderTest) -> impl Iterator<Item = &BoardUnderTest> {
        self.boards.iter().filter(move |board| board.role == role)
    }

    /// This number of anchors.
    ///
    /// # Errors
    /// There are fewer.
    pub fn anchors(&self, count: usize) -> Result<Vec<&BoardUnderTest>> {
        let anchors: Vec<&BoardUnderTest> = self.of(RoleUnderTest::Anchor).take(count).collect();
        ensure!(anchors.len() == count, "{count} anchors are needed, {} are here", anchors.len());
        Ok(anchors)
    }

    /// The first tag.
    ///
    /// # Errors
    /// There is none.
    pub fn tag(&self) -> Result<&BoardUnderTest> {
        self.of(RoleUnderTest::Tag).next().context("a tag is needed")
    }
}

impl fmt::Display for Desk {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(out, "{} boards, site {}", self.boards.len(), self.site.display())?;
        for BoardUnderTest { node, board, role, probe, port, wiring, .. } in &self.boards {
            let at = probe.as_ref().or(port.as_ref()).map_or("the only probe", String::as_str);
            let wiring = if wiring.is_empty() { String::new() } else { format!("; {wiring}") };
            writeln!(out, "- {node}: {role:?} on {board}, at {at}{wiring}")?;
        }
        Ok(())
    }
}

impl BoardUnderTest {
    fn read(file: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
        let board: Self = toml::from_str(&text).with_context(|| file.display().to_string())?;
        match (&board.probe, &board.port) {
            (Some(_), Some(_)) => bail!("{}: either probe or port", file.display()),
            (None, Some(_)) | (Some(_), None) | (None, None) => Ok(board),
        }
    }

    /// The image's file.
    pub fn image(&self) -> PathBuf {
        let role = match self.role {
            RoleUnderTest::Anchor => "anchor",
            RoleUnderTest::Tag => "tag",
        };
        let usual = || crate::target_directory().join(format!("firmware/{role}-{}.elf", self.board));
        self.image.clone().unwrap_or_else(usual)
    }

    fn probe_words(&self) -> Vec<String> {
        self.probe.iter().flat_map(|probe| ["--probe".to_owned(), probe.clone()]).collect()
    }

    /// The command that flashes its image and its record.
    pub fn flash(&self, site: &Path) -> Vec<String> {
        let mut command = words("flash --config");
        command.extend([word(site), "--node".into(), self.node.clone(), "--board".into(), self.board.clone()]);
        command.extend(["--image".into(), word(&self.image())]);
        command.extend(self.probe_words());
        command
    }

    /// The command that reads its record.
    pub fn read_record(&self) -> Vec<String> {
        let mut command = words("provision --read --json --board");
        command.push(self.board.clone());
        command.extend(self.probe_words());
        command
    }

    /// The command that listens to it for a time, from a reset on where it is at a probe.
    pub fn listen(&self, seconds: u32, reset: bool) -> Vec<String> {
        let mut command = words("monitor --format jsonl --seconds");
        command.push(seconds.to_string());
        command.extend(["--elf".into(), word(&self.image())]);
        match &self.port {
            Some(port) => command.extend(["--serial".into(), port.clone()]),
            None => {
                command.extend(self.probe_words());
                command.extend(reset.then(|| "--reset".to_owned()));
            }
        }
        command
    }
}
