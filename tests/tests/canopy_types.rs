//! `ripstop new`: the scene of every type passes the inspection, one runs, and no file is overwritten.

use std::path::Path;
use std::process::{Command, Output};

use ripstop_tests::{History, program, ripstop_run, succeed};

fn ripstop(arguments: &[&str], folder: &Path) -> Output {
    Command::new(program("ripstop")).args(arguments).current_dir(folder).output().expect("ripstop runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn scenes_of_all_types_have_neither_error_nor_warning() {
    let folder = tempfile::tempdir().expect("a folder");
    let help = text(&ripstop(&["new", "--help"], folder.path()).stdout);
    let types: Vec<&str> =
        help.lines().filter_map(|line| Some(line.trim().strip_prefix("- ")?.split_once(':')?.0)).collect();
    assert_eq!(types.len(), 12, "{help}");
    for name in types {
        for options in [&["new", name][..], &["new", name, "--wind-tunnel", "--out", "tunnel.toml"]] {
            let made = ripstop(options, folder.path());
            assert!(made.status.success(), "{name}: {}", text(&made.stderr));
            let file = if options.len() > 2 { "tunnel.toml".to_owned() } else { format!("{name}.toml") };
            let checked = ripstop(&["check", &file], folder.path());
            let found = text(&checked.stdout) + &text(&checked.stderr);
            assert!(checked.status.success() && found.contains("0 errors, 0 warnings"), "{name}: {found}");
        }
        std::fs::remove_file(folder.path().join("tunnel.toml")).expect("removed");
        let again = ripstop(&["new", name], folder.path());
        assert_eq!(again.status.code(), Some(2));
        assert!(text(&again.stderr).contains("move it away"), "{}", text(&again.stderr));
    }
}

/// The disk-gap-band canopy in a wind tunnel: its cloth holds together across the gap, and windows converge.
#[test]
fn disk_gap_band_is_coupled() {
    let folder = tempfile::tempdir().expect("a folder");
    let made = ripstop(&["new", "disk-gap-band", "--wind-tunnel", "--diameter", "2"], folder.path());
    assert!(made.status.success(), "{}", text(&made.stderr));
    let (scene, out) = (folder.path().join("disk-gap-band.toml"), folder.path().join("out"));
    let coarse = ["--set", "flow.immersed.spacing_m=0.1", "--set", "stage.developed-flow.duration_s=0.1"];
    succeed(ripstop_run(&scene, &out, &[&coarse[..], &["--stop-after-windows", "10"]].concat()));
    let history = History::read(&out, "wind-tunnel");
    assert!(history.column("coupling_converged").iter().all(|c| *c == 1.0));
    // Nominal area 3.14 m2: the open canopy has four to six tenths of it.
    let area = history.column("projected_area_m2");
    assert!(area.iter().all(|a| (1.2..2.0).contains(a)), "{area:?}");
    assert!(history.column("drag_n").iter().all(|d| *d > 0.0));
}
