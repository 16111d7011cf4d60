//! A headless Chromium under remote control: the DevTools protocol over a pipe.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use serde_json::{Value, json};

use crate::load::Limit;

/// Maximum time of a response, allowing for software rendering on a shared machine.
const DEADLINE: Duration = Duration::from_secs(60);
/// Polling interval.
const LOOK: Duration = Duration::from_millis(50);

/// The browser of `RIPSTOP_BROWSER`, else one on the path.
pub fn find_browser() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os("RIPSTOP_BROWSER") {
        return Some(named.into());
    }
    let path = std::env::var_os("PATH")?;
    let names = ["chromium", "chromium-browser", "google-chrome"];
    std::env::split_paths(&path).flat_map(|f| names.map(|n| f.join(n))).find(|p| p.is_file())
}

/// A browser with one page open.
pub struct Browser {
    process: Child,
    input: ChildStdin,
    messages: Receiver<Value>,
    session: String,
    calls: u64,
    /// Events received from the browser.
    pub events: Vec<Value>,
}

impl Browser {
    /// Starts one with its data in `folder`.
    pub fn start(program: &Path, folder: &Path) -> Self {
        // The browser reads commands from descriptor 3 and replies on 4, each terminated by a zero byte.
        let mut process = Command::new("sh")
            .args(["-c", "exec \"$@\" 3<&0 4>&1 </dev/null >/dev/null", "sh"])
            .arg(program)
            .args([
                "--headless",
                "--remote-debugging-pipe",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-quic",
            ])
            .args(["--no-first-run", "--disable-background-networking", "--disable-component-update"])
            .args(["--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
            .arg("--window-size=1200,900")
            .arg(format!("--user-data-dir={}", folder.display()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the browser starts");
        let input = process.stdin.take().expect("a pipe");
        let output = process.stdout.take().expect("a pipe");
        let (sender, messages) = channel();
        std::thread::spawn(move || {
            for message in BufReader::new(output).split(0).map_while(Result::ok) {
                let message = serde_json::from_slice(&message).expect("the browser speaks JSON");
                if sender.send(message).is_err() {
                    break;
                }
            }
        });
        let mut browser =
            Self { process, input, messages, session: String::new(), calls: 0, events: Vec::new() };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = browser.call("Target.attachToTarget", attach);
        browser.session = session["sessionId"].as_str().expect("a session").to_owned();
        for domain in ["Page", "Runtime", "Log", "Network"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        browser
    }

    /// Calls a method of the protocol and returns its result.
    pub fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.calls += 1;
        let mut message = json!({ "id": self.calls, "method": method, "params": parameters });
        if !self.session.is_empty() {
            message["sessionId"] = json!(self.session);
        }
        let mut bytes = message.to_string().into_bytes();
        bytes.push(0);
        self.input.write_all(&bytes).expect("the browser listens");
        let limit = Limit::new(DEADLINE);
        loop {
            let answer = match self.messages.recv_timeout(LOOK) {
                Ok(answer) => answer,
                Err(RecvTimeoutError::Timeout) => {
                    limit.demand(format_args!("no answer to {method}"));
                    continue;
                }
                Err(end) => panic!("no answer to {method}: {end}"),
            };
            if answer["id"] == json!(self.calls) {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].clone();
            }
            self.events.push(answer);
        }
    }

    /// Opens a file and waits until it is loaded.
    pub fn open(&mut self, file: &Path) {
        self.call("Page.navigate", json!({ "url": format!("file://{}", file.display()) }));
        self.until("document.readyState === 'complete' && location.protocol === 'file:'");
    }

    /// Value of an expression in the page; awaits promises.
    pub fn evaluate(&mut self, expression: &str) -> Value {
        let parameters = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let answer = self.call("Runtime.evaluate", parameters);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    /// Waits until an expression is true.
    pub fn until(&mut self, expression: &str) {
        let limit = Limit::new(DEADLINE);
        while self.evaluate(expression) != json!(true) {
            limit.demand(format_args!("never true: {expression}"));
            std::thread::sleep(LOOK);
        }
    }

    /// Middle of an element in the window, after scrolling it there.
    fn place(&mut self, selector: &str) -> [f64; 2] {
        let found = self.evaluate(&format!(
            "(() => {{ const e = document.querySelector({selector:?}); e.scrollIntoView({{ block: 'center', \
             behavior: 'instant' }}); const b = e.getBoundingClientRect(); \
             return [b.x + b.width / 2, b.y + b.height / 2]; }})()"
        ));
        [0, 1].map(|i| found[i].as_f64().unwrap_or_else(|| panic!("{selector} has no place")))
    }

    /// Moves the pointer onto an element.
    pub fn point(&mut self, selector: &str) {
        let [x, y] = self.place(selector);
        self.mouse("mouseMoved", x, y, "none");
    }

    /// Clicks on an element.
    pub fn click(&mut self, selector: &str) {
        let [x, y] = self.place(selector);
        self.mouse("mousePressed", x, y, "left");
        self.mouse("mouseReleased", x, y, "left");
    }

    /// Drags from the centre of an element by `by` pixels.
    pub fn drag(&mut self, selector: &str, by: [f64; 2]) {
        let [x, y] = self.place(selector);
        self.mouse("mousePressed", x, y, "left");
        for step in 1..=5 {
            let part = f64::from(step) / 5.0;
            self.mouse("mouseMoved", x + part * by[0], y + part * by[1], "left");
        }
        self.mouse("mouseReleased", x + by[0], y + by[1], "left");
    }

    fn mouse(&mut self, kind: &str, x: f64, y: f64, button: &str) {
        let pressed = u32::from(button == "left" && kind != "mouseReleased");
        let parameters =
            json!({ "type": kind, "x": x, "y": y, "button": button, "buttons": pressed, "clickCount": 1 });
        self.call("Input.dispatchMouseEvent", parameters);
    }

    /// Presses a named key, such as `ArrowLeft`, in the focused element.
    pub fn key(&mut self, key: &str, code: u32) {
        for kind in ["keyDown", "keyUp"] {
            let parameters = json!({ "type": kind, "key": key, "code": key, "windowsVirtualKeyCode": code });
            self.call("Input.dispatchKeyEvent", parameters);
        }
    }

    /// Exceptions and console errors of the page.
    pub fn complaints(&self) -> Vec<String> {
        let bad = |e: &&Value| match e["method"].as_str().unwrap_or_default() {
            "Runtime.exceptionThrown" => true,
            "Runtime.consoleAPICalled" => e["params"]["type"] == "error",
            "Log.entryAdded" => e["params"]["entry"]["level"] == "error",
            _ => false,
        };
        self.events.iter().filter(bad).map(Value::to_string).collect()
    }

    /// Addresses requested by the page.
    pub fn requests(&self) -> Vec<String> {
        let asked = |e: &&Value| e["method"] == "Network.requestWillBeSent";
        let url = |e: &Value| e["params"]["request"]["url"].as_str().unwrap_or_default().to_owned();
        self.events.iter().filter(asked).map(url).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // Closing ends all processes of the browser; killing would leave some.
        let close = json!({ "id": 0, "method": "Browser.close" }).to_string();
        let _ = self.input.write_all(format!("{close}\0").as_bytes());
        let ended = || self.process.try_wait().is_ok_and(|status| status.is_some());
        if Limit::new(Duration::from_secs(10)).until(LOOK, ended).is_ok() {
            return;
        }
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
