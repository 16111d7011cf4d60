use case::{CableGroup, FabricGroup};

use super::*;

/// Two quadrilaterals' worth of fabric, one of them cut, a line and a payload.
const FILE: &str = r#"$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
3
0 7 "payload"
1 2 "lines"
1 3 "fixed-z"
$EndPhysicalNames
$Entities
1 2 1 0
1 1 0 -3 1 7
4 0 0 0 0 1 0 1 3 0
5 1 0 -3 1 0 0 1 2 2 1 -2
1 0 0 0 2 1 0 0 0
$EndEntities
$Comment
anything at all
$EndComment
$Nodes
2 7 1 9
2 1 0 6
1
2
3
4
5
6
0 0 0
1 0 0
2 0 0
0 1 0
1 1 0
2 1 0
0 1 0 1
9
1 0 -3
$EndNodes
$Elements
5 6 1 6
2 1 3 1
1 1 2 5 4
2 1 2 2
2 2 3 6
3 2 6 5
1 4 1 1
4 4 1
1 5 1 1
5 2 9
0 1 15 1
6 9
$EndElements
"#;

fn read(text: &str) -> Result<StructureMesh, MeshError> {
    read_with(text, Vec::new())
}

fn read_with(text: &str, cables: Vec<CableGroup>) -> Result<StructureMesh, MeshError> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("canopy.msh");
    std::fs::write(&file, text).unwrap();
    gmsh(&GmshCanopy { file, cables, fabrics: Vec::new() }, true, Some(5.0))
}

/// Faces of a named surface have the cloth of its group, others that of `[fabric]`; a group without surfaces is refused.
#[test]
fn surfaces_of_groups_have_their_cloth() {
    let text = FILE
        .replace("Names\n3\n", "Names\n4\n2 8 \"crown\"\n")
        .replace("Entities\n1 2 1 0", "Entities\n1 2 2 0")
        .replace("1 0 0 0 2 1 0 0 0\n", "1 0 0 0 2 1 0 0 0\n2 0 0 0 2 1 0 1 8 0\n")
        .replace("2 1 2 2\n", "2 2 2 2\n");
    let with = |group: &str| {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("canopy.msh");
        std::fs::write(&file, &text).unwrap();
        let thickness_m = Some(2e-4);
        let fabrics = vec![FabricGroup { group: group.into(), thickness_m, ..FabricGroup::default() }];
        gmsh(&GmshCanopy { file, cables: Vec::new(), fabrics }, true, Some(5.0))
    };
    let mesh = with("crown").unwrap();
    assert_eq!(mesh.face_fabric, [None, Some(0), Some(0)]);
    assert_eq!([0, 1, 2].map(|f| mesh.fabric_group(f)), [None, Some(0), Some(0)]);
    let error = with("skirt").unwrap_err().to_string();
    assert!(error.contains("\"skirt\"") && error.contains("groups of surfaces are: crown"), "{error}");
}

/// A group by another name is a cable where the scene gives it a section, shorter than in the file by its factor; a name without curves is refused.
#[test]
fn groups_with_sections_are_cables() {
    let text = FILE.replace("\"lines\"", "\"kevlar\"");
    // Without its section the group is no cable, so that nothing holds the payload.
    assert!(read(&text).unwrap_err().to_string().contains("belongs to no fabric and no cable"));
    let group = |name: &str| CableGroup {
        group: name.into(),
        part: CablePart::Riser,
        axial_stiffness_n: 2e3,
        mass_kg_m: 0.01,
        rest_length_factor: 0.5,
        pretension_n: 0.0,
        tension_only: true,
        retardation_time_s: 0.0,
    };
    let mesh = read_with(&text, vec![group("kevlar")]).unwrap();
    let c = mesh.cables[0];
    assert_eq!((c.kind, c.rest_length, c.group), (CableKind::Riser, 1.5, Some(0)));
    // The scene's word counts more than the name of the group, and each curve is one cable.
    let mesh = read_with(FILE, vec![group("lines")]).unwrap();
    assert_eq!((mesh.cables.len(), mesh.cables[0].kind), (1, CableKind::Riser));
    let error = read_with(FILE, vec![group("kevlar")]).unwrap_err().to_string();
    assert!(error.contains("\"kevlar\"") && error.contains("fixed-z, lines"), "{error}");
}

