use crate::sources::{ALL, Source, Sources};

const MS: i64 = 1_000_000;

/// Streams of 100 Hz that have all reached `ms`.
fn all_until(ms: i64) -> Sources {
    let mut sources = Sources::new(true, true);
    for at in (0..=ms).step_by(10) {
        for (source, _) in ALL {
            sources.heard(source, at * MS).unwrap();
        }
    }
    sources
}

#[test]
fn an_interval_is_complete_when_every_source_has_reached_its_end() {
    let mut sources = all_until(1000);
    assert_eq!(sources.complete(1000 * MS), Ok(true));
    assert_eq!(sources.complete(1010 * MS), Ok(false));
    for (source, _) in ALL.into_iter().filter(|(source, _)| *source != Source::Valves) {
        for at in (1010..=3100).step_by(10) {
            sources.heard(source, at * MS).unwrap();
        }
    }
    assert_eq!(sources.complete(1200 * MS), Ok(false));
    assert_eq!(sources.complete(1050 * MS), Err("states of the valves are missing".to_owned()));
    // A platform without jets has no valves to wait for.
    let mut sources = Sources::new(false, false);
    for source in [Source::Gyro, Source::Attitude, Source::Control] {
        sources.heard(source, 5 * MS).unwrap();
    }
    assert_eq!(sources.complete(5 * MS), Ok(true));
}

#[test]
fn gaps_and_disorder_are_found_and_slow_sources_are_not_gaps() {
    let mut sources = all_until(1000);
    assert_eq!(sources.heard(Source::Wheels, 1040 * MS).unwrap(), Some(0.04));
    assert_eq!(
        sources.heard(Source::Wheels, 1040 * MS),
        Err("states of the wheels came in disorder".to_owned())
    );
    assert_eq!(
        sources.heard(Source::Gyro, 900 * MS),
        Err("readings of the gyro came in disorder".to_owned())
    );
    assert_eq!(
        sources.heard(Source::Valves, 1080 * MS),
        Err("states of the valves were late or lost".to_owned())
    );
    assert_eq!(sources.heard(Source::Control, 1200 * MS).unwrap(), Some(0.2));
    sources.forget();
    assert_eq!(sources.heard(Source::Wheels, 0).unwrap(), None, "the first after a hole");
    // Drives that answer 15 times a second.
    let mut slow = Sources::new(true, false);
    for at in (0..2000).step_by(66) {
        assert!(slow.heard(Source::Wheels, at * MS).is_ok(), "{at}");
    }
}
