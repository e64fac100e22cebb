//! Terms of laws that are sought: which are tried, and what each symbol costs.
//!
//! A term is a factor of recorded quantities times a direction. Its prior probability is the product of the probabilities
//! of its choices, each as likely as the others of its kind (a code of symbols, Rissanen 1978): a law about one axis pays
//! for the axis, a product pays for both of its variables, and friction along the rate, which favours no axis, pays for
//! none. So simple and symmetric laws come first, whatever is tried.

use crate::grammar::variable::Variable;

/// Direction of a torque.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Direction {
    /// Along the rate of the body.
    AlongRate,
    /// A body axis.
    Body(usize),
    /// A world axis; 2 is the vertical.
    World(usize),
    /// About the axis of each wheel, on the wheel.
    Wheels,
}

/// A number inside a term that is fitted with it: a width, a limit, a lag.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Shape {
    pub name: &'static str,
    pub unit: String,
    pub value: f64,
    pub meaning: &'static str,
}

/// A term: a factor times a direction.
#[derive(Debug, Clone)]
pub(crate) struct Term {
    /// The factor, a number; `{0}` stands for its shape, where it has one.
    pub factor: String,
    pub shape: Option<Shape>,
    pub direction: Direction,
    /// The factor follows its own value with this lag: the shape is its time.
    pub is_lag: bool,
    /// Log of its prior probability, < 0.
    pub log_prior: f64,
    /// Texts of the variables in it.
    pub variables: Vec<String>,
    /// In words: "the cube of the yaw rate".
    pub words: String,
}

/// Rate below which directions along the rate fade out [rad/s], as a share of the largest.
const FADE: f64 = 0.01;

/// Factors of one variable: text, shape, words, and how many symbols beyond the variable.
fn factors(v: &Variable) -> Vec<(String, Option<Shape>, String, f64)> {
    let x = &v.text;
    let size = |share: f64| two_digits(share * v.largest);
    let shape = |name: &'static str, share: f64, meaning: &'static str| {
        Some(Shape { name, unit: v.unit.to_owned(), value: size(share), meaning })
    };
    let w = &v.words;
    let mut list = vec![
        (x.clone(), None, w.clone(), 1.0),
        (format!("{x}^2"), None, format!("the square of {w}"), 2.0),
        (format!("{x}^3"), None, format!("the cube of {w}"), 2.0),
    ];
    if v.is_signed {
        list.push((format!("abs({x}) * {x}"), None, format!("the signed square of {w}"), 2.0));
        list.push((format!("abs({x})"), None, format!("the size of {w}"), 2.0));
        list.push((
            format!("sign({x}, {{0}})"),
            shape("width", 0.03, "Width of the step."),
            format!("the sign of {w}"),
            2.0,
        ));
    } else {
        list.push((format!("sqrt({x})"), None, format!("the root of {w}"), 2.0));
    }
    for share in [0.25, 0.5] {
        list.push((
            format!("limit({x}, {{0}})"),
            shape("limit", share, "Where it saturates."),
            format!("{w}, saturating"),
            3.0,
        ));
        list.push((
            format!("beyond({x}, {{0}})"),
            shape("edge", share, "Half-width of the dead zone."),
            format!("{w} beyond a dead zone"),
            3.0,
        ));
    }
    if v.text == "time" {
        for share in [0.1, 0.3] {
            let tau =
                Some(Shape { name: "tau", unit: "s".into(), value: size(share), meaning: "Time constant." });
            list.push(("exp(-time / {0})".into(), tau, "time, fading out".into(), 3.0));
        }
    }
    list
}

/// Rounded to two digits: a place to start from, not a result.
pub(crate) fn two_digits(x: f64) -> f64 {
    if x == 0.0 || !x.is_finite() {
        return x;
    }
    // By way of text: the nearest double of two digits.
    format!("{x:.1e}").parse().unwrap_or(x)
}

/// Log priors of choices: logarithms of one over the number of alternatives.
struct LogPriors {
    variable: f64,
    shape: f64,
    direction: f64,
}

impl LogPriors {
    fn new(variables: usize) -> Self {
        // Heading and the constant are variables too; six axes, the rate and the wheels are directions.
        Self { variable: -((variables + 2) as f64).ln(), shape: -4f64.ln(), direction: -8f64.ln() }
    }

    /// Shapes: one symbol is free, each further one is one of four.
    fn of_symbols(&self, symbols: f64) -> f64 {
        self.shape * (symbols - 1.0).max(0.0) - 0.5
    }
}

const AXES: [Direction; 6] = [
    Direction::Body(0),
    Direction::Body(1),
    Direction::Body(2),
    Direction::World(0),
    Direction::World(1),
    Direction::World(2),
];

