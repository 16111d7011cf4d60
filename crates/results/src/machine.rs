//! The machine of a run, for the summary.

use std::path::Path;

use serde::Serialize;

/// Properties of a machine that affect wall times.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Machine {
    /// Model of the processor; empty if unknown.
    pub processor: String,
    /// Hardware threads that this process may use.
    pub threads: usize,
    /// Main memory, GiB; 0 if unknown.
    pub memory_gib: f64,
    /// Kernel and architecture.
    pub system: String,
}

impl Machine {
    /// The machine of this process.
    pub fn here() -> Self {
        let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
        let kilobytes = value(&read("/proc/meminfo"), "MemTotal")
            .and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
        // Major and minor version only.
        let release = read("/proc/sys/kernel/osrelease");
        let release: Vec<&str> = release.trim().split('.').take(2).collect();
        Self {
            processor: value(&read("/proc/cpuinfo"), "model name").unwrap_or_default(),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            memory_gib: kilobytes.map_or(0.0, |k| (k / 1024.0 / 1024.0 * 10.0).round() / 10.0),
            system: format!("{} {} {}", std::env::consts::OS, release.join("."), std::env::consts::ARCH),
        }
    }
}

/// Free bytes in the file system of `folder`; `None` if unknown.
pub fn free_in(folder: &Path) -> Option<u64> {
    rustix::fs::statvfs(folder).ok().map(|s| s.f_bavail * s.f_frsize)
}

/// Value after `key` and a colon in the first line that starts with `key`.
fn value(text: &str, key: &str) -> Option<String> {
    let line = text.lines().find(|line| line.starts_with(key))?;
    line.split_once(':').map(|(_, value)| value.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn machine_is_described() {
        let here = Machine::here();
        assert!(here.threads >= 1 && here.system.len() > 5);
        assert_eq!(value("a: 1\nmodel name\t: X 9\n", "model name").as_deref(), Some("X 9"));
    }
}
