//! Questions to whoever sits at the terminal.

use nalgebra::{Matrix3, Vector3};
use whorl_dynamics::MassProperties;

use whorl_bag::CsvLook;
use whorl_math::words::shortened;

use super::lines::{Origin, Sourced};
use super::names::{Meaning, named};
use super::table::Called;

/// Somebody who may be asked.
pub trait Ask {
    /// The answer to a question; empty: what is suggested. `None`: nobody is there.
    fn ask(&mut self, question: &str, suggested: &str) -> Option<String>;

    /// Says that an answer cannot be used.
    fn object(&mut self, why: &str);
}

/// Nobody: everything that the data do not show is assumed and marked.
#[derive(Debug, Clone, Copy, Default)]
pub struct Nobody;

impl Ask for Nobody {
    fn ask(&mut self, _question: &str, _suggested: &str) -> Option<String> {
        None
    }

    fn object(&mut self, _why: &str) {}
}

/// An answer that cannot be used is asked for so often.
const TRIES: usize = 5;

/// Asks for one of some words.
pub fn choice(ask: &mut dyn Ask, question: &str, of: &[&str], suggested: Sourced<String>) -> Sourced<String> {
    asked(ask, &format!("{question} ({})", of.join(", ")), &suggested.value.clone(), suggested, |answer| {
        of.iter().find(|word| **word == answer).map(|word| (*word).to_owned()).ok_or_else(|| of.join(", "))
    })
}

/// Asks for a positive number.
pub fn positive(ask: &mut dyn Ask, question: &str, suggested: Sourced<f64>) -> Sourced<f64> {
    asked(ask, question, &super::lines::number(suggested.value), suggested, |answer| {
        let number = read_number(answer);
        number.filter(|x| *x > 0.0 && x.is_finite()).ok_or_else(|| "a number above 0".to_owned())
    })
}

/// Asks for the moments of inertia of a body.
pub fn moments(ask: &mut dyn Ask, question: &str, suggested: Sourced<[f64; 3]>) -> Sourced<[f64; 3]> {
    let shown = suggested.value.map(super::lines::number).join(" ");
    asked(ask, question, &shown, suggested, |answer| {
        let numbers: Option<Vec<f64>> = answer.split_whitespace().map(read_number).collect();
        let three = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
        let Some(three) = three.filter(|all| all.iter().all(|x| *x > 0.0 && x.is_finite())) else {
            return Err("three numbers above 0, with spaces between".to_owned());
        };
        let inertia = Matrix3::from_diagonal(&Vector3::from(three));
        match MassProperties::new(inertia, Vector3::zeros(), 1.0) {
            Ok(_) => Ok(three),
            Err(_) => Err("three numbers of which none is more than the sum of the other two".to_owned()),
        }
    })
}

/// A number with a decimal point or comma.
fn read_number(text: &str) -> Option<f64> {
    text.replacen(',', ".", 1).parse().ok()
}

/// Asks for a name of letters, digits and underscores.
pub fn name(ask: &mut dyn Ask, question: &str, suggested: String) -> String {
    let suggested = Sourced::new(suggested, Origin::Stated, "");
    asked(ask, question, &suggested.value.clone(), suggested, |answer| {
        let is_name = answer.chars().next().is_some_and(|c| c.is_ascii_alphabetic())
            && answer.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        is_name.then(|| answer.to_owned()).ok_or_else(|| "a letter, then letters, digits and _".to_owned())
    })
    .value
}

/// Columns that are asked about, in a file of many.
const MOST_COLUMNS: usize = 12;

/// Asks what columns hold that nobody knows what to do with, and that change.
pub fn columns(ask: &mut dyn Ask, look: &CsvLook, unknown: &[String], called: &mut Called) {
    let range = |name: &str| {
        let column = look.columns.iter().find(|column| column.name == name)?;
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        column.present().for_each(|x| (least, most) = (least.min(x), most.max(x)));
        (least < most).then_some((least, most))
    };
    let change = unknown.iter().filter_map(|name| Some((name, range(name)?)));
    for (name, (least, most)) in change.take(MOST_COLUMNS) {
        let from_to = format!("{} to {}", super::lines::number(least), super::lines::number(most));
        let question = format!(
            "What is column `{}` ({from_to})? A name such as gyro_x_deg_s, acc_z_g, wheel_speed_1_rpm or wheel_torque_1_mn_m, or nothing",
            shortened(name, super::LONGEST_NAME)
        );
        let suggested = Sourced::new(None, Origin::Assumed, "");
        let said = asked(ask, &question, "nothing", suggested, |answer| match named(answer).meaning {
            _ if answer == "nothing" => Ok(None),
            Some(Meaning::Channel(_)) => Ok(Some(answer.to_owned())),
            _ => Err("a name of a sensor, its axis or number, and its unit; or nothing".to_owned()),
        });
        called.extend(said.value.map(|answer| (name.clone(), answer)));
    }
}

fn asked<T>(
    ask: &mut dyn Ask,
    question: &str,
    shown: &str,
    suggested: Sourced<T>,
    read: impl Fn(&str) -> Result<T, String>,
) -> Sourced<T> {
    for _ in 0..TRIES {
        let Some(answer) = ask.ask(question, shown) else { return suggested };
        let answer = answer.trim();
        if answer.is_empty() {
            return suggested;
        }
        match read(answer) {
            Ok(value) => return Sourced::new(value, Origin::Answered, ""),
            Err(allowed) => ask.object(&format!("`{answer}` cannot be used; allowed: {allowed}")),
        }
    }
    suggested
}
