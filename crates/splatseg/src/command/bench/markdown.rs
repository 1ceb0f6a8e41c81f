//! `tables.md`.

use super::Results;
use super::size_table::SizeTable;
use super::stage_table::StageTable;
use super::tables::{of_scene, over_all_scenes};
use crate::command::score_table::SIZE_COLUMNS_EXPLAINED;
use splatseg_metrics::Protocol;

/// All tables, and what is missing in them.
pub fn document(results: &Results) -> String {
    let plan = results.plan;
    let mut text = format!(
        "# Benchmark\n\nScores are percent, mean ± sample standard deviation over {} seeds. Over several scenes, tubes, \
         tracks and pixels are summed before dividing; scenes are not averaged. {}. splatseg {}.\n\nTables by size: \
         {SIZE_COLUMNS_EXPLAINED}\n\n",
        plan.seeds.len(),
        plan.parts(),
        env!("CARGO_PKG_VERSION"),
    );
    let other = match results.protocol {
        Protocol::Paper => Protocol::Strict,
        Protocol::Strict => Protocol::Paper,
    };
    for protocol in [results.protocol, other] {
        text.push_str(&over_all_scenes(results, protocol).markdown());
        text.push('\n');
    }
    for protocol in [results.protocol, other] {
        text.push_str(&SizeTable::new(results, protocol).markdown());
        text.push('\n');
    }
    text.push_str(&StageTable::new(results).markdown());
    text.push('\n');
    if plan.scenes.len() > 1 {
        for scene in 0..plan.scenes.len() {
            text.push_str(&of_scene(results, scene, results.protocol).markdown());
            text.push('\n');
        }
    }
    if !results.failed.is_empty() {
        text.push_str("## Not measured\n\n");
        for failed in &results.failed {
            let variant = failed.variant.as_ref().map(|variant| format!(" {variant}")).unwrap_or_default();
            let error = failed.error.replace('\n', " ");
            text.push_str(&format!("- {}, {}{variant}, seed {}: {error}\n", failed.scene, failed.method, failed.seed));
        }
    }
    text
}
