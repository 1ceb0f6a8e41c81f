//! `docs/SETTINGS.md`.

use super::{Entry, entries};
use std::fmt::Write as _;

/// Every setting whose key contains `part`, as Markdown with a table per section; `None` if there is no such setting.
/// With an empty `part` this is `docs/SETTINGS.md`.
pub fn markdown(part: &str) -> Option<String> {
    let entries: Vec<Entry> = entries().into_iter().filter(|entry| entry.field.key().contains(part)).collect();
    if entries.is_empty() {
        return None;
    }
    let mut text = String::new();
    if part.is_empty() {
        text.push_str(
            "# Settings\n\nA setting has the same name in a TOML file (`--config`), in `--set KEY=VALUE`, in \
             `summary.json` and in the library.\nSome also have their own option, e.g. `--segmenter`. A setting that \
             the chosen method, segmenter, tracker or memory does\nnot use is an error. `splatseg settings` prints \
             this page.\n",
        );
    }
    let mut section = None;
    for entry in &entries {
        if section != Some(entry.field.section) {
            section = Some(entry.field.section);
            let title = if entry.field.section.is_empty() { "Top level" } else { entry.field.section };
            let _ = write!(
                text,
                "\n## {title}\n\n| setting | default | allowed values | used with | meaning |\n|---|---|---|---|---|\n"
            );
        }
        let field = &entry.field;
        let default = field.default.as_ref().map_or_else(|| "–".to_owned(), |default| format!("`{default}`"));
        let whole = if field.whole { "whole number, " } else { "" };
        let needs: Vec<String> = entry.needs.iter().map(ToString::to_string).collect();
        let needs = if needs.is_empty() { "everything".to_owned() } else { needs.join("; ") };
        let _ = writeln!(
            text,
            "| `{}` | {default} | {whole}{} | {needs} | {} |",
            field.key(),
            field.allowed,
            field.help.replace('|', "\\|")
        );
    }
    Some(text)
}
