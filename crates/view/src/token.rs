//! The secret part of the link.

use crate::ViewError;
use std::fmt;
use std::hint::black_box;
use thiserror::Error;

/// Random bytes of a token: too many to guess.
const RANDOM_BYTES: usize = 16;
/// Allowed lengths of a given token, characters.
const LENGTHS: std::ops::RangeInclusive<usize> = 16..=128;

/// The secret that a viewer must present. Its debug form hides it.
#[derive(Clone)]
pub struct Token(String);

/// A text is not a [`Token`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("a token must have 16 to 128 letters, digits, '-' or '_'")]
pub struct TokenError;

impl Token {
    /// A random token of 128 bits, as 32 hexadecimal digits.
    ///
    /// # Errors
    /// [`ViewError::Random`] if the system has no random numbers.
    pub fn random() -> Result<Self, ViewError> {
        let mut bytes = [0; RANDOM_BYTES];
        getrandom::fill(&mut bytes).map_err(|error| ViewError::Random(error.to_string()))?;
        Ok(Self(bytes.iter().map(|byte| format!("{byte:02x}")).collect()))
    }

    /// A given token, e.g. the same after a restart.
    ///
    /// # Errors
    /// [`TokenError`] for a short text, or characters that would need an escape in a link.
    pub fn new(text: &str) -> Result<Self, TokenError> {
        let is_allowed = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
        let valid = LENGTHS.contains(&text.len()) && text.bytes().all(is_allowed);
        if valid { Ok(Self(text.to_owned())) } else { Err(TokenError) }
    }

    /// The token as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Returns true if a text is the token. The time does not depend on the number of equal characters.
    pub fn matches(&self, text: &str) -> bool {
        let (own, other) = (self.0.as_bytes(), text.as_bytes());
        let differences = own.iter().zip(other).fold(0, |sum, (own, other)| black_box(sum | (own ^ other)));
        own.len() == other.len() && differences == 0
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Token(hidden)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_whole_token_matches() {
        let token = Token::new("0123456789abcdef").unwrap();
        assert!(token.matches("0123456789abcdef"));
        for other in ["", "0", "0123456789abcdeF", "0123456789abcdef0", "0123456789abcde"] {
            assert!(!token.matches(other), "{other}");
        }
        assert_eq!(format!("{token:?}"), "Token(hidden)");
    }

    #[test]
    fn tokens_are_random_and_need_no_escape() {
        let (one, other) = (Token::random().unwrap(), Token::random().unwrap());
        assert_ne!(one.as_str(), other.as_str());
        assert!(Token::new(one.as_str()).is_ok());
        for text in ["short", "0123456789abcde<", "0123456789abcde&", "0123456789abcd\u{e9}", &"a".repeat(129)] {
            assert_eq!(Token::new(text).unwrap_err(), TokenError, "{text}");
        }
    }
}
