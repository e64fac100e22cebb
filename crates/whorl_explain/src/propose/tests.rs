use std::path::{Path, PathBuf};

use super::{Envelope, Manoeuvre, Step, family};

fn parameters() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params")
}

fn manoeuvres(platform: &str, scale: f64) -> (Envelope, Vec<Manoeuvre>) {
    let known = whorl_recording::read_model(&parameters().join(format!("{platform}.yaml")), None).unwrap();
    let envelope = Envelope::of(&known.model, scale);
    let all = family(&envelope);
    (envelope, all)
}

/// Whorl-I's bearing stops at 5 deg, and it balances 2.1 deg from the vertical (Table 4.1).
#[test]
fn tilts_stay_a_degree_within_the_bearing() {
    let (envelope, all) = manoeuvres("whorl_1", 1.0);
    assert!((envelope.balance_deg.0 + 0.57).abs() < 0.02 && (envelope.balance_deg.1 - 2.0).abs() < 0.02);
    for step in all.iter().flat_map(|m| &m.steps) {
        let tilt = match step {
            Step::Slew { tilt_deg: Some((pitch, roll)), .. } => pitch.hypot(*roll),
            Step::Scan { axis: "pitch" | "roll", amplitude_deg, .. } => 2.08 + amplitude_deg,
            _ => 0.0,
        };
        assert!(tilt <= 4.1, "{step:?}");
    }
}

#[test]
fn a_smaller_scale_makes_everything_gentler() {
    let ((_, full), (_, half)) = (manoeuvres("whorl_1", 1.0), manoeuvres("whorl_1", 0.5));
    for (a, b) in full.iter().zip(&half) {
        let (full, half) = (a.demand_deg_s(), b.demand_deg_s());
        assert!(half.0 <= full.0 && half.1 <= full.1, "{}: {half:?} {full:?}", a.name);
    }
}
