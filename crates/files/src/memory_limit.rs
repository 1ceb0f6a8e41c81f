//! The program's memory limit.

use serde::{Deserialize, Serialize};
use splatseg_settings::{Allowed, SettingValue};
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::atomic::{AtomicU64, Ordering};
use thiserror::Error;

/// Memory assumed to be available if the system does not report it.
const FALLBACK_BYTES: u64 = 4_000_000_000;

/// Units of sizes, in bytes.
const UNITS: [(&str, f64); 8] = [
    ("KiB", 1024.0),
    ("MiB", 1_048_576.0),
    ("GiB", 1_073_741_824.0),
    ("TiB", 1_099_511_627_776.0),
    ("kB", 1e3),
    ("MB", 1e6),
    ("GB", 1e9),
    ("TB", 1e12),
];

/// The limit in force, bytes; 0 if not set.
static IN_FORCE: AtomicU64 = AtomicU64::new(0);

/// The most memory that the program takes to read one input file, written `4GB`, `512MiB` or, for the machine's available
/// memory, `auto`. What a file claims to need is compared with it before memory is allocated. It does not limit what the
/// program has in all, e.g. its map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MemoryLimit {
    /// The machine's available memory.
    #[default]
    Auto,
    /// This many bytes.
    Bytes(u64),
}

/// A text that is not a memory size.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("memory limit: found {0:?}, expected {expected}", expected = MemoryLimit::EXPECTED)]
pub struct ByteSizeTextError(String);

impl MemoryLimit {
    /// Description of the accepted texts, for error messages.
    pub const EXPECTED: &str = "a size such as 4GB or 512MiB, or auto";

    /// The limit in bytes; for `auto`, the currently available memory. On Linux that is `MemAvailable` of
    /// `/proc/meminfo`, or the limit of the control group or of the address space if it is lower; elsewhere it is 4 GB.
    pub fn bytes(self) -> u64 {
        match self {
            Self::Auto => available_bytes(),
            Self::Bytes(bytes) => bytes,
        }
    }

    /// Sets the limit of the whole process. Memory is shared by the process, so there is one limit. The command calls
    /// this with the setting `memory_limit`; a program that uses the library must call it itself.
    pub fn enforce(self) {
        IN_FORCE.store(self.bytes().max(1), Ordering::Relaxed);
    }

    /// The limit of the process, bytes; that of `auto` if none was set.
    pub fn in_force() -> u64 {
        match IN_FORCE.load(Ordering::Relaxed) {
            0 => {
                Self::Auto.enforce();
                IN_FORCE.load(Ordering::Relaxed)
            }
            bytes => bytes,
        }
    }
}

impl fmt::Display for MemoryLimit {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self::Bytes(bytes) = *self else { return formatter.write_str("auto") };
        let exact = |(_, size): &&(&str, f64)| bytes > 0 && bytes.is_multiple_of(*size as u64);
        // The largest unit that divides it.
        match UNITS.iter().filter(exact).max_by(|left, right| left.1.total_cmp(&right.1)) {
            Some((unit, size)) => write!(formatter, "{}{unit}", bytes / *size as u64),
            None => write!(formatter, "{bytes}B"),
        }
    }
}

impl FromStr for MemoryLimit {
    type Err = ByteSizeTextError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = || ByteSizeTextError(text.to_owned());
        let trimmed = text.trim();
        if trimmed.eq_ignore_ascii_case("auto") {
            return Ok(Self::Auto);
        }
        let digits = trimmed.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(trimmed.len());
        let (number, unit) = (&trimmed[..digits], trimmed[digits..].trim_start());
        let unit = match unit {
            "" | "B" => 1.0,
            unit => UNITS.iter().find(|(name, _)| name.eq_ignore_ascii_case(unit)).ok_or_else(wrong)?.1,
        };
        let bytes = number.parse::<f64>().map_err(|_| wrong())? * unit;
        // Integers below 2^53 are exact.
        if (1.0..9e15).contains(&bytes) { Ok(Self::Bytes(bytes.round() as u64)) } else { Err(wrong()) }
    }
}

impl SettingValue for MemoryLimit {
    fn text(&self) -> Option<String> {
        Some(format!("\"{self}\""))
    }

    fn is_text_of(text: &str) -> bool {
        text.parse::<Self>().is_ok()
    }

    fn is_allowed(&self, _: &Allowed) -> bool {
        true
    }
}

