//! Allowed values of a setting.

use std::fmt;

/// The allowed values of a setting. The `Display` text completes the sentence "expected …".
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Allowed {
    /// `true` or `false`.
    Switch,
    /// Any text, e.g. a path. The string describes the expected text.
    Text(&'static str),
    /// One of these names.
    Names(&'static [&'static str]),
    /// A number from `min` to `max`, inclusive, but without `min` if `above` is set.
    Range {
        /// Smallest number.
        min: f64,
        /// Largest number.
        max: f64,
        /// True if `min` itself is excluded.
        above: bool,
    },
    /// One of these numbers.
    OneOf(&'static [f64]),
    /// A multiple of `of` from `min` to `max`.
    Multiple {
        /// The divisor.
        of: u32,
        /// Smallest multiple.
        min: u32,
        /// Largest multiple.
        max: u32,
    },
}

impl Allowed {
    /// Largest whole number of a setting: 2^63 − 1, the largest in TOML.
    pub const MAX_WHOLE: u64 = i64::MAX as u64;

    /// A number from `min` to `max`, inclusive.
    pub const fn between(min: f64, max: f64) -> Self {
        Self::Range { min, max, above: false }
    }

    /// A number above `min` and at most `max`.
    pub const fn above_up_to(min: f64, max: f64) -> Self {
        Self::Range { min, max, above: true }
    }

    /// Returns true if the number is allowed. NaN and infinity never are.
    pub fn accepts_number(&self, number: f64) -> bool {
        if !number.is_finite() {
            return false;
        }
        match *self {
            Self::Range { min, max, above } => number <= max && if above { number > min } else { number >= min },
            Self::OneOf(numbers) => numbers.contains(&number),
            Self::Multiple { of, min, max } => {
                number % f64::from(of) == 0.0 && (f64::from(min)..=f64::from(max)).contains(&number)
            }
            Self::Switch | Self::Text(_) | Self::Names(_) => false,
        }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Switch => formatter.write_str("true or false"),
            Self::Text(description) => formatter.write_str(description),
            Self::Names(names) => write_choice(formatter, names),
            // An `f64` cannot hold 2^63 − 1 exactly.
            Self::Range { min, max, .. } if max == Self::MAX_WHOLE as f64 => {
                write!(formatter, "{min} to {}", Self::MAX_WHOLE)
            }
            Self::Range { min, max, above: false } => write!(formatter, "{min} to {max}"),
            Self::Range { min, max, above: true } => write!(formatter, "more than {min} and at most {max}"),
            Self::OneOf(numbers) => write_choice(formatter, numbers),
            Self::Multiple { of, min, max } => write!(formatter, "a multiple of {of} from {min} to {max}"),
        }
    }
}

/// Writes `a, b or c`.
fn write_choice(formatter: &mut fmt::Formatter<'_>, choices: &[impl fmt::Display]) -> fmt::Result {
    for (index, choice) in choices.iter().enumerate() {
        let separator = match index {
            0 => "",
            _ if index + 1 == choices.len() => " or ",
            _ => ", ",
        };
        write!(formatter, "{separator}{choice}")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_accept_the_values_that_they_describe() {
        let cases = [
            (Allowed::between(0.0, 1.0), "0 to 1", vec![0.0, 1.0], vec![-0.1, 1.1]),
            (Allowed::above_up_to(0.0, 1.0), "more than 0 and at most 1", vec![0.1, 1.0], vec![0.0, 1.1]),
            (Allowed::between(0.0, Allowed::MAX_WHOLE as f64), "0 to 9223372036854775807", vec![1e18], vec![1e19]),
            (Allowed::OneOf(&[1.0, 2.0, 4.0]), "1, 2 or 4", vec![2.0], vec![3.0]),
            (
                Allowed::Multiple { of: 32, min: 32, max: 4096 },
                "a multiple of 32 from 32 to 4096",
                vec![64.0],
                vec![0.0, 33.0, 8192.0],
            ),
        ];
        for (allowed, text, accepted, refused) in cases {
            assert_eq!(allowed.to_string(), text);
            assert!(accepted.iter().all(|number| allowed.accepts_number(*number)), "{text}");
            assert!(!refused.iter().any(|number| allowed.accepts_number(*number)), "{text}");
            assert!(!allowed.accepts_number(f64::NAN) && !allowed.accepts_number(f64::INFINITY), "{text}");
        }
    }
}
