//! From the text of an equation to steps, with dimensions and axes checked on the way.
//!
//! The grammar: numbers (with a unit in brackets: `0.1 [rad/s]`), quantities, parameters, states and curves by name,
//! `+ - * / ^`, parentheses, vectors `(x, y, z)`, components `.x .y .z`, and the functions of [`FUNCTIONS`]. No loops, no
//! conditions, no assignments: an equation is evaluated in a time that its length bounds. General expression crates have
//! neither units nor vectors, which is what makes a mistake visible here.

mod functions;
mod operations;

use super::program::{At, MOST_STEPS, Program, Step};
use super::quantity::{Axes, QUANTITIES, QuantityForm, Read};
use super::spline::Spline;
use super::units::Dimension;

/// Functions, how they are written, and what they give.
pub const FUNCTIONS: &[(&str, &str)] = &[
    ("norm(v)", "length of a vector"),
    ("dot(v, w)", "scalar product"),
    ("cross(v, w)", "vector product"),
    ("unit(v, width)", "v / sqrt(|v|^2 + width^2): its direction, fading out below the width"),
    ("world(v), body(v)", "a vector in the other axes"),
    ("abs(x), sqrt(x), exp(x), log(x)", "as usual"),
    ("sin(x), cos(x), tanh(x), atan2(y, x)", "of angles and numbers"),
    ("min(x, y), max(x, y), hypot(x, y)", "as usual"),
    ("sign(x, width)", "x / hypot(x, width): -1 to 1, smooth over the width"),
    ("limit(x, size)", "x within -size and size: a saturation"),
    ("beyond(x, size)", "what of x is beyond -size and size: a dead zone"),
    ("oddpower(x, p)", "|x|^p with the sign of x; x without a unit"),
    ("wrap(x)", "an angle within half a turn either side of zero"),
];

/// Deepest nesting of parentheses.
const DEEPEST: usize = 48;

/// A name that an equation may use besides the quantities.
#[derive(Debug, Clone)]
pub(super) struct Name {
    pub name: String,
    pub dimension: Dimension,
    pub what: What,
}

/// What a name stands for.
#[derive(Debug, Clone)]
pub(super) enum What {
    Parameter(u16),
    State(u16),
    /// A curve over an expression of its own.
    Curve {
        of: String,
        argument: Dimension,
        spline: Spline,
    },
}

/// Why an equation was refused.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Refusal {
    /// Character at which, from 0.
    pub at: usize,
    pub problem: String,
}

/// What a sub-expression is.
#[derive(Debug, Clone, PartialEq)]
struct Typed {
    form: Form,
    /// `None`: a zero, which has any.
    dimension: Option<Dimension>,
    /// Its text, to name it in errors.
    from: usize,
    to: usize,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Form {
    Scalar(At),
    /// `None`: axes that fit any.
    Vector([At; 3], Option<Axes>),
}

/// A compiled equation with its dimension and form.
#[derive(Debug, Clone)]
pub(super) struct Compiled {
    pub program: Program,
    pub dimension: Option<Dimension>,
    /// `None`: a scalar.
    pub vector: Option<Option<Axes>>,
}

/// Compiles one equation. `of_wheel`: it may name the wheel's own speed and drive.
pub(super) fn compile(text: &str, names: &[Name], of_wheel: bool) -> Result<Compiled, Refusal> {
    let mut parser =
        Parser { text, at: 0, names, of_wheel, depth: 0, program: Program::default(), curves: Vec::new() };
    let found = parser.sum()?;
    parser.space();
    if parser.at < text.len() {
        return Err(parser.refuse(parser.at, format!("`{}` follows the end of the equation", parser.rest())));
    }
    let mut program = parser.program;
    let vector = match found.form {
        Form::Scalar(at) => {
            program.results = vec![at];
            None
        }
        Form::Vector(at, axes) => {
            program.results = at.to_vec();
            Some(axes)
        }
    };
    Ok(Compiled { program, dimension: found.dimension, vector })
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
    names: &'a [Name],
    of_wheel: bool,
    depth: usize,
    program: Program,
    /// Curves that were met: name and where their value stands.
    curves: Vec<(String, At)>,
}

impl Parser<'_> {
    fn rest(&self) -> &str {
        self.text.get(self.at..).unwrap_or("")
    }

