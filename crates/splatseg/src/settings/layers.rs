//! Settings combined from files, options and assignments.

use super::file::SettingsFile;
use super::toml_table::{merge, values_by_key};
use super::usage::{Usage, with_preset};
use super::{Entry, Settings, SettingsError, entries};
use splatseg_dataset::DatasetSettings;
use splatseg_memory::{MemoryKind, SavedMemorySettings};
use splatseg_settings::Allowed;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Settings built up in layers. Later layers override earlier ones.
#[derive(Clone, Debug, Default)]
pub struct SettingsLayers {
    table: Table,
    /// File and line of each value that came from a file, by full key.
    places: BTreeMap<String, (PathBuf, Option<usize>)>,
}

impl SettingsLayers {
    /// Adds a TOML file, or the settings of the `summary.json` of an earlier run.
    ///
    /// # Errors
    /// If the file cannot be read or has the wrong format.
    pub fn add_file(&mut self, path: &Path) -> Result<(), SettingsError> {
        let file = SettingsFile::read(path)?;
        for key in values_by_key(&file.table).into_keys() {
            let line = file.lines.get(&key).copied();
            self.places.insert(key, (path.to_owned(), line));
        }
        merge(&mut self.table, file.table);
        Ok(())
    }

    /// Puts the layers `above` over these layers.
    #[must_use]
    pub fn with(mut self, above: Self) -> Self {
        self.places.retain(|key, _| above.get(key).is_none());
        self.places.extend(above.places);
        merge(&mut self.table, above.table);
        self
    }

    /// Returns the dataset settings `base`, overridden by these layers. Other settings are ignored.
    ///
    /// # Errors
    /// If a key does not exist, or a value has the wrong type or is out of range.
    pub fn over_dataset(self, base: &DatasetSettings) -> Result<DatasetSettings, SettingsError> {
        let mut layers = Self::default();
        // Never fails: every setting can be written as TOML.
        if let Ok(base) = Value::try_from(base) {
            layers.add("dataset", base);
        }
        // Not `resolve`: `base` also has values for settings that are not in use.
        Ok(layers.with(self).resolve_shared()?.dataset)
    }

    /// Adds the settings that a saved memory fixes: its kind, feature dimension and number of codes. Does nothing for a
    /// method without a memory, and where the layers choose a registered kind of memory for a file of a built-in one.
    ///
    /// # Errors
    /// If the file cannot be read, or a layer has another value.
    pub fn add_saved_memory(&mut self, path: &Path) -> Result<(), SettingsError> {
        let entries = entries();
        if !Usage::new(&with_preset(&self.table, &entries), &entries).uses("memory.kind") {
            return Ok(());
        }
        let saved = SavedMemorySettings::read(path)?;
        let kind = self.get("memory.kind").and_then(Value::as_str).and_then(MemoryKind::from_name);
        // Whether a registered kind can use the content of a built-in one is found out by loading it.
        if matches!(kind, Some(MemoryKind::Registered(_))) && !matches!(saved.kind, MemoryKind::Registered(_)) {
            return Ok(());
        }
        let number = |number: usize| Value::Integer(i64::try_from(number).unwrap_or(i64::MAX));
        let mut fixed = vec![("memory.kind", Value::String(saved.kind.name().to_owned()))];
        if let Some(codes) = saved.codes {
            fixed.push(("memory.feature_dim", number(codes.feature_dim)));
            fixed.push(("memory.num_codes", number(codes.num_codes)));
        }
        for (key, value) in fixed {
            match self.get(key) {
                Some(given) if *given != value => {
                    return Err(self.with_place(SettingsError::SavedOtherwise {
                        key,
                        found: given.to_string(),
                        path: path.to_owned(),
                        saved: value.to_string(),
                    }));
                }
                _ => _ = self.add(key, value),
            }
        }
        Ok(())
    }

    /// Adds `KEY=VALUE`. The parts of a key are separated by dots. Quotes around text are optional.
    ///
    /// # Errors
    /// If `assignment` does not have that form.
    pub fn add_assignment(&mut self, assignment: &str) -> Result<(), SettingsError> {
        let malformed = || SettingsError::Assignment(assignment.to_owned());
        let (key, value) = assignment.split_once('=').ok_or_else(malformed)?;
        self.add_text(key.trim(), value.trim()).ok_or_else(malformed)
    }

