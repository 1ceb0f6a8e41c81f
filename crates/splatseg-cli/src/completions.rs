//! `splatseg completions`: the completions of the command for a shell.

use super::Failure;
use super::arguments::complete_command;
use super::terminal::record_output_error;
use clap::Args;
use clap_complete::Shell;
use std::io::Write;

#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    splatseg completions bash > ~/.local/share/bash-completion/completions/splatseg\n  \
    splatseg completions zsh > ~/.zfunc/_splatseg        # with fpath+=~/.zfunc before compinit in ~/.zshrc\n  \
    splatseg completions fish > ~/.config/fish/completions/splatseg.fish")]
pub struct CompletionsArguments {
    /// The shell
    #[arg(value_enum)]
    pub shell: Shell,
}

/// Prints the completions.
pub fn completions(arguments: &CompletionsArguments) -> Result<(), Failure> {
    let mut command = complete_command();
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut command, "splatseg", &mut text);
    // Not escaped: it is a script, and has no text from files.
    record_output_error(std::io::stdout().lock().write_all(&text));
    Ok(())
}
