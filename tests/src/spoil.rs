//! Deterministic mutation fuzzing of file readers: no panic, no excessive memory, and either an error that names the file or
//! a value that passes all checks.
//!
//! A test uses [`Measured`] as its allocator. Each format is tested with `INPUTS` mutations (10 000 by default; more with
//! `scripts/fuzz`).

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// Allocator that records the largest block requested by a thread.
pub struct Measured;

thread_local! {
    static LARGEST: Cell<usize> = const { Cell::new(0) };
}

fn note(size: usize) {
    // The record of an ending thread no longer exists.
    let _ = LARGEST.try_with(|largest| largest.set(largest.get().max(size)));
}

// SAFETY: forwards to the system allocator.
unsafe impl GlobalAlloc for Measured {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note(layout.size());
        // SAFETY: as the caller promised.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        note(layout.size());
        // SAFETY: as the caller promised.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        note(size);
        // SAFETY: as the caller promised.
        unsafe { System.realloc(block, layout, size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: as the caller promised.
        unsafe { System.dealloc(block, layout) }
    }
}

/// Maximum size of a block relative to the file size; blocks up to [`FLOOR`] are always allowed.
pub const SHARE: usize = 64;
/// Block size that is allowed for files of any size, bytes.
pub const FLOOR: usize = 4 << 20;

/// xorshift64*.
pub struct Random(pub u64);

impl Random {
    /// The next number.
    #[allow(clippy::should_implement_trait, reason = "it never ends")]
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// A number below `n`, 0 for 0.
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

const WORDS: [&str; 34] = [
    "nan",
    "-nan",
    "inf",
    "-1",
    "0",
    "1e308",
    "1e400",
    "1e-320",
    "-0.0",
    "9223372036854775807",
    "18446744073709551615",
    "4294967296",
    "2147483647",
    "[",
    "]",
    "{",
    "}",
    "\"",
    "'",
    "\"\"\"",
    "\n",
    "=",
    ".",
    ",",
    "#",
    "true",
    "\"x\"",
    "[[stage]]",
    "[flow]",
    "\u{0}",
    "\u{fe0f}ü",
    "$Nodes",
    "$EndNodes",
    "$Elements",
];

/// Mutates a valid file in one to four places.
pub fn spoilt(good: &[u8], other: &[u8], r: &mut Random) -> Vec<u8> {
    let mut bytes = good.to_vec();
    for _ in 0..=r.below(4) {
        let at = r.below(bytes.len() + 1);
        let length = 1 + r.below(16).min(r.below(1 + bytes.len() - at.min(bytes.len())));
        let end = (at + length).min(bytes.len());
        match r.below(12) {
            0 => bytes.truncate(at),
            1 => drop(bytes.drain(at..end)),
            2 => {
                let again = bytes[at..end].to_vec();
                bytes.splice(at..at, again);
            }
            3 => {
                let from = r.below(other.len());
                let piece = &other[from..(from + r.below(64)).min(other.len())];
                bytes.splice(at..end, piece.iter().copied());
            }
            4 | 5 => drop(bytes.splice(at..end, WORDS[r.below(WORDS.len())].bytes())),
            6 => {
                // Replaces a word or number by another.
                let word = |b: &u8| !b.is_ascii_whitespace() && !b"=,[]".contains(b);
                let from = (at..bytes.len()).find(|&i| word(&bytes[i])).unwrap_or(at);
                let to = (from..bytes.len()).find(|&i| !word(&bytes[i])).unwrap_or(from);
                bytes.splice(from..to, WORDS[r.below(WORDS.len())].bytes());
            }
            7 => {
                // A count: a bincode marker of long integers, or eight bytes.
                let count = [u64::MAX, 1 << 40, 1 << 31, 1 << 20, 0][r.below(5)].to_le_bytes();
                let mark = [&[253u8][..], &[]][r.below(2)];
                let whole: Vec<u8> = mark.iter().copied().chain(count).collect();
                let end = (at + whole.len()).min(bytes.len());
                bytes.splice(at..end, whole);
            }
            8 if at < end => bytes[at] ^= 1 << r.below(8),
            9 if at < end => bytes[at..end].fill([0, 0xff, 0x7f, 0x80][r.below(4)]),
            _ if at < end => bytes[at] = r.next() as u8,
            _ => {}
        }
    }
    bytes
}

/// Number of inputs per format.
pub fn inputs() -> usize {
    std::env::var("INPUTS").ok().and_then(|n| n.parse().ok()).unwrap_or(10_000)
}

/// Function that corrects checksums.
pub type Seal = fn(&mut Vec<u8>);

/// Runs `work`. Returns its result (`None` after a panic) and the largest block requested by this thread, bytes.
pub fn measured<T>(work: impl FnOnce() -> T) -> (Option<T>, usize) {
    LARGEST.with(|l| l.set(0));
    let result = catch_unwind(AssertUnwindSafe(work)).ok();
    (result, LARGEST.with(Cell::get))
}

/// Writes an input to a file for inspection; returns the file.
pub fn kept(name: &str, i: usize, bytes: &[u8]) -> String {
    let file = std::env::temp_dir().join(format!("ripstop-fuzz-{name}-{i}"));
    std::fs::write(&file, bytes).expect("written");
    file.display().to_string()
}

/// Tests `reader` with mutations of `good`; `reader` returns the fault found with an input, if any. `seal` corrects
/// checksums, so that the checks after them are tested too.
pub fn fuzz(
    name: &str,
    good: &[Vec<u8>],
    seal: Seal,
    reader: &mut dyn FnMut(&[u8]) -> Result<(), String>,
    place: &str,
) {
    for bytes in good {
        reader(bytes).unwrap_or_else(|e| panic!("{name}: a good input is refused: {e}"));
    }
    // These files start with a header of lengths and checksums.
    let anywhere = name.ends_with("state") || name.ends_with("memory");
    let mut r = Random(0x5eed ^ name.len() as u64);
    let mut refused = 0;
    // Panics are reported below with their input.
    for i in 0..inputs() {
        let (a, b) = (r.below(good.len()), r.below(good.len()));
        let mut bytes =
            if anywhere { spoilt_anywhere(&good[a], &mut r) } else { spoilt(&good[a], &good[b], &mut r) };
        if r.below(4) > 0 {
            seal(&mut bytes);
        }
        let (result, largest) = measured(|| reader(&bytes));
        let told = || kept(name, i, &bytes);
        match result {
            None => panic!("{name}: input {i} panics: {}", told()),
            Some(Err(message)) => {
                refused += 1;
                assert!(
                    message.contains(place) && message.len() > place.len() + 5,
                    "{name}: input {i} ({}): no place in: {message}",
                    told()
                );
                assert!(message.len() < 100_000, "{name}: input {i}: a message of {} bytes", message.len());
            }
            Some(Ok(())) => {}
        }
        assert!(
            largest <= FLOOR + SHARE * bytes.len(),
            "{name}: input {i} of {} bytes takes a block of {largest}: {}",
            bytes.len(),
            told()
        );
    }
    println!("{name}: {} inputs, {refused} refused, none panicked", inputs());
    assert!(refused * 20 > inputs(), "{name}: only {refused} refused: are inputs spoilt at all?");
}

/// A file in memory for readers that need a path.
pub fn slot() -> (tempfile::TempDir, PathBuf) {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
    let folder = folder.expect("a folder");
    let file = folder.path().join("spoilt");
    (folder, file)
}

/// Mutates bytes, with equal probability in the header and in the rest of the file, because the header describes the data.
pub fn spoilt_anywhere(good: &[u8], r: &mut Random) -> Vec<u8> {
    match r.below(3) {
        0 => return spoilt(good, good, r),
        // Replaces numbers without a change of length.
        1 => {
            let mut bytes = good.to_vec();
            for _ in 0..=r.below(3) {
                let at = r.below(bytes.len());
                let end = (at + [1, 2, 4, 8][r.below(4)]).min(bytes.len());
                let number = [0, u64::MAX, r.next(), r.next() % 300, f64::NAN.to_bits(), 1 << 31][r.below(6)];
                bytes[at..end].copy_from_slice(&number.to_le_bytes()[..end - at]);
            }
            return bytes;
        }
        _ => {}
    }
    let (head, rest) = good.split_at(good.len().min(120));
    let mut bytes = spoilt(head, good, r);
    bytes.extend(rest);
    bytes
}
