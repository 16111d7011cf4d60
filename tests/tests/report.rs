//! The report of a run, tested in a browser.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use ripstop_tests::browser::{Browser, find_browser};
use ripstop_tests::load::Limit;
use ripstop_tests::skip::skipped;
use ripstop_tests::{changed_scene, program, ripstop_run, succeed};
use serde_json::json;

fn report(run: &Path, options: &[&str]) -> Command {
    let mut command = Command::new(program("ripstop"));
    command.arg("report").arg(run).args(options);
    command
}

/// Number of colours on the canvas of the canopy, and a hash of its pixels. Drawn and read in one call, because the canvas
/// buffer may be cleared afterwards.
const PIXELS: &str = "(() => { const v = document.getElementById('canopy').viewer; v.render(); \
    const c = document.createElement('canvas'); [c.width, c.height] = [v.canvas.width, v.canvas.height]; \
    const x = c.getContext('2d'); x.drawImage(v.canvas, 0, 0); \
    const d = new Uint32Array(x.getImageData(0, 0, c.width, c.height).data.buffer); \
    let sum = 0; for (const p of d) sum = (sum * 31 + p) % 4294967291; return [new Set(d).size, sum]; })()";

fn colours_and_sum(browser: &mut Browser) -> (u64, u64) {
    let found = browser.evaluate(PIXELS);
    (found[0].as_u64().expect("a count"), found[1].as_u64().expect("a sum"))
}

/// `report --watch` while another process holds the lock of `out`, as a run does: the open page reloads itself and keeps its
/// view; the last page does not reload.
fn page_follows_the_run(browser: &mut Browser, out: &Path) {
    let lock = std::fs::File::create(out.join(".lock")).expect("a file");
    lock.lock().expect("the lock");
    let mut command = report(out, &["--watch"]);
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("it starts");
    let page = out.join("report.html");
    let reloads = || std::fs::read_to_string(&page).is_ok_and(|text| text.contains("<body data-reload="));
    let limit = Limit::new(Duration::from_secs(60));
    limit.until(Duration::from_millis(50), reloads).expect("a page that reloads itself");
    browser.open(&page);
    let ready = "document.getElementById('canopy')?.dataset.state === 'ready'";
    browser.until(ready);
    let choose = |part: &str, value: u32| {
        format!(
            "(() => {{ const s = document.querySelector('[data-part={part}]'); s.value = {value}; \
             s.dispatchEvent(new Event('change')); }})();"
        )
    };
    browser.evaluate(&(choose("stage", 0) + &choose("field", 2)));
    browser.evaluate(
        "canopy.viewer.show(3); canopy.viewer.camera.position.set(1, 2, 3); canopy.viewer.controls.update()",
    );
    browser.evaluate("scrollTo({ top: 700, behavior: 'instant' }); window.before = true");
    let view = "[scrollY, canopy.viewer.stage, canopy.viewer.field, canopy.viewer.frame, \
                ...canopy.viewer.camera.position.toArray().map(Math.round)]";
    let before = browser.evaluate(view);
    assert_eq!(before, json!([700, 0, 2, 3, 1, 2, 3]));
    browser.until(&format!("window.before === undefined && {ready} && history.state && scrollY > 0"));
    assert_eq!(browser.evaluate(view), before, "the page that was loaded again has another view");

    drop(lock);
    let ended = limit.until(Duration::from_millis(50), || child.try_wait().expect("a child").is_some());
    ended.expect("it ends with the run");
    assert!(child.wait().expect("a child").success() && !reloads());
}

/// What the view of the canopy shows: stage, frame, field, whether it plays.
fn state(browser: &mut Browser) -> serde_json::Value {
    browser.evaluate("(({ stage, frame, field, playing }) => [stage, frame, field, playing])(canopy.viewer)")
}

/// Chooses a value of a list of the view.
fn choose(browser: &mut Browser, part: &str, value: u32) {
    browser.evaluate(&format!(
        "(() => {{ const s = document.querySelector('[data-part={part}]'); s.value = {value}; \
         s.dispatchEvent(new Event('change')); }})()"
    ));
}

/// The last frame is drawn; a key press on the slider goes back by one.
fn slider_steps_back(browser: &mut Browser) {
    // The canopy is shaded: more than the colours of background and lines.
    let (colours, last) = colours_and_sum(browser);
    assert!(colours > 500, "{colours} colours on the canvas");
    let frames = browser.evaluate("canopy.viewer.data.header.stages.map(s => s.times.length)");
    // 20 windows of descent, every second one.
    assert_eq!(frames[1], json!(10));
    assert_eq!(state(browser), json!([1, 9, 0, false]));

    // A key press on the slider goes back by one frame.
    browser.evaluate("document.querySelector('[data-part=time]').focus()");
    browser.key("ArrowLeft", 37);
    assert_eq!(state(browser), json!([1, 8, 0, false]));
    let (_, earlier) = colours_and_sum(browser);
    assert_ne!(last, earlier, "the canopy did not move");
    assert_eq!(browser.evaluate("document.querySelector('[data-part=clock]').textContent"), json!("0.090 s"));
}

