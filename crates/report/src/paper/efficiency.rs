//! The paper's efficiency table: speed and size of each method.

use super::tables::{Cell, PaperResults, PublishedTable, TableRow};
use super::{EFFICIENCY, PublishedEfficiency};
use crate::Origin;
use crate::spread::Spread;

/// A measured row of the efficiency table.
#[derive(Clone, Debug)]
pub struct EfficiencyRow {
    /// Its name in [`EFFICIENCY`], or that of a row that the paper does not have.
    pub name: String,
    /// Index of the measured variant in the benchmark on ScanNet-MV.
    pub variant: Option<usize>,
    /// Parameters of its backbone, if known.
    pub backbone_parameters: Option<usize>,
    /// Reason why it was not measured.
    pub obstacle: Option<String>,
}

/// The table: for each method our row, then the paper's; at the end our rows that the paper does not have.
pub(super) fn table(results: &PaperResults<'_>) -> PublishedTable {
    let mut rows = Vec::new();
    for published in &EFFICIENCY {
        rows.extend(
            results.efficiency.iter().filter(|row| row.name == published.name).map(|row| measured(results, row)),
        );
        rows.push(of_the_paper(published));
    }
    let is_published = |row: &EfficiencyRow| EFFICIENCY.iter().any(|published| published.name == row.name);
    rows.extend(results.efficiency.iter().filter(|row| !is_published(row)).map(|row| measured(results, row)));
    let machines: Vec<&str> = results.scannet.map(|benchmark| benchmark.machines()).unwrap_or_default();
    let ours = if machines.is_empty() { "nothing was measured".to_owned() } else { machines.join("; ") };
    PublishedTable {
        title: "Efficiency".to_owned(),
        notes: vec![
            "Frames per second of the whole method over all videos, with reading but without scoring and drawing. Millions of numbers: \
             the parameters of FastSAM, or of the tracker without the FastSAM that prompts it, and the memory at the end of \
             a video, mean over the videos."
                .to_owned(),
            "Our Gaussians have 7 numbers (position, radius, colour) plus the numbers for segments: 8 of votes, or one \
             per feature dimension. The paper's Gaussians have 14 (position, rotation, three scales, opacity, colour) \
             and features; the paper does not say how it counts."
                .to_owned(),
            format!("Machine: ours {ours}; the paper's rows are from its authors' GPU."),
        ],
        columns: ["frames/s", "backbone, M", "memory, M", "sum, M"].to_vec(),
        keys: ["frames_per_second", "backbone_parameters_m", "memory_numbers_m", "parameters_m"].to_vec(),
        rows,
        curves: Vec::new(),
    }
}

fn measured(results: &PaperResults<'_>, row: &EfficiencyRow) -> TableRow {
    let of_variant = |variant| results.scannet.map(|benchmark| benchmark.of_variant(variant)).unwrap_or_default();
    let measurements = row.variant.map(of_variant).unwrap_or_default();
    let mean = |values: &[f64]| Spread::from_values(values).map(|spread| spread.mean);
    let speeds = results.scannet.map(|benchmark| benchmark.speeds_by_seed(&measurements)).unwrap_or_default();
    let speed = mean(&speeds);
    let sizes: Vec<f64> = measurements.iter().map(|measurement| measurement.parameters as f64 / 1e6).collect();
    let memory = mean(&sizes).filter(|memory| *memory > 0.0);
    let backbone = row.backbone_parameters.filter(|_| speed.is_some()).map(|count| count as f64 / 1e6);
    TableRow {
        name: row.name.clone(),
        origin: Origin::Measured,
        note: row.obstacle.clone(),
        cells: cells(speed, backbone, memory),
    }
}

fn of_the_paper(published: &PublishedEfficiency) -> TableRow {
    TableRow {
        name: published.name.to_owned(),
        origin: Origin::Paper,
        note: None,
        cells: cells(Some(published.frames_per_second), Some(published.backbone), published.memory),
    }
}

fn cells(speed: Option<f64>, backbone: Option<f64>, memory: Option<f64>) -> Vec<Cell> {
    let sum = backbone.map(|backbone| backbone + memory.unwrap_or(0.0));
    [speed, backbone, memory, sum].map(|value| Cell { value: value.map(Spread::from_mean), mark: "" }).to_vec()
}