#[test]
fn gmsh_canopy_is_read_completely() {
    let mesh = read(FILE).unwrap();
    assert_eq!((mesh.n_canopy, mesh.coords.len()), (6, 7));
    assert_eq!(mesh.faces, [[0, 1, 4, 3], [1, 2, 5, 5], [1, 5, 4, 4]]);
    assert_eq!(mesh.triangles.len(), 4);
    assert!((mesh.fabric_area(|_| true) - 2.0).abs() < 1e-14);
    assert_eq!(mesh.cables.len(), 1);
    assert_eq!((mesh.cables[0].nodes, mesh.cables[0].rest_length), ([1, 6], 3.0));
    assert_eq!(mesh.point_masses, [(6, 5.0)]);
    assert_eq!((&mesh.node_sets["fixed-z"], &mesh.node_sets["payload"]), (&vec![0, 3], &vec![6]));
    assert_eq!(mesh.fixed, [(0, [false, false, true]), (3, [false, false, true]), (6, [true; 3])]);
}

/// Without `[fabric]` the nodes of cables are the canopy, the payload's point comes after them; surfaces are refused, and with `[fabric]` so is
/// a file without them.
#[test]
fn cables_alone_are_a_structure() {
    let with = |text: &str, fabric: bool| {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("canopy.msh");
        std::fs::write(&file, text).unwrap();
        let canopy = GmshCanopy { file, cables: Vec::new(), fabrics: Vec::new() };
        gmsh(&canopy, fabric, Some(5.0)).map_err(|e| e.to_string())
    };
    // The file without its surface: one cable, fixed points, the payload.
    let text = FILE
        .replace("5 6 1 6\n", "3 3 1 6\n")
        .replace("2 1 3 1\n1 1 2 5 4\n2 1 2 2\n2 2 3 6\n3 2 6 5\n", "")
        .replace("4 0 0 0 0 1 0 1 3 0", "4 0 0 0 0 1 0 0 0");
    let text = text.replace("1 4 1 1\n4 4 1\n", "").replace("3 3 1 6\n", "2 2 1 6\n");
    let mesh = with(&text, false).unwrap();
    assert_eq!((mesh.n_canopy, mesh.coords.len(), mesh.faces.len()), (1, 2, 0));
    assert_eq!((mesh.cables[0].nodes, mesh.cables[0].rest_length), ([0, 1], 3.0));
    assert_eq!(mesh.point_masses, [(1, 5.0)]);
    assert!(with(&text, true).unwrap_err().contains("has no fabric"));
    assert!(with(FILE, false).unwrap_err().contains("has fabric, 3 faces"));
    let none = with(&text.replace("\"lines\"", "\"ropes\""), false).unwrap_err();
    assert!(none.contains("no fabric and no cables"), "{none}");
}

#[test]
fn errors_report_the_line() {
    let reason = |from: &str, to: &str| match read(&FILE.replacen(from, to, 1)) {
        Err(MeshError::File { reason, .. }) => reason,
        other => panic!("{other:?}"),
    };
    assert!(reason("4.1 0 8", "2.2 0 8").contains("format 4.1"));
    assert!(reason("1 1 2 5 4", "1 1 2 8 4").contains("line 42: node 8"));
    assert!(reason("2 1 3 1", "2 1 16 1").contains("element type 16"));
    assert!(reason("1 0 -3\n$End", "1 zero -3\n$End").contains("\"zero\" is not a coordinate"));
    assert!(reason("0 1 0\n1 1 0", "0 1 0\n0.5 0 0").contains("no area"));
    assert!(reason("$EndElements\n", "").contains("the file ends"));
    assert!(matches!(
        gmsh(&GmshCanopy { file: "/none.msh".into(), cables: Vec::new(), fabrics: Vec::new() }, true, None),
        Err(MeshError::Io { .. })
    ));
}
