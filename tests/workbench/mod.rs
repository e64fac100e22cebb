//! `whorl open` in a real browser, as a person would use it: a file is dropped, the effect is found, adopted and taken back; a computation
//! is stopped; a letter is no recording; two pages see the same; the program is killed and started again. `whole`: the example of a real rig,
//! whose effect has no name, and a run of two platforms.

mod whole;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::support::browser::{Browser, Page};
use crate::support::machine::Load;
use crate::support::process::Process;
use crate::support::{binaries, root, skipped, wait_for};

/// For what takes no computation.
const SOON: Duration = Duration::from_secs(60);
/// For a diagnosis, on a computer that does other things as well.
const LONG: Duration = Duration::from_secs(600);
const TOKEN: &str = "00112233445566778899aabbccddeeff";
/// What swing.csv.gz was made with [N m s].
const FRICTION_N_M_S: f64 = 0.0035;

/// A folder that is open.
struct Open {
    process: Process,
    folder: TempDir,
    address: String,
}

fn data(name: &str) -> PathBuf {
    root().join("tests/workbench/data").join(name)
}

/// Opens a folder with these files of the data.
fn open(files: &[&str]) -> Open {
    let folder = tempfile::tempdir().unwrap();
    for file in files {
        std::fs::copy(data(file), folder.path().join(file)).unwrap();
    }
    let (process, address) = start(folder.path(), "0");
    Open { process, folder, address }
}

fn start(folder: &Path, port: &str) -> (Process, String) {
    let mut command = Command::new(binaries::path("whorl"));
    command.arg("open").arg(folder).args(["--port", port]).env("WHORL_OPEN_TOKEN", TOKEN);
    let log = tempfile::Builder::new().suffix(".log").tempfile().unwrap().into_temp_path();
    let process = Process::start("open", command, &log);
    let address = wait_for("the address", SOON, || {
        let log = process.log();
        Some(log.split_once(" open at ")?.1.lines().next()?.trim().to_owned())
    });
    (process, address)
}

fn browser(what: &str) -> Option<Browser> {
    let browser = Browser::start();
    if browser.is_none() {
        skipped(what, "chromium is not installed");
    }
    browser
}

fn text(browser: &mut Browser, page: &Page, selector: &str) -> String {
    let value = browser.value(page, &format!("document.querySelector('{selector}')?.textContent ?? ''"));
    value.as_str().unwrap().to_owned()
}

fn click(browser: &mut Browser, page: &Page, selector: &str) {
    browser.value(page, &format!("document.querySelector('{selector}').click()"));
}

/// The error of the headline: a number as it is shown.
fn headline(browser: &mut Browser, page: &Page) -> f64 {
    let shown = text(browser, page, "#headline .number");
    shown.split_whitespace().next().unwrap().parse().unwrap()
}

fn is_idle(browser: &mut Browser, page: &Page, timeout: Duration) {
    browser.wait(page, "all that was asked", timeout, "document.body.dataset.busy === '' && !document.querySelector('#job_stages')?.textContent.includes('then:') || document.getElementById('working').hidden");
}

/// Nothing keeps a person from using the page with keyboard or screen reader, wide or narrow, light or dark.
fn is_usable_by_all(browser: &mut Browser, page: &Page) {
    for (width, dark) in [(390, false), (390, true), (1400, true), (1400, false)] {
        browser.show_as(page, width, dark);
        // Drawn at this size.
        browser
            .value(page, "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))");
        let flaws = browser.flaws(page);
        assert!(flaws.is_empty(), "{width} px, dark: {dark}: {flaws:#?}");
        let wider = browser.value(page, "document.documentElement.scrollWidth - innerWidth");
        assert!(wider.as_f64().unwrap() <= 0.0, "{width} px: scrolls sideways by {wider} px");
    }
}

