//! Robustness against arbitrary contents of shared memory: headers, texts, rows and JSON are rejected or read, never
//! a panic. `INPUTS=1000000` sets their number.

use serde_json::Value;

use crate::header::{Header, Kind, unpack_text};
use crate::session::SessionInfo;
use crate::windows::WindowOrder;
use crate::wire::{Hello, RankCounts, Welcome, decode_rows, during, first_not_finite};
use crate::{Stats, Window};

/// xorshift64*: the same inputs on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    /// A number, often at the limits of its type.
    fn edge(&mut self) -> u64 {
        match self.below(8) {
            0 => 0,
            1 => u64::MAX,
            2 => 1 << self.below(64),
            3 => (1 << self.below(64)) - 1,
            4 => f64::NAN.to_bits(),
            5 => f64::INFINITY.to_bits(),
            6 => self.next() % 100,
            _ => self.next(),
        }
    }
}

fn inputs() -> usize {
    std::env::var("INPUTS").ok().and_then(|n| n.parse().ok()).unwrap_or(10_000)
}

fn header(r: &mut Random) -> Header {
    let mut real = || f64::from_bits(r.edge());
    let window = Window {
        time: real(),
        dt: real(),
        frame_velocity: [real(), real(), real()],
        frame_acceleration: [real(), real(), real()],
        ..Window::default()
    };
    let stats = Stats { busy_s: real(), values: std::array::from_fn(|_| real()) };
    let window = Window { index: r.edge(), iteration: r.edge(), substeps: r.edge(), ..window };
    Header {
        magic: r.edge(),
        contract: r.edge() as u32,
        kind: r.edge() as u32,
        session: r.edge(),
        role: r.edge() as u32,
        rank: r.edge() as u32,
        sequence: r.edge(),
        unit: r.edge() as u32,
        reserved: r.edge() as u32,
        length: r.edge(),
        bytes: r.edge(),
        window,
        stats,
    }
}

#[test]
fn arbitrary_headers_are_checked() {
    let mut r = Random(11);
    let mut windows = WindowOrder::default();
    for _ in 0..inputs() {
        let found = header(&mut r);
        // One mismatched field is enough; without a mismatch there is no problem.
        let good = Header::new(Kind::Output, 7, 1, 2, 3).with_payload(crate::Unit::Load, 8);
        assert_eq!(good.problem(7, 1, 2, 8), None);
        assert!(found.problem(r.next(), 1, 2, 8).is_some());
        let mut one = good;
        match r.below(5) {
            0 => one.magic = found.magic,
            1 => one.contract = found.contract,
            2 => one.session = found.session,
            3 => (one.role, one.rank) = (found.role, found.rank),
            _ => one.length = found.length,
        }
        assert_eq!(one.problem(7, 1, 2, 8).is_none(), one == good, "{one:?}");
        let kind = Kind::from_code(found.kind).unwrap_or(Kind::Grid);
        assert!(!during(kind, &found.window).is_empty());
        // The order of windows: rejected or accepted, and only a computed window can be accepted.
        if windows.advance(&found.window).is_none() && r.below(2) == 0 {
            assert_eq!(windows.accept(&found.window), None);
        }
    }
}

#[test]
fn arbitrary_texts_and_rows_are_read_or_rejected() {
    let mut r = Random(12);
    for _ in 0..inputs() {
        let words: Vec<f64> = (0..r.below(40)).map(|_| f64::from_bits(r.edge())).collect();
        let bytes = if r.below(2) == 0 { r.edge() } else { r.below(8 * words.len() + 9) as u64 };
        if let Some(text) = unpack_text(&words, bytes) {
            assert_eq!(text.len() as u64, bytes);
        }
        if let Some(rows) = decode_rows(&words) {
            assert!(rows.iter().zip(&words).all(|(row, word)| *row as f64 == *word));
        }
        let bad = words.iter().position(|w| !w.is_finite());
        assert_eq!(first_not_finite(&words), bad);
    }
}

/// Changes a JSON value in one place.
fn corrupted(value: &mut Value, r: &mut Random) {
    match value {
        Value::Object(map) if !map.is_empty() && r.below(4) > 0 => {
            let at = r.below(map.len());
            corrupted(map.values_mut().nth(at).expect("below"), r);
        }
        Value::Array(list) if !list.is_empty() && r.below(4) > 0 => {
            let at = r.below(list.len());
            corrupted(&mut list[at], r);
        }
        other => {
            *other = match r.below(6) {
                0 => Value::Null,
                1 => r.edge().into(),
                2 => (-1).into(),
                3 => "structure".into(),
                4 => Value::Array(vec![0.into(); r.below(5)]),
                _ => serde_json::json!({"a": 1.5e308}),
            }
        }
    }
}

#[test]
fn corrupted_json_is_rejected_or_read() {
    let mut r = Random(13);
    let hello = serde_json::json!({
        "contract": 3, "stage": 0, "rank": 0, "ranks": 1, "pid": 7, "output_rows": 3, "grid_rows": 0,
        "announcement": {"role": "flow", "program": "p", "version": "1", "canopy_nodes": 1,
            "canopy_faces": 1, "surface_hash": 1, "grid_nodes": 1, "output_width": 4, "effects": ["a"]}
    });
    let welcome = serde_json::json!({
        "input_length": 8, "mesh_rows": [1, 2], "grid_readers": 1, "coupler_reads_grid": false
    });
    let session_info = serde_json::json!({
        "contract": 3, "session": "s", "id": "00ff", "pid": 1, "roles": [["structure", 1], ["flow", 2]]
    });
    assert!(serde_json::from_value::<Hello>(hello.clone()).is_ok());
    assert!(serde_json::from_value::<Welcome>(welcome.clone()).is_ok());
    let mut read = 0;
    for _ in 0..inputs() {
        let mut one = [&hello, &welcome, &session_info][r.below(3)].clone();
        (0..=r.below(3)).for_each(|_| corrupted(&mut one, &mut r));
        let mut text = one.to_string().into_bytes();
        if r.below(2) == 0 {
            let at = r.below(text.len());
            text[at] = r.next() as u8;
        }
        read += usize::from(serde_json::from_slice::<Hello>(&text).is_ok());
        read += usize::from(serde_json::from_slice::<Welcome>(&text).is_ok());
        if let Ok(session_info) = serde_json::from_slice::<SessionInfo>(&text) {
            read += usize::from(RankCounts::from_notice(&session_info).is_some());
        }
    }
    assert!(read > 0, "some of them are still valid");
}