impl Serialize for MemoryLimit {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for MemoryLimit {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

/// A number of bytes in a readable form: `363 kB`, `12 GB`.
pub fn display_bytes(bytes: u64) -> String {
    let bytes = bytes as f64;
    let (unit, size) = [("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)]
        .into_iter()
        .find(|(_, size)| bytes >= *size)
        .unwrap_or(("bytes", 1.0));
    let value = bytes / size;
    if value < 10.0 && size > 1.0 { format!("{value:.1} {unit}") } else { format!("{value:.0} {unit}") }
}

fn available_bytes() -> u64 {
    let machine = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| available_in(&text));
    [machine, control_group_limit(), address_space_limit()].into_iter().flatten().min().unwrap_or(FALLBACK_BYTES)
}

/// The limit of the process's address space (`ulimit -v`), bytes; `None` if there is none, and on systems other than Linux.
pub fn address_space_limit() -> Option<u64> {
    address_space_in(&std::fs::read_to_string("/proc/self/limits").ok()?)
}

/// The address space in `/proc/self/limits`, bytes.
fn address_space_in(limits: &str) -> Option<u64> {
    let line = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// `MemAvailable` of `/proc/meminfo`, bytes.
fn available_in(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kibibytes.checked_mul(1024)
}

/// The lowest limit of the process's control group and its ancestors, bytes.
fn control_group_limit() -> Option<u64> {
    let groups = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    groups
        .lines()
        .flat_map(limit_files)
        .filter_map(|file| std::fs::read_to_string(file).ok()?.trim().parse().ok())
        .min()
}

/// The files with the limits for a line `number:controllers:/path` of `/proc/self/cgroup`, from the group itself to the
/// root. In version 2, the line has no controllers.
fn limit_files(line: &str) -> Vec<PathBuf> {
    let mut parts = line.splitn(3, ':').skip(1);
    let (Some(controllers), Some(group)) = (parts.next(), parts.next()) else { return Vec::new() };
    let (root, file) = match controllers {
        "" => (Path::new("/sys/fs/cgroup"), "memory.max"),
        other if other.split(',').any(|name| name == "memory") => {
            (Path::new("/sys/fs/cgroup/memory"), "memory.limit_in_bytes")
        }
        _ => return Vec::new(),
    };
    Path::new(group.trim_start_matches('/')).ancestors().map(|group| root.join(group).join(file)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_back_as_they_are_written() {
        for (text, bytes) in [("4GB", 4_000_000_000), ("512MiB", 1 << 29), ("1.5 gb", 1_500_000_000), ("800", 800)] {
            let limit: MemoryLimit = text.parse().unwrap();
            assert_eq!(limit, MemoryLimit::Bytes(bytes));
            assert_eq!(limit.to_string().parse(), Ok(limit), "{limit}");
        }
        assert_eq!(MemoryLimit::Bytes(4_000_000_000).to_string(), "4GB");
        assert_eq!("auto".parse(), Ok(MemoryLimit::Auto));
        for wrong in ["", "GB", "-1GB", "4 XB", "0", "1e99GB", "99999999TB", "NaN"] {
            let error = wrong.parse::<MemoryLimit>().unwrap_err().to_string();
            assert!(error.ends_with("expected a size such as 4GB or 512MiB, or auto"), "{wrong}: {error}");
        }
    }

    #[test]
    fn amounts_are_easy_to_read() {
        let texts = [(12, "12 bytes"), (363_000, "363 kB"), (5_800_000_000, "5.8 GB"), (11_800_000_000, "12 GB")];
        for (bytes, text) in texts {
            assert_eq!(display_bytes(bytes), text);
        }
    }

    #[test]
    fn the_system_says_what_is_available() {
        assert_eq!(available_in("MemTotal: 9 kB\nMemAvailable:   2000 kB\n"), Some(2_048_000));
        assert_eq!(available_in("MemTotal: 9 kB\n"), None);
        let limits = "Max cpu time  unlimited  unlimited  seconds\nMax address space  2000000  unlimited  bytes\n";
        assert_eq!(address_space_in(limits), Some(2_000_000));
        assert_eq!(address_space_in("Max address space  unlimited  unlimited  bytes\n"), None);
        let files = limit_files("0::/user.slice/job");
        let expected = ["user.slice/job/memory.max", "user.slice/memory.max", "memory.max"];
        assert_eq!(files, expected.map(|file| Path::new("/sys/fs/cgroup").join(file)));
        assert_eq!(limit_files("4:cpu,memory:/a")[0], Path::new("/sys/fs/cgroup/memory/a/memory.limit_in_bytes"));
        assert!(limit_files("5:devices:/a").is_empty());
        assert!(MemoryLimit::Auto.bytes() > 0 && MemoryLimit::in_force() > 0);
    }
}
