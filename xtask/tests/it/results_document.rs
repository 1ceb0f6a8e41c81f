//! Every table of results states the version of the program that made it, the same for all.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// The text of each table, by name, in the documents that `tools/results` writes.
fn tables() -> Vec<(String, String)> {
    let mut tables = Vec::new();
    for document in ["README.md", "docs/RESULTS.md", "docs/dev/ABLATIONS.md", "docs/RESULTS_TABLES.md"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(document);
        let text = fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        for part in text.split("<!-- table ").skip(1) {
            let (name, rest) = part.split_once(" -->").unwrap();
            let (table, _) = rest.split_once("<!-- end of table -->").unwrap_or_else(|| panic!("{name} has no end"));
            tables.push((name.to_owned(), table.to_owned()));
        }
    }
    tables
}

/// The line under a table that states its version.
fn stamp(table: &str) -> Option<&str> {
    table.lines().find(|line| line.starts_with("Commit "))
}

#[test]
fn all_tables_are_of_one_version_of_the_program() {
    let tables = tables();
    assert!(tables.len() > 10, "only {} tables found", tables.len());
    let mut commits = BTreeSet::new();
    for (name, table) in &tables {
        let stamp = stamp(table).unwrap_or_else(|| panic!("table {name} is not stamped: run tools/results"));
        let commit = stamp.strip_prefix("Commit ").unwrap().split(',').next().unwrap();
        assert!(commit.len() >= 7 && commit.chars().all(|digit| digit.is_ascii_hexdigit()), "{name}: {stamp}");
        commits.insert(commit);
        assert!(table.lines().filter(|line| line.starts_with('|')).count() >= 3, "table {name} has no rows");
    }
    assert_eq!(commits.len(), 1, "tables of different versions: {commits:?}");
}

#[test]
fn every_table_names_the_commands_that_made_it() {
    for (name, table) in tables() {
        let refers = stamp(&table).is_some_and(|stamp| stamp.contains("the commands of"));
        assert!(refers || table.contains("\nsplatseg "), "table {name} shows no command");
    }
}
