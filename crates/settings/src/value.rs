//! Types of setting values.

use crate::Allowed;
use std::path::PathBuf;

/// A type of setting values.
pub trait SettingValue {
    /// True if the type holds whole numbers only.
    const WHOLE: bool = false;

    /// Returns the value as TOML; `None` if the setting is left out.
    fn text(&self) -> Option<String>;

    /// Returns true if the text can be parsed as a value of this type. Called only for types written as text.
    fn is_text_of(_text: &str) -> bool {
        true
    }

    /// Returns true if the value is allowed.
    fn is_allowed(&self, allowed: &Allowed) -> bool;
}

/// An enum of named values, declared with [`choices!`](crate::choices).
pub trait Choice: Copy + Sized + 'static {
    /// Names of all values, in order.
    const NAMES: &'static [&'static str];

    /// All values, in order.
    const ALL: &'static [Self];

    /// Returns the name used in settings, on the command line and in tables.
    fn name(self) -> &'static str;

    /// Returns a description of the value, in one line.
    fn help(self) -> &'static str;

    /// Returns the value with this name, if there is one.
    fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|value| value.name() == name)
    }
}

/// Returns true if a text can name a value in settings and on the command line: lower-case letters, digits, `-` and
/// `_`.
pub fn is_name(text: &str) -> bool {
    let is_plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || b"-_".contains(&byte);
    !text.is_empty() && text.bytes().all(is_plain)
}

impl<T: SettingValue> SettingValue for Option<T> {
    const WHOLE: bool = T::WHOLE;

    fn text(&self) -> Option<String> {
        self.as_ref().and_then(SettingValue::text)
    }

    fn is_text_of(text: &str) -> bool {
        T::is_text_of(text)
    }

    fn is_allowed(&self, allowed: &Allowed) -> bool {
        self.as_ref().is_none_or(|value| value.is_allowed(allowed))
    }
}

macro_rules! numbers {
    ($whole:literal: $($type:ty),*) => {$(
        impl SettingValue for $type {
            const WHOLE: bool = $whole;

            fn text(&self) -> Option<String> {
                Some(self.to_string())
            }

            // `usize` cannot be cast losslessly. Above 2^53 the rounded value is precise enough for a range check.
            #[allow(clippy::cast_lossless, clippy::unnecessary_cast)]
            fn is_allowed(&self, allowed: &Allowed) -> bool {
                allowed.accepts_number(*self as f64)
            }
        }
    )*};
}

numbers!(false: f64);
numbers!(true: u8, u32, u64, usize);

impl SettingValue for f32 {
    fn text(&self) -> Option<String> {
        Some(self.to_string())
    }

    /// Checks the decimal text, because the `f32` nearest to 0.1 is larger than 0.1.
    fn is_allowed(&self, allowed: &Allowed) -> bool {
        self.to_string().parse().is_ok_and(|number| allowed.accepts_number(number))
    }
}

macro_rules! texts {
    ($($type:ty, |$value:ident| $text:expr);*) => {$(
        impl SettingValue for $type {
            fn text(&self) -> Option<String> {
                let $value = self;
                $text
            }

            fn is_allowed(&self, _: &Allowed) -> bool {
                true
            }
        }
    )*};
}

texts!(
    bool, |value| Some(value.to_string());
    String, |value| Some(format!("\"{value}\""));
    PathBuf, |value| Some(format!("\"{}\"", value.display()))
);

/// Returns true if a setting is left out of files.
#[doc(hidden)]
pub fn is_left_out(value: &impl SettingValue) -> bool {
    value.text().is_none()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_of_a_range_are_allowed_for_every_type() {
        let allowed = Allowed::between(0.000_001, 0.1);
        assert!([1e-6_f32, 0.1].iter().all(|number| number.is_allowed(&allowed)));
        assert!([1e-6_f64, 0.1].iter().all(|number| number.is_allowed(&allowed)));
        assert!(![9e-7_f32, 0.100_001, f32::NAN, f32::INFINITY].iter().any(|number| number.is_allowed(&allowed)));
    }
}