/// What the command says of the same files.
fn by_command(folder: &Path, arguments: &[&str]) -> Value {
    let output = Command::new(binaries::path("whorl"))
        .args(arguments)
        .args(["--json", "-"])
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_dropped_file_leads_to_the_effect_that_it_was_made_with_and_back() {
    let _share = Load::Browser.take();
    let Some(mut browser) = browser("the workbench in a browser") else { return };
    let open = open(&["pendulum.yaml", "pendulum.channels.yaml"]);
    let folder = open.folder.path();
    let page = browser.open(&open.address);
    browser.wait(&page, "the page", SOON, "document.getElementById('problem')");
    assert!(!text(&mut browser, &page, "#connection").is_empty());
    assert_eq!(browser.value(&page, "location.hash"), json!(""), "the token left the address");

    // Dropped, it is drawn, and the error stands there as a number.
    browser.drop_files(&page, &[data("swing.csv.gz")]);
    browser.wait(&page, "a first picture", SOON, "document.querySelector('.lane canvas')");
    browser.wait(&page, "the error", LONG, "document.getElementById('headline')");
    let before = headline(&mut browser, &page);
    let model = ["--model", "pendulum.yaml", "--channels", "pendulum.channels.yaml"];
    let said = by_command(folder, &[&["compare", "swing.csv.gz"], &model[..]].concat());
    let error = said["prediction_error"].as_f64().unwrap();
    assert!((before - error).abs() < 0.006, "the page says {before}, the command {error}");
    assert!(before > 1.5, "{before}");

    is_usable_by_all(&mut browser, &page);

    // A computation that is stopped leaves no answer, and the page as it was.
    click(&mut browser, &page, "#ask_diagnose");
    browser.wait(&page, "a diagnosis", SOON, "document.body.dataset.busy === 'diagnose'");
    assert_eq!(headline(&mut browser, &page), before, "the page answers meanwhile");
    click(&mut browser, &page, "#stop");
    browser.wait(&page, "its end", LONG, "document.querySelector('.notice[data-is=stopped]')");
    assert_eq!(browser.value(&page, "document.getElementById('verdict')"), Value::Null);

    // Where, and what.
    click(&mut browser, &page, "#ask_where");
    browser.wait(&page, "where", LONG, "document.querySelector('#where .bars')");
    click(&mut browser, &page, "#ask_diagnose");
    browser.wait(&page, "a verdict", LONG, "document.getElementById('verdict')");
    let verdict = text(&mut browser, &page, "#verdict h3");
    assert!(verdict.contains("viscous friction"), "{verdict}");

    // Adopted: in the file, in the error, and as a step.
    let file = || std::fs::read_to_string(folder.join("pendulum.yaml")).unwrap();
    let given = file();
    click(&mut browser, &page, "#adopt_it");
    browser.wait(&page, "undo", LONG, "document.getElementById('undo')");
    is_idle(&mut browser, &page, LONG);
    browser.wait(
        &page,
        "the smaller error",
        LONG,
        "parseFloat(document.querySelector('#headline .number').textContent) < 1.2",
    );
    let written = file();
    let line = written.lines().find(|line| line.trim_start().starts_with("c_n_m_s:")).unwrap();
    let number = |text: &str| text.trim().split([' ', ',']).next().unwrap().parse::<f64>().unwrap();
    let (value, rest) = (number(line.split_once(':').unwrap().1), line.split_once("+-").unwrap().1);
    let stddev = number(rest);
    assert!((value - FRICTION_N_M_S).abs() < 4.0 * stddev && stddev < 0.1 * FRICTION_N_M_S, "{line}");
    assert_eq!(text(&mut browser, &page, "#steps tr:nth-child(2) td"), "1");
    // A pendulum has nothing to point with, and the page says so.
    assert!(text(&mut browser, &page, "#adopt").contains("was not simulated: it has no wheels or jets"));
    is_usable_by_all(&mut browser, &page);

    // Exported, it is one page with the figures and the commands.
    click(&mut browser, &page, "#export");
    browser.wait(&page, "an export", SOON, "Number(document.body.dataset.exported) > 10000");
    let exported = "fetch('/api/export', {method: 'POST', headers: {Authorization: `Bearer ${localStorage.getItem('whorl-token')}`}}).then((r) => r.text())";
    let exported = browser.value(&page, exported);
    let exported = exported.as_str().unwrap();
    for part in ["<svg", "whorl compare swing.csv.gz", "whorl adopt swing.csv.gz bearing_viscous_friction"] {
        assert!(exported.contains(part), "{part}");
    }

    // And back, to the letter; the answer of before holds again.
    click(&mut browser, &page, "#undo");
    browser.wait(
        &page,
        "the error of before",
        LONG,
        &format!("parseFloat(document.querySelector('#headline .number').textContent) === {before}"),
    );
    assert_eq!(file(), given);
    assert!(browser.complaints(&page).is_empty(), "{:?}", browser.complaints(&page));
}

#[test]
fn the_page_says_what_the_command_says_of_any_case() {
    let _share = Load::Browser.take();
    let Some(mut browser) = browser("cases in the workbench") else { return };
    for name in ["band", "valves"] {
        let [run, model, map] =
            [format!("{name}.csv.gz"), format!("{name}.yaml"), format!("{name}.channels.yaml")];
        let open = open(&[&run, &model, &map]);
        let page = browser.open(&open.address);
        browser.wait(&page, "the error", LONG, "document.getElementById('headline')");
        let said = by_command(open.folder.path(), &["compare", &run, "--model", &model, "--channels", &map]);
        let error = said["prediction_error"].as_f64().unwrap();
        let shown = headline(&mut browser, &page);
        assert!(
            (shown - error).abs() < 0.006 * error.max(1.0),
            "{name}: the page says {shown}, the command {error}"
        );
    }
}

#[test]
fn two_pages_see_the_same_and_a_killed_program_comes_back() {
    let _share = Load::Browser.take();
    let Some(mut browser) = browser("two pages of the workbench") else { return };
    let mut open = open(&["pendulum.yaml", "pendulum.channels.yaml", "swing.csv.gz"]);
    let first = browser.open(&open.address);
    let second = browser.open(&open.address);
    for page in [&first, &second] {
        browser.wait(page, "the error", LONG, "document.getElementById('headline')");
    }
    // What one chooses the other sees.
    let role = "document.querySelector('.files select')";
    browser.value(&first, &format!("{role}.value = 'held_out'; {role}.dispatchEvent(new Event('change'))"));
    browser.wait(&second, "the choice", SOON, &format!("{role}.value === 'held_out'"));
    browser.value(&first, &format!("{role}.value = 'training'; {role}.dispatchEvent(new Event('change'))"));
    browser.wait(&second, "the choice", SOON, &format!("{role}.value === 'training'"));

    // What is no recording is refused in words, and not kept.
    let letter = open.folder.path().join("../letter.txt");
    std::fs::write(&letter, "Dear Sir,\n").unwrap();
    browser.drop_files(&first, &[letter.canonicalize().unwrap()]);
    browser.wait(
        &first,
        "a refusal",
        SOON,
        "[...document.querySelectorAll('.notice[data-is=failed]')].some((n) => n.textContent.includes('no recording'))",
    );
    assert!(!open.folder.path().join("letter.txt").exists());
    std::fs::remove_file(&letter).unwrap();
    let disguised = tempfile::tempdir().unwrap();
    let letter = disguised.path().join("letter.csv");
    std::fs::write(&letter, "Dear Sir,\nthis is a letter\n").unwrap();
    browser.drop_files(&first, &[letter]);
    browser.wait(&second, "the refusal", SOON, "[...document.querySelectorAll('.notice[data-is=failed]')].some((n) => n.textContent.includes('letter.csv'))");
    browser.wait(&second, "what it was", SOON, &format!("{role} && [...document.querySelectorAll('.files select')].filter((s) => s.value === 'training').length === 1"));

    // Killed in the midst of a computation, and started again at the same place.
    click(&mut browser, &first, "#ask_diagnose");
    browser.wait(&second, "a diagnosis", SOON, "document.body.dataset.busy === 'diagnose'");
    let before = std::fs::read_to_string(open.folder.path().join("pendulum.yaml")).unwrap();
    open.process.kill();
    for page in [&first, &second] {
        browser.wait(page, "the loss", SOON, "document.getElementById('connection').dataset.is === 'lost'");
    }
    let port = open.address.split_once("127.0.0.1:").unwrap().1.split('/').next().unwrap().to_owned();
    let (again, _) = start(open.folder.path(), &port);
    open.process = again;
    for page in [&first, &second] {
        browser.wait(
            page,
            "the program",
            SOON,
            "document.getElementById('connection').dataset.is === 'open'",
        );
        browser.wait(
            page,
            "an idle page",
            LONG,
            "document.getElementById('working').hidden && document.getElementById('headline')",
        );
    }
    assert_eq!(std::fs::read_to_string(open.folder.path().join("pendulum.yaml")).unwrap(), before);

    // Who does not know the token sees nothing.
    let site = open.address.split_once("#token=").unwrap().0.trim_end_matches('/').to_owned();
    let stranger = "fetch('/api/state', {method: 'POST'}).then((r) => r.status)";
    assert_eq!(browser.value(&first, stranger), json!(401));
    let page = browser.open(&format!("{site}/assets/nothing.js"));
    browser.wait(&page, "a refusal", SOON, "document.body.innerText.includes('no such part')");
}
