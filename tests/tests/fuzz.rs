//! Damaged and hostile files: never a panic, never memory out of proportion, always an error
//! that names the file (and where in it), or a value that passes every check.
//!
//! Each format is tried with `INPUTS` mutations of good files (10 000 by default; millions by
//! `scripts/fuzz`), the same on every machine.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use case::Canopy;
use coupler::recording::{Header, Moment, Reader, Writer};
use ripstop_tests::root;

/// Notes the largest block that a thread asks for.
struct Measured;

thread_local! {
    static LARGEST: Cell<usize> = const { Cell::new(0) };
}

fn note(size: usize) {
    // A thread that ends has no note any more.
    let _ = LARGEST.try_with(|largest| largest.set(largest.get().max(size)));
}

// SAFETY: passes everything on to the system's allocator.
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

#[global_allocator]
static ALLOCATOR: Measured = Measured;

/// A block may be this many times as long as the file, and this many bytes in any case.
const SHARE: usize = 64;
const ANYWAY: usize = 4 << 20;

/// xorshift64*.
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

/// A good file, spoilt in one to four places.
fn spoilt(good: &[u8], other: &[u8], r: &mut Random) -> Vec<u8> {
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
                // A whole word or number in the place of another.
                let word = |b: &u8| !b.is_ascii_whitespace() && !b"=,[]".contains(b);
                let from = (at..bytes.len()).find(|&i| word(&bytes[i])).unwrap_or(at);
                let to = (from..bytes.len()).find(|&i| !word(&bytes[i])).unwrap_or(from);
                bytes.splice(from..to, WORDS[r.below(WORDS.len())].bytes());
            }
            7 => {
                // A count: bincode's marks of long integers, or eight bytes.
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

fn inputs() -> usize {
    std::env::var("INPUTS").ok().and_then(|n| n.parse().ok()).unwrap_or(10_000)
}

/// Tries `reader` with spoilt forms of `good`; it says what is wrong with an input, if anything.
/// `seal` mends what would be seen at a glance, so that what lies behind is tried as well.
fn fuzz(
    name: &str,
    good: &[Vec<u8>],
    seal: fn(&mut Vec<u8>),
    reader: &mut dyn FnMut(&[u8]) -> Result<(), String>,
    place: &str,
) {
    for bytes in good {
        reader(bytes).unwrap_or_else(|e| panic!("{name}: a good input is refused: {e}"));
    }
    let mut r = Random(0x5eed ^ name.len() as u64);
    let mut refused = 0;
    // Panics are told below, with their input.
    for i in 0..inputs() {
        let (a, b) = (r.below(good.len()), r.below(good.len()));
        let mut bytes = spoilt(&good[a], &good[b], &mut r);
        if r.below(4) > 0 {
            seal(&mut bytes);
        }
        LARGEST.with(|l| l.set(0));
        let result = catch_unwind(AssertUnwindSafe(|| reader(&bytes)));
        let largest = LARGEST.with(Cell::get);
        let told = || {
            let file = std::env::temp_dir().join(format!("ripstop-fuzz-{name}-{i}"));
            std::fs::write(&file, &bytes).expect("written");
            file.display().to_string()
        };
        match result {
            Err(_) => panic!("{name}: input {i} panics: {}", told()),
            Ok(Err(message)) => {
                refused += 1;
                assert!(
                    message.contains(place) && message.len() > place.len() + 5,
                    "{name}: input {i} ({}): no place in: {message}",
                    told()
                );
                assert!(message.len() < 100_000, "{name}: input {i}: a message of {} bytes", message.len());
            }
            Ok(Ok(())) => {}
        }
        assert!(
            largest <= ANYWAY + SHARE * bytes.len(),
            "{name}: input {i} of {} bytes takes a block of {largest}: {}",
            bytes.len(),
            told()
        );
    }
    println!("{name}: {} inputs, {refused} refused, none panicked", inputs());
    assert!(refused * 20 > inputs(), "{name}: only {refused} refused: are inputs spoilt at all?");
}

/// A file in memory for readers that want a path.
fn slot() -> (tempfile::TempDir, PathBuf) {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
    let folder = folder.expect("a folder");
    let file = folder.path().join("spoilt");
    (folder, file)
}

fn as_is(_: &mut Vec<u8>) {}

#[test]
fn scenes() {
    let mut good = Vec::new();
    for entry in std::fs::read_dir(root().join("cases")).expect("cases").flatten() {
        if let Ok(text) = std::fs::read(entry.path().join("scene.toml")) {
            good.push(text);
        }
    }
    assert!(good.len() > 5);
    // Beside the mesh that one of them names.
    let file = &root().join("cases/plate-gmsh/scene.toml");
    let mut read = |bytes: &[u8]| {
        let text = String::from_utf8_lossy(bytes);
        let scene = case::parse(file, &text).map_err(|e| e.to_string())?;
        // What passes is fit for numbers.
        let dense = scene.fabric.density_kg_m3 * scene.fabric.thickness_m;
        assert!(dense.is_finite() && dense > 0.0);
        assert!(scene.stages.iter().all(|s| s.window_s >= 0.0 && s.window_s.is_finite()));
        // Names become names of files: none leads out of its folder.
        let names = scene.stages.iter().map(|s| &s.name).chain([&scene.name]);
        assert!(names.into_iter().all(|n| !n.contains('/') && !n.starts_with('.')));
        Ok(())
    };
    fuzz("scene", &good, as_is, &mut read, "scene.toml");
}

#[test]
fn gmsh_files() {
    let scene = case::load(&root().join("cases/plate-gmsh/scene.toml")).expect("a good scene");
    let Canopy::Gmsh(canopy) = &scene.canopy else { panic!("not Gmsh") };
    // A small file: most of a large one is lines of the same kind.
    let head = "$PhysicalNames\n2\n0 2 \"fixed\"\n2 1 \"canopy\"\n$EndPhysicalNames\n$Entities\n";
    let small = format!(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n{head}1 0 1 0\n1 0 0 0 1 2\n1 0 0 0 1 1 0 1 1 0\n$EndEntities\n\
         $Nodes\n1 4 1 4\n2 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n$EndNodes\n\
         $Elements\n2 3 1 3\n0 1 15 1\n3 1\n2 1 2 2\n1 1 2 3\n2 1 3 4\n$EndElements\n"
    );
    let mut binary = format!("$MeshFormat\n4.1 1 8\n\u{1}\0\0\0\n$EndMeshFormat\n{head}").into_bytes();
    let sizes = |b: &mut Vec<u8>, list: &[u64]| b.extend(list.iter().flat_map(|n| n.to_le_bytes()));
    let ints = |b: &mut Vec<u8>, list: &[i32]| b.extend(list.iter().flat_map(|n| n.to_le_bytes()));
    let reals = |b: &mut Vec<u8>, list: &[f64]| b.extend(list.iter().flat_map(|n| n.to_le_bytes()));
    sizes(&mut binary, &[1, 0, 1, 0]);
    ints(&mut binary, &[1]);
    reals(&mut binary, &[0.0, 0.0, 0.0]);
    sizes(&mut binary, &[1]);
    ints(&mut binary, &[2, 1]);
    reals(&mut binary, &[0.0, 0.0, 0.0, 1.0, 1.0, 0.0]);
    sizes(&mut binary, &[1]);
    ints(&mut binary, &[1]);
    sizes(&mut binary, &[0]);
    binary.extend(b"\n$EndEntities\n$Nodes\n");
    sizes(&mut binary, &[1, 4, 1, 4]);
    ints(&mut binary, &[2, 1, 0]);
    sizes(&mut binary, &[4, 1, 2, 3, 4]);
    reals(&mut binary, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    binary.extend(b"\n$EndNodes\n$Elements\n");
    sizes(&mut binary, &[2, 3, 1, 3]);
    ints(&mut binary, &[0, 1, 15]);
    sizes(&mut binary, &[1, 3, 1]);
    ints(&mut binary, &[2, 1, 2]);
    sizes(&mut binary, &[2, 1, 1, 2, 3, 2, 1, 3, 4]);
    binary.extend(b"\n$EndElements\n");
    let (_folder, file) = slot();
    let mut canopy = canopy.clone();
    canopy.file = file.clone();
    let mut scene = scene.clone();
    scene.canopy = Canopy::Gmsh(canopy);
    let mut read = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("written");
        let mesh = mesh::structure_mesh(&scene).map_err(|e| e.to_string())?;
        assert!(mesh.coords.iter().flatten().all(|x| x.is_finite()), "a node that is nowhere");
        Ok(())
    };
    fuzz("gmsh", &[small.into_bytes(), binary], as_is, &mut read, "spoilt");
}

#[test]
fn volume_grids() {
    let scene = case::load(&root().join("cases/plate-gmsh/scene.toml")).expect("a good scene");
    let canopy = mesh::structure_mesh(&scene).expect("a canopy");
    let file = scene.flow.as_ref().and_then(|f| f.grid_file.as_ref()).expect("a grid").path.clone();
    let whole = std::fs::read(&file).expect("a file");
    let (_folder, spoilt) = slot();
    let mut scene = scene.clone();
    scene.flow.as_mut().and_then(|f| f.grid_file.as_mut()).expect("a grid").path = spoilt.clone();
    let coords = canopy.coords[..canopy.n_canopy].to_vec();
    let read = |bytes: &[u8]| {
        std::fs::write(&spoilt, bytes).expect("written");
        mesh::draft_grid(&scene, &canopy, &coords).map(|_| ()).map_err(|e| e.to_string())
    };
    // A large file: a hundredth of the inputs takes as long as all of another format.
    let before = inputs();
    let few = (before / 100).max(20);
    read(&whole).expect("a good grid");
    let mut r = Random(77);
    for i in 0..few {
        let bytes = self::spoilt(&whole, &whole, &mut r);
        LARGEST.with(|l| l.set(0));
        let result = catch_unwind(AssertUnwindSafe(|| read(&bytes)));
        let largest = LARGEST.with(Cell::get);
        match result {
            Err(_) => {
                let file = std::env::temp_dir().join(format!("ripstop-fuzz-grid-{i}"));
                std::fs::write(&file, &bytes).expect("written");
                panic!("grid: input {i} panics: {}", file.display());
            }
            Ok(Err(message)) => assert!(message.len() > 10, "{message}"),
            Ok(Ok(())) => {}
        }
        assert!(largest <= ANYWAY + SHARE * bytes.len(), "grid: input {i} takes a block of {largest}");
    }
    println!("grid: {few} inputs, none panicked");
}

/// Checksums of all frames made right, as far as frames can be told.
#[allow(clippy::ptr_arg)] // as all spoilers, which may also shorten
fn sealed_frames(bytes: &mut Vec<u8>) {
    let mut at = 8;
    while at + 8 <= bytes.len() {
        let length = u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four")) as usize;
        let end = (at + 8).saturating_add(length);
        if end > bytes.len() {
            return;
        }
        let sum = crc32(&bytes[at + 8..end]);
        bytes[at + 4..at + 8].copy_from_slice(&sum.to_le_bytes());
        at = end;
    }
}

/// CRC-32 (IEEE), bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |c: u32| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 };
    !bytes.iter().fold(!0u32, |c, b| (0..8).fold(c ^ u32::from(*b), |c, _| step(c)))
}

