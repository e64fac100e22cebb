use std::path::{Path, PathBuf};

use whorl_identification::{ExpectedInformation, Verdict};
use whorl_recording::Recording;

use super::{Judged, Manoeuvre, ManoeuvreDemand, Proposal, family};

fn parameters() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params")
}

fn manoeuvres(platform: &str, scale: f64) -> Vec<Manoeuvre> {
    let known = whorl_recording::read_model(&parameters().join(format!("{platform}.yaml")), None).unwrap();
    family(&known.model, scale)
}

/// Whorl-I's bearing stops at 5 deg, and it balances 2.1 deg from the vertical (Table 4.1).
#[test]
fn tilts_stay_a_degree_within_the_bearing() {
    let all = manoeuvres("whorl_1", 1.0);
    let [pitch, roll] = all[0].balance_deg;
    assert!((pitch + 0.57).abs() < 0.02 && (roll - 2.0).abs() < 0.02);
    let mut tilts = 0;
    for step in all.iter().flat_map(|m| m.steps.lines()) {
        let number = |key: &str| {
            let behind = step.split(key).nth(1)?.trim_start_matches(": ");
            behind.split([',', '}']).next()?.parse::<f64>().ok()
        };
        let tilt = match (number("pitch_deg"), number("roll_deg"), number("amplitude_deg")) {
            (Some(pitch), Some(roll), _) => pitch.hypot(roll),
            (.., Some(amplitude)) if !step.contains("axis: yaw") => 2.08 + amplitude,
            _ => 0.0,
        };
        assert!(tilt <= 4.1, "{step}");
        tilts += usize::from(tilt > 0.0);
    }
    assert!(tilts >= 5, "{tilts}");
}

#[test]
fn a_smaller_scale_makes_everything_gentler() {
    let (full, half) = (manoeuvres("whorl_1", 1.0), manoeuvres("whorl_1", 0.5));
    for (a, b) in full.iter().zip(&half) {
        let (full, half) = (a.demand_deg_s, b.demand_deg_s);
        assert!(half.0 <= full.0 && half.1 <= full.1, "{}: {half:?} {full:?}", a.name);
    }
}

/// Where nothing is in doubt no run is needed, and the answer begins with that; else it says which run comes next.
#[test]
fn a_run_is_proposed_only_where_something_is_in_doubt() {
    let all = manoeuvres("whorl_1", 1.0);
    let known = whorl_recording::read_model(&parameters().join("whorl_1.yaml"), None).unwrap();
    let sets = [vec!["bearing_viscous_friction".to_owned()], vec!["harness_spring".to_owned()]];
    let expected = |odds: Option<f64>, shown: &[&str]| ExpectedInformation {
        log_odds: odds,
        shown: shown.iter().map(|id| (*id).to_owned()).collect(),
        not_shown: vec!["slosh".to_owned()],
    };
    for (verdict, explanations, needed, says) in [
        (Verdict::Confounded, sets.to_vec(), true, "The data leave open"),
        (Verdict::Unknown, Vec::new(), true, "Something is missing"),
        (Verdict::NotEnoughInformation, Vec::new(), true, "The data cannot say"),
        (Verdict::Named, sets.to_vec(), false, "No run is needed: the data name viscous friction"),
        (Verdict::Named, sets[..1].to_vec(), false, "No run is needed: the data name viscous friction"),
        (Verdict::NothingMissing, Vec::new(), false, "No run is needed: nothing is missing, and 2 of 3"),
    ] {
        let odds = (explanations.len() > 1).then_some(7.0);
        let best = Judged {
            manoeuvre: all[0].clone(),
            demand: ManoeuvreDemand::of(&Recording::default(), &known.model),
            expected: expected(odds, &["gyro_scale", "wheel_drag", "slosh"]),
            motion: Recording::default(),
        };
        let now = expected(odds, &["gyro_scale", "wheel_drag"]);
        let separates = odds.is_some();
        let proposal =
            Proposal { explanations, now, judged: vec![best.clone()], left_out: Vec::new(), separates };
        let answer = proposal.answer(&best, verdict, "whorl_1");
        assert!(answer[0].starts_with(says), "{verdict:?}: {answer:#?}");
        assert_eq!(answer[0].contains("No run is needed"), !needed, "{verdict:?}");
        assert_eq!(answer[1].starts_with("Next: whorl_1 "), needed, "{verdict:?}: {answer:#?}");
        assert!(
            answer.iter().all(|sentence| !sentence.contains("none") && !sentence.contains("..")),
            "{answer:#?}"
        );
        assert_eq!(super::needs_run(verdict), needed);
    }
}
