//! The measured device.

use serde_json::{Value, json};
use splatseg_models::device::DeviceName;
use splatseg_models::transfer::Transfers;
use splatseg_settings::Choice;

/// Parses an option's value.
pub fn parse_device(name: &str) -> Result<DeviceName, String> {
    DeviceName::from_name(name).ok_or_else(|| format!("expected one of {}", DeviceName::NAMES.join(", ")))
}

/// Mean transfers to and from the device per pass since `before`.
pub fn moved(before: Transfers, passes: usize) -> Value {
    let moved = Transfers::so_far().since(before);
    let each = |count: usize| count as f64 / passes.max(1) as f64;
    json!({ "uploads": each(moved.uploads), "uploaded_mib": each(moved.uploaded_bytes) / f64::from(1 << 20),
        "round_trips": each(moved.downloads), "downloaded_mib": each(moved.downloaded_bytes) / f64::from(1 << 20) })
}
