//! Effects as data: an equation in text over named quantities with units, as good as one that is compiled in.
//!
//! [`Definition`] is what a file says; [`WrittenEffect::new`] checks it (dimensions, axes, finiteness, neutral value,
//! passivity) and compiles its equations to steps without loops; [`super::register`] puts it into the catalogue. From
//! then on it is simulated, fitted, predicted, fed forward and listed like the others.

mod check;
mod definition;
mod expression;
mod formula;
mod program;
mod quantity;
mod spline;
#[cfg(test)]
mod tests;
mod units;

use nalgebra::Vector3;

pub use definition::{ActsOn, Definition, DefinitionError, WrittenCurve, WrittenParameter, WrittenState};
pub use expression::FUNCTIONS;
pub use formula::Formula;
pub use quantity::{Axes, QUANTITIES, Quantity, QuantityForm};
pub use spline::CurveShape;
pub use units::Dimension;

use self::expression::{Name, What, compile};
use self::program::Program;
use self::quantity::Read;
use self::spline::Spline;
use super::search::geometric;
use super::{
    Clues, Effect, EffectInfo, EffectKind, Evidence, Grouping, Need, ParameterSpec, Part, Regressed, Role,
    Start, Starter, TrueImu,
};
use crate::{Environment, PlatformModel};

/// Starts of a fit that are tried, at most.
const MOST_STARTS: usize = 48;

/// An effect made of a [`Definition`].
#[derive(Debug)]
pub struct WrittenEffect {
    definition: Definition,
    info: &'static EffectInfo,
    specs: Vec<ParameterSpec>,
    starts: Vec<Vec<f64>>,
    equation: Program,
    axes: Axes,
    derivatives: Vec<Program>,
    evidence: Evidence,
}

impl WrittenEffect {
    /// Checks and compiles a definition. Texts that live as long as the program are leaked: an effect stays.
    ///
    /// # Errors
    /// The entry that is wrong, and what is allowed.
    pub fn new(definition: Definition) -> Result<Self, DefinitionError> {
        check::form(&definition)?;
        let of_wheel = definition.acts_on == ActsOn::WheelTorque;
        let mut specs = Vec::new();
        let mut starts = Vec::new();
        let mut names = Vec::new();
        let unit_of = |key: String, unit: &str| -> Result<Dimension, DefinitionError> {
            let (dimension, size) =
                Dimension::parse(unit).map_err(|problem| DefinitionError::new(&key, problem))?;
            if size == 1.0 {
                return Ok(dimension);
            }
            Err(DefinitionError::new(
                key,
                format!("{unit} is no base unit; state it in SI units without prefixes"),
            ))
        };
        for p in &definition.parameters {
            let dimension = unit_of(format!("parameters.{}.unit", p.name), &p.unit)?;
            names.push(Name { name: p.name.clone(), dimension, what: What::Parameter(specs.len() as u16) });
            specs.push(spec_of(p));
            starts.push(starts_of(p));
        }
        for curve in &definition.curves {
            let key = |what: &str| format!("curves.{}.{what}", curve.name);
            let dimension = unit_of(key("unit"), &curve.unit)?;
            let argument = unit_of(key("of_unit"), &curve.of_unit)?;
            let spline = Spline::new(curve.knots.clone(), specs.len(), curve.shape);
            let least = if curve.shape == CurveShape::Free { -curve.largest } else { 0.0 };
            let unit = leaked(&curve.unit);
            for i in 0..spline.parameters().len() {
                let doc = "Coefficient of a measured curve.";
                let name = format!("{}_{}", curve.name, i + 1);
                specs.push(ParameterSpec::new(name, unit, (least, curve.largest), curve.prior, doc));
                starts.push(Vec::new());
            }
            let what = What::Curve { of: curve.of.clone(), argument, spline };
            names.push(Name { name: curve.name.clone(), dimension, what });
        }
        for (i, state) in definition.states.iter().enumerate() {
            let dimension = unit_of(format!("states.{}.unit", state.name), &state.unit)?;
            names.push(Name { name: state.name.clone(), dimension, what: What::State(i as u16) });
        }
        let compiled = compile(&definition.equation, &names, of_wheel)
            .map_err(|e| check::located("equation", &definition.equation, &e))?;
        let axes = check::result(&definition, &compiled)?;
        let mut derivatives = Vec::new();
        for (state, name) in
            definition.states.iter().zip(names.iter().rev().take(definition.states.len()).rev())
        {
            let key = format!("states.{}.derivative", state.name);
            let found = compile(&state.derivative, &names, false)
                .map_err(|e| check::located(&key, &state.derivative, &e))?;
            let expected = name.dimension / Dimension::TIME;
            if found.vector.is_some() || found.dimension.is_some_and(|d| d != expected) {
                let unit = found.dimension.unwrap_or_default();
                let problem =
                    format!("it gives {unit}; the derivative of {} is a number in {expected}", state.name);
                return Err(DefinitionError::new(key, problem));
            }
            derivatives.push(found.program);
        }
        let evidence = evidence_of(&definition, std::iter::once(&compiled.program).chain(&derivatives));
        let info = Box::leak(Box::new(info_of(&definition)));
        let effect =
            Self { info, specs, starts, equation: compiled.program, axes, derivatives, evidence, definition };
        check::names_are_used(&effect)?;
        check::behaviour(&effect)?;
        Ok(effect)
    }

