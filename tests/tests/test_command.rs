//! `./test` ends with one line that counts the tests of all suites, including failed ones.

use std::path::Path;
use std::process::Command;

use ripstop_tests::root;

/// Result line of a suite in the format of the Rust test library.
fn result(word: &str, passed: u32, failed: u32, ignored: u32) -> String {
    format!(
        "test result: {word}. {passed} passed; {failed} failed; {ignored} ignored; 0 measured; \
         2 filtered out; finished in 1.25s\n"
    )
}

/// Last line, full output and exit code of the summary.
fn summary(log: &str, skipped: &str, code: &str) -> (String, String, i32) {
    let folder = tempfile::tempdir().expect("a folder");
    let [log_file, skipped_file] = ["log", "skipped"].map(|name| folder.path().join(name));
    std::fs::write(&log_file, log).expect("written");
    std::fs::write(&skipped_file, skipped).expect("written");
    let output = Command::new(root().join("scripts/test-summary"))
        .arg(log_file)
        .arg(skipped_file)
        .arg(code)
        .output()
        .expect("it starts");
    let text = String::from_utf8(output.stdout).expect("text");
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    (text.lines().last().unwrap_or_default().to_owned(), text, output.status.code().expect("a code"))
}

#[test]
fn all_suites_are_summed() {
    let log = [
        "   Compiling mesh v0.1.0\n    Finished `release` profile\n",
        "     Running unittests src/lib.rs (target/release/deps/mesh-0a)\n\nrunning 3 tests\ntest a::b ... ok\n",
        "test c ... ok\ntest d ... ignored, nightly: long\n\n",
        &result("ok", 2, 0, 1),
        "\x1b[1m\x1b[92m     Running\x1b[0m tests/ranks.rs (target/release/deps/ranks-0b)\ntest x ... \x1b[32mok\x1b[m\n\n",
        "test result: \x1b[32mok\x1b[m. 1 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.10s\n",
        "   Doc-tests mesh\n\n",
        &result("ok", 4, 0, 0),
    ]
    .concat();
    let (line, _, code) = summary(&log, "", "0");
    assert_eq!((line.as_str(), code), ("7 passed, 0 failed, 1 skipped", 0));
}

#[test]
fn skipped_tests_are_not_counted_as_passed() {
    let log = format!("     Running tests/python.rs (target/x)\n{}", result("ok", 3, 0, 2));
    let skipped = "reads: no Python\nreads: no Python\nwrites: no Python\n";
    let (line, text, code) = summary(&log, skipped, "0");
    assert_eq!((line.as_str(), code), ("1 passed, 0 failed, 4 skipped", 0));
    assert!(text.contains("skipped on this machine:\n  reads: no Python\n"), "{text}");
}

#[test]
fn failures_are_counted_and_named() {
    let log = [
        "     Running unittests src/lib.rs (target/release/deps/mesh-0a)\n",
        "test good ... ok\ntest shape::bad ... FAILED\n",
        // The output of a failed test may contain such lines.
        "---- shape::bad stdout ----\nit said: test result: ok. 50 passed\n",
        &result("FAILED", 1, 1, 0),
        "error: test failed, to rerun pass `-p mesh --lib`\n",
        "     Running tests/next.rs (target/release/deps/next-0a)\n",
        &result("ok", 5, 0, 0),
        "error: 1 target failed:\n    `-p mesh --lib`\n",
    ]
    .concat();
    let (line, text, code) = summary(&log, "", "1");
    assert_eq!((line.as_str(), code), ("6 passed, 1 failed, 0 skipped", 1));
    assert!(text.contains("failed:\n  unittests src/lib.rs: shape::bad\n"), "{text}");
}

/// A test that passes at its second attempt is counted as passed and named; one that fails again is a failure.
#[test]
fn second_attempt_is_reported() {
    let log = |verdict: &str| {
        [
            "     Running unittests src/lib.rs (target/release/deps/mesh-0a)\n",
            "test good ... ok\ntest shape::slow ... FAILED\n",
            &result("FAILED", 1, 1, 0),
            "error: test failed, to rerun pass `-p mesh --lib`\n",
            "error: 1 target failed:\n    `-p mesh --lib`\n",
            "\n     Once more, alone: unittests src/lib.rs: shape::slow\n",
            &format!("second attempt: unittests src/lib.rs: shape::slow ... {verdict}\n"),
        ]
        .concat()
    };
    let (line, text, code) = summary(&log("ok"), "", "1");
    assert_eq!((line.as_str(), code), ("2 passed, 0 failed, 0 skipped", 0));
    assert!(
        text.contains("passed when run once more, alone:\n  unittests src/lib.rs: shape::slow\n"),
        "{text}"
    );
    let (line, text, code) = summary(&log("FAILED"), "", "1");
    assert_eq!((line.as_str(), code), ("1 passed, 1 failed, 0 skipped", 1));
    assert!(
        text.contains("failed:\n  unittests src/lib.rs: shape::slow\n")
            && !text.contains("once more, alone:\n  ")
    );
    // Other failures remain failures.
    let other =
        log("ok") + "     Running tests/next.rs (target/release/deps/next-0a)\n" + &result("FAILED", 5, 1, 0);
    assert_eq!(summary(&other, "", "1").2, 1);
}

