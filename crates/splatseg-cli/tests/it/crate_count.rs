//! The command without features stays small: the first command of the README builds it.

use std::collections::BTreeSet;
use std::process::Command;

/// Maximum number of crates, with those of this project, that `cargo run --release -- demo` builds.
const MAX_CRATES: usize = 200;

/// Crates that only the features `networks`, `ros2` and `mcp` may bring.
const OF_FEATURES: [&str; 6] = ["burn", "burn-flex", "rmcp", "rustdds", "splatseg-mcp", "splatseg-ros2"];

#[test]
fn the_demo_is_built_from_few_crates() {
    let Some(core) = crates(&[]) else { return };
    let has = |crates: &BTreeSet<String>, name: &str| crates.iter().any(|found| found.starts_with(&format!("{name} ")));
    assert!(has(&core, "splatseg-segmenter"), "{core:?}");
    assert!(core.len() <= MAX_CRATES, "{} crates, expected at most {MAX_CRATES}: {core:?}", core.len());
    assert!(OF_FEATURES.iter().all(|name| !has(&core, name)), "{core:?}");
    let Some(all) = crates(&["--features", "networks,ros2,mcp"]) else { return };
    assert!(OF_FEATURES.iter().all(|name| has(&all, name)), "{all:?}");
}

/// Returns the names and versions of the crates that the command is built from on this machine; `None`, which is reported, if Cargo
/// cannot tell.
fn crates(features: &[&str]) -> Option<BTreeSet<String>> {
    let mut cargo = Command::new(option_env!("CARGO").unwrap_or("cargo"));
    cargo.args(["tree", "--package", "splatseg-cli", "--locked", "--offline", "--edges", "normal,build"]);
    cargo.args(["--prefix", "none", "--format", "{p}"]).args(features).current_dir(env!("CARGO_MANIFEST_DIR"));
    let output = match cargo.output() {
        Ok(output) => output,
        Err(error) => return skipped(&format!("cargo cannot be run: {error}")),
    };
    let complaint = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() {
        // Without a copy of every dependency, Cargo would have to fetch some.
        assert!(complaint.contains("offline") || complaint.contains("download"), "{complaint}");
        return skipped(complaint.lines().next().unwrap_or("cargo tree failed"));
    }
    let lines = String::from_utf8_lossy(&output.stdout);
    let name_and_version = |line: &str| line.split(' ').take(2).collect::<Vec<_>>().join(" ");
    Some(lines.lines().map(name_and_version).collect())
}

/// Reports that the test was skipped.
fn skipped<T>(reason: &str) -> Option<T> {
    splatseg_test_scenes::skipped("the_demo_is_built_from_few_crates", reason);
    None
}
