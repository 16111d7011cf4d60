//! Processor time and memory of a program and its ranks.

use std::fs;

use coupling::partners::Usage;

use super::process;

/// A session name that no command line contains, to exclude orphans.
const NO_SESSION: &str = "\n";

/// Usage of the process `root` and its live descendants. MPI waits by polling, so waiting
/// within a program counts as processor time.
pub(super) fn usage(root: u32) -> Usage {
    let ticks = rustix::param::clock_ticks_per_second().max(1) as f64;
    let mut all = Usage::default();
    for seen in process::descendants(&[root], NO_SESSION) {
        let one = of(seen.process, ticks).unwrap_or_default();
        all.cpu_s += one.cpu_s;
        all.peak_bytes += one.peak_bytes;
    }
    all
}

fn of(process: u32, ticks: f64) -> Option<Usage> {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let fields: Vec<&str> = stat[stat.rfind(')')? + 2..].split(' ').collect();
    let time: f64 = fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?;
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let peak = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kilobytes: u64 = peak.trim().trim_end_matches(" kB").parse().ok()?;
    Some(Usage { cpu_s: time / ticks, peak_bytes: 1024 * kilobytes })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usage_of_this_process_is_measured() {
        let block = vec![1u8; 64 << 20];
        let mut sum = 0u64;
        let start = std::time::Instant::now();
        while start.elapsed().as_millis() < 60 {
            sum = block.iter().fold(sum, |s, b| s.wrapping_mul(31).wrapping_add(u64::from(*b)));
        }
        let used = usage(std::process::id());
        assert!(sum != 0 && used.peak_bytes >= 64 << 20 && used.cpu_s > 0.02, "{used:?}");
    }
}
