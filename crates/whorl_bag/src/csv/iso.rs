//! Dates and times of ISO 8601, as loggers and spreadsheets write them.

use chrono::{DateTime, NaiveDateTime};

/// Nanoseconds since 1970 of `2026-11-26T23:02:51.123456Z`, with a space for the T, a comma for the point, an offset for the Z,
/// or without one (then UTC). `None` of any other text.
pub(crate) fn nanoseconds(text: &str) -> Option<i64> {
    let text = text.trim();
    // Days, hours and minutes at least: a number is no date.
    if text.len() < 16 || text.as_bytes().get(4) != Some(&b'-') {
        return None;
    }
    let text = text.replacen(',', ".", 1);
    if let Ok(time) = DateTime::parse_from_rfc3339(&text.replacen(' ', "T", 1)) {
        return time.timestamp_nanos_opt();
    }
    // An offset without a colon, a Z behind a space.
    let forms = ["%Y-%m-%dT%H:%M:%S%.f%z", "%Y-%m-%d %H:%M:%S%.f%z", "%Y-%m-%d %H:%M:%S%.f %z"];
    if let Some(time) = forms.iter().find_map(|form| DateTime::parse_from_str(&text, form).ok()) {
        return time.timestamp_nanos_opt();
    }
    let text = text.trim_end_matches("UTC").trim_end();
    let forms = ["%Y-%m-%dT%H:%M:%S%.f", "%Y-%m-%d %H:%M:%S%.f", "%Y-%m-%dT%H:%M", "%Y-%m-%d %H:%M"];
    let time = forms.iter().find_map(|form| NaiveDateTime::parse_from_str(text, form).ok())?;
    time.and_utc().timestamp_nanos_opt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forms_of_one_instant_are_one_instant() {
        // date -u -d 2026-11-26T23:02:51Z +%s
        let at = 1_795_734_171_250_000_000;
        for text in [
            "2026-11-26T23:02:51.25Z",
            "2026-11-26T23:02:51.250000",
            "2026-11-26 23:02:51,25",
            "2026-11-26 23:02:51.25 UTC",
            "2026-11-27T01:02:51.25+02:00",
            "2026-11-27 01:02:51.25+0200",
        ] {
            assert_eq!(nanoseconds(text), Some(at), "{text}");
        }
        for text in ["", "12.5", "2026-11-26", "1795734171.123456789", "2026-13-26T23:02:51Z"] {
            assert_eq!(nanoseconds(text), None, "{text}");
        }
    }
}
