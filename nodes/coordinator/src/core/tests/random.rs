//! Random experiments with random faults: no reference leaves its limits.

use super::*;
use proptest::prelude::*;

fn step(index: usize, kind: u8, a: [f64; 3], duration_s: f64) -> String {
    let [yaw, pitch, roll] = a;
    let angles =
        format!("yaw_deg: {:.2}, pitch_deg: {:.2}, roll_deg: {:.2}", yaw * 170.0, pitch * 60.0, roll * 60.0);
    let kind = match kind {
        0 => "kind: hold".to_owned(),
        1 => format!("kind: offset, platform: whorl_2, {angles}"),
        2 => {
            let axis = ["yaw", "pitch", "roll"][index % 3];
            format!("kind: scan, axis: {axis}, amplitude_deg: {:.2}, period_s: 2.0", 30.0 * yaw.abs())
        }
        _ => format!("kind: slew, {angles}"),
    };
    format!("      step_{index}: {{{kind}, duration_s: {duration_s:.2}}}\n")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn random_experiments_with_cuts_stay_inside_every_limit(
        structure in any::<bool>(),
        steps in prop::collection::vec((0..6_u8, prop::array::uniform3(-1.0..1.0_f64), 2.0..15.0_f64), 2..7),
        cuts in prop::collection::vec((0..2_usize, 0.0..40.0_f64, 0.1..6.0_f64), 0..4),
    ) {
        let text: String =
            steps.iter().enumerate().map(|(i, (kind, a, duration))| step(i, *kind, *a, *duration)).collect();
        let head = PAIR.split("      settle:").next().unwrap();
        let mut experiment = format!("{head}{text}");
        if structure {
            experiment = experiment.replace("    law:\n", "    law:\n      kind: virtual_structure\n");
        }
        let mut lab = Laboratory::new(&experiment);
        for tick in 0..6000 {
            let t = f64::from(tick) * 0.01;
            for index in 0..2 {
                lab.platforms[index].cut =
                    cuts.iter().any(|(who, from, length)| *who == index && t > *from && t < from + length);
            }
            lab.step();
        }
        for (index, references) in lab.references.iter().enumerate() {
            for message in references {
                let q = reference_of(message).q_world_reference;
                let (tilt, max_deg) = if index == 0 {
                    (whorl_math::tilt_rad(&q), 4.0)
                } else {
                    (whorl_math::elevation_x_rad(&q).abs(), 29.0)
                };
                prop_assert!(tilt.to_degrees() <= max_deg + 1e-6, "{index}: {}", tilt.to_degrees());
            }
            // A platform that was lost may start anew from where it is: only then may a reference jump.
            let tracked = references.split(|r| r.mode == AttitudeReference::MODE_HOLD);
            let worst = tracked.map(smoothness).fold(Smoothness::default(), |worst, s| Smoothness {
                rate_rad_s: worst.rate_rad_s.max(s.rate_rad_s),
                acceleration_rad_s2: worst.acceleration_rad_s2.max(s.acceleration_rad_s2),
                mismatch_rad_s: worst.mismatch_rad_s.max(s.mismatch_rad_s),
            });
            // A dumbbell at 29 deg of pitch turns faster about its body axes than in yaw, pitch and roll.
            prop_assert!(worst.rate_rad_s.to_degrees() < 4.0 * 1.25, "{index}: {worst:?}");
            prop_assert!(worst.mismatch_rad_s < 1e-4, "{index}: {worst:?}");
            prop_assert!(worst.acceleration_rad_s2 < 0.02, "{index}: {worst:?}");
        }
    }
}
