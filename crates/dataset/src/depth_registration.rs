//! Whether depth is registered to colour: a choice that is also written as a switch.

use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use splatseg_settings::{Allowed, Choice, SettingValue};
use std::fmt;

/// Whether depth is registered to colour here. In files, `true` and `false` may also be written without quotes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum DepthRegistration {
    /// Decided for each format: by the camera infos and frames of recordings with topics; not for other formats.
    #[default]
    Auto,
    /// Depth is registered here, from its own camera.
    True,
    /// Depth is taken as registered: its pixels are those of the colour images.
    False,
}

impl DepthRegistration {
    /// Returns the name used in settings, on the command line and in tables.
    pub fn name(self) -> &'static str {
        Choice::name(self)
    }
}

impl Choice for DepthRegistration {
    const NAMES: &'static [&'static str] = &["auto", "true", "false"];
    const ALL: &'static [Self] = &[Self::Auto, Self::True, Self::False];

    fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::True => "true",
            Self::False => "false",
        }
    }

    fn help(self) -> &'static str {
        match self {
            Self::Auto => {
                "Decided for each format: by the camera infos and frames of recordings with topics; not for other formats."
            }
            Self::True => "Depth is registered here, from its own camera.",
            Self::False => "Depth is taken as registered: its pixels are those of the colour images.",
        }
    }
}

impl SettingValue for DepthRegistration {
    fn text(&self) -> Option<String> {
        Some(format!("\"{}\"", self.name()))
    }

    fn is_allowed(&self, _: &Allowed) -> bool {
        true
    }
}

impl fmt::Display for DepthRegistration {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl Serialize for DepthRegistration {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for DepthRegistration {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NameOrSwitch;

        impl Visitor<'_> for NameOrSwitch {
            type Value = DepthRegistration;

            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("auto, true or false")
            }

            fn visit_bool<E: Error>(self, value: bool) -> Result<DepthRegistration, E> {
                Ok(if value { DepthRegistration::True } else { DepthRegistration::False })
            }

            fn visit_str<E: Error>(self, value: &str) -> Result<DepthRegistration, E> {
                DepthRegistration::from_name(value).ok_or_else(|| E::unknown_variant(value, DepthRegistration::NAMES))
            }
        }

        deserializer.deserialize_any(NameOrSwitch)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_written_as_a_name_and_read_as_a_switch_too() {
        for value in DepthRegistration::ALL {
            let text = serde_json::to_string(value).unwrap();
            assert_eq!(text, format!("\"{value}\""));
            assert_eq!(serde_json::from_str::<DepthRegistration>(&text).unwrap(), *value);
        }
        let read = |text: &str| serde_json::from_str::<DepthRegistration>(text);
        assert_eq!(
            (read("true").unwrap(), read("false").unwrap()),
            (DepthRegistration::True, DepthRegistration::False)
        );
        assert!(read("\"maybe\"").is_err() && read("1").is_err());
    }
}
