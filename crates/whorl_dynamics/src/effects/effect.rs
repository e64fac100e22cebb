//! The one definition behind the four uses of a physical effect.

use std::fmt;

use nalgebra::{Matrix3, Vector3};

use super::{
    Aid, Clues, Contribution, EffectError, Evidence, Grouping, Need, ParameterSpec, Periodicity, Signature,
    Start, ThrustLag,
};
use crate::{Environment, PlatformModel};

/// Where an effect enters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EffectKind {
    /// A torque on the body.
    Torque,
    /// What an actuator does with its command.
    Actuator,
    /// What is measured, not what happens.
    Sensor,
    /// A torque with states of its own.
    HiddenState,
}

impl fmt::Display for EffectKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Torque => "torque",
            Self::Actuator => "actuator",
            Self::Sensor => "sensor",
            Self::HiddenState => "hidden_state",
        })
    }
}

/// Description of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectInfo {
    /// Fixed name in parameter files, reports and JSON.
    pub id: &'static str,
    /// A few words.
    pub title: &'static str,
    /// One sentence: the mechanism, and how it shows in the data.
    pub explanation: &'static str,
    /// The equation, in plain text.
    pub equation: &'static str,
    /// Where the equation comes from.
    pub source: &'static str,
    /// Where it enters.
    pub kind: EffectKind,
    /// Effects that typical data cannot tell from this one.
    pub confusable_with: &'static [&'static str],
    /// What separates it from those.
    pub separated_by: &'static str,
    /// Its torque never does positive work: torque . omega <= 0 for every state.
    pub is_passive: bool,
}

/// The inertial unit's true input: what ideal sensors would read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueImu {
    /// Rate seen by the gyro, body axes [rad/s].
    pub angular_velocity_b_rad_s: Vector3<f64>,
    /// Specific force at the accelerometer, body axes [m/s^2].
    pub specific_force_b_m_s2: Vector3<f64>,
}

impl TrueImu {
    /// Linear between this and `later`: `share` 0 is this.
    pub(crate) fn towards(&self, later: &Self, share: f64) -> Self {
        Self {
            angular_velocity_b_rad_s: self
                .angular_velocity_b_rad_s
                .lerp(&later.angular_velocity_b_rad_s, share),
            specific_force_b_m_s2: self.specific_force_b_m_s2.lerp(&later.specific_force_b_m_s2, share),
        }
    }
}

/// A physical effect beyond the base model, written once and used four times: the truth plant
/// simulates with it, the model predicts with it, the diagnosis fits it (columns by differences in
/// `values`), estimator and controller compensate it.
///
/// Its file also has everything else that these uses need: no other file names an effect by its id.
///
/// An effect either corrects constants of the platform ([`Self::adjust`]) or adds physics in the
/// other hooks, each of which does nothing unless an effect overrides it. `values` holds one number
/// per entry of [`Self::parameters`], in that order. With every parameter at its neutral value no
/// hook may change anything, and each hook must be differentiable in `values` there, if need be
/// from one side.
pub trait Effect: Sync + fmt::Debug {
    /// What it is.
    fn info(&self) -> &'static EffectInfo;

    /// Its parameters on this platform (per wheel or per jet where it says so).
    fn parameters(&self, model: &PlatformModel) -> Vec<ParameterSpec>;

    /// Corrects constants of the platform. Corrections of several effects add up.
    ///
    /// # Errors
    /// When the corrected platform is physically impossible.
    fn adjust(&self, _values: &[f64], _model: &mut PlatformModel) -> Result<(), EffectError> {
        Ok(())
    }

    /// Whether it corrects constants ([`Self::adjust`]) and has no other of these hooks: nothing asks it while the platform moves.
    fn is_correction(&self) -> bool {
        false
    }

    /// Whether its formula is that of a rig to a hundredth: where parts are and which way they point, factors and delays of linear sensors. Laws of
    /// friction, of gas and of air are not.
    fn is_exact(&self) -> bool {
        false
    }

