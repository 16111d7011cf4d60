//! `./test` ends with one line that counts the tests of all suites, including failed ones.

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

/// The nightly command runs all tests that `./test` omits: it finds ignored tests by their reason.
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

/// Suites run two at a time and are printed as `cargo test` prints them, so that the summary counts failures and crashes.
#[test]
fn suites_are_reported_as_by_cargo() {
    let folder = tempfile::tempdir().expect("a folder");
    let script = |name: &str, text: &str| {
        let file = folder.path().join(name);
        std::fs::write(&file, format!("#!/bin/sh\n{text}")).expect("written");
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o755);
        std::fs::set_permissions(&file, mode).expect("executable");
        file.display().to_string()
    };
    let place = folder.path().display().to_string();
    let artifact = |package: &str, kind: &str, name: &str, source: &str, executable: &str, test: bool| {
        format!(
            "{{\"reason\":\"compiler-artifact\",\"package_id\":\"path+file://{place}/{package}\",\"manifest_path\":\"{place}/Cargo.toml\",\"target\":\
             {{\"kind\":[\"{kind}\"],\"crate_types\":[\"bin\"],\"name\":\"{name}\",\"src_path\":\"{place}/{source}\",\"test\":true}},\
             \"profile\":{{\"test\":{test}}},\"executable\":\"{executable}\"}}\n"
        )
    };
    // Each waits for the other: one after the other would not end.
    let meet = |own: &str, other: &str, rest: &str| {
        let wait = format!("for i in $(seq 100); do [ -e {place}/{other}.here ] && break; sleep 0.1; done");
        let met = format!("[ -e {place}/{other}.here ] || exit 9");
        script(own, &format!("touch {place}/{own}.here\n{wait}\n{met}\n{rest}"))
    };
    let good = meet("good", "bad", &format!("echo 'test a ... ok'\necho '{}'", result("ok", 1, 0, 0).trim()));
    let text = format!("echo 'test b::c ... FAILED'\necho '{}'\nexit 101", result("FAILED", 0, 1, 0).trim());
    let bad = meet("bad", "good", &text);
    let crash = script("crash", "echo 'test d ... ok'\nkill -SEGV $$\n");
    let list = [
        artifact("mesh#0.2.0", "lib", "mesh", "src/lib.rs", &good, true),
        artifact("tests#ripstop-tests@0.2.0", "test", "winds", "tests/winds.rs", &bad, true),
        artifact("tests#ripstop-tests@0.2.0", "test", "crash", "tests/crash.rs", &crash, true),
        artifact("mesh#0.2.0", "bin", "mesh", "src/main.rs", "/nowhere", false),
    ]
    .concat();
    script("cargo", &format!("case \"$*\" in *--no-run*) cat <<'EOF'\n{list}EOF\n;; esac"));
    let path = format!("{place}:{}", std::env::var("PATH").expect("a path"));
    let mut run = Command::new(root().join("scripts/run-suites"));
    let output = run
        .env("PATH", path)
        .env("CARGO_TARGET_DIR", folder.path())
        .env("JOBS", "2")
        .output()
        .expect("it starts");
    let log = String::from_utf8(output.stdout).expect("text");
    assert_eq!(output.status.code(), Some(1), "{log}");
    assert!(log.contains(&format!("     Running unittests src/lib.rs ({good})\n")), "{log}");
    assert!(log.contains("to rerun pass `-p ripstop-tests --test winds`"), "{log}");
    let (line, text, _) = summary(&log, "", "1");
    assert_eq!(line, "2 passed, 2 failed, 0 skipped", "{log}");
    let failed = "tests/winds.rs: b::c";
    assert!(text.contains(failed) && text.contains("tests/crash.rs: ended before its result"), "{text}");
}