/// All terms of one variable about every axis, along the rate, and on the wheels.
pub(crate) fn single_terms(variables: &[Variable]) -> Vec<Term> {
    let log_priors = LogPriors::new(variables.len());
    let mut terms = Vec::new();
    for v in variables {
        for (factor, shape, words, symbols) in factors(v) {
            for direction in AXES {
                terms.push(Term {
                    factor: factor.clone(),
                    shape: shape.clone(),
                    direction,
                    is_lag: false,
                    log_prior: log_priors.variable + log_priors.direction + log_priors.of_symbols(symbols),
                    variables: vec![v.text.clone()],
                    words: words.clone(),
                });
            }
        }
    }
    let term = |factor: String, words: String, direction: Direction, log_prior: f64, variable: &str| Term {
        factor,
        shape: None,
        direction,
        is_lag: false,
        log_prior,
        variables: vec![variable.to_owned()],
        words,
    };
    for n in 1..=3 {
        for function in ["sin", "cos"] {
            let (factor, words) = match n {
                1 => (format!("{function}(heading)"), "the heading".to_owned()),
                n => (format!("{function}({n} * heading)"), format!("{n} times the heading")),
            };
            for direction in AXES {
                let log_prior =
                    log_priors.variable + log_priors.direction + log_priors.of_symbols(1.0 + f64::from(n));
                let words = format!("the {} of {words}", if function == "sin" { "sine" } else { "cosine" });
                terms.push(term(factor.clone(), words, direction, log_prior, "heading"));
            }
        }
    }
    for direction in AXES {
        terms.push(term(
            "1".into(),
            "nothing: it is constant".into(),
            direction,
            log_priors.variable + log_priors.direction,
            "constant",
        ));
    }
    // Along the rate: powers of its size, alone or with another quantity.
    let size = variables.iter().find(|v| v.text == "norm(rate)");
    let largest = size.map_or(0.0, |v| v.largest);
    let others: Vec<&Variable> =
        variables.iter().filter(|v| v.rate_axis.is_none() && v.text != "norm(rate)").collect();
    let powers: [(&str, &str, f64); 8] = [
        ("1", "nothing but its direction (dry friction)", 1.0),
        ("norm(rate)", "the rate", 1.0),
        ("norm(rate)^2", "the square of the rate", 1.0),
        ("norm(rate)^3", "the cube of the rate", 1.5),
        ("norm(rate)^4", "the fourth power of the rate", 2.0),
        ("norm(rate)^0.5", "the root of the rate", 2.0),
        ("norm(rate)^1.5", "the power 1.5 of the rate", 2.0),
        ("norm(rate)^2.5", "the power 2.5 of the rate", 2.5),
    ];
    for (factor, words, symbols) in powers {
        let log_prior = log_priors.direction + log_priors.of_symbols(symbols);
        terms.push(term(factor.into(), words.into(), Direction::AlongRate, log_prior, "norm(rate)"));
        for v in &others {
            let bends: &[(String, String)] = &[
                (v.text.clone(), v.words.clone()),
                (format!("{}^2", v.text), format!("the square of {}", v.words)),
            ];
            for (text, of) in bends {
                let mut product = term(
                    format!("{factor} * {text}"),
                    format!("{words} times {of}"),
                    Direction::AlongRate,
                    log_prior + log_priors.variable + log_priors.shape,
                    "norm(rate)",
                );
                product.variables.push(v.text.clone());
                terms.push(product);
            }
        }
    }
    for share in [0.1, 0.25, 0.5] {
        let shape = |name: &'static str, meaning: &'static str| {
            Some(Shape { name, unit: "rad/s".into(), value: two_digits(share * largest), meaning })
        };
        let log_prior = log_priors.direction + log_priors.of_symbols(3.0);
        for (function, name, meaning, words) in [
            ("limit", "limit", "Rate at which it saturates.", "the rate, saturating"),
            ("beyond", "edge", "Rate below which it is absent.", "the rate beyond a threshold"),
        ] {
            let factor = format!("{function}(norm(rate), {{0}})");
            let bare = term(factor, words.into(), Direction::AlongRate, log_prior, "norm(rate)");
            terms.push(Term { shape: shape(name, meaning), ..bare });
        }
    }
    terms.extend(wheel_terms(&log_priors));
    terms
}

/// Drag of each wheel, with a coefficient of its own.
fn wheel_terms(log_priors: &LogPriors) -> Vec<Term> {
    let powers = [
        ("speed", "the wheel's speed", 1.0),
        ("abs(speed) * speed", "the signed square of the wheel's speed", 2.0),
        ("speed^3", "the cube of the wheel's speed", 2.0),
        ("sign(speed, 1.0 [rad/s])", "the sense of the wheel's turning", 2.0),
    ];
    powers
        .into_iter()
        .map(|(factor, words, symbols)| Term {
            factor: factor.to_owned(),
            shape: None,
            direction: Direction::Wheels,
            is_lag: false,
            log_prior: log_priors.direction + log_priors.of_symbols(symbols),
            variables: vec!["speed".to_owned()],
            words: words.to_owned(),
        })
        .collect()
}

