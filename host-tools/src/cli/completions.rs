//! `baliza completions`: prints a script with which a shell completes commands and flags.

use anyhow::Result;
use clap_complete::{Shell, generate};

/// Print a shell's completions of commands and flags
///
/// Where the script goes is the shell's matter; usual places are in the examples.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The shell
    shell: Shell,
}

const EXAMPLES: &str = "\
Examples:
  baliza completions bash > ~/.local/share/bash-completion/completions/baliza
  baliza completions zsh > ~/.zfunc/_baliza       (with `fpath+=~/.zfunc` before `compinit` in ~/.zshrc)
  baliza completions fish > ~/.config/fish/completions/baliza.fish";

/// Runs `baliza completions`.
///
/// # Errors
/// Standard output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mut script = Vec::new();
    generate(arguments.shell, &mut super::companion::whole(), "baliza", &mut script);
    super::print(&script)
}
