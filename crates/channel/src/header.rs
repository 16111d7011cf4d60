//! The fixed header of every message, and the encoding of text.

use case::Role;

use crate::{CONTRACT_VERSION, Stats, Window};

/// First eight bytes of every header: "RIPSTOP" and a zero, little-endian.
pub const MAGIC: u64 = u64::from_le_bytes(*b"RIPSTOP\0");

/// Kind of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// Rank to coupler: its announcement (JSON text, `Hello` in `docs/reference/contract.md`).
    Announce = 1,
    /// Coupler to program: accepted, with its partners (JSON text).
    Welcome = 2,
    /// Coupler to program: rejected, with the reason (text).
    Refuse = 3,
    /// Coupler to program: publish your layout.
    SendLayout = 4,
    /// Rank to coupler and, from the mesh, to each rank of the flow: global rows.
    Layout = 5,
    /// Rank to coupler: the last command is completed.
    Done = 6,
    /// Coupler to program: compute a window from this input.
    Advance = 7,
    /// Rank to coupler: its output for the window.
    Output = 8,
    /// Rank of the mesh to each rank of the flow: its rows of the moved grid.
    Grid = 9,
    /// Coupler to program: the last response is accepted.
    Accept = 10,
    /// Coupler to program: write the accepted state below this folder (text).
    Save = 11,
    /// Coupler to program: write pictures below this folder (text).
    Snapshot = 12,
    /// Coupler to program: end of the run.
    Stop = 13,
    /// Rank to coupler: an error that ends the run (text).
    Fault = 14,
    /// Coupler to program: the run failed elsewhere (text).
    Abort = 15,
}

impl Kind {
    pub(crate) const ALL: [Kind; 15] = [
        Kind::Announce,
        Kind::Welcome,
        Kind::Refuse,
        Kind::SendLayout,
        Kind::Layout,
        Kind::Done,
        Kind::Advance,
        Kind::Output,
        Kind::Grid,
        Kind::Accept,
        Kind::Save,
        Kind::Snapshot,
        Kind::Stop,
        Kind::Fault,
        Kind::Abort,
    ];

    pub(crate) fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|&k| k as u32 == code)
    }
}

/// Meaning of the numbers of a payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Unit {
    /// No payload.
    None = 0,
    /// UTF-8 text, eight bytes per number, padded with zeros.
    Text = 1,
    /// Global row numbers, exact in a double.
    Rows = 2,
    /// `[nodes][3]`: displacement, m.
    Displacement = 3,
    /// `[faces][4]`: pressure jump and traction, Pa.
    Load = 4,
    /// `[faces][8]`: the same at the start and at the end of the window, Pa.
    LoadPair = 5,
    /// `[nodes][6]`: position, m, and velocity, m/s.
    Grid = 6,
}

impl Unit {
    #[cfg(test)]
    pub(crate) const ALL: [Unit; 7] =
        [Unit::None, Unit::Text, Unit::Rows, Unit::Displacement, Unit::Load, Unit::LoadPair, Unit::Grid];

    /// Unit of what the coupler sends with `Advance`.
    pub(crate) fn of_input(role: Role) -> Self {
        match role {
            Role::Structure => Unit::LoadPair,
            // The flow's is empty unless it announces `CANOPY_MOTION`.
            Role::Mesh | Role::Flow => Unit::Displacement,
        }
    }

    /// Unit of a role's output.
    pub(crate) fn of_output(role: Role) -> Self {
        match role {
            Role::Structure => Unit::Displacement,
            Role::Mesh => Unit::Grid,
            Role::Flow => Unit::Load,
        }
    }

    /// Numbers in a row.
    pub(crate) fn width(self) -> usize {
        match self {
            Unit::None => 0,
            Unit::Text | Unit::Rows => 1,
            Unit::Displacement => 3,
            Unit::Load => 4,
            Unit::LoadPair => 8,
            Unit::Grid => 6,
        }
    }
}

/// Header of every message, 416 bytes, little-endian.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Header {
    /// [`MAGIC`].
    pub magic: u64,
    /// [`CONTRACT_VERSION`].
    pub contract: u32,
    /// [`Kind`].
    pub kind: u32,
    /// Identity of the session, from `session.json`.
    pub session: u64,
    /// Sender: 0 coupler, 1 structure, 2 flow, 3 mesh.
    pub role: u32,
    /// Rank of the sender in its program.
    pub rank: u32,
    /// The coupler numbers its commands to a program by consecutive integers from 1; a response repeats the number of
    /// its command (0: without a command).
    pub sequence: u64,
    /// [`Unit`] of the payload.
    pub unit: u32,
    /// Zero.
    pub reserved: u32,
    /// Numbers in the payload.
    pub length: u64,
    /// Bytes of text in the payload; 0 for anything else.
    pub bytes: u64,
    /// The window that the message belongs to; zeros outside windows.
    pub window: Window,
    /// Statistics of an answer; zeros elsewhere.
    pub stats: Stats,
}

impl Header {
    /// A header without payload.
    pub(crate) fn new(kind: Kind, session: u64, role: u32, rank: usize, sequence: u64) -> Self {
        Self {
            magic: MAGIC,
            contract: CONTRACT_VERSION,
            kind: kind as u32,
            session,
            role,
            rank: rank as u32,
            sequence,
            unit: Unit::None as u32,
            reserved: 0,
            length: 0,
            bytes: 0,
            window: Window::default(),
            stats: Stats::default(),
        }
    }

    pub(crate) fn with_payload(mut self, unit: Unit, length: usize) -> Self {
        self.unit = unit as u32;
        self.length = length as u64;
        self
    }