    /// What it was made of.
    #[must_use]
    pub fn definition(&self) -> &Definition {
        &self.definition
    }

    /// What the equation gives, in body axes if it is a vector.
    #[inline]
    fn result(
        &self,
        values: &[f64],
        environment: &Environment<'_>,
        hidden: &[f64],
        wheel: usize,
    ) -> Vector3<f64> {
        let given = Vector3::from(self.equation.evaluate(values, environment, hidden, wheel));
        match self.axes {
            Axes::Body => given,
            Axes::World => environment.to_body(&given),
        }
    }

    fn acts_on(&self, what: ActsOn) -> bool {
        self.definition.acts_on == what
    }
}

fn leaked(text: &str) -> &'static str {
    Box::leak(text.to_owned().into_boxed_str())
}

fn spec_of(p: &WrittenParameter) -> ParameterSpec {
    let spec = ParameterSpec::new(p.name.clone(), leaked(&p.unit), p.range, p.prior, leaked(&p.meaning));
    let spec = spec.with_neutral(p.neutral);
    let spec = match p.role {
        Role::Amplitude => spec,
        Role::Shape => spec.shape().regressed(Regressed::WithAmplitude),
        Role::FloatingShape => spec.floating_shape().regressed(Regressed::WithAmplitude),
    };
    if p.known { spec.known() } else { spec }
}

/// Values of a shape from which a fit is tried.
fn starts_of(p: &WrittenParameter) -> Vec<f64> {
    let (low, high) = p.range;
    match p.role {
        _ if p.known => Vec::new(),
        Role::Amplitude => Vec::new(),
        _ if !p.starts.is_empty() => p.starts.clone(),
        Role::Shape => vec![p.neutral],
        // Over decades where the range is one.
        Role::FloatingShape if low > 0.0 && high > 8.0 * low => geometric(low * 1.5, high / 1.5, 6),
        Role::FloatingShape => (0..6).map(|i| low + (high - low) * (f64::from(i) + 0.5) / 6.0).collect(),
    }
}

fn info_of(definition: &Definition) -> EffectInfo {
    let kind = match definition.acts_on {
        _ if !definition.states.is_empty() => EffectKind::HiddenState,
        ActsOn::Torque => EffectKind::Torque,
        ActsOn::WheelTorque | ActsOn::Thrust => EffectKind::Actuator,
        ActsOn::Gyro | ActsOn::Accelerometer => EffectKind::Sensor,
    };
    let confusable: Vec<&'static str> = definition.confusable_with.iter().map(|id| leaked(id)).collect();
    let mut equation = format!("{} += {}", definition.acts_on.name(), definition.equation.trim());
    for state in &definition.states {
        equation += &format!("; d({})/dt = {}", state.name, state.derivative.trim());
    }
    for curve in &definition.curves {
        equation += &format!("; {} is a measured curve over {}", curve.name, curve.of.trim());
    }
    EffectInfo {
        id: leaked(&definition.id),
        title: leaked(&definition.title),
        explanation: leaked(&definition.explanation),
        equation: leaked(&equation),
        source: leaked(&definition.source),
        kind,
        confusable_with: Box::leak(confusable.into_boxed_slice()),
        separated_by: leaked(&definition.separated_by),
        is_passive: definition.is_passive,
    }
}

/// What recordings must hold, by what the equations read.
fn evidence_of<'p>(definition: &Definition, programs: impl Iterator<Item = &'p Program>) -> Evidence {
    let mut needs = vec![Need::FreeBody];
    match definition.acts_on {
        ActsOn::WheelTorque => needs = vec![Need::Wheels, Need::WheelCommands],
        ActsOn::Thrust => needs.push(Need::Jets),
        ActsOn::Accelerometer => needs.push(Need::Accelerometer),
        ActsOn::Torque | ActsOn::Gyro => {}
    }
    for read in programs.flat_map(Program::reads) {
        match read {
            Read::Temperature => needs.push(Need::Temperature),
            Read::Voltage => needs.push(Need::BusVoltage),
            Read::Valve(_) => needs.push(Need::Jets),
            Read::WheelSpeed(_) | Read::WheelMomentum(_) => needs.push(Need::Wheels),
            Read::MotorTorque(_) => needs.push(Need::WheelCommands),
            Read::Ballast(_) => needs.push(Need::Ballast),
            _ => {}
        }
    }
    let mut once: Vec<Need> = Vec::new();
    for need in needs {
        if !once.contains(&need) {
            once.push(need);
        }
    }
    Box::leak(Box::new([&*Box::leak(once.into_boxed_slice())]))
}

