//! Terms that have an equation, and what each symbol costs.
//! A term is a product of at most two shapes of recorded quantities. Its prior probability is the product of those of its choices, each as
//! likely as the others of its kind (a code of symbols, Rissanen 1978): a law about one axis pays for the axis, a product for both of its
//! quantities, and friction along the rate, which favours no axis, for none. So simple and symmetric laws come first.

use whorl_validation::{Parity, Quantity, SHAPES, Shape};

use super::{Law, Term, Way};

#[derive(Debug, Clone)]
struct Factor {
    quantity: Quantity,
    /// Its place in the table, and its unit in the shape.
    place: usize,
    scale: f64,
    shape: &'static Shape,
}

/// A term as an equation: the product of its factors.
#[derive(Debug, Clone)]
pub(crate) struct Written {
    factors: Vec<Factor>,
    /// Log of its prior probability, < 0.
    pub log_prior: f64,
}

impl Written {
    fn term(factors: Vec<Factor>, way: Way, log_prior_of_choices: f64) -> Term {
        let of_symbols: f64 = factors.iter().map(|factor| factor.shape.symbols * 0.25_f64.ln()).sum();
        let variable = factors.first().map_or("", |factor| factor.quantity.text.as_str()).to_owned();
        let written = Some(Self { factors: factors.clone(), log_prior: log_prior_of_choices + of_symbols });
        let term = Term::new(&variable, Parity::None, way, move |at| {
            factors.iter().map(|of| (of.shape.of)(at.values[of.place] / of.scale)).product()
        });
        Term { written, ..term }
    }

    /// The equation with this text for its parameter; empty of a constant.
    pub fn equation(&self, parameter: &str) -> String {
        let text = |of: &Factor| of.shape.text.replace("{x}", &of.quantity.text).replace("{p}", parameter);
        self.factors.iter().map(text).collect::<Vec<_>>().join(" * ")
    }

    /// In words: "the cube of the yaw rate"; empty of a constant.
    pub fn words(&self) -> String {
        let words = |of: &Factor| of.shape.words.replace("{x}", &of.quantity.words());
        self.factors.iter().map(words).collect::<Vec<_>>().join(" times ")
    }

    pub fn variables(&self) -> Vec<String> {
        self.factors.iter().map(|factor| factor.quantity.text.clone()).collect()
    }

    /// A number in it that is fitted with it, a width or a limit: name, value, unit, meaning.
    pub fn parameter(&self) -> Option<(&'static str, f64, &'static str, &'static str)> {
        let factor = self.factors.first()?;
        let (name, share, meaning) = factor.shape.parameter?;
        Some((name, two_digits(share * factor.scale), factor.quantity.unit, meaning))
    }

    /// Value of the equation where that of the term is 1.
    pub fn unit(&self) -> f64 {
        self.factors.iter().map(|factor| factor.scale.powi(factor.shape.power)).product()
    }

    /// Whether it can only brake, with a negative coefficient: an odd function of a rate along that rate.
    pub fn can_only_brake(&self, way: Way, law: &Law) -> bool {
        match (way, self.factors.as_slice()) {
            (Way::AlongRate, all) => all.iter().all(|factor| !factor.quantity.is_signed),
            (Way::Wheel(_), _) => true,
            (_, [one]) => {
                let is_odd = one.shape.parity == Parity::Odd;
                is_odd && !law.world && law.axis.is_some() && one.quantity.rate_axis() == law.axis
            }
            _ => false,
        }
    }
}

/// All terms of quantities with these largest sizes, in groups that share a coefficient or have one for each wheel; what does not move has none.
pub(crate) fn written(quantities: &[Quantity], largest: &[f64], wheels: &[&str]) -> Vec<Vec<Term>> {
    let all = quantities.iter().zip(largest).enumerate().map(|(place, (of, largest))| (place, of, *largest));
    let moving: Vec<_> = all.filter(|(.., largest)| *largest > 1e-9 && largest.is_finite()).collect();
    let factor = |(place, quantity, largest): &(usize, &Quantity, f64), shape| Factor {
        scale: if quantity.is_angle() { 1.0 } else { 0.5 * largest },
        quantity: (*quantity).clone(),
        place: *place,
        shape,
    };
    let itself = |of| factor(of, &SHAPES[0]);
    // Of what has no sign the size is the quantity itself.
    let shapes = |of: &Quantity| {
        let is_signed = of.is_signed;
        let is_size = |shape: &Shape| shape.text.starts_with("abs") || shape.text.starts_with("sign");
        of.shapes().flatten().filter(move |shape| is_signed || !is_size(shape))
    };
    // The constant is a quantity too; six axes, the rate and the wheels are directions. Two factors have no order.
    let (of_quantity, of_direction) = (-((moving.len() + 1) as f64).ln(), -8f64.ln() - 0.5);
    let about_axes = of_quantity + of_direction;
    let about = |factors, more: f64| Written::term(factors, Way::BodyOrRoom, about_axes + more);
    let mut terms = vec![about(Vec::new(), 0.0)];
    for (k, of) in moving.iter().enumerate() {
        terms.extend(shapes(of.1).map(|shape| about(vec![factor(of, shape)], 0.0)));
        let others = moving[k + 1..].iter().filter(|other| !of.1.is_angle() && !other.1.is_angle());
        terms.extend(others.map(|other| about(vec![itself(of), itself(other)], of_quantity + 2f64.ln())));
    }
    if let Some(rate) = moving.iter().find(|of| of.1.name == "rate") {
        let along = |factors, more: f64| Written::term(factors, Way::AlongRate, of_direction + more);
        for size in shapes(rate.1).map(|shape| vec![factor(rate, shape)]).chain([Vec::new()]) {
            let is_plain = size.iter().all(|size| size.shape.parameter.is_none());
            let is_apart = |of: &Quantity| is_plain && !of.name.ends_with("rate") && !of.is_angle();
            let others = moving.iter().filter(|of| is_apart(of.1));
            terms.extend(others.map(|of| along([size.clone(), vec![itself(of)]].concat(), of_quantity)));
            terms.push(along(size, 0.0));
        }
    }
    let mut groups: Vec<Vec<Term>> = terms.into_iter().map(|term| vec![term]).collect();
    for shape in SHAPES.iter().filter(|shape| shape.parity == Parity::Odd && shape.parameter.is_none()) {
        let on_wheel = |(j, name): (usize, &&str)| {
            let mut own = factor(moving.iter().find(|of| of.1.name == format!("{name}_speed"))?, shape);
            // In an equation of wheel torques.
            own.quantity.text = "speed".to_owned();
            own.quantity.name = "wheel's speed".to_owned();
            Some(Written::term(vec![own], Way::Wheel(j), of_direction))
        };
        groups.push(wheels.iter().enumerate().filter_map(on_wheel).collect());
    }
    groups.retain(|group| !group.is_empty());
    groups
}

/// Rounded to two digits: a place to start from, not a result.
pub(crate) fn two_digits(x: f64) -> f64 {
    // By way of text: the nearest double of two digits.
    format!("{x:.1e}").parse().unwrap_or(x)
}
