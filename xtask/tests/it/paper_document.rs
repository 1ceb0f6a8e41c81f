//! `docs/PAPER.md` maps each rule of the paper to the code. Everything that it names must exist.

use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The texts between backticks.
fn code(cell: &str) -> Vec<&str> {
    cell.split('`').skip(1).step_by(2).collect()
}

/// One row of a table of rules.
struct Rule {
    line: usize,
    file: String,
    functions: String,
    settings: String,
}

fn rules() -> Vec<Rule> {
    let text = read(&root().join("docs/PAPER.md"));
    let mut rules = Vec::new();
    for (index, line) in text.lines().enumerate().filter(|(_, line)| line.starts_with("| ")) {
        // `\|` is a bar inside a cell.
        let line = line.replace(r"\|", " ");
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        assert_eq!(cells.len(), 6, "docs/PAPER.md:{}: every table has six columns", index + 1);
        if cells[0] == "paper" || cells[0].starts_with("---") {
            continue;
        }
        let [file, functions, settings] = [cells[2], cells[3], cells[5]].map(str::to_owned);
        rules.push(Rule { line: index + 1, file, functions, settings });
    }
    assert!(rules.len() > 30, "only {} rules found in docs/PAPER.md", rules.len());
    rules
}

/// True if the source defines a function, type or constant of that name.
fn defines(source: &str, name: &str) -> bool {
    let ends = |rest: &str| !rest.starts_with(|next: char| next.is_alphanumeric() || next == '_');
    ["fn ", "struct ", "enum ", "trait "].iter().any(|keyword| {
        let wanted = format!("{keyword}{name}");
        source.match_indices(&wanted).any(|(at, _)| ends(&source[at + wanted.len()..]))
    })
}

/// True if the sources declare a setting with that full key: a line of `settings!` in the key's section.
fn declares(sources: &str, key: &str) -> bool {
    let (section, field) = key.rsplit_once('.').unwrap_or(("", key));
    let (header, declaration) = (format!(" in \"{section}\" {{"), format!("{field}: "));
    let is_declaration = |line: &str| line.trim_start().starts_with(&declaration) && line.contains(" Allowed::");
    sources.split("settings! {").any(|block| block.contains(&header) && block.lines().any(is_declaration))
}

/// The text of every source file below a folder.
fn sources(folder: &Path, text: &mut String) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, text);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            text.push_str(&read(&path));
        }
    }
}

#[test]
fn files_and_functions_exist() {
    let mut wrong = Vec::new();
    for rule in rules() {
        let (files, functions) = (code(&rule.file), code(&rule.functions));
        if files.len() != 1 || functions.is_empty() {
            wrong.push(format!("line {}: expected one file and at least one function", rule.line));
            continue;
        }
        let Ok(source) = fs::read_to_string(root().join(files[0])) else {
            wrong.push(format!("line {}: {} does not exist", rule.line, files[0]));
            continue;
        };
        let missing = functions.iter().filter(|name| !defines(&source, name));
        wrong.extend(missing.map(|name| format!("line {}: {} does not define {name}", rule.line, files[0])));
    }
    assert!(wrong.is_empty(), "docs/PAPER.md:\n{}", wrong.join("\n"));
}

#[test]
fn settings_exist() {
    let mut text = String::new();
    sources(&root().join("crates"), &mut text);
    let mut wrong = Vec::new();
    for rule in rules() {
        let keys = code(&rule.settings).into_iter().filter(|key| key.contains('.') || key.contains('_'));
        for key in keys.filter(|key| !key.starts_with('-')) {
            if !declares(&text, key) {
                wrong.push(format!("line {}: there is no setting {key}", rule.line));
            }
        }
    }
    assert!(wrong.is_empty(), "docs/PAPER.md:\n{}", wrong.join("\n"));
}

#[test]
fn names_are_found_whole() {
    let source = "pub(crate) fn by_paper(x: u8) {}\nstruct Codebook;";
    assert!(defines(source, "by_paper") && defines(source, "Codebook"));
    assert!(!defines(source, "by") && !defines(source, "paper") && !defines(source, "Code"));
    let source = "settings! {\n pub struct S in \"oven\" {\n  heat: f32 = 1.0, Allowed::above(0.0);\n }\n}";
    assert!(declares(source, "oven.heat"));
    assert!(!declares(source, "heat") && !declares(source, "oven.hea") && !declares(source, "pan.heat"));
}
