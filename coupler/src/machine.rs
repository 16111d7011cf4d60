//! Where and when a run took place, for its summary.

use std::time::{SystemTime, UNIX_EPOCH};

use serde::Serialize;

/// What matters of a machine for wall times.
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
        // Major and minor version: the rest says who built it.
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

/// What stands behind `key` and a colon in the first such line.
fn value(text: &str, key: &str) -> Option<String> {
    let line = text.lines().find(|line| line.starts_with(key))?;
    line.split_once(':').map(|(_, value)| value.trim().to_owned())
}

/// Now, as `2026-01-31 23:59:59`, UTC.
pub fn utc_now() -> String {
    utc(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs()))
}

/// Seconds since 1970 as a date and time (days to a date: Howard Hinnant, "chrono-compatible
/// low-level date algorithms").
fn utc(seconds: u64) -> String {
    let days = seconds / 86_400 + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    let (hour, minute, second) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        // `date -u -d @SECONDS`.
        for (seconds, text) in [
            (0, "1970-01-01 00:00:00"),
            (951_782_399, "2000-02-28 23:59:59"),
            (951_782_400, "2000-02-29 00:00:00"),
            (1_735_689_599, "2024-12-31 23:59:59"),
            (4_107_542_400, "2100-03-01 00:00:00"),
        ] {
            assert_eq!(utc(seconds), text);
        }
    }

    #[test]
    fn this_machine_has_a_name() {
        let here = Machine::here();
        assert!(here.threads >= 1 && here.system.len() > 5);
        assert_eq!(value("a: 1\nmodel name\t: X 9\n", "model name").as_deref(), Some("X 9"));
    }
}