/// Selection of the tests that are repeated; unknown names fail again.
#[test]
fn few_failures_are_repeated_and_crashes_are_not() {
    let again = |log: &str| {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("log");
        std::fs::write(&file, log).expect("written");
        let script = root().join("scripts/second-attempt");
        // This `cargo` prints its arguments and a passed test.
        let fake = folder.path().join("cargo");
        let text =
            "#!/bin/sh\necho asked: \"$@\"\necho \"test a::b ... ok\"\necho test result: ok. 1 passed\n";
        std::fs::write(&fake, text).expect("written");
        std::fs::set_permissions(&fake, std::os::unix::fs::PermissionsExt::from_mode(0o755))
            .expect("executable");
        let path = format!("{}:{}", folder.path().display(), std::env::var("PATH").expect("a path"));
        let output = Command::new(script).arg(&file).env("PATH", path).output().expect("it starts");
        String::from_utf8(output.stdout).expect("text")
    };
    let suite = "     Running tests/verification/main.rs (target/release/deps/verification-0a1b)\n";
    let text = again(&format!("{suite}test a::b ... FAILED\ntest c ... ok\n"));
    assert!(text.contains("--workspace --test=verification -- --exact a::b"), "{text}");
    assert!(text.contains("second attempt: tests/verification/main.rs: a::b ... ok\n"), "{text}");
    assert!(!text.contains("test result"), "{text}");
    let library = "     Running unittests src/lib.rs (target/release/deps/mesh-0a)\n";
    let text = again(&format!("{library}test other ... FAILED\n"));
    assert!(text.contains("--lib -- --exact other") && text.contains("lib.rs: other ... FAILED\n"), "{text}");
    assert_eq!(again(&format!("{suite}{}", "test a::b ... FAILED\n".repeat(6))), "");
    assert_eq!(again(&format!("{suite}error: test failed, to rerun pass `-p x --test verification`\n")), "");
}

/// Line of Cargo's messages for a test program, a script in `folder`.
fn test_program(folder: &Path, package: &str, name: &str, kind: &str, script: &str) -> String {
    let crate_folder = folder.join(package);
    std::fs::create_dir_all(&crate_folder).expect("made");
    let manifest = crate_folder.join("Cargo.toml");
    std::fs::write(&manifest, format!("[package]\nname = \"{package}\"\n")).expect("written");
    let executable = folder.join(format!("{name}-0a1b"));
    std::fs::write(&executable, format!("#!/bin/sh\n{script}\n")).expect("written");
    std::fs::set_permissions(&executable, std::os::unix::fs::PermissionsExt::from_mode(0o755)).expect("done");
    let source =
        crate_folder.join(if kind == "test" { format!("tests/{name}.rs") } else { "src/lib.rs".into() });
    serde_json::json!({
        "reason": "compiler-artifact", "executable": executable, "manifest_path": manifest,
        "target": {"kind": [kind], "name": name, "src_path": source}, "profile": {"test": true},
    })
    .to_string()
}