    /// Adds one value, written as on a command line. Returns `None` if a part of the key is empty, or a part other than
    /// the last is not a section.
    pub fn add_text(&mut self, key: &str, text: &str) -> Option<()> {
        let is_text = |entry: &Entry| matches!(entry.field.allowed, Allowed::Text(_) | Allowed::Names(_));
        let is_text = entries().iter().find(|entry| entry.field.key() == key).is_some_and(is_text);
        let parsed = || {
            let mut table = format!("value = {text}").parse::<Table>().ok().filter(|table| table.len() == 1)?;
            table.remove("value")
        };
        let value = if is_text && !text.starts_with(['"', '\'']) { None } else { parsed() };
        self.add(key, value.unwrap_or_else(|| Value::String(text.to_owned())))
    }

    /// Adds one value. Returns `None` if a part of the key is empty, or a part other than the last is not a section.
    pub fn add(&mut self, key: &str, value: impl Into<Value>) -> Option<()> {
        let mut parts: Vec<&str> = key.split('.').collect();
        let last = parts.pop()?;
        if last.is_empty() || parts.iter().any(|part| part.is_empty()) {
            return None;
        }
        let mut table = &mut self.table;
        for part in parts {
            table = table.entry(part).or_insert_with(|| Value::Table(Table::new())).as_table_mut()?;
        }
        table.insert(last.to_owned(), value.into());
        self.places.remove(key);
        Some(())
    }

    /// Returns the value of a key, if a layer has one.
    pub fn get(&self, key: &str) -> Option<&Value> {
        let mut parts = key.split('.');
        let first = self.table.get(parts.next()?)?;
        parts.try_fold(first, |value, part| value.as_table()?.get(part))
    }

    /// Returns one [`SettingsError::Unused`] for each value that the chosen method, segmenter, tracker and memory do
    /// not use.
    pub fn unused(&self) -> Vec<SettingsError> {
        let entries = entries();
        Usage::new(&with_preset(&self.table, &entries), &entries).unused()
    }

    /// Returns the settings, with defaults where no layer has a value.
    ///
    /// # Errors
    /// If a key does not exist, the chosen method, segmenter, tracker or memory does not use a setting, a value has the
    /// wrong type or is out of range, a required file is missing, or the device is not built in.
    pub fn resolve(&self) -> Result<Settings, SettingsError> {
        let settings = Settings::from_table(&self.table, true).map_err(|error| self.with_place(error))?;
        settings.validate().map_err(|error| self.with_place(error))?;
        Ok(settings)
    }

    /// Like [`Self::resolve`], for several methods that share settings: ignores values that the chosen method does not
    /// use.
    ///
    /// # Errors
    /// If a key does not exist, or a value has the wrong type or is out of range.
    pub fn resolve_shared(&self) -> Result<Settings, SettingsError> {
        Settings::from_table(&self.table, false).map_err(|error| self.with_place(error))
    }

