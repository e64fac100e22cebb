//! The known words that a mistyped one may stand for: the one source of "did you mean" in all messages.

use std::borrow::Cow;

/// The candidate with the smallest edit distance, if it is close enough.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let length = word.chars().count();
    let limit = (length / 3).clamp(2, 8);
    candidates
        .into_iter()
        // Optimal string alignment: two letters that changed places are one mistake.
        .map(|candidate| (strsim::osa_distance(word, candidate), candidate))
        // Of a word of two letters nothing is left when one is wrong.
        .filter(|(distance, _)| *distance <= limit && 2 * distance < length)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// "did you mean X?": the [`nearest`] candidate, else up to three that share a part of five letters or more with the
/// word, as `bearing_friction` does with `bearing_viscous_friction`. `None` when nothing is like it.
pub fn did_you_mean<'a>(
    word: &str,
    candidates: impl IntoIterator<Item = &'a str, IntoIter: Clone>,
) -> Option<String> {
    let candidates = candidates.into_iter();
    let near = match nearest(word, candidates.clone()) {
        Some(near) => vec![near],
        None => sharing_most(word, candidates),
    };
    (!near.is_empty()).then(|| format!("did you mean {}?", near.join(" or ")))
}

/// "; did you mean X?", or nothing: for the end of a sentence.
pub fn or_did_you_mean<'a>(
    word: &str,
    candidates: impl IntoIterator<Item = &'a str, IntoIter: Clone>,
) -> String {
    did_you_mean(word, candidates).map_or_else(String::new, |question| format!("; {question}"))
}

/// The `count` candidates with the smallest edit distance, the nearest first, however far they are.
pub fn ranked<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>, count: usize) -> Vec<String> {
    let mut ranked: Vec<(usize, &str)> =
        candidates.into_iter().map(|c| (strsim::osa_distance(word, c), c)).collect();
    ranked.sort_by_key(|(distance, _)| *distance);
    ranked.into_iter().take(count).map(|(_, c)| c.to_owned()).collect()
}

/// Parts of a word shorter than this say nothing.
const PART: usize = 5;
/// More suggestions than this are none.
const MOST: usize = 3;

fn sharing_most<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let parts: Vec<&str> =
        word.split(|c: char| !c.is_alphanumeric()).filter(|part| part.chars().count() >= PART).collect();
    let shared = |candidate: &str| parts.iter().filter(|part| candidate.contains(**part)).count();
    let counted: Vec<(usize, &str)> = candidates.map(|c| (shared(c), c)).collect();
    let most = counted.iter().map(|(count, _)| *count).max().filter(|count| *count > 0);
    let best: Vec<&str> =
        counted.iter().filter(|(count, _)| Some(*count) == most).map(|(_, candidate)| *candidate).collect();
    if best.len() <= MOST { best } else { Vec::new() }
}

/// A text in a message: its first `most` characters, in [`one_line`], and how many it has in all. What was read may be megabytes.
#[must_use]
pub fn shortened(text: &str, most: usize) -> Cow<'_, str> {
    match text.char_indices().nth(most) {
        None => one_line(text),
        Some((end, _)) => {
            let (shown, all) = (text.get(..end).unwrap_or_default(), text.chars().count());
            format!("{}... ({all} characters)", one_line(shown)).into()
        }
    }
}

/// A name or a sentence that somebody else wrote, in one line: ends of lines are written as JSON writes them, `\u000a`. Otherwise it
/// could add lines that look like those of the program.
#[must_use]
pub fn one_line(text: &str) -> Cow<'_, str> {
    if text.contains(['\n', '\r']) {
        text.replace('\n', "\\u000a").replace('\r', "\\u000d").into()
    } else {
        text.into()
    }
}

/// A word as a shell takes it: in quotes where it has a space or another character that a shell would not leave alone.
#[must_use]
pub fn shell_word(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-./=:,+@%".contains(c) || !c.is_ascii();
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_letters_that_changed_places_are_one_mistake() {
        assert_eq!(nearest("gian", ["gains_of_2", "mean", "gain"]), Some("gain"));
        assert_eq!(nearest("abdcefgh", ["abxyefgh", "abcdefgh"]), Some("abcdefgh"));
    }

    #[test]
    fn a_far_word_is_not_suggested() {
        let known = ["gyro_noise_rad_s", "rate_hz"];
        assert_eq!(nearest("gyro_noise_rads", known), Some("gyro_noise_rad_s"));
        assert_eq!(nearest("colour", known), None);
        assert_eq!(nearest("az", ["gz", "t"]), None);
        assert_eq!(did_you_mean("colour", known), None);
        assert_eq!(or_did_you_mean("colour", known), "");
    }

    #[test]
    fn words_that_share_a_part_are_suggested_unless_they_are_many() {
        let known = ["bearing_viscous_friction", "wheel_friction", "harness_spring"];
        assert_eq!(
            did_you_mean("bearing_friction_of_some_kind", known).as_deref(),
            Some("did you mean bearing_viscous_friction?")
        );
        assert_eq!(
            did_you_mean("friction", known).as_deref(),
            Some("did you mean bearing_viscous_friction or wheel_friction?")
        );
        assert_eq!(did_you_mean("jet_thrust", ["jet_a", "jet_b", "jet_c", "jet_d"]), None);
    }

    #[test]
    fn long_texts_are_cut_between_characters() {
        assert_eq!(shortened("abc", 3), "abc");
        assert_eq!(shortened("äöüß", 2), "äö... (4 characters)");
        assert!(shortened(&"ä".repeat(5_000_000), 40).len() < 120);
    }

    #[test]
    fn names_have_one_line() {
        assert_eq!(one_line("hold\nverdict: PASSED\r"), "hold\\u000averdict: PASSED\\u000d");
        assert!(matches!(one_line("Ångström\t1"), Cow::Borrowed(_)));
        assert_eq!(shortened("a\nbcd", 3), "a\\u000ab... (5 characters)");
        assert_eq!(shortened("a\nb", 3), "a\\u000ab");
    }
}
