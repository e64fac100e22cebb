//! Names of hive partitions.

use std::path::PathBuf;

/// The folder of a partition beneath a table's: `experiment=hold/delay_s=0.1`. What cannot stand in a folder's name is
/// percent-encoded, as Hive, Spark, DuckDB and Polars do.
#[must_use]
pub fn partition<S: AsRef<str>>(keys: &[(S, S)]) -> PathBuf {
    keys.iter().map(|(key, value)| format!("{}={}", encoded(key.as_ref()), encoded(value.as_ref()))).collect()
}

fn encoded(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        if character.is_alphanumeric() || "_-. +".contains(character) {
            out.push(character);
        } else {
            let mut bytes = [0; 4];
            character.encode_utf8(&mut bytes).bytes().for_each(|byte| out.push_str(&format!("%{byte:02X}")));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_stand_in_a_path_is_encoded() {
        let path = partition(&[("run", "a/b=c:d"), ("delay_s", "0.1")]);
        assert_eq!(path, PathBuf::from("run=a%2Fb%3Dc%3Ad/delay_s=0.1"));
        assert_eq!(partition(&[("x", "Größe")]), PathBuf::from("x=Größe"));
        assert_eq!(partition(&[("x", "100 %")]), PathBuf::from("x=100 %25"));
    }
}
