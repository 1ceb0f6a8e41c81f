//! What the methods run on.

use crate::settings::Settings;

/// The processor and its number of threads, or the GPU's kind where the networks run on one: `--device` has no more.
pub fn name(settings: &Settings) -> String {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let processor = processor().unwrap_or_else(|| std::env::consts::ARCH.to_owned());
    let device = settings.run.device.name();
    let network = if device == "cpu" { String::new() } else { format!(", networks on {device}") };
    format!("{processor}, {threads} threads{network}")
}

/// The processor's name, where the system tells it.
pub fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    line.split_once(':').map(|(_, name)| name.trim().to_owned())
}
