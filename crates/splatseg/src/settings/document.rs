//! The text of `docs/SETTINGS.md` and of `splatseg settings`.

use super::table::nearest_key;
use super::{Entry, MethodPreset, entries};
use serde::Serialize;
use std::fmt::Write as _;

const INTRODUCTION: &str = "# Settings

A setting has the same name in TOML files (`--config`), `--set KEY=VALUE`, `summary.json` and the library. Some settings
also have their own option, e.g. `--segmenter`. Giving a setting that the chosen method, segmenter, tracker or memory
does not use is an error. `splatseg settings` prints this page, `splatseg settings NAME` one section or setting.
`method_preset = \"paper\"` (`--method-preset paper`) changes some defaults; the tables list both. Explicit values
override both. `--config` also accepts the `summary.json` of an earlier run, which lists every setting in use.
";

/// Returns the text of `docs/SETTINGS.md`: every setting, in one table per section.
pub fn markdown() -> String {
    format!("{INTRODUCTION}{}", tables(&entries()))
}

/// A setting in words, for programs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DescribedSetting {
    /// Its full key.
    pub key: String,
    /// Its default as in TOML; `None` if it has none.
    pub default: Option<String>,
    /// Its default with `method_preset = "paper"`, if that differs.
    pub paper_default: Option<String>,
    /// The allowed values, in words.
    pub allowed: String,
    /// The choices without which it is not used; empty for settings that are always used.
    pub used_with: Vec<String>,
    /// Its effect.
    pub help: String,
}

impl DescribedSetting {
    fn new(entry: &Entry) -> Self {
        let key = entry.field.key();
        Self {
            default: entry.field.default.clone(),
            paper_default: MethodPreset::Paper.default_of(&key),
            allowed: allowed(entry),
            used_with: entry.needs.iter().map(ToString::to_string).collect(),
            help: entry.field.help(),
            key,
        }
    }

    /// A few lines, without Markdown, at most `width` characters wide if words allow it.
    fn text(&self, width: usize) -> String {
        let default = self.default.as_deref().unwrap_or("none");
        let paper = self.paper_default.as_ref().map(|value| format!(" (method_preset = paper: {value})"));
        let used_with = if self.used_with.is_empty() { "everything".to_owned() } else { self.used_with.join("; ") };
        let lines = [
            format!("default: {default}{}", paper.unwrap_or_default()),
            format!("allowed: {}", self.allowed),
            format!("used with: {used_with}"),
            self.help.replace('`', ""),
        ];
        let lines = lines.iter().flat_map(|line| wrapped(line, width.saturating_sub(INDENT.len())));
        lines.fold(format!("{}\n", self.key), |text, line| format!("{text}{INDENT}{line}\n"))
    }
}

/// Before each line about a setting, except its key.
const INDENT: &str = "  ";

