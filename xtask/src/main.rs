//! Measurements and pictures for developers of splatseg; users need none of them. See `cargo xtask --help`.

mod affinity_speed;
mod calibrate_oracle;
mod device;
mod fastsam_speed;
mod make_standins;
mod peak_memory;
mod readme_picture;
mod sam2_speed;
mod standins;

use clap::{Parser, Subcommand};

/// Measurements and pictures for developers of splatseg
#[derive(Parser)]
#[command(name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    AffinitySpeed(affinity_speed::Arguments),
    CalibrateOracle(calibrate_oracle::Arguments),
    FastsamSpeed(fastsam_speed::Arguments),
    Sam2Speed(sam2_speed::Arguments),
    ReadmePicture(readme_picture::Arguments),
    MakeStandins(make_standins::Arguments),
}

fn main() -> anyhow::Result<()> {
    match Arguments::parse().task {
        Task::AffinitySpeed(arguments) => affinity_speed::run(&arguments),
        Task::CalibrateOracle(arguments) => calibrate_oracle::run(&arguments),
        Task::FastsamSpeed(arguments) => fastsam_speed::run(&arguments),
        Task::Sam2Speed(arguments) => sam2_speed::run(&arguments),
        Task::ReadmePicture(arguments) => readme_picture::run(&arguments),
        Task::MakeStandins(arguments) => make_standins::run(&arguments),
    }
}
