//! Name of the machine that the methods run on.

use splatseg::settings::Settings;

/// Returns the processor and its number of threads, and the device of the networks unless it is the CPU. Only the kind of
/// GPU is known, as `--device` names no more.
pub fn name(settings: &Settings) -> String {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let processor = processor().unwrap_or_else(|| std::env::consts::ARCH.to_owned());
    let device = settings.run.device.name();
    let network = if device == "cpu" { String::new() } else { format!(", networks on {device}") };
    format!("{processor}, {threads} threads{network}")
}

/// Returns the processor's name, if the system reports it.
pub fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    line.split_once(':').map(|(_, name)| name.trim().to_owned())
}