/// Breaks a line between words.
fn wrapped(line: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in line.split_whitespace() {
        match lines.last_mut() {
            Some(last) if last.is_empty() => last.push_str(word),
            Some(last) if last.chars().count() + 1 + word.chars().count() <= width => *last += &format!(" {word}"),
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Returns the settings that `name` selects, or all. Tries in order: the setting with this key, the section, all settings
/// with this name in any section, all settings whose key contains it.
///
/// # Errors
/// If there are none: the most similar key, if one is similar enough.
pub fn described_settings(name: Option<&str>) -> Result<Vec<DescribedSetting>, Option<String>> {
    let selected = name.map_or_else(|| Ok(entries()), selected)?;
    Ok(selected.iter().map(DescribedSetting::new).collect())
}

/// Returns the settings that `name` selects, or all, as text without Markdown, at most `width` characters wide if words
/// allow it.
///
/// # Errors
/// As [`described_settings`].
pub fn settings_text(name: Option<&str>, width: usize) -> Result<String, Option<String>> {
    let settings: Vec<String> = described_settings(name)?.iter().map(|setting| setting.text(width)).collect();
    Ok(settings.join("\n"))
}

/// Returns the settings that `name` selects as Markdown; one setting as a few lines of text.
///
/// # Errors
/// As [`described_settings`].
pub fn describe_settings(name: &str) -> Result<String, Option<String>> {
    Ok(match selected(name)?.as_slice() {
        [one] => DescribedSetting::new(one).text(usize::MAX),
        several => tables(several).trim_start().to_owned(),
    })
}

fn selected(name: &str) -> Result<Vec<Entry>, Option<String>> {
    let section = format!("{name}.");
    let has_name: [&dyn Fn(&str) -> bool; 4] =
        [&|key| key == name, &|key| key.starts_with(&section), &|key| key.rsplit('.').next() == Some(name), &|key| {
            key.contains(name)
        }];
    let entries = entries();
    for has_name in has_name {
        let selected: Vec<Entry> = entries.iter().filter(|entry| has_name(&entry.field.key())).cloned().collect();
        if !selected.is_empty() {
            return Ok(selected);
        }
    }
    Err(nearest_key(name, entries.iter().map(|entry| entry.field.key())))
}

/// Returns a Markdown table for each section.
fn tables(entries: &[Entry]) -> String {
    let mut text = String::new();
    let mut section = None;
    for entry in entries {
        let field = &entry.field;
        if section != Some(field.section) {
            section = Some(field.section);
            let title = if field.section.is_empty() { "Top level" } else { field.section };
            let _ = write!(
                text,
                "\n## {title}\n\n| setting | default | allowed values | used with | meaning |\n|---|---|---|---|---|\n"
            );
        }
        let default = field.default.as_ref().map_or_else(|| "–".to_owned(), |default| format!("`{default}`"));
        let paper = MethodPreset::Paper.default_of(&field.key()).map(|value| format!("; `paper`: `{value}`"));
        let default = default + &paper.unwrap_or_default();
        let (key, allowed, needs, help) = (field.key(), allowed(entry), needs(entry), field.help().replace('|', "\\|"));
        let _ = writeln!(text, "| `{key}` | {default} | {allowed} | {needs} | {help} |");
    }
    text
}

fn allowed(entry: &Entry) -> String {
    let whole = if entry.field.whole { "whole number, " } else { "" };
    format!("{whole}{}", entry.field.allowed)
}

fn needs(entry: &Entry) -> String {
    let needs: Vec<String> = entry.needs.iter().map(ToString::to_string).collect();
    if needs.is_empty() { "everything".to_owned() } else { needs.join("; ") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    // Not in `tests/it`: a part that is registered there would be in the text.
    #[test]
    fn the_document_is_up_to_date() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/SETTINGS.md");
        let document = std::fs::read_to_string(&path).unwrap_or_default();
        let differs = document.trim_end() != markdown().trim_end();
        assert!(!differs, "{} is not up to date: splatseg settings > docs/SETTINGS.md", path.display());
    }

    #[test]
    fn a_name_selects_a_setting_a_section_or_all_of_that_name() {
        let one = describe_settings("memory.max_votes").unwrap();
        assert_eq!(describe_settings("max_votes").as_deref(), Ok(one.as_str()));
        let lines: Vec<&str> = one.lines().collect();
        assert_eq!(lines[..3], ["memory.max_votes", "  default: 4", "  allowed: more than 0 and at most 1000000"]);
        assert!(lines[3].starts_with("  used with: method = ") && lines[4].contains("votes"), "{one}");
        // Not `tracker_weights`.
        assert!(describe_settings("weights").unwrap().starts_with("weights\n"));
        let graph = describe_settings("graph").unwrap();
        for section in ["## graph\n", "## graph.surface\n", "`graph.borders.bias`"] {
            assert!(graph.contains(section), "{graph}");
        }
        assert!(!graph.contains("memory."), "{graph}");
        let two = describe_settings("image_size").unwrap();
        assert!(two.contains("`sam2.image_size`") && two.contains("`fastsam.image_size`"), "{two}");
        assert_eq!(describe_settings("memory.max_votess"), Err(Some("memory.max_votes".to_owned())));
        assert_eq!(describe_settings("QQQ"), Err(None));
    }
}
