//! Macros that declare settings and choices.

/// Declares a section of settings.
///
/// ```
/// use splatseg_settings::{Allowed, Section, settings};
///
/// settings! {
///     /// Settings of a kettle.
///     pub struct KettleSettings in "kettle" {
///         /// Amount of water, litres.
///         litres: f32 = 1.5, Allowed::above_up_to(0.0, 2.0);
///         /// Temperature at which the kettle switches off, degrees Celsius.
///         stop_at: usize = 100, Allowed::between(40.0, 100.0), only "kettle.electric = true";
///         /// Heats with electricity.
///         electric: bool = true, Allowed::Switch;
///     }
/// }
///
/// let kettle = KettleSettings::default().with(|kettle| kettle.litres = 3.0);
/// assert_eq!(kettle.validate().unwrap_err().to_string(), "kettle.litres is 3, expected more than 0 and at most 2");
/// assert_eq!(KettleSettings::fields()[1].key(), "kettle.stop_at");
/// assert_eq!(KettleSettings::fields()[1].default.as_deref(), Some("100"));
/// ```
///
/// A section may contain other sections, declared after its settings: `sections { /// Help. memory: MemorySettings; }`.
#[macro_export]
macro_rules! settings {
    (
        $(#[doc = $struct_doc:literal])*
        $(#[derive($($derive:ident),+)])?
        pub struct $name:ident in $section:literal {
            $(
                $(#[doc = $doc:literal])+
                $field:ident: $type:ty = $default:expr, $allowed:expr $(, only $only:literal)?;
            )*
        }
        $(sections {
            $(
                $(#[doc = $inner_doc:literal])+
                $inner:ident: $inner_type:ty;
            )+
        })?
    ) => {
        $(#[doc = $struct_doc])*
        $(#[derive($($derive),+)])?
        #[derive(Clone, Debug, PartialEq, $crate::serde::Serialize, $crate::serde::Deserialize)]
        #[serde(crate = "splatseg_settings::serde", deny_unknown_fields, default)]
        #[non_exhaustive]
        pub struct $name {
            $(
                $(#[doc = $doc])+
                #[serde(skip_serializing_if = "splatseg_settings::is_left_out")]
                pub $field: $type,
            )*
            $($(
                $(#[doc = $inner_doc])+
                pub $inner: $inner_type,
            )+)?
        }

        impl ::std::default::Default for $name {
            fn default() -> Self {
                Self {
                    $($field: $default,)*
                    $($($inner: ::std::default::Default::default(),)+)?
                }
            }
        }

        impl $name {
            /// Returns these settings with changes: `settings.with(|settings| settings.field = value)`.
            #[must_use]
            pub fn with(mut self, change: impl FnOnce(&mut Self)) -> Self {
                change(&mut self);
                self
            }

            /// Checks every setting.
            ///
            /// # Errors
            /// Names the first setting that is out of range.
            pub fn validate(&self) -> ::std::result::Result<(), $crate::SettingError> {
                $(
                    let allowed: $crate::Allowed = $allowed;
                    if !$crate::SettingValue::is_allowed(&self.$field, &allowed) {
                        return Err($crate::SettingError {
                            key: $crate::full_key($section, stringify!($field)),
                            found: $crate::SettingValue::text(&self.$field).unwrap_or_default(),
                            expected: allowed.to_string(),
                        });
                    }
                )*
                $($(self.$inner.validate()?;)+)?
                Ok(())
            }

            /// Returns the settings if all are in range.
            ///
            /// # Errors
            /// Names the first setting that is out of range.
            pub fn validated(self) -> ::std::result::Result<Self, $crate::SettingError> {
                self.validate().map(|()| self)
            }
        }

        impl $crate::Section for $name {
            const SECTION: &'static str = $section;

            fn validate(&self) -> ::std::result::Result<(), $crate::SettingError> {
                // The inherent function.
                Self::validate(self)
            }

            fn fields() -> ::std::vec::Vec<$crate::Field> {
                [::std::vec![
                    $($crate::Field {
                        section: $section,
                        name: stringify!($field),
                        default: {
                            let default: $type = $default;
                            $crate::SettingValue::text(&default)
                        },
                        allowed: $allowed,
                        whole: <$type as $crate::SettingValue>::WHOLE,
                        is_text_of: <$type as $crate::SettingValue>::is_text_of,
                        doc: concat!($($doc, " "),+),
                        only: $crate::settings!(@only $($only)?),
                    },)*
                ], $($(<$inner_type as $crate::Section>::fields(),)+)?].concat()
            }
        }
    };
    (@only) => { ::std::option::Option::None };
    (@only $only:literal) => { ::std::option::Option::Some($only) };
}

/// Declares an enum of named values. The names are the same in TOML, in JSON and on the command line.
///
/// ```
/// use splatseg_settings::{Choice, choices};
///
/// choices! {
///     /// Heat source of a kettle.
///     pub enum Heat, default Gas {
///         /// A flame.
///         Gas = "gas",
///         /// A coil.
///         ElectricCoil = "electric-coil",
///     }
/// }
///
/// assert_eq!(Heat::from_name("electric-coil"), Some(Heat::ElectricCoil));
/// assert_eq!(Heat::default().to_string(), "gas");
/// ```
#[macro_export]
macro_rules! choices {
    (
        $(#[doc = $enum_doc:literal])*
        pub enum $name:ident $(, default $default:ident)? {
            $(
                $(#[doc = $doc:literal])+
                $value:ident = $text:literal,
            )+
        }
    ) => {
        $(#[doc = $enum_doc])*
        #[derive(
            Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash,
            $crate::serde::Serialize, $crate::serde::Deserialize,
        )]
        #[serde(crate = "splatseg_settings::serde")]
        #[non_exhaustive]
        pub enum $name {
            $(
                $(#[doc = $doc])+
                #[serde(rename = $text)]
                $value,
            )+
        }

        impl $name {
            /// Returns the name used in settings, on the command line and in tables.
            pub fn name(self) -> &'static str {
                $crate::Choice::name(self)
            }
        }

        $(impl ::std::default::Default for $name {
            fn default() -> Self {
                Self::$default
            }
        })?

        impl $crate::Choice for $name {
            const NAMES: &'static [&'static str] = &[$($text),+];
            const ALL: &'static [Self] = &[$(Self::$value),+];

            fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $text,)+
                }
            }

            fn help(self) -> &'static str {
                match self {
                    $(Self::$value => concat!($($doc),+).trim_ascii(),)+
                }
            }
        }

        impl $crate::SettingValue for $name {
            fn text(&self) -> ::std::option::Option<::std::string::String> {
                Some(::std::format!("\"{}\"", $crate::Choice::name(*self)))
            }

            fn is_allowed(&self, _: &$crate::Allowed) -> bool {
                true
            }
        }

        impl ::std::fmt::Display for $name {
            fn fmt(&self, formatter: &mut ::std::fmt::Formatter<'_>) -> ::std::fmt::Result {
                formatter.write_str($crate::Choice::name(*self))
            }
        }
    };
}