    /// Adds the file and line to an error if its value came from a file.
    #[must_use]
    pub fn with_place(&self, error: SettingsError) -> SettingsError {
        match error.key().and_then(|key| self.places.get(key)).cloned() {
            Some((path, line)) => SettingsError::InFile { path, line, source: Box::new(error) },
            None => error,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::Rotate;
    use crate::settings::MethodSettings;

    fn resolve(assignments: &[&str]) -> Result<Settings, SettingsError> {
        let mut layers = SettingsLayers::default();
        assignments.iter().try_for_each(|assignment| layers.add_assignment(assignment))?;
        layers.resolve()
    }

    #[test]
    fn later_layers_win_over_earlier_ones_and_defaults() {
        let settings = resolve(&[
            "memory.max_votes=14",
            "memory.removal_frames = 5",
            "memory.max_votes=7",
            "segmenter=oracle",
            "dataset.resize=320x240",
        ])
        .unwrap();
        let memory = settings.method.memory().unwrap();
        assert_eq!((memory.max_votes, memory.removal_frames), (7.0, 5));
        assert_eq!(settings.segmenter.name(), "oracle");
        assert!(matches!(settings.method, MethodSettings::FastsamSplat(_)));
    }

    #[test]
    fn a_name_that_is_a_number_may_be_written_as_one() {
        for text in ["rotate=90", "rotate=\"90\""] {
            assert_eq!(resolve(&[text]).unwrap().run.rotate, Rotate::Right);
        }
        let settings: Settings = toml::from_str("rotate = 270").unwrap();
        assert_eq!(settings.run.rotate, Rotate::Left);
        let error = resolve(&["rotate=45"]).unwrap_err().to_string();
        assert!(error.contains("auto, 0, 90, 180 or 270"), "{error}");
    }

    #[test]
    fn errors_name_the_full_key() {
        let cases: [(&[&str], &str); 9] = [
            (&["memory.max_votess=14"], "there is no setting memory.max_votess, did you mean memory.max_votes?"),
            (&["memory.max_votes=many"], "memory.max_votes is \"many\", expected more than 0 and at most 1000000"),
            (&["memory.max_votes=0"], "memory.max_votes is 0, expected more than 0 and at most 1000000"),
            (&["dataset.stride=1.5"], "dataset.stride is 1.5, expected a whole number, 1 to 1000000000"),
            (
                &["memory.num_codes=600"],
                "memory.num_codes is not used here: it needs memory.kind = features, but memory.kind is evidence",
            ),
            (
                &["method=fastsam", "memory.max_votes=3"],
                "memory.max_votes is not used here: it needs method = fastsam-splat or sam2-splat, \
                 but method is fastsam",
            ),
            (
                &["segmenter=graph", "weights=x.pt"],
                "weights is not used here: it needs segmenter = affinity or fastsam, but segmenter is graph",
            ),
            (
                &["segmenter=fastsam"],
                "segmenter = fastsam needs weights: a checkpoint of FastSAM, e.g. --weights FastSAM-x.pt",
            ),
            (&["segmenter=yolo"], "segmenter is \"yolo\", expected affinity, graph, fastsam, masks or oracle"),
        ];
        for (assignments, message) in cases {
            assert_eq!(resolve(assignments).unwrap_err().to_string(), message);
        }
        for malformed in ["memory", "=3", "memory..x=1"] {
            assert!(matches!(resolve(&[malformed]), Err(SettingsError::Assignment(_))), "{malformed}");
        }
    }

    #[test]
    fn whole_numbers_of_2_63_and_more_are_errors_with_the_range() {
        for number in ["9223372036854775808", "18446744073709551615", "18446744073709551616", "-9223372036854775809"] {
            for entry in entries().iter().filter(|entry| matches!(entry.field.allowed, Allowed::Range { .. })) {
                // Not `resolve`, so that the only error is the number.
                let mut layers = SettingsLayers::default();
                let key = entry.field.key();
                layers.add_text(&key, number).unwrap();
                let error = layers.resolve_shared().unwrap_err().to_string();
                assert_eq!(error, entry.field.error(number).to_string());
            }
        }
        let error = resolve(&["seed=9223372036854775808"]).unwrap_err().to_string();
        assert_eq!(error, "seed is 9223372036854775808, expected a whole number, 0 to 9223372036854775807");
        for seed in ["1e3", "-1"] {
            assert!(resolve(&[&format!("seed={seed}")]).is_err(), "{seed}");
        }
        assert_eq!(resolve(&["seed=9223372036854775807"]).unwrap().run.seed, i64::MAX as u64);
    }

    #[test]
    fn settings_survive_toml_and_json() {
        let all = [
            resolve(&[]).unwrap(),
            resolve(&["memory.kind=features", "memory.feature_dim=14", "seed=4"]).unwrap(),
            resolve(&["method=sam2", "tracker=sim", "segmenter=oracle", "oracle.miss_rate=0.5"]).unwrap(),
            resolve(&["method=sam2-splat", "tracker_weights=a.pt", "sam2.image_size=512"]).unwrap(),
        ];
        for settings in all {
            let text = toml::to_string(&settings).unwrap();
            assert_eq!(toml::from_str::<Settings>(&text).unwrap(), settings, "{text}");
            let json = serde_json::to_string(&settings).unwrap();
            assert_eq!(serde_json::from_str::<Settings>(&json).unwrap(), settings, "{json}");
            assert!(!json.contains("0.30000001"), "numbers are written as they were given: {json}");
        }
    }
}
