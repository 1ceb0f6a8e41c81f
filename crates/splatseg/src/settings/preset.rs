//! Presets of defaults, chosen by `method_preset`.

use super::toml_table::values_by_key;
use splatseg_settings::choices;
use toml::{Table, Value};

choices! {
    /// A preset of defaults.
    pub enum MethodPreset, default Splatseg {
        /// Our defaults
        Splatseg = "splatseg",
        /// The paper's defaults
        Paper = "paper",
    }
}

/// The paper's values where they differ from our defaults. `docs/PAPER.md` has a row for each; a test compares them.
const PAPER: &str = "
min_area = 0
match_whole_masks = true
working_pixels = 67_108_864

[memory]
kind = 'features'
growth = 'paper'
max_gaussians = 100_000_000
fade_matched = false
fade_undecoded = true
max_covered_fraction = 0.1
direction_learning_rate = 0.5
active_tolerance = -1.0
learning_min_weight = 0.0
learn_new = true

[reprompt]
count_negative_clicks = true
remove_tracks = false
max_answer_iou = 1.0

[sam2]
image_size = 1024
max_cond_frames_in_attn = 0
max_absent_frames = 0
";

impl MethodPreset {
    /// Returns the values that differ from our defaults, as in a settings file.
    pub(super) fn values(self) -> Table {
        match self {
            // `PAPER` is valid TOML, which a test checks.
            Self::Paper => PAPER.parse().unwrap_or_default(),
            Self::Splatseg => Table::new(),
        }
    }

    /// Returns the default of a setting, by full key, as TOML; `None` if it equals that of [`Self::Splatseg`].
    pub fn default_of(self, key: &str) -> Option<String> {
        values_by_key(&self.values()).get(key).map(|value| text(value))
    }
}

/// Formats a value as in a TOML file, but 0.0 as 0, like defaults elsewhere.
fn text(value: &Value) -> String {
    match value {
        Value::Float(number) => number.to_string(),
        value => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::usage::Usage;
    use crate::settings::{Settings, SettingsError, SettingsLayers, entries};

    fn resolve(assignments: &[&str]) -> Result<Settings, SettingsError> {
        let mut layers = SettingsLayers::default();
        assignments.iter().try_for_each(|assignment| layers.add_assignment(assignment))?;
        layers.resolve()
    }

    #[test]
    fn every_value_is_a_setting_and_differs_from_its_default() {
        let values = MethodPreset::Paper.values();
        let entries = entries();
        let usage = Usage::new(&values, &entries);
        assert!(usage.values().count() > 10);
        for (key, value) in usage.values() {
            let entry = usage.entry(key).unwrap_or_else(|| panic!("there is no setting {key}"));
            assert_ne!(entry.field.default, Some(text(value)), "{key}");
        }
    }

    #[test]
    fn what_is_given_wins_over_the_preset_and_the_preset_over_defaults() {
        let paper = resolve(&["method_preset=paper"]).unwrap();
        let memory = paper.method.memory().unwrap();
        assert_eq!(memory.kind, splatseg_memory::MemoryKind::Features);
        assert!(memory.learn_new && memory.fade_undecoded && !memory.fade_matched);
        let mine = resolve(&["memory.learn_new=false", "method_preset=paper", "min_area=7"]).unwrap();
        assert!(!mine.method.memory().unwrap().learn_new);
        let text = toml::to_string(&mine).unwrap();
        assert!(text.contains("min_area = 7"), "{text}");
        let ours = resolve(&["method_preset=splatseg"]).unwrap();
        assert_eq!(ours, Settings::default());
    }

    #[test]
    fn values_that_the_choices_do_not_use_are_left_out() {
        for assignments in [
            &["method_preset=paper", "method=fastsam"][..],
            &["method_preset=paper", "memory.kind=evidence"],
            &["method_preset=paper", "method=sam2", "tracker=sim", "segmenter=oracle"],
        ] {
            resolve(assignments).unwrap();
        }
        let error = resolve(&["method_preset=paper", "memory.kind=evidence", "memory.learn_new=true"]).unwrap_err();
        assert!(error.to_string().starts_with("memory.learn_new is not used here"), "{error}");
        let error = resolve(&["method_preset=papr"]).unwrap_err();
        assert_eq!(error.to_string(), "method_preset is \"papr\", did you mean paper?");
    }

    #[test]
    fn saved_settings_have_the_values_in_force() {
        let settings = resolve(&["method_preset=paper", "memory.num_steps=5", "method=sam2-splat", "tracker=sim"]);
        let settings = settings.unwrap();
        let json = serde_json::to_string(&settings).unwrap();
        for part in ["\"method_preset\":\"paper\"", "\"learn_new\":true", "\"num_steps\":5", "\"remove_tracks\":false"]
        {
            assert!(json.contains(part), "{part}: {json}");
        }
        assert_eq!(serde_json::from_str::<Settings>(&json).unwrap(), settings);
    }
}
