//! The token: who knows it may command.

use std::io::Read as _;

use anyhow::Context as _;
use axum::http::HeaderMap;
use axum::http::header::{AUTHORIZATION, SEC_WEBSOCKET_PROTOCOL};
use sha2::{Digest as _, Sha256};

/// Length of a token.
const DIGITS: usize = 32;

/// 128 random bits in hexadecimal digits.
///
/// # Errors
/// When the operating system gives none.
pub fn secret() -> anyhow::Result<String> {
    let mut bytes = [0u8; DIGITS / 2];
    std::fs::File::open("/dev/urandom")
        .and_then(|mut file| file.read_exact(&mut bytes))
        .context("there is no source of randomness for the token")?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The token that whoever started this process has chosen, in this variable of the environment.
#[must_use]
pub fn chosen(variable: &str) -> Option<String> {
    std::env::var(variable).ok().filter(|token| token.len() == DIGITS)
}

/// Whether a request has the token in its header. Digests are compared, so that the time it takes tells nothing of it.
#[must_use]
pub fn authorised(headers: &HeaderMap, token: &str) -> bool {
    let given =
        headers.get(AUTHORIZATION).and_then(|v| v.to_str().ok()).and_then(|v| v.strip_prefix("Bearer "));
    given.is_some_and(|given| Sha256::digest(given) == Sha256::digest(token))
}

/// Whether the token is among the protocols that are asked for: a browser cannot send a header when it opens a WebSocket.
#[must_use]
pub fn asks_with(headers: &HeaderMap, token: &str) -> bool {
    let asked = headers.get_all(SEC_WEBSOCKET_PROTOCOL).iter().filter_map(|value| value.to_str().ok());
    let digest = Sha256::digest(token);
    asked.flat_map(|value| value.split(',')).any(|name| Sha256::digest(name.trim()) == digest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(list: &[(&'static str, &str)]) -> HeaderMap {
        list.iter().map(|(name, value)| (name.parse().unwrap(), value.parse().unwrap())).collect()
    }

    #[test]
    fn an_operator_asks_with_the_token() {
        let asked = |value: &str| asks_with(&headers(&[("sec-websocket-protocol", value)]), "0a1b");
        assert!(asked("whorl, 0a1b") && asked("0a1b"));
        assert!(!asked("whorl") && !asked("whorl, 0a1c") && !asked(""));
        assert!(!asks_with(&HeaderMap::new(), "0a1b"));
    }

    #[test]
    fn only_the_token_commands() {
        assert!(authorised(&headers(&[("authorization", "Bearer abc")]), "abc"));
        assert!(!authorised(&headers(&[("authorization", "Bearer abd")]), "abc"));
        assert!(!authorised(&headers(&[("authorization", "abc")]), "abc"));
        assert!(!authorised(&HeaderMap::new(), "abc"));
    }

    #[test]
    fn no_token_is_like_another() {
        let (first, second) = (secret().unwrap(), secret().unwrap());
        assert!(first.len() == DIGITS && first != second);
        assert!(first.bytes().all(|byte| byte.is_ascii_hexdigit()));
    }
}
