//! A headless Chromium, driven over the DevTools protocol: JSON messages, each ended by a zero byte, on the browser's
//! file descriptors 3 and 4.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Maximum time to wait for an answer, including drawing in software.
const PATIENCE: Duration = Duration::from_secs(60);

/// A browser with one page.
pub struct Browser {
    process: Child,
    to: ChildStdin,
    from: Receiver<Value>,
    messages: u64,
    session: Option<String>,
    /// Errors on the page so far: script exceptions and console errors.
    pub errors: Vec<String>,
    _profile: TempDir,
}

impl Browser {
    /// Starts a browser with a window of this size, pixels. If there is no browser, prints that the test is skipped.
    pub fn start(test: &str, width: u32, height: u32) -> Option<Self> {
        let found = Command::new("chromium").arg("--version").output();
        if !found.is_ok_and(|output| output.status.success()) {
            splatseg_test_scenes::skipped(test, "chromium is not installed");
            return None;
        }
        let profile = tempfile::tempdir().unwrap();
        // The shell gives the browser its own input and output as 3 and 4.
        let mut command = Command::new("sh");
        command.args(["-c", "exec \"$@\" 3<&0 4>&1 </dev/null >/dev/null 2>&1", "sh", "chromium"]);
        command.args(["--headless", "--no-sandbox", "--remote-debugging-pipe", "--no-first-run", "--disable-quic"]);
        command.args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]);
        command.args(["--disable-background-networking", "--disable-component-update", "--disable-sync"]);
        command
            .args([format!("--window-size={width},{height}"), format!("--user-data-dir={}", profile.path().display())]);
        let mut process = command.arg("about:blank").stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let (to, output) = (process.stdin.take().unwrap(), process.stdout.take().unwrap());
        let (sender, from) = channel();
        std::thread::spawn(move || {
            for message in BufReader::new(output).split(0) {
                let Ok(message) = message else { break };
                if sender.send(serde_json::from_slice(&message).unwrap()).is_err() {
                    break;
                }
            }
        });
        let mut browser = Self { process, to, from, messages: 0, session: None, errors: Vec::new(), _profile: profile };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }));
        let attached =
            browser.call("Target.attachToTarget", json!({ "targetId": target["targetId"], "flatten": true }));
        browser.session = Some(attached["sessionId"].as_str().unwrap().to_owned());
        browser.call("Runtime.enable", json!({}));
        browser.call("Page.enable", json!({}));
        browser.resize(width, height);
        Some(browser)
    }

    /// Changes the size of the page, pixels.
    pub fn resize(&mut self, width: u32, height: u32) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", size);
    }

    /// Opens a file. `hash` may be empty.
    pub fn open(&mut self, file: &Path, hash: &str) {
        let path = file.to_str().unwrap().replace('%', "%25").replace(' ', "%20").replace('#', "%23");
        self.open_url(&format!("file://{path}{hash}"));
    }

    /// Opens an address.
    pub fn open_url(&mut self, url: &str) {
        self.call("Page.navigate", json!({ "url": url }));
    }

    /// Shows pages as for someone who prefers `dark` or `light` ones.
    pub fn prefer_scheme(&mut self, scheme: &str) {
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.call("Emulation.setEmulatedMedia", json!({ "features": features }));
    }

    /// Evaluates a JavaScript expression. For a promise, returns its resolved value.
    pub fn value(&mut self, expression: &str) -> Value {
        let how = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let answer = self.call("Runtime.evaluate", how);
        assert!(answer.get("exceptionDetails").is_none(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    /// Waits until a JavaScript expression is true.
    pub fn wait_for(&mut self, expression: &str) {
        let deadline = Instant::now() + PATIENCE;
        while self.value(expression) != Value::Bool(true) {
            assert!(Instant::now() < deadline, "never came true: {expression}; errors: {:?}", self.errors);
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Clicks at a position, pixels from the top left of the page.
    pub fn click(&mut self, x: f64, y: f64) {
        for kind in ["mouseMoved", "mousePressed", "mouseReleased"] {
            let buttons = u8::from(kind == "mousePressed");
            let button = if kind == "mouseMoved" { "none" } else { "left" };
            let event = json!({ "type": kind, "x": x, "y": y, "button": button, "buttons": buttons, "clickCount": 1 });
            self.call("Input.dispatchMouseEvent", event);
        }
    }

    /// Presses the mouse at one position and releases it at another.
    pub fn drag(&mut self, from: (f64, f64), to: (f64, f64)) {
        let halfway = ((from.0 + to.0) / 2.0, (from.1 + to.1) / 2.0);
        let steps = [("mousePressed", from), ("mouseMoved", halfway), ("mouseMoved", to), ("mouseReleased", to)];
        for (kind, (x, y)) in steps {
            let buttons = u8::from(kind != "mouseReleased");
            let event = json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1 });
            self.call("Input.dispatchMouseEvent", event);
        }
    }

    /// Clicks in the middle of the first element that a selector finds, after scrolling to it.
    pub fn click_on(&mut self, selector: &str) {
        let (left, top, width, height) = self.place_of(selector);
        self.click(left + width / 2.0, top + height / 2.0);
    }

    /// Returns left, top, width and height of an element, pixels, after scrolling to it.
    pub fn place_of(&mut self, selector: &str) -> (f64, f64, f64, f64) {
        let place = self.value(&format!(
            "(() => {{ const found = document.querySelector({selector:?}); found.scrollIntoView({{ block: 'nearest' }}); \
             const place = found.getBoundingClientRect(); return [place.left, place.top, place.width, place.height]; }})()"
        ));
        let number = |index: usize| place[index].as_f64().unwrap();
        (number(0), number(1), number(2), number(3))
    }

    /// Presses a key, e.g. `ArrowRight`.
    pub fn press(&mut self, key: &str) {
        for kind in ["keyDown", "keyUp"] {
            self.call("Input.dispatchKeyEvent", json!({ "type": kind, "key": key, "code": key }));
        }
    }

    /// Returns a screenshot as a PNG in base64.
    pub fn screenshot(&mut self) -> String {
        self.call("Page.captureScreenshot", json!({ "format": "png" }))["data"].as_str().unwrap().to_owned()
    }

    /// Sends a command and returns its result.
    pub fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.messages += 1;
        let mut message = json!({ "id": self.messages, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.to.write_all(format!("{message}\0").as_bytes()).unwrap();
        loop {
            let answer = self.from.recv_timeout(PATIENCE).unwrap_or_else(|error| panic!("{method}: {error}"));
            self.record_error(&answer);
            if answer["id"] == self.messages {
                assert!(answer.get("error").is_none(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    fn record_error(&mut self, event: &Value) {
        let is_error = match event["method"].as_str() {
            Some("Runtime.exceptionThrown") => true,
            Some("Runtime.consoleAPICalled") => event["params"]["type"] == "error",
            _ => false,
        };
        if is_error {
            self.errors.push(event["params"].to_string());
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
