//! Fuzzing of input files: no panic, no excessive memory, and either an error that names the file (and the location) or a
//! value that passes all checks.

use case::Canopy;
use results::recording::{Header, Moment, Reader, Writer};
use ripstop_tests::root;
use ripstop_tests::spoil::{FLOOR, Measured, Random, SHARE, fuzz, inputs, kept, measured, slot, spoilt};

#[global_allocator]
static ALLOCATOR: Measured = Measured;

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
    // In a folder with the files that they name.
    let (folder, _) = slot();
    for named in ["plate-gmsh/plate.msh", "pattern-conical/gore.pattern", "hanging-rope/rope.msh"] {
        let from = root().join("cases").join(named);
        let name = from.file_name().expect("a name");
        std::fs::copy(&from, folder.path().join(name)).expect("a copy");
    }
    let file = &folder.path().join("scene.toml");
    let mut read = |bytes: &[u8]| {
        let text = String::from_utf8_lossy(bytes);
        let scene = case::parse(file, &text).map_err(|e| e.to_string())?;
        // Accepted scenes have finite values.
        let dense = scene.fabric.density_kg_m3 * scene.fabric.thickness_m;
        assert!(dense.is_finite() && (dense > 0.0 || !scene.has_fabric()));
        assert!(scene.stages.iter().all(|s| s.window_s >= 0.0 && s.window_s.is_finite()));
        // Names are used as file names and must not leave their folder.
        let names = scene.stages.iter().map(|s| &s.name).chain([&scene.name]);
        assert!(names.into_iter().all(|n| !n.contains('/') && !n.starts_with('.')));
        Ok(())
    };
    fuzz("scene", &good, as_is, &mut read, "scene.toml");
}

/// A pattern is meshed with a few elements across its largest extent.
#[test]
fn pattern_files() {
    let mut scene = case::load(&root().join("cases/pattern-conical/scene.toml")).expect("a good scene");
    let good = std::fs::read(root().join("cases/pattern-conical/gore.pattern")).expect("a pattern");
    let (_folder, file) = slot();
    let mut read = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("written");
        let pattern = case::pattern::Pattern::read(&file).map_err(|e| e.to_string())?;
        let points = pattern.panels.iter().flat_map(|p| &p.edges).flat_map(|e| e.points_m.as_flattened());
        let extent = points.filter(|x| x.is_finite()).fold(1.0_f64, |m, x| m.max(x.abs()));
        let Canopy::Pattern(canopy) = &mut scene.canopy else { panic!("not a pattern") };
        (canopy.file, canopy.element_size_m) = (file.clone(), (0.3 * extent).min(200.0));
        let mesh = mesh::structure_mesh(&scene).map_err(|e| e.to_string())?;
        assert!(mesh.coords.iter().flatten().all(|x| x.is_finite()));
        assert!((0..mesh.triangles.len()).all(|t| mesh.starting_stretches(t)[0] < 1.02));
        Ok(())
    };
    fuzz("pattern", &[good], as_is, &mut read, "spoilt");
}

#[test]
fn gmsh_files() {
    let scene = case::load(&root().join("cases/plate-gmsh/scene.toml")).expect("a good scene");
    let Canopy::Gmsh(canopy) = &scene.canopy else { panic!("not Gmsh") };
    // A small file, because large ones mostly repeat the same kind of line.
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
    let good = scene.flow.as_ref().and_then(|f| f.grid_file.as_ref()).expect("a grid").path.clone();
    let whole = std::fs::read(&good).expect("a file");
    let (_folder, file) = slot();
    let mut scene = scene.clone();
    scene.flow.as_mut().and_then(|f| f.grid_file.as_mut()).expect("a grid").path = file.clone();
    let coords = canopy.coords[..canopy.n_canopy].to_vec();
    let read = |bytes: &[u8]| {
        std::fs::write(&file, bytes).expect("written");
        mesh::draft_grid(&scene, &canopy, &coords).map(|_| ()).map_err(|e| e.to_string())
    };
    // A large file: 1 % of the inputs takes as long as all inputs of another format.
    let before = inputs();
    let few = (before / 100).max(20);
    read(&whole).expect("a good grid");
    let mut r = Random(77);
    for i in 0..few {
        let bytes = spoilt(&whole, &whole, &mut r);
        let (result, largest) = measured(|| read(&bytes));
        match result {
            None => panic!("grid: input {i} panics: {}", kept("grid", i, &bytes)),
            Some(Err(message)) => assert!(message.len() > 10, "{message}"),
            Some(Ok(())) => {}
        }
        assert!(largest <= FLOOR + SHARE * bytes.len(), "grid: input {i} takes a block of {largest}");
    }
    println!("grid: {few} inputs, none panicked");
}

/// Corrects the checksums of all recognisable frames.
#[allow(clippy::ptr_arg)] // common signature of mutations, which may change the length
fn sealed_frames(bytes: &mut Vec<u8>) {
    let mut at = 8;
    while at + 8 <= bytes.len() {
        let length = u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four")) as usize;
        let end = (at + 8).saturating_add(length);
        if end > bytes.len() {
            return;
        }
        let sum = crc32fast::hash(&bytes[at + 8..end]);
        bytes[at + 4..at + 8].copy_from_slice(&sum.to_le_bytes());
        at = end;
    }
}

#[test]
fn recordings() {
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
        use results::recording::Event;
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
