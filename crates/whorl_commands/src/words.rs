//! Errors in words.

/// An error with its causes, each once: many errors say their cause in their own words already.
#[must_use]
pub fn in_words(error: &anyhow::Error) -> String {
    let mut said = String::new();
    for cause in error.chain() {
        let words = cause.to_string();
        if said.ends_with(&words) {
            continue;
        }
        if !said.is_empty() {
            said.push_str(": ");
        }
        said.push_str(&words);
    }
    said
}

/// A text about options of the command line as one about arguments of a function: `--held-out RUN` is `held_out=RUN`, and
/// `--platform` alone `platform`. Quoted commands stay.
#[must_use]
pub fn of_arguments(text: &str) -> String {
    let parts = text.split('`').enumerate();
    let told = parts.map(|(k, part)| if k % 2 == 0 { options_replaced(part) } else { part.to_owned() });
    told.collect::<Vec<_>>().join("`")
}

fn options_replaced(text: &str) -> String {
    let mut told = String::new();
    let mut rest = text;
    while let Some(at) = rest.find("--") {
        let (before, option) = (rest.get(..at).unwrap_or(rest), rest.get(at + 2..).unwrap_or_default());
        told.push_str(before);
        let is_name = |c: char| c.is_ascii_lowercase() || c == '-';
        let (name, after) = option.split_at(option.find(|c| !is_name(c)).unwrap_or(option.len()));
        if name.starts_with(|c: char| c.is_ascii_lowercase())
            && !before.ends_with(|c: char| c.is_alphanumeric())
        {
            told.push_str(&name.replace('-', "_"));
            let word = after.strip_prefix(' ').unwrap_or_default().split([' ', ';', ':', ',', ')']).next();
            let word = word.unwrap_or_default().trim_end_matches('.');
            // A file, or a word in capitals that stands for one.
            let is_value =
                word.contains(['/', '.']) || !word.is_empty() && word.chars().all(|c| c.is_ascii_uppercase());
            told.push_str(if is_value { "=" } else { "" });
            rest = after.get(usize::from(is_value)..).unwrap_or_default();
        } else {
            told.push_str("--");
            rest = option;
        }
    }
    told + rest
}

#[cfg(test)]
mod tests {
    use anyhow::Context as _;

    #[test]
    fn a_cause_is_said_once() {
        #[derive(Debug)]
        struct Outer(std::io::Error);
        impl std::fmt::Display for Outer {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, "a.mcap is no bag: {}", self.0)
            }
        }
        impl std::error::Error for Outer {
            fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
                Some(&self.0)
            }
        }
        let cause = || std::io::Error::other("Bad magic number");
        assert_eq!(
            super::in_words(&anyhow::Error::new(Outer(cause()))),
            "a.mcap is no bag: Bad magic number"
        );
        let with_context = Err::<(), _>(cause()).context("cannot read a.mcap").unwrap_err();
        assert_eq!(super::in_words(&with_context), "cannot read a.mcap: Bad magic number");
    }

    #[test]
    fn options_are_said_as_arguments_and_commands_stay() {
        for (said, expected) in [
            ("choose one with --platform", "choose one with platform"),
            ("--turn-error-deg is 0; allowed", "turn_error_deg is 0; allowed"),
            ("e.g. --model params/whorl_1.yaml; for", "e.g. model=params/whorl_1.yaml; for"),
            (
                "a map, --channels MAP.yaml: `whorl new a --b` writes",
                "a map, channels=MAP.yaml: `whorl new a --b` writes",
            ),
            ("give --held-out RUN, or", "give held_out=RUN, or"),
            ("check --model", "check model"),
            ("a -- b and --anyway overrides this", "a -- b and anyway overrides this"),
        ] {
            assert_eq!(super::of_arguments(said), expected);
        }
    }
}