    fn space(&mut self) {
        let rest = self.rest();
        self.at += rest.len() - rest.trim_start().len();
    }

    fn refuse(&self, at: usize, problem: impl Into<String>) -> Refusal {
        Refusal { at, problem: problem.into() }
    }

    fn words(&self, typed: &Typed) -> &str {
        self.text.get(typed.from..typed.to).unwrap_or("").trim()
    }

    /// What follows is `symbol`; then it is passed.
    fn takes(&mut self, symbol: char) -> bool {
        self.space();
        let is = self.rest().starts_with(symbol);
        if is {
            self.at += symbol.len_utf8();
        }
        is
    }

    fn expects(&mut self, symbol: char) -> Result<(), Refusal> {
        if self.takes(symbol) {
            Ok(())
        } else {
            Err(self.refuse(self.at, format!("`{symbol}` is missing here")))
        }
    }

    /// A step; the same one once only.
    fn step(&mut self, step: Step) -> Result<At, Refusal> {
        if let Some(at) = self.program.steps.iter().position(|s| *s == step) {
            return Ok(at as At);
        }
        if self.program.steps.len() >= MOST_STEPS {
            return Err(
                self.refuse(self.at, format!("the equation is too long: more than {MOST_STEPS} steps"))
            );
        }
        self.program.steps.push(step);
        Ok((self.program.steps.len() - 1) as At)
    }

