//! Why the command failed, and with which exit code.

use std::fmt;

/// A failure; its text is one line.
#[derive(Debug)]
pub enum Failure {
    /// Bad usage or input: exit code 2.
    Input(String),
    /// Anything else: exit code 1.
    Work(String),
    /// Ended by a signal.
    Interrupted {
        /// The exit code that shells report for a program that the signal ended, e.g. 130 for Ctrl-C.
        code: u8,
        /// What was done before.
        text: String,
    },
}

impl Failure {
    /// Bad usage or input.
    pub fn input(error: impl fmt::Display) -> Self {
        Self::Input(error.to_string())
    }

    /// Work that failed although the input was right.
    pub fn work(error: impl fmt::Display) -> Self {
        Self::Work(error.to_string())
    }

    /// The exit code of the command.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Work(_) => 1,
            Self::Interrupted { code, .. } => *code,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(text) | Self::Work(text) | Self::Interrupted { text, .. } => formatter.write_str(text),
        }
    }
}
