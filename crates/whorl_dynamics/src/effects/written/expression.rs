//! From the text of an equation to steps, with dimensions and axes checked on the way.
//!
//! The grammar: numbers (with a unit in brackets: `0.1 [rad/s]`), quantities, parameters, states and curves by name,
//! `+ - * / ^`, parentheses, vectors `(x, y, z)`, components `.x .y .z`, and the functions of [`FUNCTIONS`]. No loops, no
//! conditions, no assignments: an equation is evaluated in a time that its length bounds. General expression crates have
//! neither units nor vectors, which is what makes a mistake visible here.

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
            let near = crate::effects::error::nearest(word, own.chain(QUANTITIES.iter().map(|q| q.name)), 3);
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

    fn scalar(&self, of: &Typed, role: &str) -> Result<At, Refusal> {
        match of.form {
            Form::Scalar(at) => Ok(at),
            Form::Vector(..) => {
                let words = self.words(of);
                Err(self.refuse(
                    of.from,
                    format!(
                        "{words} is a vector; {role} is a number (a component {words}.z, or norm({words})?)"
                    ),
                ))
            }
        }
    }

    fn vector(&self, of: &Typed, function: &str) -> Result<([At; 3], Option<Axes>), Refusal> {
        match of.form {
            Form::Vector(at, axes) => Ok((at, axes)),
            Form::Scalar(_) => {
                Err(self.refuse(of.from, format!("{} is a number; {function} is of vectors", self.words(of))))
            }
        }
    }

    fn is_plain(&self, of: &Typed, role: &str) -> Result<(), Refusal> {
        match of.dimension {
            None | Some(Dimension::NONE) => Ok(()),
            Some(dimension) => Err(self.refuse(
                of.from,
                format!("{} has the unit {dimension}; {role} has none. Divide it by a size, as in x / 0.1 [{dimension}]", self.words(of)),
            )),
        }
    }

    /// The common dimension of what came before and of this.
    fn same(&self, before: Option<Dimension>, of: &Typed) -> Result<Option<Dimension>, Refusal> {
        match (before, of.dimension) {
            (Some(a), Some(b)) if a != b => Err(self.refuse(
                of.from,
                format!(
                    "{} has the unit {b}, what stands before it {a}: they cannot be added or compared",
                    self.words(of)
                ),
            )),
            (a, b) => Ok(a.or(b)),
        }
    }

    fn joint(&self, a: Option<Axes>, b: Option<Axes>, at: usize) -> Result<Option<Axes>, Refusal> {
        match (a, b) {
            (Some(a), Some(b)) if a != b => Err(self.refuse(
                at,
                "a vector in body axes meets one in world axes; turn one of them with world(v) or body(v)",
            )),
            (a, b) => Ok(a.or(b)),
        }
    }

    fn added(&mut self, left: Typed, right: &Typed, adds: bool) -> Result<Typed, Refusal> {
        let dimension = self.same(left.dimension, right)?;
        let step = |a, b| if adds { Step::Sum(a, b) } else { Step::Difference(a, b) };
        let form = match (left.form, right.form) {
            (Form::Scalar(a), Form::Scalar(b)) => Form::Scalar(self.step(step(a, b))?),
            (Form::Vector(a, of_a), Form::Vector(b, of_b)) => {
                let axes = self.joint(of_a, of_b, right.from)?;
                Form::Vector(self.each(a, b, step)?, axes)
            }
            _ => {
                return Err(self.refuse(
                    right.from,
                    format!(
                        "a vector and a number cannot be added: {} and {}",
                        self.words(&left),
                        self.words(right)
                    ),
                ));
            }
        };
        Ok(Typed { form, dimension, from: left.from, to: right.to })
    }

    fn each(&mut self, a: [At; 3], b: [At; 3], step: impl Fn(At, At) -> Step) -> Result<[At; 3], Refusal> {
        let mut at = [0; 3];
        for (slot, (a, b)) in at.iter_mut().zip(a.into_iter().zip(b)) {
            *slot = self.step(step(a, b))?;
        }
        Ok(at)
    }

    fn multiplied(&mut self, left: Typed, right: &Typed) -> Result<Typed, Refusal> {
        let dimension = left.dimension.zip(right.dimension).map(|(a, b)| a * b);
        let form = match (left.form, right.form) {
            (Form::Scalar(a), Form::Scalar(b)) => Form::Scalar(self.step(Step::Product(a, b))?),
            (Form::Scalar(a), Form::Vector(b, axes)) | (Form::Vector(b, axes), Form::Scalar(a)) => {
                Form::Vector(self.each([a; 3], b, Step::Product)?, axes)
            }
            (Form::Vector(..), Form::Vector(..)) => {
                return Err(
                    self.refuse(right.from, "two vectors side by side: write dot(v, w) or cross(v, w)")
                );
            }
        };
        Ok(Typed { form, dimension, from: left.from, to: right.to })
    }

    fn divided(&mut self, left: Typed, right: &Typed) -> Result<Typed, Refusal> {
        let below = self.scalar(right, "a divisor")?;
        let dimension = left.dimension.zip(right.dimension).map(|(a, b)| a / b);
        if right.dimension.is_none() {
            return Err(self.refuse(right.from, "division by zero"));
        }
        let form = match left.form {
            Form::Scalar(a) => Form::Scalar(self.step(Step::Quotient(a, below))?),
            Form::Vector(a, axes) => Form::Vector(self.each(a, [below; 3], Step::Quotient)?, axes),
        };
        Ok(Typed { form, dimension, from: left.from, to: right.to })
    }

    fn dot(&mut self, a: [At; 3], b: [At; 3]) -> Result<At, Refusal> {
        let [x, y, z] = self.each(a, b, Step::Product)?;
        let xy = self.step(Step::Sum(x, y))?;
        self.step(Step::Sum(xy, z))
    }

    fn function(&mut self, word: &str, from: usize) -> Result<Typed, Refusal> {
        let mut items = vec![self.sum()?];
        while self.takes(',') {
            items.push(self.sum()?);
        }
        self.expects(')')?;
        let to = self.at;
        let known =
            FUNCTIONS.iter().flat_map(|(form, _)| form.split("), ")).filter_map(|f| f.split('(').next());
        if !known.clone().any(|f| f == word) {
            let near = crate::effects::error::nearest(word, known, 3);
            return Err(
                self.refuse(from, format!("there is no function `{word}`; nearest: {}", near.join(", ")))
            );
        }
        let wrong = |parser: &Self, items: &[Typed]| {
            let form =
                FUNCTIONS.iter().map(|(form, _)| *form).find(|form| form.contains(&format!("{word}(")));
            parser
                .refuse(from, format!("{word} of {} values; allowed: {}", items.len(), form.unwrap_or(word)))
        };
        let none = Some(Dimension::NONE);
        let (form, dimension) = match items.as_slice() {
            [x] => match word {
                "norm" => {
                    let (v, _) = self.vector(x, word)?;
                    let square = self.dot(v, v)?;
                    (Form::Scalar(self.step(Step::Root(square))?), x.dimension)
                }
                "world" | "body" => self.turned(x, word)?,
                "abs" => {
                    (Form::Scalar(self.scalar(x, word).and_then(|a| self.step(Step::Abs(a)))?), x.dimension)
                }
                "sqrt" => {
                    let a = self.scalar(x, word)?;
                    let dimension = match x.dimension {
                        Some(d) => Some(
                            d.power_of_halves(1)
                                .ok_or_else(|| self.refuse(x.from, format!("the root of {d} is no unit")))?,
                        ),
                        None => None,
                    };
                    (Form::Scalar(self.step(Step::Root(a))?), dimension)
                }
                "exp" | "log" | "sin" | "cos" | "tanh" | "wrap" => {
                    let a = self.scalar(x, word)?;
                    self.is_plain(x, &format!("what {word} is of"))?;
                    let step = match word {
                        "exp" => Step::Exponential(a),
                        "log" => Step::Logarithm(a),
                        "sin" => Step::Sine(a),
                        "cos" => Step::Cosine(a),
                        "tanh" => Step::Tanh(a),
                        _ => Step::Wrapped(a),
                    };
                    (Form::Scalar(self.step(step)?), none)
                }
                _ => return Err(wrong(self, &items)),
            },
            [x, y] => match word {
                "dot" | "cross" => {
                    let ((a, of_a), (b, of_b)) = (self.vector(x, word)?, self.vector(y, word)?);
                    let axes = self.joint(of_a, of_b, y.from)?;
                    let dimension = x.dimension.zip(y.dimension).map(|(a, b)| a * b);
                    if word == "dot" {
                        (Form::Scalar(self.dot(a, b)?), dimension)
                    } else {
                        let mut at = [0; 3];
                        for (slot, (i, j)) in at.iter_mut().zip([(1, 2), (2, 0), (0, 1)]) {
                            let (plus, minus) = (
                                self.step(Step::Product(a[i], b[j]))?,
                                self.step(Step::Product(a[j], b[i]))?,
                            );
                            *slot = self.step(Step::Difference(plus, minus))?;
                        }
                        (Form::Vector(at, axes), dimension)
                    }
                }
                "unit" => {
                    let (v, axes) = self.vector(x, word)?;
                    self.same(x.dimension, y)?;
                    let width = self.scalar(y, "a width")?;
                    let square = self.dot(v, v)?;
                    let length = self.step(Step::Root(square))?;
                    let size = self.step(Step::Hypotenuse(length, width))?;
                    (Form::Vector(self.each(v, [size; 3], Step::Quotient)?, axes), none)
                }
                "oddpower" => {
                    let (a, b) = (self.scalar(x, word)?, self.scalar(y, "an exponent")?);
                    self.is_plain(x, "what oddpower is of")?;
                    self.is_plain(y, "an exponent")?;
                    (Form::Scalar(self.step(Step::OddPower(a, b))?), none)
                }
                "atan2" | "min" | "max" | "hypot" | "sign" | "limit" | "beyond" => {
                    let (a, b) = (self.scalar(x, word)?, self.scalar(y, word)?);
                    let dimension = self.same(x.dimension, y)?;
                    let step = match word {
                        "atan2" => Step::Arctangent(a, b),
                        "min" => Step::Least(a, b),
                        "max" => Step::Largest(a, b),
                        "hypot" => Step::Hypotenuse(a, b),
                        "sign" => Step::Sign(a, b),
                        "limit" => Step::Limited(a, b),
                        _ => Step::Beyond(a, b),
                    };
                    let is_plain = matches!(word, "atan2" | "sign");
                    (Form::Scalar(self.step(step)?), if is_plain { none } else { dimension })
                }
                _ => return Err(wrong(self, &items)),
            },
            _ => return Err(wrong(self, &items)),
        };
        Ok(Typed { form, dimension, from, to })
    }

    /// A vector in the other axes: v_world = R v_body.
    fn turned(&mut self, of: &Typed, word: &str) -> Result<(Form, Option<Dimension>), Refusal> {
        let (v, axes) = self.vector(of, word)?;
        let (to, from) = if word == "world" { (Axes::World, Axes::Body) } else { (Axes::Body, Axes::World) };
        if axes == Some(to) {
            return Err(self.refuse(of.from, format!("{} is in {word} axes already", self.words(of))));
        }
        let _ = from;
        let mut at = [0; 3];
        for (i, slot) in at.iter_mut().enumerate() {
            let mut row = [0; 3];
            for (j, element) in row.iter_mut().enumerate() {
                let (r, c) = if word == "world" { (i, j) } else { (j, i) };
                *element = self.step(Step::Read(Read::Rotation(r as u8, c as u8)))?;
            }
            *slot = self.dot(row, v)?;
        }
        Ok((Form::Vector(at, Some(to)), of.dimension))
    }
}
