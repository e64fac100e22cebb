//! Terms that have an equation, and what each symbol costs.
//!
//! A term is a product of at most two factors, shapes of recorded quantities, about an axis, along the rate, or on the wheels. Its prior probability is
//! the product of the probabilities of its choices, each as likely as the others of its kind (a code of symbols, Rissanen 1978): a law
//! about one axis pays for the axis, a product pays for both of its quantities, and friction along the rate, which favours no axis, pays
//! for none. So simple and symmetric laws come first, whatever is tried.

use whorl_validation::{Parity, Quantity, SHAPES, Shape};

use super::{Law, Term, Way};

/// A shape of a quantity.
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
        let values: Vec<_> =
            factors.iter().map(|factor| (factor.shape.of, factor.place, factor.scale)).collect();
        let written = Self { factors, log_prior: log_prior_of_choices + of_symbols };
        let variable = written.variables().first().cloned().unwrap_or_default();
        let term = Term::new(&variable, Parity::None, way, move |at| {
            values.iter().map(|(of, place, scale)| of(at.values[*place] / scale)).product()
        });
        Term { written: Some(written), ..term }
    }

    /// The equation with its parameter as this text; `None`: as its number.
    pub fn equation(&self, parameter: Option<&str>) -> String {
        let number = self.parameter().map(|(_, value, unit, _)| format!("{value} [{unit}]"));
        let parameter = parameter.map(str::to_owned).or(number).unwrap_or_default();
        let text = |factor: &Factor| {
            factor.shape.text.replace("{x}", &factor.quantity.text).replace("{p}", &parameter)
        };
        let all: Vec<String> = self.factors.iter().map(text).collect();
        if all.is_empty() { "1".to_owned() } else { all.join(" * ") }
    }

    /// In words: "the cube of the yaw rate".
    pub fn words(&self) -> String {
        let words = |factor: &Factor| factor.shape.words.replace("{x}", &factor.quantity.words());
        let all: Vec<String> = self.factors.iter().map(words).collect();
        if all.is_empty() { "nothing: it is constant".to_owned() } else { all.join(" times ") }
    }

    /// Equations of the quantities in it.
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
    let moves = |(_, (_, largest)): &(usize, (&Quantity, &f64))| **largest > 1e-9 && largest.is_finite();
    let moving = || quantities.iter().zip(largest).enumerate().filter(moves);
    let factor = |(place, (quantity, largest)): (usize, (&Quantity, &f64)), shape| Factor {
        scale: if quantity.is_angle() { 1.0 } else { 0.5 * largest },
        quantity: quantity.clone(),
        place,
        shape,
    };
    // The constant is a quantity too; six axes, the rate and the wheels are directions. Two factors have no order.
    let (of_quantity, of_direction) = (-((moving().count() + 1) as f64).ln(), -8f64.ln() - 0.5);
    let about_axes = of_quantity + of_direction;
    let mut terms = vec![Written::term(Vec::new(), Way::BodyOrRoom, about_axes)];
    // Of what has no sign the size is the quantity itself.
    let is_other = |quantity: &Quantity, shape: &&'static Shape| {
        quantity.is_signed || !(shape.text.starts_with("abs") || shape.text.starts_with("sign"))
    };
    for of @ (place, (quantity, _)) in moving() {
        let shapes = quantity.shapes().flatten().filter(|shape| is_other(quantity, shape));
        terms.extend(shapes.map(|shape| Written::term(vec![factor(of, shape)], Way::BodyOrRoom, about_axes)));
        let others = moving().filter(|(other, (with, _))| *other > place && !with.is_angle());
        terms.extend(others.filter(|_| !quantity.is_angle()).map(|other| {
            let pair = vec![factor(of, &SHAPES[0]), factor(other, &SHAPES[0])];
            Written::term(pair, Way::BodyOrRoom, about_axes + of_quantity + 2f64.ln())
        }));
    }
    if let Some(of @ (_, (rate, _))) = moving().find(|(_, (quantity, _))| quantity.name == "rate") {
        let sizes = rate.shapes().flatten().filter(|shape| is_other(rate, shape));
        let sizes = sizes.map(|shape| vec![factor(of, shape)]).chain([Vec::new()]);
        let is_apart = |quantity: &Quantity| !quantity.name.ends_with("rate") && !quantity.is_angle();
        for size in sizes {
            let others = moving().filter(|(_, (with, _))| is_apart(with));
            for other in others.filter(|_| size.iter().all(|size| size.shape.parameter.is_none())) {
                let with = [size.clone(), vec![factor(other, &SHAPES[0])]].concat();
                terms.push(Written::term(with, Way::AlongRate, of_direction + of_quantity));
            }
            terms.push(Written::term(size, Way::AlongRate, of_direction));
        }
    }
    let mut groups: Vec<Vec<Term>> = terms.into_iter().map(|term| vec![term]).collect();
    for shape in SHAPES.iter().filter(|shape| shape.parity == Parity::Odd && shape.parameter.is_none()) {
        let on_wheel = |(j, name): (usize, &&str)| {
            let speed = moving().find(|(_, (of, _))| of.name == format!("{name}_speed"))?;
            let mut own = factor(speed, shape);
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
