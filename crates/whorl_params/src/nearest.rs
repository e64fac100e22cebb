//! The known word nearest to a mistyped one.

/// The candidate with the smallest edit distance, if it is close enough.
pub(crate) fn nearest<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let limit = (word.chars().count() / 3).clamp(2, 8);
    candidates
        // Optimal string alignment: two letters that changed places are one mistake.
        .map(|candidate| (strsim::osa_distance(word, candidate), candidate))
        .filter(|(distance, _)| *distance <= limit)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_letters_that_changed_places_are_one_mistake() {
        assert_eq!(nearest("gian", ["gains_of_2", "mean", "gain"].into_iter()), Some("gain"));
        assert_eq!(nearest("abdcefgh", ["abxyefgh", "abcdefgh"].into_iter()), Some("abcdefgh"));
    }

    #[test]
    fn a_far_word_is_not_suggested() {
        let known = ["gyro_noise_rad_s", "rate_hz"];
        assert_eq!(nearest("gyro_noise_rads", known.into_iter()), Some("gyro_noise_rad_s"));
        assert_eq!(nearest("colour", known.into_iter()), None);
    }
}
