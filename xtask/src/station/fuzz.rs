//! Requests at random, made of the API's own description by Schemathesis (`station/tests/fuzz/`), as each of three
//! roles, to a station with tokens.

use std::fmt::Write as _;
use std::process::Command;

use anyhow::Result;
use sha2::{Digest, Sha256};

use super::server::Server;
use crate::python::{environment, install};
use crate::{root, succeed, target_directory};

/// What makes the requests: one version, so that equal seeds make equal requests.
const TOOL: &str = "schemathesis==4.32.5";
/// Who asks. The name of a role is its secret too.
const ROLES: [&str; 3] = ["view", "operate", "administer"];

/// Makes at least this number of requests.
///
/// # Errors
/// There is no Python with `venv`, the tool cannot be fetched, or an answer is not as the description says: a status of
/// 500 or more, another body, or something that the role may not.
pub fn run(requests: u32) -> Result<()> {
    let python = environment(&target_directory().join("station/venv"))?;
    install(&python, [TOOL])?;
    let mut tokens = String::new();
    for role in ROLES {
        let sha256: String = Sha256::digest(role).iter().map(|byte| format!("{byte:02x}")).collect();
        write!(tokens, "[[token]]\nname = \"{role}\"\nrole = \"{role}\"\nsha256 = \"{sha256}\"\n")?;
    }
    let arguments = ["--simulate", "--tokens", "tokens.toml"];
    let station = Server::start(&arguments, ("tokens.toml", &tokens))?;
    let folder = root().join("station/tests/fuzz");
    let url = format!("http://{}", station.address);
    let scratch = target_directory().join("station");
    succeed(Command::new(&python).arg(folder.join("run.py")).args([&url, &requests.to_string()]).current_dir(scratch))?;
    station.stop()
}
