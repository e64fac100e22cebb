//! Numbers as people read them.

/// A number with three significant digits, in plain notation where that is short; a dash for what is not finite.
#[must_use]
pub fn three_digits(value: f64) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let size = value.abs();
    if size == 0.0 || (1e-3..1e5).contains(&size) {
        let digits = if size == 0.0 { 0 } else { (2 - size.log10().floor() as i32).clamp(0, 6) };
        format!("{value:.*}", usize::try_from(digits).unwrap_or(0))
    } else {
        format!("{value:.2e}")
    }
}

#[cfg(test)]
mod tests {
    use super::three_digits;

    #[test]
    fn numbers_keep_three_digits() {
        let cases =
            [(0.0, "0"), (1234.4, "1234"), (-12.345, "-12.3"), (0.012_345, "0.0123"), (1.5e-7, "1.50e-7")];
        for (value, expected) in cases {
            assert_eq!(three_digits(value), expected);
        }
        assert_eq!(three_digits(f64::NAN), "–");
    }
}
