//! The unit of stored depth.

use crate::{DatasetError, DatasetSettings, FramePart, RecordedFrame};
use splatseg_settings::SettingError;
use std::path::{Path, PathBuf};

/// Depth value that Kinect drivers write for missing measurements, like 0.
const NO_MEASUREMENT: u16 = u16::MAX;

/// Depth farther than this is none, metres: renderers write 1e10 where they see nothing.
const MAX_DEPTH_M: f32 = 1e5;

/// Depth below this is shown as `0.00 m`, and no depth camera measures it, metres.
const LEAST_DEPTH_M: f32 = 0.005;

/// A frame is judged if one in this many of its pixels has depth: a covered lens measures noise.
const MIN_SHARE: usize = 100;

/// Stored units per metre of depth: a stored value divided by it is in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DepthScale {
    units_per_metre: f32,
    source: ScaleSource,
}

/// Where a unit comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ScaleSource {
    /// The format's integers have this unit. It says nothing about files of numbers with fractions.
    Format,
    /// A file or setting states it for whatever is stored.
    Stated,
}

impl DepthScale {
    /// The unit of most data sets.
    pub(crate) const MILLIMETRES: Self = Self::of_format(1000.0);
    /// Depth that is stored as numbers with fractions.
    pub(crate) const METRES: Self = Self::of_format(1.0);

    /// Creates the unit of a format.
    pub(crate) const fn of_format(units_per_metre: f32) -> Self {
        Self { units_per_metre, source: ScaleSource::Format }
    }

    /// Creates the unit of a format that has it in every file, also in those with fractions.
    pub(crate) const fn of_every_number(units_per_metre: f32) -> Self {
        Self { units_per_metre, source: ScaleSource::Stated }
    }

    const fn of_statement(units_per_metre: f64) -> Self {
        Self { units_per_metre: units_per_metre as f32, source: ScaleSource::Stated }
    }

    /// Returns the unit of files that store numbers with fractions: metres, unless a file or setting states one.
    pub(crate) fn of_floats(self) -> Self {
        match self.source {
            ScaleSource::Format => Self::METRES,
            ScaleSource::Stated => self,
        }
    }

    /// Returns the unit that a file states, or that of the settings if they have one, which replaces it.
    ///
    /// # Errors
    /// [`DatasetError::Field`] with the file's `path` and `field` if the file's value is impossible.
    pub(crate) fn stated(
        units_per_metre: f64,
        (path, field): (&Path, &str),
        settings: &DatasetSettings,
    ) -> Result<Self, DatasetError> {
        match Self::from_settings(settings) {
            Some(own) => Ok(own),
            None if DatasetSettings::DEPTH_SCALES.accepts_number(units_per_metre) => {
                Ok(Self::of_statement(units_per_metre))
            }
            None => Err(DatasetError::Field {
                path: path.to_owned(),
                field: field.to_owned(),
                found: format!("{units_per_metre:?}"),
                expected: format!(
                    "{} stored units per metre: 1000 where depth is in millimetres",
                    DatasetSettings::DEPTH_SCALES
                ),
            }),
        }
    }

    /// Returns the unit of the settings; `None` if they have none. They must be valid.
    pub(crate) fn from_settings(settings: &DatasetSettings) -> Option<Self> {
        settings.depth_scale.map(Self::of_statement)
    }

    /// Returns the unit of the settings, otherwise this one.
    pub(crate) fn or_of(self, settings: &DatasetSettings) -> Self {
        Self::from_settings(settings).unwrap_or(self)
    }

    /// Converts a stored depth to metres; 0 if it means "no measurement".
    pub(crate) fn metres(self, stored: u16) -> f32 {
        if stored == NO_MEASUREMENT { 0.0 } else { f32::from(stored) / self.units_per_metre }
    }

    /// Converts depth that is stored as a number with a fraction to metres; 0 if it is not positive, not finite or too far.
    pub(crate) fn measured(self, stored: f32) -> f32 {
        let metres = stored / self.units_per_metre;
        // NaN is in no range.
        if (0.0..MAX_DEPTH_M).contains(&metres) { metres } else { 0.0 }
    }
}

/// Returns the number of millimetres that is read as exactly this depth in metres; `None` if there is none.
pub fn whole_millimetres(depth_m: f32) -> Option<u16> {
    // Rounds, and saturates what is not a number of 16 bits.
    let stored = (depth_m * 1000.0).round() as u16;
    (DepthScale::MILLIMETRES.metres(stored).to_bits() == depth_m.to_bits()).then_some(stored)
}