/// Each field has its colours, and the last one its legend.
fn fields_differ(browser: &mut Browser) {
    let mut seen = vec![colours_and_sum(browser).1];
    for field in [1, 2] {
        choose(browser, "field", field);
        let (_, sum) = colours_and_sum(browser);
        assert!(!seen.contains(&sum), "colour {field} equals an earlier one");
        seen.push(sum);
    }
    let legend = browser.evaluate("document.querySelector('[data-part=legend]').textContent");
    assert_eq!(legend, json!("slackwrinkledtaut"));
}

fn plays_and_pauses(browser: &mut Browser) {
    browser.click("[data-part=play]");
    if browser.evaluate("canopy.viewer.playing") == json!(false) {
        // The layout changed under the pointer with the legend.
        browser.click("[data-part=play]");
    }
    assert_eq!(browser.evaluate("canopy.viewer.playing"), json!(true));
    let from = browser.evaluate("canopy.viewer.frame");
    browser.until(&format!("canopy.viewer.frame !== {from}"));
    browser.click("[data-part=play]");
    assert_eq!(browser.evaluate("canopy.viewer.playing"), json!(false));
}

/// Rotation, lines, mesh, the other stage.
fn view_changes(browser: &mut Browser) {
    let before = colours_and_sum(browser).1;
    browser.drag("#canopy canvas", [120.0, 40.0]);
    assert_ne!(before, colours_and_sum(browser).1, "dragging did not rotate it");
    for part in ["lines", "mesh"] {
        let before = colours_and_sum(browser).1;
        browser.click(&format!("[data-part={part}]"));
        assert_ne!(before, colours_and_sum(browser).1, "{part} changed nothing");
    }
    choose(browser, "stage", 0);
    assert_eq!(browser.evaluate("canopy.viewer.stage"), json!(0));
    browser.point("#canopy canvas");
}

/// A chart shows the value at the pointer; all pictures are there; nothing is loaded from elsewhere.
fn charts_and_pictures_are_complete(browser: &mut Browser, page: &Path) {
    browser.point("#stage-descent-descent-speed svg");
    let tip =
        browser.evaluate("document.querySelector('#stage-descent-descent-speed svg .marks').textContent");
    assert!(tip.as_str().is_some_and(|t| t.contains("m/s")), "{tip}");
    let pictures = browser.evaluate("[...document.images].every(i => i.complete && i.naturalWidth > 200)");
    assert_eq!(pictures, json!(true), "a picture is broken");

    assert_eq!(browser.complaints(), Vec::<String>::new());
    let asked: Vec<String> = browser.requests().into_iter().filter(|u| !u.starts_with("data:")).collect();
    assert_eq!(asked, [format!("file://{}", page.display())], "the page requests other resources");
}

#[test]
fn report_page_is_complete_and_interactive() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let output = "[output]\nsurface_every_windows = 2\nvolume_every_windows = 10\n\n[coupling]";
    let scene = changed_scene("square-drop", folder.path(), &[("[coupling]", output)]);
    succeed(ripstop_run(&scene, &out, &["--quiet"]));
    succeed(report(&out, &[]));
    succeed(report(&out, &["--markdown"]));

    let text = std::fs::read_to_string(out.join("report.md")).expect("the Markdown");
    for part in ["Descent speed", "| command | ripstop run", "| machine |", "report-pictures/flow-0.png"] {
        assert!(text.contains(part), "{part} is missing in\n{text}");
    }

    let Some(found) = find_browser() else {
        skipped("no browser to open the page in (scripts/setup --browser installs one)");
        return;
    };
    let mut browser = Browser::start(&found, &folder.path().join("browser"));
    let page = out.join("report.html");
    browser.open(&page);
    browser.until("document.getElementById('canopy').dataset.state === 'ready'");
    let missing = browser.evaluate("document.getElementById('missing') === null");
    assert_eq!(missing, json!(true), "a complete run has no missing data");

    slider_steps_back(&mut browser);
    fields_differ(&mut browser);
    plays_and_pauses(&mut browser);
    view_changes(&mut browser);
    charts_and_pictures_are_complete(&mut browser, &page);

    if let Some(keep) = std::env::var_os("RIPSTOP_KEEP") {
        std::fs::copy(&page, Path::new(&keep).join("report.html")).expect("a folder");
    }
    page_follows_the_run(&mut browser, &out);
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

#[test]
fn incomplete_run_has_a_report() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    let scene = ripstop_tests::scene("air-bag");
    // A run killed at once leaves at most a scene: a message instead of a report.
    std::fs::create_dir_all(&out).expect("a folder");
    let empty = report(&out, &[]).output().expect("it starts");
    assert_eq!(empty.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&empty.stderr).contains("scene.toml is missing"));
    succeed(ripstop_run(&scene, &out, &["--quiet", "--stop-after-windows", "3"]));
    std::fs::remove_file(out.join("summary.json")).expect("it was there");
    let output = succeed(report(&out, &[]));
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(errors.contains("summary.json is missing"), "{errors}");
    assert!(out.join("report.html").is_file());
}
