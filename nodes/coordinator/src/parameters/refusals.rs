//! Error texts of the pure crates with platform numbers replaced by names.

/// `text` with names for numbers: "platform 1", "spacecraft 1", "platforms [0, 1]".
pub(super) fn with_names(text: &str, platforms: &[String]) -> String {
    let mut words = Vec::new();
    let mut rest = text.split(' ').peekable();
    while let Some(word) = rest.next() {
        let named = |number: &str| {
            let (digits, after) =
                number.split_at(number.find(|c: char| !c.is_ascii_digit()).unwrap_or(number.len()));
            let name = platforms.get(digits.parse::<usize>().ok()?)?;
            Some(format!("{name}{after}"))
        };
        let one = matches!(word, "platform" | "spacecraft");
        if one && let Some(name) = rest.peek().and_then(|number| named(number)) {
            rest.next();
            words.push(name);
        } else if word == "platforms" && rest.peek().is_some_and(|next| next.starts_with('[')) {
            for number in rest.by_ref() {
                let digits = number.trim_matches(|c| "[],".contains(c));
                let comma = if number.contains(']') { "" } else { "," };
                words.push(named(digits).map_or_else(|| number.to_owned(), |name| name + comma));
                if number.contains(']') {
                    break;
                }
            }
        } else {
            words.push(word.to_owned());
        }
    }
    words.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_become_names_and_other_numbers_stay() {
        let platforms = ["whorl_1", "whorl_2"].map(str::to_owned);
        for (text, named) in [
            (
                "platforms [0, 1] follow each other in a circle",
                "whorl_1, whorl_2 follow each other in a circle",
            ),
            ("from platforms [1] to one", "from whorl_2 to one"),
            ("platform 1: a weight is 0", "whorl_2: a weight is 0"),
            ("horizon of spacecraft 0", "horizon of whorl_1"),
            ("there are only 2 platforms", "there are only 2 platforms"),
            ("platform 7 follows platform 0,", "platform 7 follows whorl_1,"),
        ] {
            assert_eq!(with_names(text, &platforms), named);
        }
    }
}
