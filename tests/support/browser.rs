//! A headless Chromium, driven through its DevTools protocol (<https://chromedevtools.github.io/devtools-protocol/>).

use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;
use tungstenite::{Message, WebSocket};

use super::process::Process;

/// How long Chromium may take to start, and to answer.
const PATIENCE: Duration = Duration::from_secs(60);

/// A browser and its connection; it ends when dropped.
pub struct Browser {
    socket: WebSocket<TcpStream>,
    next: u64,
    /// Errors of scripts, by the page's session.
    errors: Vec<(String, String)>,
    _process: Process,
    _profile: TempDir,
}

/// A page of the browser.
#[derive(Debug, Clone)]
pub struct Page {
    session: String,
}

/// The Chromium on this machine, if there is one.
fn program() -> Option<String> {
    let named = std::env::var("CHROMIUM").ok();
    named.into_iter().chain(["chromium".to_owned(), "chromium-browser".to_owned()]).find(|program| {
        let tried =
            Command::new(program).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        tried.is_ok_and(|status| status.success())
    })
}

impl Browser {
    /// Starts one; `None` where Chromium is not installed.
    pub fn start() -> Option<Self> {
        let program = program()?;
        let profile = tempfile::tempdir().unwrap();
        let mut command = Command::new(program);
        command
            .args([
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-dev-shm-usage",
                "--no-first-run",
            ])
            .args(["--remote-debugging-port=0", "--window-size=1400,1000"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank");
        let process = Process::start("chromium", command, &profile.path().join("chromium.log"));
        let address = Self::address(profile.path());
        let stream = TcpStream::connect(("127.0.0.1", address.0)).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let url = format!("ws://127.0.0.1:{}{}", address.0, address.1);
        let (socket, _) = tungstenite::client::client(url, stream).unwrap();
        Some(Self { socket, next: 0, errors: Vec::new(), _process: process, _profile: profile })
    }

    /// Port and path, which Chromium writes into its profile.
    fn address(profile: &Path) -> (u16, String) {
        let begun = Instant::now();
        loop {
            let text = std::fs::read_to_string(profile.join("DevToolsActivePort")).unwrap_or_default();
            if let Some((port, path)) = text.split_once('\n').filter(|(_, path)| !path.is_empty()) {
                return (port.parse().unwrap(), path.trim().to_owned());
            }
            assert!(begun.elapsed() < PATIENCE, "chromium does not start");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Calls a method and returns its result.
    fn call(&mut self, session: Option<&str>, method: &str, parameters: Value) -> Value {
        self.next += 1;
        let mut message = json!({"id": self.next, "method": method, "params": parameters});
        if let Some(session) = session {
            message["sessionId"] = json!(session);
        }
        self.socket.send(Message::text(message.to_string())).unwrap();
        loop {
            let Message::Text(text) = self.socket.read().unwrap() else { continue };
            let answer: Value = serde_json::from_str(&text).unwrap();
            if answer["method"] == "Runtime.exceptionThrown" {
                let session = answer["sessionId"].as_str().unwrap_or_default().to_owned();
                self.errors.push((session, answer["params"]["exceptionDetails"].to_string()));
            }
            if answer["id"] == self.next {
                assert!(answer.get("error").is_none(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    /// Opens a page.
    pub fn open(&mut self, url: &str) -> Page {
        let target = self.call(None, "Target.createTarget", json!({"url": url}))["targetId"].clone();
        let attached = self.call(None, "Target.attachToTarget", json!({"targetId": target, "flatten": true}));
        Page { session: attached["sessionId"].as_str().unwrap().to_owned() }
    }

    /// The value of an expression in a page; of a promise, what it comes to.
    pub fn value(&mut self, page: &Page, expression: &str) -> Value {
        let parameters = json!({"expression": expression, "awaitPromise": true, "returnByValue": true});
        let result = self.call(Some(&page.session), "Runtime.evaluate", parameters);
        assert!(result.get("exceptionDetails").is_none(), "{expression}: {result}");
        result["result"]["value"].clone()
    }

    /// Waits until an expression in a page is true.
    pub fn wait(&mut self, page: &Page, what: &str, timeout: Duration, expression: &str) {
        let begun = Instant::now();
        // While a page is loaded, what is looked for may not be there yet.
        let tried = format!("(() => {{ try {{ return !!({expression}); }} catch {{ return false; }} }})()");
        while self.value(page, &tried) != json!(true) {
            if begun.elapsed() > timeout {
                let text = self.value(page, "document.body.innerText");
                panic!(
                    "waited for {what} ({expression}); the page says:\n{}",
                    text.as_str().unwrap_or("nothing")
                );
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Drops files on the middle of what a page shows, as from a file manager.
    pub fn drop_files(&mut self, page: &Page, files: &[PathBuf]) {
        let data = json!({"items": [], "files": files, "dragOperationsMask": 1});
        for kind in ["dragEnter", "dragOver", "drop"] {
            let event = json!({"type": kind, "x": 400, "y": 300, "data": data});
            self.call(Some(&page.session), "Input.dispatchDragEvent", event);
        }
    }

    /// What scripts of a page have complained of: errors that nobody caught.
    pub fn complaints(&mut self, page: &Page) -> Vec<String> {
        self.call(Some(&page.session), "Runtime.enable", json!({}));
        // A value asked for afterwards: what was held back has come before its answer.
        self.value(page, "1");
        self.errors
            .iter()
            .filter(|(session, _)| *session == page.session)
            .map(|(_, text)| text.clone())
            .collect()
    }

    /// Shows a page this wide [CSS pixels], light or dark.
    pub fn show_as(&mut self, page: &Page, width: u32, dark: bool) {
        let size = json!({"width": width, "height": 1000, "deviceScaleFactor": 1, "mobile": false});
        self.call(Some(&page.session), "Emulation.setDeviceMetricsOverride", size);
        let scheme = if dark { "dark" } else { "light" };
        let features = json!({"features": [{"name": "prefers-color-scheme", "value": scheme}]});
        self.call(Some(&page.session), "Emulation.setEmulatedMedia", features);
    }

    /// What axe finds of a page that cannot be used with a screen reader or the keyboard, or hardly be read.
    pub fn flaws(&mut self, page: &Page) -> Vec<String> {
        self.value(page, concat!(include_str!("axe/axe.min.js"), "; 1"));
        let found = self.value(page, "axe.run(document, {resultTypes: ['violations']}).then((r) => r.violations.map((v) => `${v.id}: ${v.help}: ${v.nodes.map((n) => n.target.join(' ')).join(', ')}`))");
        serde_json::from_value(found).unwrap()
    }

    /// Loads a page anew.
    pub fn reload(&mut self, page: &Page) {
        self.call(Some(&page.session), "Page.reload", json!({}));
    }
}