/// Products of variables, and their lags, about the axes about which they were seen to act.
pub(crate) fn compound_terms(variables: &[Variable], hints: &[(String, Direction)], run_s: f64) -> Vec<Term> {
    let log_priors = LogPriors::new(variables.len());
    let find = |text: &str| variables.iter().find(|v| v.text == text);
    let mut terms: Vec<Term> = Vec::new();
    let mut directions: Vec<Direction> = hints.iter().map(|(_, d)| *d).collect();
    directions.sort_by_key(|d| format!("{d:?}"));
    directions.dedup();
    directions.retain(|d| AXES.contains(d));
    for (i, a) in variables.iter().enumerate() {
        for b in variables.iter().skip(i + 1) {
            for direction in &directions {
                terms.push(Term {
                    factor: format!("{} * {}", a.text, b.text),
                    shape: None,
                    direction: *direction,
                    is_lag: false,
                    log_prior: 2.0 * log_priors.variable + 2f64.ln() + log_priors.direction - 0.5,
                    variables: vec![a.text.clone(), b.text.clone()],
                    words: format!("{} times {}", a.words, b.words),
                });
            }
        }
    }
    for (variable, direction) in hints.iter().filter(|(_, d)| AXES.contains(d)) {
        let Some(v) = find(variable) else { continue };
        for tau in [0.5, 1.5, 5.0, 15.0].into_iter().filter(|tau| *tau < 0.5 * run_s) {
            let shape =
                Shape { name: "tau", unit: "s".into(), value: tau, meaning: "Time by which it lags." };
            terms.push(Term {
                factor: v.text.clone(),
                shape: Some(shape),
                direction: *direction,
                is_lag: true,
                log_prior: log_priors.variable + log_priors.direction + log_priors.of_symbols(3.0),
                variables: vec![v.text.clone()],
                words: format!("{}, lagging", v.words),
            });
        }
    }
    terms
}

impl Term {
    /// The factor with its shape as this text.
    pub fn factor_with(&self, shape: &str) -> String {
        self.factor.replace("{0}", shape)
    }

    /// The factor with the number of its shape.
    pub fn factor_in_numbers(&self) -> String {
        match &self.shape {
            Some(shape) if !self.is_lag => self.factor_with(&format!("{} [{}]", shape.value, shape.unit)),
            _ => self.factor.clone(),
        }
    }

    /// The direction as a unit vector in text; `None` on wheels.
    pub fn direction_text(&self, largest_rate_rad_s: f64) -> Option<String> {
        let axis = |i: usize| ["(1, 0, 0)", "(0, 1, 0)", "(0, 0, 1)"].get(i).copied().unwrap_or("(0, 0, 1)");
        match self.direction {
            Direction::AlongRate => {
                Some(format!("unit(rate, {} [rad/s])", two_digits(FADE * largest_rate_rad_s).max(1e-9)))
            }
            Direction::Body(i) => Some(axis(i).to_owned()),
            Direction::World(2) => Some("vertical".to_owned()),
            Direction::World(i) => Some(format!("body({})", axis(i))),
            Direction::Wheels => None,
        }
    }

    /// The direction in words.
    pub fn direction_words(&self) -> String {
        let axis = |i: usize| ["x", "y", "z"].get(i).copied().unwrap_or("z");
        match self.direction {
            Direction::AlongRate => "along the rate".into(),
            Direction::Body(i) => format!("about body {}", axis(i)),
            Direction::World(2) => "about the vertical".into(),
            Direction::World(i) => format!("about world {}", axis(i)),
            Direction::Wheels => "on each wheel".into(),
        }
    }

    /// Whether it can only brake, with a negative coefficient: an odd function of a rate along that rate.
    pub fn can_be_passive(&self, variables: &[Variable]) -> bool {
        match self.direction {
            Direction::AlongRate => {
                let is_plain = self.variables.iter().all(|v| v == "norm(rate)" || v == "tilt" || v == "time");
                is_plain || self.factor.ends_with("^2")
            }
            Direction::Body(axis) if !self.is_lag => {
                let own = variables.iter().find(|v| v.rate_axis == Some(axis)).map(|v| v.text.as_str());
                let x = own.unwrap_or("");
                self.variables.len() == 1
                    && self.variables.first().map(String::as_str) == own
                    && (self.factor == x
                        || self.factor == format!("{x}^3")
                        || self.factor.starts_with("abs(") && self.factor.contains(") * ")
                        || ["sign(", "limit(", "beyond("].iter().any(|f| self.factor.starts_with(f)))
            }
            Direction::Wheels => true,
            _ => false,
        }
    }
}