    fn sum(&mut self) -> Result<Typed, Refusal> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(self.refuse(self.at, format!("nested deeper than {DEEPEST} levels")));
        }
        let mut left = self.product()?;
        loop {
            let adds = if self.takes('+') {
                true
            } else if self.takes('-') {
                false
            } else {
                break;
            };
            let right = self.product()?;
            left = self.added(left, &right, adds)?;
        }
        self.depth -= 1;
        Ok(left)
    }

    fn product(&mut self) -> Result<Typed, Refusal> {
        let mut left = self.signed()?;
        loop {
            if self.takes('*') {
                let right = self.signed()?;
                left = self.multiplied(left, &right)?;
            } else if self.takes('/') {
                let right = self.signed()?;
                left = self.divided(left, &right)?;
            } else {
                return Ok(left);
            }
        }
    }

    fn signed(&mut self) -> Result<Typed, Refusal> {
        self.space();
        let from = self.at;
        if !self.takes('-') {
            return self.power();
        }
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(self.refuse(from, "too many signs"));
        }
        let of = self.signed()?;
        self.depth -= 1;
        let form = match of.form {
            Form::Scalar(a) => Form::Scalar(self.step(Step::Negative(a))?),
            Form::Vector([a, b, c], axes) => Form::Vector(
                [self.step(Step::Negative(a))?, self.step(Step::Negative(b))?, self.step(Step::Negative(c))?],
                axes,
            ),
        };
        Ok(Typed { form, from, ..of })
    }

    fn power(&mut self) -> Result<Typed, Refusal> {
        let base = self.component()?;
        if !self.takes('^') {
            return Ok(base);
        }
        let exponent = self.signed()?;
        let a = self.scalar(&base, "a power")?;
        let b = self.scalar(&exponent, "an exponent")?;
        self.is_plain(&exponent, "an exponent")?;
        let dimension = base.dimension.unwrap_or(Dimension::NONE);
        let number = self.constant(b);
        let whole = number.filter(|n| n.fract() == 0.0 && n.abs() <= 12.0);
        let step = match whole {
            Some(n) => Step::WholePower(a, n as i32),
            None => Step::Power(a, b),
        };
        let dimension = if dimension == Dimension::NONE {
            dimension
        } else {
            let halves = number.map(|n| 2.0 * n).filter(|h| h.fract() == 0.0 && h.abs() <= 24.0);
            halves.and_then(|h| dimension.power_of_halves(h as i16)).ok_or_else(|| {
                self.refuse(
                    base.from,
                    format!(
                        "{} has the unit {dimension} and cannot be raised to {}; divide it by a size first, as in (x / 0.1 [{dimension}])^p",
                        self.words(&base),
                        self.words(&exponent)
                    ),
                )
            })?
        };
        let form = Form::Scalar(self.step(step)?);
        Ok(Typed { form, dimension: Some(dimension), from: base.from, to: exponent.to })
    }

    /// The number that a step is, if it is one.
    fn constant(&self, at: At) -> Option<f64> {
        match self.program.steps.get(usize::from(at)) {
            Some(Step::Constant(value)) => Some(*value),
            Some(Step::Negative(a)) => self.constant(*a).map(|x| -x),
            _ => None,
        }
    }

    fn component(&mut self) -> Result<Typed, Refusal> {
        let mut of = self.atom()?;
        loop {
            let rest = self.rest();
            let Some(index) = ["x", "y", "z"].iter().position(|axis| {
                rest.strip_prefix('.')
                    .and_then(|r| r.strip_prefix(axis))
                    .is_some_and(|after| !after.starts_with(|c: char| c.is_alphanumeric() || c == '_'))
            }) else {
                return Ok(of);
            };
            let Form::Vector(at, _) = of.form else {
                return Err(
                    self.refuse(of.from, format!("{} is no vector and has no components", self.words(&of)))
                );
            };
            self.at += 2;
            of = Typed { form: Form::Scalar(at.get(index).copied().unwrap_or(0)), to: self.at, ..of };
        }
    }

    fn atom(&mut self) -> Result<Typed, Refusal> {
        self.space();
        let from = self.at;
        let rest = self.rest();
        match rest.chars().next() {
            None => Err(self.refuse(from, "the equation ends where a value is missing")),
            Some('(') => self.parenthesis(),
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_alphabetic() || c == '_' => {
                let end = rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len());
                let word = rest.get(..end).unwrap_or("").to_owned();
                self.at += end;
                if self.takes('(') { self.function(&word, from) } else { self.named(&word, from) }
            }
            Some(c) => Err(self.refuse(from, format!("`{c}` cannot stand here; a value is expected"))),
        }
    }

    fn parenthesis(&mut self) -> Result<Typed, Refusal> {
        let from = self.at;
        self.expects('(')?;
        let mut items = vec![self.sum()?];
        while self.takes(',') {
            items.push(self.sum()?);
        }
        self.expects(')')?;
        let to = self.at;
        match items.as_slice() {
            [only] => Ok(Typed { from, to, ..only.clone() }),
            [x, y, z] => {
                let mut dimension = None;
                for item in [x, y, z] {
                    dimension = self.same(dimension, item)?;
                }
                let at = [
                    self.scalar(x, "a component")?,
                    self.scalar(y, "a component")?,
                    self.scalar(z, "a component")?,
                ];
                Ok(Typed { form: Form::Vector(at, None), dimension, from, to })
            }
            _ => Err(self.refuse(from, format!("a vector has 3 components, not {}", items.len()))),
        }
    }

    fn number(&mut self) -> Result<Typed, Refusal> {
        let from = self.at;
        let rest = self.rest();
        let mut end = 0;
        for (i, c) in rest.char_indices() {
            let after_e = rest.get(..i).is_some_and(|r| r.ends_with(['e', 'E']));
            let exponent = matches!(c, 'e' | 'E')
                && rest
                    .get(i + 1..)
                    .is_some_and(|r| r.starts_with(|c: char| c.is_ascii_digit() || c == '-' || c == '+'));
            if c.is_ascii_digit() || c == '.' || exponent || (after_e && matches!(c, '-' | '+')) {
                end = i + 1;
            } else {
                break;
            }
        }
        let text = rest.get(..end).unwrap_or("").to_owned();
        let value: f64 = text.parse().map_err(|_| self.refuse(from, format!("`{text}` is no number")))?;
        self.at += end;
        let (mut dimension, mut size) = (Dimension::NONE, 1.0);
        if self.takes('[') {
            let inside = self.rest();
            let end = inside.find(']').ok_or_else(|| self.refuse(from, "the ] of a unit is missing"))?;
            let unit = inside.get(..end).unwrap_or("").to_owned();
            (dimension, size) = Dimension::parse(&unit).map_err(|problem| self.refuse(self.at, problem))?;
            self.at += end + 1;
        }
        let value = value * size;
        if !value.is_finite() {
            return Err(self.refuse(from, format!("`{text}` is too large")));
        }
        let form = Form::Scalar(self.step(Step::Constant(value))?);
        Ok(Typed { form, dimension: (value != 0.0).then_some(dimension), from, to: self.at })
    }

    fn named(&mut self, word: &str, from: usize) -> Result<Typed, Refusal> {
        let to = from + word.len();
        if word == "pi" {
            let form = Form::Scalar(self.step(Step::Constant(std::f64::consts::PI))?);
            return Ok(Typed { form, dimension: Some(Dimension::NONE), from, to });
        }
        if let Some(name) = self.names.iter().find(|n| n.name == word) {
            let dimension = Some(name.dimension);
            let at = match &name.what {
                What::Parameter(i) => self.step(Step::Parameter(*i))?,
                What::State(i) => self.step(Step::State(*i))?,
                What::Curve { of, argument, spline } => self.curve(word, of, *argument, spline)?,
            };
            return Ok(Typed { form: Form::Scalar(at), dimension, from, to });
        }
        let Some(quantity) = QUANTITIES.iter().find(|q| q.name == word) else {
            let own = self.names.iter().map(|n| n.name.as_str());
            let near = whorl_math::words::ranked(word, own.chain(QUANTITIES.iter().map(|q| q.name)), 3);
            return Err(self.refuse(
                from,
                format!(
                    "there is no parameter or quantity `{word}`; nearest: {} (`whorl effects --quantities` lists them)",
                    near.join(", ")
                ),
            ));
        };
        if matches!(quantity.reads(0), Read::OwnSpeed | Read::OwnMotorTorque) && !self.of_wheel {
            return Err(self.refuse(
                from,
                format!("`{word}` is for effects that act on wheels; elsewhere name the wheel: wheel_speed[1], motor_torque[1]"),
            ));
        }
        let dimension = Some(quantity.dimension());
        let form = match quantity.form {
            QuantityForm::Scalar => Form::Scalar(self.step(Step::Read(quantity.reads(0)))?),
            QuantityForm::Vector => Form::Vector(
                [
                    self.step(Step::Read(quantity.reads(0)))?,
                    self.step(Step::Read(quantity.reads(1)))?,
                    self.step(Step::Read(quantity.reads(2)))?,
                ],
                Some(Axes::Body),
            ),
            QuantityForm::Indexed => {
                let wrong = |parser: &Self| {
                    parser.refuse(from, format!("`{word}` needs a number from 1 to 64 behind it: {word}[1]"))
                };
                if !self.takes('[') {
                    return Err(wrong(self));
                }
                let inside = self.rest();
                let end = inside.find(']').ok_or_else(|| wrong(self))?;
                let index: u8 = inside
                    .get(..end)
                    .and_then(|n| n.trim().parse().ok())
                    .filter(|n| (1..=64).contains(n))
                    .ok_or_else(|| wrong(self))?;
                self.at += end + 1;
                Form::Scalar(self.step(Step::Read(quantity.reads(index - 1)))?)
            }
        };
        Ok(Typed { form, dimension, from, to: self.at.max(to) })
    }

    /// The value of a curve at its own expression.
    fn curve(&mut self, word: &str, of: &str, argument: Dimension, spline: &Spline) -> Result<At, Refusal> {
        if let Some((_, at)) = self.curves.iter().find(|(name, _)| name == word) {
            return Ok(*at);
        }
        // What a curve is over may name parameters and quantities, not curves.
        let names: Vec<Name> =
            self.names.iter().filter(|n| !matches!(n.what, What::Curve { .. })).cloned().collect();
        let mut inner = Parser {
            text: of,
            at: 0,
            names: &names,
            of_wheel: self.of_wheel,
            depth: 0,
            program: std::mem::take(&mut self.program),
            curves: Vec::new(),
        };
        let found = inner.sum();
        let left_over = inner.rest().trim().to_owned();
        self.program = inner.program;
        let blame =
            |problem: String| Refusal { at: 0, problem: format!("curve {word} of `{of}`: {problem}") };
        let found = found.map_err(|e| blame(e.problem))?;
        if !left_over.is_empty() {
            return Err(blame(format!("`{left_over}` follows its end")));
        }
        let Form::Scalar(at) = found.form else { return Err(blame("it is a vector".to_owned())) };
        if found.dimension.is_some_and(|d| d != argument) {
            let unit = found.dimension.unwrap_or_default();
            return Err(blame(format!("it has the unit {unit}, its knots {argument}")));
        }
        let index = self.program.curves.len() as u16;
        self.program.curves.push(spline.clone());
        let value = self.step(Step::Curve(at, index))?;
        self.curves.push((word.to_owned(), value));
        Ok(value)
    }
}
