//! Failures of a command, with their exit codes.

use std::fmt;

/// A failure; its text is one line.
#[derive(Debug)]
pub enum Failure {
    /// Invalid usage or input: exit code 2.
    Input(String),
    /// Anything else: exit code 1.
    Runtime(String),
    /// Ended by a signal.
    Interrupted {
        /// The exit code that shells report for a program ended by the signal, e.g. 130 for Ctrl-C.
        code: u8,
        /// Message with the work done so far.
        text: String,
    },
}

impl Failure {
    /// Creates a failure for invalid usage or input.
    pub fn input(error: impl fmt::Display) -> Self {
        Self::Input(error.to_string())
    }

    /// Creates a failure for an error despite valid input.
    pub fn runtime(error: impl fmt::Display) -> Self {
        Self::Runtime(error.to_string())
    }

    /// Combines results: one failure with the text of all, so that none hides another. It is an invalid input only if all
    /// are.
    pub fn all(results: impl IntoIterator<Item = Result<(), Self>>) -> Result<(), Self> {
        let failures: Vec<Self> = results.into_iter().filter_map(Result::err).collect();
        let text = failures.iter().map(Self::to_string).collect::<Vec<_>>().join("; ");
        match failures.iter().map(Self::exit_code).min() {
            None => Ok(()),
            Some(2) => Err(Self::Input(text)),
            Some(_) => Err(Self::Runtime(text)),
        }
    }

    /// Returns the exit code of the command.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Runtime(_) => 1,
            Self::Interrupted { code, .. } => *code,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(text) | Self::Runtime(text) | Self::Interrupted { text, .. } => formatter.write_str(text),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_failures_are_one_line() {
        let all =
            |results: Vec<Result<(), Failure>>| Failure::all(results).map_err(|all| (all.exit_code(), all.to_string()));
        assert_eq!(all(vec![Ok(()), Ok(())]), Ok(()));
        let (input, runtime) = (|| Err(Failure::input("a")), || Err(Failure::runtime("b")));
        assert_eq!(all(vec![input(), Ok(()), runtime()]), Err((1, "a; b".to_owned())));
        assert_eq!(all(vec![input(), input()]), Err((2, "a; a".to_owned())));
    }
}
