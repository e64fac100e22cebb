use crate::Settings;

fn is_borne_out(own: f64, held: f64, expected: impl Into<Option<f64>>) -> bool {
    super::is_borne_out(own, held, expected.into(), &Settings::default())
}

#[test]
fn held_out_data_must_gain_what_they_would_if_the_effect_were_there() {
    // Twenty nats are expected, with a deviation of the root of forty.
    assert!(is_borne_out(100.0, 20.0, 20.0) && is_borne_out(100.0, 1.0, 20.0));
    assert!(!is_borne_out(100.0, -1.0, 20.0));
    // Of a strong effect whose formula is another it is enough that half of its size is there.
    assert!(is_borne_out(1000.0, 10.0, 250.0) && !is_borne_out(1000.0, -10.0, 250.0));
    // Runs that do not excite it say nothing,
    assert!(is_borne_out(100.0, -1.0, 0.5) && is_borne_out(100.0, -0.4, 0.0));
    // unless they are much less likely with it.
    assert!(!is_borne_out(100.0, -15.0, 0.5));
    // Where nobody knows what to expect, only that counts.
    assert!(is_borne_out(100.0, -10.0, None) && !is_borne_out(100.0, -15.0, None));
}