/// Refuses the setting for a scene without stored depth.
///
/// # Errors
/// [`SettingError`] if `dataset.depth_scale` is set.
pub(crate) fn require_no_depth_scale(settings: &DatasetSettings, format: &str) -> Result<(), SettingError> {
    settings.depth_scale.map_or(Ok(()), |found| {
        Err(SettingError {
            key: "dataset.depth_scale".to_owned(),
            found: found.to_string(),
            expected: format!("no value for the format {format}, whose depth is not stored"),
        })
    })
}

/// Check of the first frame with depth: a unit by which all depth becomes nothing is refused.
#[derive(Debug, Default)]
pub(crate) struct DepthUnitCheck {
    is_done: bool,
}

impl DepthUnitCheck {
    /// Checks the next frame. `place` names the file of a part of it.
    ///
    /// # Errors
    /// [`DatasetError::NoDepthLeft`] if it is the first with depth, and that is nearer than any camera can measure.
    pub(crate) fn check(
        &mut self,
        recorded: &RecordedFrame,
        place: &dyn Fn(FramePart) -> PathBuf,
    ) -> Result<(), DatasetError> {
        if self.is_done {
            return Ok(());
        }
        let pixels = recorded.frame.depth().pixels();
        let measured = pixels.iter().copied().filter(|depth| *depth > 0.0);
        let (count, farthest) =
            measured.fold((0, 0.0), |(count, farthest): (usize, f32), depth| (count + 1, depth.max(farthest)));
        if count <= pixels.len() / MIN_SHARE {
            return Ok(());
        }
        if farthest < LEAST_DEPTH_M {
            return Err(DatasetError::NoDepthLeft { path: place(FramePart::Depth), farthest });
        }
        self.is_done = true;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_replace_the_unit_of_files_and_formats() {
        let none = DatasetSettings::default();
        let own = DatasetSettings { depth_scale: Some(5000.0), ..none.clone() };
        let of_file = |value, settings| DepthScale::stated(value, (Path::new("camera.json"), "depth_scale"), settings);
        assert_eq!(of_file(1000.0, &none).unwrap().metres(1500), 1.5);
        assert_eq!(of_file(1000.0, &own).unwrap().metres(1500), 0.3);
        assert_eq!(DepthScale::MILLIMETRES.or_of(&own).metres(5000), 1.0);
        assert_eq!(DepthScale::METRES.or_of(&none).measured(1.25), 1.25);
        assert_eq!(DepthScale::MILLIMETRES.metres(u16::MAX), 0.0);
        assert_eq!(DepthScale::MILLIMETRES.of_floats(), DepthScale::METRES);
        assert_eq!(DepthScale::MILLIMETRES.or_of(&own).of_floats().measured(5000.0), 1.0);
    }

    #[test]
    fn what_is_no_depth_is_missing() {
        let stored = [0.0, 1.5, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e10];
        let found = stored.map(|stored| DepthScale::METRES.measured(stored));
        assert_eq!(found, [0.0, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn only_depth_that_is_read_back_exactly_is_whole_millimetres() {
        for stored in 0..NO_MEASUREMENT {
            assert_eq!(whole_millimetres(DepthScale::MILLIMETRES.metres(stored)), Some(stored));
        }
        let next = f32::from_bits(1.5_f32.to_bits() + 1);
        for other in [next, 0.0005, 65.535, 65.536, 1e30, -0.0, -1.0, f32::NAN, f32::INFINITY, f32::MIN_POSITIVE] {
            assert_eq!(whole_millimetres(other), None, "{other}");
        }
    }

    #[test]
    fn impossible_units_are_errors_that_name_the_file() {
        for wrong in [0.0, -1.0, 1e38, 1e300, f64::NAN, f64::INFINITY] {
            let error = DepthScale::stated(wrong, (Path::new("a.json"), "depth_scale"), &DatasetSettings::default());
            let told = error.unwrap_err().to_string();
            assert!(
                told.starts_with(&format!("a.json: depth_scale: found {wrong:?}, expected 0.001 to 1000000")),
                "{told}"
            );
            let settings = DatasetSettings { depth_scale: Some(wrong), ..DatasetSettings::default() };
            assert!(settings.validate().unwrap_err().to_string().starts_with("dataset.depth_scale is "));
        }
    }
}
