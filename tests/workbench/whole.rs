//! From the file to the adopted effect and back: of a real rig whose effect has no name, and of one of two platforms.

use std::process::Command;

use serde_json::json;

use super::{LONG, SOON, browser, click, headline, is_usable_by_all, open, text};
use crate::support::browser::{Browser, Page};
use crate::support::machine::Load;
use crate::support::{binaries, root};

/// Friction in the simulated Whorl-I that its model lacks [N m s].
const FRICTION_N_M_S: f64 = 0.3;

/// Numbers of a row of bars, before and after.
fn bars(browser: &mut Browser, page: &Page, selector: &str) -> Vec<f64> {
    let shown =
        format!("[...document.querySelectorAll('{selector} output')].map((o) => parseFloat(o.textContent))");
    serde_json::from_value(browser.value(page, &shown)).unwrap()
}

#[test]
fn the_tour_leads_through_the_example_to_a_law_without_a_name() {
    let _share = Load::Browser.take();
    let Some(mut browser) = browser("the example of the workbench") else { return };
    let open = open(&[]);
    let page = browser.open(&open.address);
    browser.wait(&page, "an empty folder", SOON, "document.getElementById('example')");
    is_usable_by_all(&mut browser, &page);
    click(&mut browser, &page, "#tour");
    browser.wait(&page, "the tour", SOON, "document.getElementById('guide_do')");
    is_usable_by_all(&mut browser, &page);
    click(&mut browser, &page, "#guide_do");
    browser.wait(&page, "the error", LONG, "document.getElementById('headline')");
    let before = headline(&mut browser, &page);
    // The held-out swing-up judges. What dry friction of a tenth of the largest torque does to predictions is far from noise.
    assert!(before > 50.0, "{before}");
    let next = |browser: &mut Browser| click(browser, &page, "#guide_next");
    next(&mut browser);
    next(&mut browser);
    next(&mut browser);
    for (answer, shown) in [
        ("where", "document.querySelector('#where .bars')"),
        ("diagnose", "document.getElementById('verdict')"),
        ("discover", "document.getElementById('adopt_law')"),
    ] {
        browser.wait(&page, "its button", SOON, "document.getElementById('guide_do')");
        click(&mut browser, &page, "#guide_do");
        browser.wait(&page, answer, LONG, shown);
        browser.wait(
            &page,
            "what came out",
            SOON,
            "document.getElementById('guide').textContent.includes('Here: ')",
        );
        next(&mut browser);
    }
    assert!(text(&mut browser, &page, "#where").contains("yaw rate"));
    let law = text(&mut browser, &page, "#law");
    assert!(law.contains("dry friction"), "{law}");
    assert!(browser.value(&page, "document.querySelectorAll('#law math').length > 0") == json!(true));

    let file = || std::fs::read_to_string(open.folder.path().join("dfki_pendulum.yaml")).unwrap();
    let given = file();
    browser.wait(&page, "its button", SOON, "document.getElementById('guide_do')");
    click(&mut browser, &page, "#guide_do");
    browser.wait(&page, "undo", LONG, "document.getElementById('undo')");
    let falls =
        format!("parseFloat(document.querySelector('#headline .number').textContent) < {}", 0.9 * before);
    browser.wait(&page, "the smaller error", LONG, &falls);
    let line = file().lines().find(|line| line.contains("discovered_law")).map(str::to_owned);
    assert!(line.is_some(), "{}", file());
    is_usable_by_all(&mut browser, &page);
    click(&mut browser, &page, "#undo");
    let back = format!("parseFloat(document.querySelector('#headline .number').textContent) === {before}");
    browser.wait(&page, "the error of before", LONG, &back);
    assert_eq!(file(), given);
    assert!(browser.complaints(&page).is_empty(), "{:?}", browser.complaints(&page));
}

#[test]
fn one_of_two_platforms_gets_its_effect_and_points_better() {
    let _share = Load::Browser.take();
    let Some(mut browser) = browser("a run of two platforms in the workbench") else { return };
    let open = open(&[]);
    let folder = open.folder.path();
    // Its model, and what all nodes share: then the page can simulate as well.
    for file in ["whorl_1.yaml", "common.yaml"] {
        std::fs::copy(root().join("params").join(file), folder.join(file)).unwrap();
    }
    let hidden = format!("/whorl_1/driver:truth.effects.bearing_viscous_friction.c_n_m_s:={FRICTION_N_M_S}");
    let made = Command::new(binaries::path("whorl"))
        .args(["simulate", "--experiment", "params/experiments/swing.yaml", "--no-report", "--out"])
        .arg(folder.join("swing"))
        .args(["-p", &hidden])
        .current_dir(root())
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));

    let page = browser.open(&open.address);
    let role = "document.querySelector('.files select')";
    browser.wait(&page, "the run", SOON, role);
    browser.value(&page, &format!("{role}.value = 'training'; {role}.dispatchEvent(new Event('change'))"));
    // It has the models of both: which is meant has to be said, by the platform's file for one.
    let model = "document.querySelector('select[aria-label=\"Platform\\'s file\"]')";
    browser.wait(
        &page,
        "the question",
        SOON,
        "document.getElementById('problem')?.textContent.includes('whorl_1 and whorl_2: choose one')",
    );
    is_usable_by_all(&mut browser, &page);
    browser
        .value(&page, &format!("{model}.value = 'whorl_1.yaml'; {model}.dispatchEvent(new Event('change'))"));
    browser.wait(&page, "the model", SOON, "!document.getElementById('problem')");
    browser.wait(&page, "a picture", LONG, "document.querySelector('.lane canvas')");

    click(&mut browser, &page, "#ask_compare");
    browser.wait(&page, "the error", LONG, "document.getElementById('headline')");
    let before = headline(&mut browser, &page);
    click(&mut browser, &page, "#ask_diagnose");
    browser.wait(&page, "a verdict", LONG, "document.getElementById('verdict')");
    let verdict = text(&mut browser, &page, "#verdict h3");
    assert!(verdict.contains("viscous friction"), "{verdict}");
    let file = || std::fs::read_to_string(folder.join("whorl_1.yaml")).unwrap();
    let given = file();
    click(&mut browser, &page, "#adopt_it");
    browser.wait(&page, "pointing, simulated", LONG, "document.getElementById('pointing')");
    let pointing = bars(&mut browser, &page, "#pointing");
    assert!(pointing.len() == 2 && pointing[1] < 0.9 * pointing[0], "{pointing:?}");
    let falls = format!("parseFloat(document.querySelector('#headline .number').textContent) < {before}");
    browser.wait(&page, "the smaller error", LONG, &falls);
    is_usable_by_all(&mut browser, &page);
    click(&mut browser, &page, "#undo");
    let back = format!("parseFloat(document.querySelector('#headline .number').textContent) === {before}");
    browser.wait(&page, "the error of before", LONG, &back);
    assert_eq!(file(), given);
    assert!(browser.complaints(&page).is_empty(), "{:?}", browser.complaints(&page));
}