#[test]
fn recordings() {
    assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    let (_folder, file) = slot();
    let header = Header {
        contract: channel::CONTRACT_VERSION,
        version: "1".into(),
        scene: "s".into(),
        stage: ("descent".into(), 2),
        canopy: (5, 4),
        surface_hash: 1,
        grid_nodes: 7,
        ranks: [1, 2, 3],
    };
    let mut writer = Writer::create(&file, &header).expect("a writer");
    let numbers: Vec<f64> = (0..42).map(|i| f64::from(i).sqrt()).collect();
    for index in 0..2 {
        let at = Moment::from(&channel::Window { index, dt: 0.1, ..channel::Window::default() });
        let stats = [1.0; channel::STATS];
        let push = |writer: &mut Writer, event| writer.push(event).expect("written");
        use coupler::recording::Event;
        push(&mut writer, Event::Structure { at, load: &numbers[..32], displacement: &numbers[..15], stats });
        push(
            &mut writer,
            Event::Mesh { at, displacement: &numbers[..15], grid: Some(&numbers[..42]), stats },
        );
        push(&mut writer, Event::Flow { at, load: &numbers[..16], stats });
    }
    writer.flush().expect("written");
    drop(writer);
    let good = std::fs::read(&file).expect("a file");
    let mut read = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("written");
        let mut reader = Reader::open(&file).map_err(|e| e.to_string())?;
        while reader.next_event().map_err(|e| e.to_string())?.is_some() {}
        Ok(())
    };
    fuzz("recording", &[good], sealed_frames, &mut read, "spoilt");
}