impl Effect for WrittenEffect {
    fn info(&self) -> &'static EffectInfo {
        self.info
    }

    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec> {
        if !self.acts_on(ActsOn::WheelTorque) {
            return self.specs.clone();
        }
        let wheels = model.wheels().iter().enumerate();
        let own = |(j, wheel): (usize, &crate::platform::Wheel)| {
            let name = format!("{}_", wheel.name);
            let of = move |spec: &ParameterSpec| ParameterSpec {
                name: format!("{name}{}", spec.name),
                part: Part::Wheel(j),
                ..spec.clone()
            };
            self.specs.iter().map(of).collect::<Vec<_>>()
        };
        wheels.flat_map(own).collect()
    }

    fn torque_b_n_m(&self, values: &[f64], environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        if self.acts_on(ActsOn::Torque) {
            self.result(values, environment, hidden, 0)
        } else {
            Vector3::zeros()
        }
    }

    fn add_wheel_torque_n_m(&self, values: &[f64], environment: &Environment<'_>, torque_n_m: &mut [f64]) {
        if !self.acts_on(ActsOn::WheelTorque) {
            return;
        }
        for (wheel, slot) in torque_n_m.iter_mut().enumerate() {
            let Some(own) = values.get(wheel * self.specs.len()..) else { return };
            *slot += self.equation.evaluate(own, environment, &[], wheel)[0];
        }
    }

    fn thrust_factor(&self, values: &[f64], environment: &Environment<'_>) -> f64 {
        if !self.acts_on(ActsOn::Thrust) {
            return 1.0;
        }
        (1.0 + self.equation.evaluate(values, environment, &[], 0)[0]).max(0.0)
    }

    fn hidden_states(&self, _model: &PlatformModel) -> usize {
        self.derivatives.len()
    }

    fn hidden_derivative(
        &self,
        values: &[f64],
        environment: &Environment<'_>,
        hidden: &[f64],
        derivative: &mut [f64],
    ) {
        for (slot, program) in derivative.iter_mut().zip(&self.derivatives) {
            *slot = program.evaluate(values, environment, hidden, 0)[0];
        }
    }

    fn measure_imu(&self, values: &[f64], environment: &Environment<'_>, imu: &mut TrueImu) {
        match self.definition.acts_on {
            ActsOn::Gyro => imu.angular_velocity_b_rad_s += self.result(values, environment, &[], 0),
            ActsOn::Accelerometer => imu.specific_force_b_m_s2 += self.result(values, environment, &[], 0),
            _ => {}
        }
    }

    fn is_fed_forward(&self, _model: &PlatformModel) -> bool {
        self.derivatives.is_empty() && self.definition.is_fed_forward.unwrap_or(true)
    }

    fn evidence(&self) -> Evidence {
        self.evidence
    }

    fn grouping(&self) -> Grouping {
        // A part of a curve is no curve.
        if self.definition.curves.is_empty() { Grouping::AllPartsEach(&[]) } else { Grouping::All }
    }

    fn starts(&self, model: &PlatformModel, _clues: &Clues<'_>) -> Option<Vec<Start>> {
        if self.starts.iter().all(Vec::is_empty) {
            return None;
        }
        let starter = Starter::new(self, model);
        // Shapes at every combination of their starts.
        let mut origins: Vec<Vec<(&str, f64)>> = vec![Vec::new()];
        for (spec, tried) in self.specs.iter().zip(&self.starts).filter(|(_, tried)| !tried.is_empty()) {
            let more = origins.iter().flat_map(|origin| {
                tried
                    .iter()
                    .map(move |value| origin.iter().copied().chain([(spec.name.as_str(), *value)]).collect())
            });
            origins = more.collect();
            origins.truncate(MOST_STARTS);
        }
        let parts: Vec<String> = if self.acts_on(ActsOn::WheelTorque) {
            model.wheels().iter().map(|wheel| format!("{}_", wheel.name)).collect()
        } else {
            vec![String::new()]
        };
        let amplitudes = |part: &str| -> Vec<String> {
            let of = self.specs.iter().filter(|spec| spec.role == Role::Amplitude && !spec.known);
            of.map(|spec| format!("{part}{}", spec.name)).collect()
        };
        let mut starts = Vec::new();
        for part in &parts {
            for origin in &origins {
                let named: Vec<(String, f64)> =
                    origin.iter().map(|(name, value)| (format!("{part}{name}"), *value)).collect();
                let named: Vec<(&str, f64)> =
                    named.iter().map(|(name, value)| (name.as_str(), *value)).collect();
                let at = starter.at(&named);
                starts.push(amplitudes(part).iter().map(|name| starter.along(&at, name)).collect());
            }
        }
        Some(starts)
    }
}
