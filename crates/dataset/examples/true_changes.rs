//! Prints the true changes of a synthetic room with `visit=after`, as JSON.
//!
//! `cargo run --release -p splatseg-dataset --example true_changes -- "synthetic:frames=1,visit=after,seed=3"`

use splatseg_dataset::{SyntheticScene, SyntheticSettings};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let settings: SyntheticSettings = std::env::args().nth(1).ok_or("expected the scene")?.parse()?;
    println!("{}", serde_json::to_string_pretty(SyntheticScene::new(settings)?.changes())?);
    Ok(())
}