    pub(crate) fn with_window(mut self, window: Window) -> Self {
        self.window = window;
        self
    }

    /// The first problem in the parts that all messages share, if any.
    pub(crate) fn problem(&self, session: u64, role: u32, rank: usize, length: usize) -> Option<String> {
        let mismatch = |what: &str, found: String, expected: String| {
            Some(format!("{what} of the message is {found}, expected {expected}"))
        };
        if self.magic != MAGIC {
            mismatch("magic number", format!("{:#x}", self.magic), format!("{MAGIC:#x}"))
        } else if self.contract != CONTRACT_VERSION {
            mismatch("contract version", self.contract.to_string(), CONTRACT_VERSION.to_string())
        } else if self.session != session {
            mismatch("session", format!("{:#x}", self.session), format!("{session:#x}"))
        } else if self.role != role || self.rank as usize != rank {
            mismatch("sender", format!("{}.{}", self.role, self.rank), format!("{role}.{rank}"))
        } else if self.length != length as u64 {
            mismatch("length", format!("{} in its header", self.length), format!("{length} as received"))
        } else {
            None
        }
    }
}

/// Code of a role in [`Header::role`]; 0 is the coupler.
pub fn role_code(role: Role) -> u32 {
    match role {
        Role::Structure => 1,
        Role::Flow => 2,
        Role::Mesh => 3,
    }
}

/// [`Header::role`] of the coupler.
pub(crate) const COUPLER: u32 = 0;

/// Numbers that hold `text`.
pub(crate) fn text_words(text: &str) -> usize {
    text.len().div_ceil(8)
}

/// Writes `text` into the first [`text_words`] numbers.
pub(crate) fn pack_text(text: &str, words: &mut [f64]) {
    for (word, chunk) in words.iter_mut().zip(text.as_bytes().chunks(8)) {
        let mut bytes = [0; 8];
        bytes[..chunk.len()].copy_from_slice(chunk);
        *word = f64::from_bits(u64::from_le_bytes(bytes));
    }
}

/// Reads `bytes` bytes of text; `None` where the payload is shorter or not UTF-8.
pub(crate) fn unpack_text(words: &[f64], bytes: u64) -> Option<String> {
    let bytes = usize::try_from(bytes).ok().filter(|&n| n <= words.len() * 8)?;
    let mut text: Vec<u8> = words.iter().flat_map(|w| w.to_bits().to_le_bytes()).collect();
    text.truncate(bytes);
    String::from_utf8(text).ok()
}

/// The longest prefix of `text` within `bytes` bytes, cut between characters.
pub(crate) fn truncate(text: &str, bytes: usize) -> &str {
    let mut end = text.len().min(bytes);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    &text[..end]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_of_any_length_survives_packing() {
        let text = "grüße, 窓 — a longer text";
        for end in (0..=text.len()).filter(|&i| text.is_char_boundary(i)) {
            let part = &text[..end];
            let mut words = vec![f64::NAN; text_words(part)];
            pack_text(part, &mut words);
            assert_eq!(unpack_text(&words, part.len() as u64).as_deref(), Some(part));
        }
        assert_eq!(unpack_text(&[0.0], 9), None, "longer than the payload");
        assert_eq!(unpack_text(&[f64::from_bits(0xff)], 1), None, "not UTF-8");
        assert_eq!(unpack_text(&[], u64::MAX), None);
        assert_eq!(truncate("grü", 3), "gr");
        assert_eq!(truncate("grü", 40), "grü");
    }

    #[test]
    fn each_mismatched_field_is_named() {
        let good = Header::new(Kind::Done, 7, 2, 1, 5).with_payload(Unit::Load, 8);
        assert_eq!(good.problem(7, 2, 1, 8), None);
        let wrong = |change: fn(&mut Header), word: &str| {
            let mut h = good;
            change(&mut h);
            let problem = h.problem(7, 2, 1, 8).expect("a problem");
            assert!(problem.contains(word), "{problem}");
        };
        wrong(|h| h.magic = 0, "magic");
        wrong(|h| h.contract += 1, "contract version");
        wrong(|h| h.session = 8, "session");
        wrong(|h| h.rank = 0, "sender");
        wrong(|h| h.role = 3, "sender");
        wrong(|h| h.length = 9, "length");
    }

    #[test]
    fn codes_are_decoded() {
        for kind in Kind::ALL {
            assert_eq!(Kind::from_code(kind as u32), Some(kind));
        }
        assert_eq!(Kind::from_code(0), None);
        assert_eq!(Kind::from_code(16), None);
        for (code, unit) in Unit::ALL.into_iter().enumerate() {
            assert_eq!(unit as usize, code);
        }
    }

    #[test]
    fn widths_and_codes_match_the_contract() {
        assert_eq!(Unit::ALL.map(Unit::width), [0, 1, 1, 3, 4, 8, 6]);
        assert_eq!([Role::Structure, Role::Flow, Role::Mesh].map(role_code), [1, 2, 3]);
    }

    #[test]
    fn text_is_cut_at_a_character_boundary() {
        let text = "aü窓";
        assert_eq!(
            [0, 1, 2, 3, 4, 5, 6, 7].map(|n| truncate(text, n)),
            ["", "a", "a", "aü", "aü", "aü", text, text]
        );
        // All bytes of the payload are text, and none beyond.
        let words = [f64::from_bits(u64::from_le_bytes(*b"12345678")); 2];
        assert_eq!(unpack_text(&words, 16).as_deref(), Some("1234567812345678"));
        assert_eq!(unpack_text(&words, 17), None);
    }
}
