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
}