#[test]
fn states_of_the_coupler() {
    let folder = tempfile::tempdir_in("/dev/shm").expect("a folder");
    let state = coupler::schemes::InterfaceState {
        displacement: (0..18).map(f64::from).collect(),
        load: Some(vec![2.0; 16]),
        load_before: Some(vec![1.5; 16]),
        velocity: -4.0,
        acceleration: 0.2,
    };
    coupler::state::save(folder.path(), &state).expect("saved");
    let file = coupler::state::coupler_file(folder.path());
    let good = std::fs::read(&file).expect("a file");
    let mut read = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("written");
        let state = coupler::state::load(folder.path(), 6, 4).map_err(|e| e.to_string())?;
        let loads = [&state.load, &state.load_before].into_iter().flatten();
        assert!(loads.clone().all(|l| l.len() == 16), "loads of another canopy");
        let all = state.displacement.iter().chain(loads.flatten());
        assert!(all.chain([&state.velocity, &state.acceleration]).all(|x| x.is_finite()), "NaN enters");
        Ok(())
    };
    fuzz("coupler state", &[good], as_is, &mut read, "coupler.bin");
}

#[test]
fn states_of_the_mesh() {
    let (_folder, file) = slot();
    let numbers: Vec<f64> = (0..30).map(f64::from).collect();
    let state = mesh_mover::state::State {
        now: numbers.clone(),
        before: numbers.clone(),
        reference: numbers,
        dt: 0.1,
        ..mesh_mover::state::State::default()
    };
    state.save(&file).expect("saved");
    let good = std::fs::read(&file).expect("a file");
    let mut read = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("written");
        mesh_mover::state::State::load(&file, 10).map(|_| ()).map_err(|e| e.to_string())
    };
    fuzz("mesh state", &[good], as_is, &mut read, "spoilt");
}

#[test]
fn shapes_of_a_canopy() {
    let (_folder, file) = slot();
    mesh::save_shape(&file, &[[1.0, 2.0, 3.0]; 10]).expect("saved");
    let good = std::fs::read(&file).expect("a file");
    let mut read = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("written");
        mesh::load_shape(&file, 10).map(|_| ()).map_err(|e| e.to_string())
    };
    fuzz("canopy shape", &[good], as_is, &mut read, "spoilt");
}
