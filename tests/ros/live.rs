//! `whorl live` in a real browser: it draws what is published, shows a death and a recovery, survives being loaded anew, and
//! only who knows the token commands.

use std::time::Duration;

use serde_json::json;
use whorl_math::{EulerAngles, EulerSequence};
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{AttitudeEstimate, FormationState};

use crate::support::browser::{Browser, Page};
use crate::support::formation::{Formation, LONG_HOLD, STARTUP};
use crate::support::machine::Load;
use crate::support::watch::route;
use crate::support::{binaries, measured, root, skipped, wait_for};

const SOON: Duration = STARTUP;

/// Text of a cell of the table of numbers.
fn cell(row: usize, column: usize) -> String {
    format!("document.getElementById('numbers').tBodies[0].rows[{row}].cells[{column}].textContent")
}

fn is_live(browser: &mut Browser, page: &Page) {
    browser.wait(page, "a connection", SOON, "document.getElementById('connection').textContent === 'live'");
    for row in 0..2 {
        browser.wait(page, "tracking", SOON, &format!("{} === 'tracking'", cell(row, 1)));
    }
}

#[test]
fn the_live_page_shows_and_aborts_a_run() {
    let formation = Formation::with_load(Load::Browser, &["whorl_1", "whorl_2"], &[LONG_HOLD]);
    let Some(mut browser) = Browser::start() else {
        skipped("the live page in a browser", "chromium is not installed");
        return;
    };
    let (mut formation, watch) = formation.held();
    let mut command = formation.command(None, &binaries::path("whorl"));
    command.args(["live", "whorl_1", "whorl_2", "--port", "0", "--params"]).arg(root().join("params"));
    formation.adopt("live", command);
    let address = wait_for("the address", SOON, || {
        let log = formation.node("live").log();
        log.split_once("live at ").and_then(|(_, rest)| Some(rest.lines().next()?.trim().to_owned()))
    });
    let (site, token) = address.split_once("#token=").unwrap();
    let site = site.trim_end_matches('/');

    // It draws what is published.
    let page = browser.open(&address);
    is_live(&mut browser, &page);
    browser.wait(&page, "frames", SOON, "Number(document.getElementById('scene').dataset.drawn) > 30");
    let colours = "(() => { const c = document.getElementById('scene'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; \
                   const seen = new Set(); for (let i = 0; i < d.length; i += 4) seen.add(d[i] << 16 | d[i + 1] << 8 | d[i + 2]); return seen.size; })()";
    assert!(browser.value(&page, colours).as_u64().unwrap() > 20, "the view is empty");
    // In the hold the two are the same, however late the page is.
    wait_for("the page to show what is published", SOON, || {
        let shown = browser.value(&page, &cell(1, 2));
        let shown: Vec<f64> = shown.as_str()?.split(", ").map(|a| a.parse().unwrap()).collect();
        let published = watch
            .log()
            .latest::<AttitudeEstimate>(route(1, Topic::AttitudeEstimate))
            .map(|(_, m)| m.q_world_body.to_unit().unwrap())?;
        let angles = EulerAngles::from_quaternion(&published, EulerSequence::E321).angles_rad;
        let is_same = |(shown, published): (&f64, &f64)| (shown - published.to_degrees()).abs() < 0.3;
        (shown.len() == 3 && shown.iter().zip(angles.iter()).all(is_same)).then_some(())
    });

    // It takes little of a computer.
    let mut seen = || {
        let frames = browser.value(&page, "Number(document.body.dataset.frames)").as_f64();
        formation.node("live").resources().zip(frames).map(|((_, cpu_s), frames)| (cpu_s, frames))
    };
    let before = seen();
    std::thread::sleep(Duration::from_secs(5));
    if let (Some((cpu_before, before)), Some((cpu_after, after))) = (before, seen()) {
        let (cpu, frames) = ((cpu_after - cpu_before) / 5.0 * 100.0, (after - before) / 5.0);
        measured(&format!("whorl live with a browser: {cpu:.1} % of a core, {frames:.1} frames a second"));
    }

    // A node dies and comes back.
    formation.kill("/whorl_2/estimator");
    browser.wait(&page, "no attitude", SOON, &format!("{} === '–'", cell(1, 2)));
    browser.wait(&page, "safe mode", SOON, &format!("{}.startsWith('safe')", cell(1, 1)));
    formation.start("/whorl_2/estimator");
    is_live(&mut browser, &page);

    // Loaded anew, it still knows its token.
    browser.reload(&page);
    is_live(&mut browser, &page);
    assert_eq!(browser.value(&page, "document.getElementById('abort').hidden"), json!(false));
    assert_eq!(
        browser.value(&page, "location.href"),
        json!(format!("{site}/")),
        "the token left the address"
    );

    // Who does not know it only watches.
    let stranger = browser.open(&format!("{site}/?stranger"));
    is_live(&mut browser, &stranger);
    assert_eq!(browser.value(&stranger, "document.getElementById('abort').hidden"), json!(true));
    let tried = |headers: &str| {
        format!("fetch('/abort', {{method: 'POST', body: '', headers: {headers}}}).then((r) => r.status)")
    };
    assert_eq!(browser.value(&stranger, &tried("{}")), json!(401));
    let wrong = token.chars().rev().collect::<String>();
    assert_eq!(browser.value(&stranger, &tried(&format!("{{Authorization: 'Bearer {wrong}'}}"))), json!(401));
    let state = route(0, Topic::FormationState);
    let phase = watch.log().latest::<FormationState>(state).map(|(_, m)| m.phase);
    assert_ne!(phase, Some(FormationState::PHASE_ABORTED));

    // Held, the experiment stands still until it is started again.
    let step_of =
        || watch.log().latest::<FormationState>(state).map(|(_, m)| (m.step.clone(), m.step_elapsed_s));
    assert_eq!(browser.value(&stranger, "document.getElementById('hold').hidden"), json!(true));
    assert_eq!(browser.value(&stranger, &tried("{}").replace("/abort", "/hold")), json!(401));
    browser.value(&page, "document.getElementById('hold').click()");
    watch.wait_next::<FormationState>("a hold", state, SOON, |m| m.step.ends_with("(waiting)"));
    let held = step_of().unwrap();
    std::thread::sleep(Duration::from_secs(3));
    assert_eq!(step_of().unwrap(), held, "the sequence went on");
    browser.value(&page, "document.getElementById('start').click()");
    watch.wait_next::<FormationState>("going on", state, SOON, |m| {
        !m.step.ends_with("(waiting)") && m.step_elapsed_s > held.1 + 0.5
    });

    // The button aborts.
    browser.value(&page, "document.getElementById('abort').click()");
    watch.wait_next::<FormationState>("an abort", state, SOON, |m| m.phase == FormationState::PHASE_ABORTED);
    browser.wait(&page, "an answer", SOON, "document.getElementById('answer').textContent.length > 3");
    let answer = browser.value(&page, "document.getElementById('answer').textContent");
    assert!(!answer.as_str().unwrap().starts_with("refused"), "{answer}");
    formation.stop();
}
