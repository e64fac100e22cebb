//! What functions do to numbers and vectors with units and axes.

use super::{Axes, Dimension, FUNCTIONS, Form, Parser, Read, Refusal, Step, Typed};

impl Parser<'_> {
    pub(super) fn function(&mut self, word: &str, from: usize) -> Result<Typed, Refusal> {
        let mut items = vec![self.sum()?];
        while self.takes(',') {
            items.push(self.sum()?);
        }
        self.expects(')')?;
        let to = self.at;
        let known =
            FUNCTIONS.iter().flat_map(|(form, _)| form.split("), ")).filter_map(|f| f.split('(').next());
        if !known.clone().any(|f| f == word) {
            let near = whorl_math::words::ranked(word, known, 3);
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
        let to = if word == "world" { Axes::World } else { Axes::Body };
        if axes == Some(to) {
            return Err(self.refuse(of.from, format!("{} is in {word} axes already", self.words(of))));
        }
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