    /// Torque on the body about the centre of rotation, body axes [N m].
    fn torque_b_n_m(&self, _values: &[f64], _environment: &Environment<'_>, _hidden: &[f64]) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// Inertia of parts that do not follow the body rigidly, body axes [kg m^2]: it stays part of the
    /// total inertia but does not resist angular acceleration, exactly as sum J a a^T of the wheels.
    fn reaction_inertia_b_kg_m2(&self, _values: &[f64], _model: &PlatformModel) -> Matrix3<f64> {
        Matrix3::zeros()
    }

    /// Adds to `torque_n_m` the torque on each wheel about its spin axis besides motor and bearing
    /// friction \[N m\]; the body takes the opposite.
    fn add_wheel_torque_n_m(&self, _values: &[f64], _environment: &Environment<'_>, _torque_n_m: &mut [f64]) {
    }

    /// Gas lost besides what the jets use [kg/s], >= 0.
    fn gas_rate_kg_s(&self, _values: &[f64], _environment: &Environment<'_>) -> f64 {
        0.0
    }

    /// Added delay of a valve's opening and closing \[s\], taken when the pulse is commanded.
    fn valve_delay_s(&self, _values: &[f64], _environment: &Environment<'_>) -> (f64, f64) {
        (0.0, 0.0)
    }

    /// Thrust of every jet over that of its valve and the tank's pressure, >= 0; those of several effects multiply.
    fn thrust_factor(&self, _values: &[f64], _environment: &Environment<'_>) -> f64 {
        1.0
    }

    /// Lag of thrust behind the valve.
    fn thrust_lag(&self, _values: &[f64]) -> ThrustLag {
        ThrustLag::default()
    }

    /// Number of hidden states. A simulation starts with all of them at zero.
    fn hidden_states(&self, _model: &PlatformModel) -> usize {
        0
    }

    /// Derivative of the hidden states [unit/s]; `environment` holds the angular acceleration.
    fn hidden_derivative(
        &self,
        _values: &[f64],
        _environment: &Environment<'_>,
        _hidden: &[f64],
        _derivative: &mut [f64],
    ) {
    }

    /// How far each hidden state may be from rest when a recording begins, standard deviations, where what is left of an
    /// earlier motion pushes with this torque [N m]. It must be 0 for a state whose equation is not linear.
    fn hidden_start_stddev(
        &self,
        _values: &[f64],
        _model: &PlatformModel,
        _torque_n_m: f64,
        _stddev: &mut [f64],
    ) {
    }

    /// Random-walk intensity of each hidden state, unit per sqrt(s).
    fn hidden_noise(&self, _values: &[f64], _intensity: &mut [f64]) {}

    /// Random walk of the torque on the body that nobody can predict, per body axis [N m/sqrt(s)].
    fn torque_walk_b_n_m_sqrt_s(&self, _values: &[f64]) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// Changes what the inertial sensors see, before their own errors.
    fn measure_imu(&self, _values: &[f64], _environment: &Environment<'_>, _imu: &mut TrueImu) {}

    /// Whether local control counters it from the model. Not what depends on states that control does not know,
    /// nor what must not be countered.
    fn is_fed_forward(&self, model: &PlatformModel) -> bool {
        self.hidden_states(model) == 0
    }

    /// Whether its parameters correct the platform's own: every fit has them, as far as the platform's prior leaves
    /// them open ([`ParameterSpec::base`]).
    fn is_base(&self) -> bool {
        false
    }

    /// What it adds to the inertia matrix, body axes [kg m^2], whether a body can have the sum or not.
    fn added_inertia_b_kg_m2(&self, _values: &[f64]) -> Matrix3<f64> {
        Matrix3::zeros()
    }

    /// What recordings must hold for a regression to test it.
    fn evidence(&self) -> Evidence {
        &[&[Need::FreeBody]]
    }

    /// Data that recordings should hold besides: without them it is hard to tell from others.
    fn aids(&self) -> &'static [Aid] {
        &[]
    }

    /// How its parameters may enter a fit together.
    fn grouping(&self) -> Grouping {
        Grouping::AllPartsEach(&[])
    }

    /// Ways to enter while it is absent, where its parameters do not all enter linearly at their neutral values:
    /// a grid over those that do not. `None`: its parameters as [`Self::grouping`] says.
    fn starts(&self, _model: &PlatformModel, _clues: &Clues<'_>) -> Option<Vec<Start>> {
        None
    }

    /// The values to which the directions of one start lead together; `None`: each direction where it went.
    fn joined(&self, _contributions: &[Contribution<'_>]) -> Option<Vec<f64>> {
        None
    }

    /// Log-prior penalty: log odds against it, beside those against any effect: of a general law that holds others as special cases, which
    /// are the likelier explanation where they do.
    fn prior_penalty_nats(&self) -> f64 {
        0.0
    }

    /// Its periodicity.
    fn periodicity(&self) -> Option<Periodicity> {
        None
    }

    /// Frequency that something outside imposes on the platform \[Hz\].
    fn imposed_hz(&self, _values: &[f64]) -> Option<f64> {
        None
    }

    /// What samples show of it without a regression.
    fn signature(&self) -> Option<Signature> {
        None
    }

    /// Age of all inertial data beyond what the model says \[s\]; `None`: it does not delay them.
    fn imu_latency_s(&self, _values: &[f64]) -> Option<f64> {
        None
    }

    /// Torque with which it can hold the body at rest against others [N m].
    fn holding_torque_n_m(&self, _values: &[f64]) -> f64 {
        0.0
    }

    /// Tilt from which something touches \[rad\]; `None`: nothing does.
    fn contact_tilt_rad(&self, _values: &[f64]) -> Option<f64> {
        None
    }
}
