//! What a program and its ranks have used of the machine.

use std::fs;

use coupling::partners::Usage;

use super::process;

/// A word of no command line: orphans belong to no program.
const NOBODY: &str = "\n";

/// Of the process `root` and all below it that are alive. MPI waits by spinning, so waiting
/// inside of a program counts as processor time.
pub(super) fn usage(root: u32) -> Usage {
    let ticks = rustix::param::clock_ticks_per_second().max(1) as f64;
    let mut all = Usage::default();
    for seen in process::descendants(&[root], NOBODY) {
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
    fn this_process_uses_something() {
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
