//! Time per frame and memory of this process.

use std::fs;
use std::time::Instant;

/// Time of a frame, milliseconds.
#[derive(Clone, Copy)]
pub struct Cost {
    wall: f64,
    /// Of all threads.
    cpu: f64,
}

/// Times of all frames.
#[derive(Default)]
pub struct Costs {
    frames: Vec<(String, Cost, &'static str)>,
    printed: usize,
}

impl Cost {
    /// Measures `work`. The CPU's time is known on Linux only, otherwise it is the wall clock's.
    pub fn of<R>(work: impl FnOnce() -> R) -> (R, Self) {
        let (before, started) = (cpu(), Instant::now());
        let result = work();
        let wall = started.elapsed().as_secs_f64() * 1e3;
        let cpu = before.zip(cpu()).map_or(wall, |(before, after)| after - before);
        (result, Self { wall, cpu })
    }
}

impl Costs {
    pub fn add(&mut self, name: &str, cost: Cost, kind: &'static str) {
        self.frames.push((name.to_owned(), cost, kind));
    }

    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Times since the last call.
    pub fn since_last(&mut self) -> String {
        let from = std::mem::replace(&mut self.printed, self.frames.len());
        let of = |time: fn(&Cost) -> f64| summary(self.frames[from..].iter().map(|(_, cost, _)| time(cost)));
        format!("CPU {}", of(|cost| cost.cpu))
    }

    pub fn print(&self) {
        let of = |time: fn(&Cost) -> f64| summary(self.frames.iter().map(|(_, cost, _)| time(cost)));
        println!("per frame, wall clock: {}", of(|cost| cost.wall));
        println!("per frame, CPU: {}", of(|cost| cost.cpu));
        let mut slowest: Vec<_> = self.frames.iter().collect();
        slowest.sort_by(|one, other| other.1.cpu.total_cmp(&one.1.cpu));
        for (name, cost, kind) in slowest.into_iter().take(5) {
            println!("  {name}: {:.1} ms of CPU {kind}", cost.cpu);
        }
    }
}

fn summary(times: impl Iterator<Item = f64>) -> String {
    let mut times: Vec<f64> = times.collect();
    times.sort_by(f64::total_cmp);
    let quantile = |share: f64| times.get((share * times.len() as f64) as usize).copied().unwrap_or(0.0);
    let (mean, most) = (times.iter().sum::<f64>() / times.len().max(1) as f64, times.last().copied().unwrap_or(0.0));
    let [median, high] = [0.5, 0.99].map(quantile);
    format!("mean {mean:.1}, median {median:.1}, 99 % {high:.1}, maximum {most:.1} ms")
}

/// Time that all threads of this process have been running, milliseconds.
fn cpu() -> Option<f64> {
    let mut total = 0.0;
    for thread in fs::read_dir("/proc/self/task").ok()? {
        // A thread may have ended.
        let text = fs::read_to_string(thread.ok()?.path().join("schedstat")).unwrap_or_default();
        total += text.split(' ').next()?.parse::<f64>().unwrap_or(0.0) * 1e-6;
    }
    Some(total)
}

/// Memory in use by this process.
pub fn memory() -> String {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or(" unknown");
    format!("memory {}", line.trim())
}
