//! Settings, each declared once.
//!
//! [`settings!`] declares a section: a struct with one field per setting, and each setting's default, allowed values
//! and help. Reading TOML and JSON, checking ranges, `--help` and `docs/SETTINGS.md` all use that declaration.
//! [`choices!`] declares an enum whose values have names.

mod allowed;
mod error;
mod field;
mod macros;
mod value;

pub use allowed::Allowed;
pub use error::SettingError;
pub use field::{Field, Section, full_key};
#[doc(hidden)]
pub use value::is_left_out;
pub use value::{Choice, SettingValue, is_name};

/// Used by the code that the macros generate.
#[doc(hidden)]
pub use serde;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
