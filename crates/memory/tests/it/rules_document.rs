//! The table of rules in `docs/METHOD.md` against the code.

use splatseg_memory::{MemoryKind, MemoryRules, MemorySettings, SplatMemory};
use std::path::Path;

fn rules(kind: MemoryKind) -> MemoryRules {
    let settings = MemorySettings::default().with(|memory| {
        memory.kind = kind;
        memory.num_codes = 8;
        memory.feature_dim = 4;
    });
    *SplatMemory::new(settings, 0, &mut |_| {}).unwrap().rules()
}

/// The value of a field as the table has it; `None` for a field that is not in the table.
fn value(rules: &MemoryRules, field: &str) -> Option<String> {
    let number = |number: f32| format!("{}", (number * 1e4).round() / 1e4);
    Some(match field {
        "growth" => format!("`{}`", rules.growth.name()),
        "limits.min_alpha" => number(rules.limits.min_alpha),
        "limits.min_transmittance" => number(rules.limits.min_transmittance),
        "compares_frames" => rules.compares_frames.to_string(),
        "expects_previous_ids" => rules.expects_previous_ids.to_string(),
        "counts_ids_per_frame" => rules.counts_ids_per_frame.to_string(),
        "judges_predictions" => rules.judges_predictions.to_string(),
        _ => return None,
    })
}

#[test]
fn the_table_has_the_rules_of_each_kind() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/METHOD.md");
    let text = std::fs::read_to_string(&path).unwrap();
    let kinds = [rules(MemoryKind::Evidence), rules(MemoryKind::Features)];
    let mut rows = 0;
    for line in text.lines().filter_map(|line| line.strip_prefix("| `")) {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let field = cells[0].trim_end_matches('`');
        let expected = kinds.each_ref().map(|rules| value(rules, field).unwrap_or_else(|| panic!("no field {field}")));
        assert_eq!(cells[1..3], expected, "{field}");
        rows += 1;
    }
    assert_eq!(rows, 7);
}