/// Two test programs run at the same time, those that inspect the machine first and alone; output stays together, and what fails or
/// crashes is named as `cargo test` does.
#[test]
fn two_test_programs_run_at_a_time() {
    let temporary = tempfile::tempdir().expect("a folder");
    let folder = temporary.path();
    let marks = folder.display();
    // Each waits until the other has started: one after the other they would end with code 1.
    let meet = |own: &str, other: &str| {
        format!(
            "echo start {own}; touch {marks}/{own}; i=0; while [ ! -e {marks}/{other} ]; do i=$((i+1)); \
             [ $i = 600 ] && exit 1; sleep 0.05; done; echo end {own}; {}",
            result("ok", 1, 0, 0).lines().map(|l| format!("echo '{l}'")).collect::<String>()
        )
    };
    let alone = format!(
        "[ -e {marks}/a ] && exit 1; echo \"$1\"; echo 'test result: ok. 2 passed; 0 failed; 0 ignored;'"
    );
    let lines = [
        r#"{"reason":"compiler-artifact","executable":null,"profile":{"test":true}}"#.to_owned(),
        test_program(folder, "mesh", "mesh", "lib", "echo 'test shape ... FAILED'; exit 101"),
        test_program(folder, "mesh", "crash", "test", "kill -SEGV $$"),
        test_program(folder, "ripstop-tests", "a", "test", &meet("a", "b")),
        test_program(folder, "ripstop-tests", "b", "test", &meet("b", "a")),
        test_program(folder, "ripstop-tests", "hosts", "test", &alone),
        r#"{"reason":"build-finished","success":true}"#.to_owned(),
    ];
    let file = folder.join("messages");
    std::fs::write(&file, lines.join("\n")).expect("written");
    let output = Command::new(env!("CARGO_BIN_EXE_test-lanes")).arg(&file).output().expect("it starts");
    let text = String::from_utf8(output.stdout).expect("text");
    assert_eq!(output.status.code(), Some(1), "{text}");
    for (own, other) in [("a", "b"), ("b", "a")] {
        let whole = format!("     Running tests/{own}.rs ({marks}/{own}-0a1b)\nstart {own}\nend {own}\n");
        assert!(text.contains(&whole), "{other}: {text}");
    }
    let first = format!("     Running tests/hosts.rs ({marks}/hosts-0a1b)\n--test-threads=2\n");
    assert!(text.starts_with(&first), "{text}");
    assert!(
        text.contains("error: test failed, to rerun pass `-p mesh --test crash`\n\nCaused by:"),
        "{text}"
    );
    assert!(text.contains("error: test failed, to rerun pass `-p mesh --lib`\n\n"), "{text}");
    let (line, text, code) = summary(&text, "", "1");
    assert_eq!((line.as_str(), code), ("4 passed, 2 failed, 0 skipped", 1));
    assert!(
        text.contains("unittests src/lib.rs: shape") && text.contains("tests/crash.rs: ended before"),
        "{text}"
    );

    // No messages, or none about tests, is an error.
    std::fs::write(&file, lines[0].clone()).expect("written");
    let output = Command::new(env!("CARGO_BIN_EXE_test-lanes")).arg(&file).output().expect("it starts");
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("no test programs"));
}

#[test]
fn crashed_suite_is_a_failure() {
    let log = [
        "     Running tests/crash.rs (target/release/deps/crash-0a)\n\nrunning 3 tests\ntest one ... ok\n",
        "error: test failed, to rerun pass `-p mesh --test crash`\n\nCaused by:\n  (signal: 11, SIGSEGV)\n",
        "     Running tests/next.rs (target/release/deps/next-0a)\n",
        &result("ok", 5, 0, 0),
        "error: 1 target failed:\n    `-p mesh --test crash`\n",
    ]
    .concat();
    let (line, text, code) = summary(&log, "", "1");
    assert_eq!((line.as_str(), code), ("6 passed, 1 failed, 0 skipped", 1));
    assert!(text.contains("tests/crash.rs: ended before its result"), "{text}");
}

#[test]
fn failed_build_is_a_failure() {
    for log in ["error[E0425]: cannot find value `x`\nerror: could not compile `mesh` (lib)\n", ""] {
        let (line, text, code) = summary(log, "", "1");
        assert_eq!((line.as_str(), code), ("0 passed, 1 failed, 0 skipped", 1));
        assert!(text.contains("the build or the set-up"), "{text}");
    }
    // A run without tests is not a success either.
    assert_eq!(summary("", "", "0").2, 1);
}

/// The nightly command runs all tests that `./test` omits: it finds ignored tests by their reason. Those that need a GPU are run where there is one.
#[test]
fn ignored_tests_belong_to_the_nightly_command() {
    let output = Command::new(root().join("scripts/nightly")).arg("--list").output();
    let output = output.expect("python3 is there");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let listed = String::from_utf8(output.stdout).expect("text");
    let sources = Command::new("git").args(["ls-files", "*.rs"]).current_dir(root()).output().expect("git");
    let attribute = ["#[", "ignore"].concat();
    let mut seen = 0;
    for file in String::from_utf8(sources.stdout).expect("text").lines() {
        let Ok(text) = std::fs::read_to_string(root().join(file)) else { continue };
        let mut lines = text.lines();
        while let Some(line) = lines.next() {
            if !line.trim_start().starts_with(&attribute) {
                continue;
            }
            if file.starts_with("crates/gpu/") && line.contains("needs a GPU") {
                continue;
            }
            let name = lines.find_map(|l| l.trim_start().strip_prefix("fn ")).expect("a function");
            let name = name.split('(').next().expect("a name");
            let script = line.split("nightly: by ").nth(1).map(|s| s.trim_end_matches("\"]"));
            let run = match script {
                Some(script) => listed.lines().any(|l| l.contains(&format!(" {script} "))),
                None => listed.lines().any(|l| l.split_whitespace().nth(1) == Some(name)),
            };
            assert!(run, "{file}: {name}: {line} is no reason that scripts/nightly knows");
            seen += 1;
        }
    }
    assert!(seen > 10, "{seen} ignored tests");
}
