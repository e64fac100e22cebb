//! A model a little further along a parameter, on the way of a filter.

use nalgebra::Vector3;
use whorl_dynamics::actuators::wheels::MAX_WHEELS;
use whorl_dynamics::plant::{Acts, MeanInputs};
use whorl_dynamics::platform::SensorSuite;
use whorl_dynamics::{Environment, Gyrostat, Plant, PlatformModel};

use crate::commands::Commands;
use crate::driven_speeds::as_driven;
use crate::perturbed::{Differs, Torque};
use crate::prepared::plant_before;
use crate::{PredictionError, Prepared, Push};

/// A model a little further along a parameter.
#[derive(Debug, Clone)]
pub struct Varied {
    /// The model there.
    pub model: PlatformModel,
    /// How far along the parameter, in its unit.
    pub step: f64,
}

/// A varied model on the way of a filter, for differences of motions.
pub(crate) struct Other<'a> {
    pub plant: Plant,
    /// The next command, where it makes steps, and all of them; `None`: those of the filter's model.
    event: usize,
    commands: Option<Commands<'a>>,
    sensors: SensorSuite,
    pub step: f64,
    /// How much later than the filter's model it takes the readings of gyro and accelerometer to be \[s\].
    pub late_s: [f64; 2],
    /// What is behind the sensors' low-pass less what is there with the filter's model, of a model with another low-pass.
    pub behind: Option<[Vector3<f64>; 2]>,
    pub differs: Differs,
    /// What differs, where that is a torque that can be told from the filter's state alone.
    torque: Torque,
    pub turns_vectors: bool,
    /// What it does over the present step, and how, where that shows in the filter's state: at every step in the same place.
    pub does: Does,
    pub acts: Acts,
    /// The torques that it makes more, and what a gyro sees more by them.
    pub pushes: Vec<Push>,
}

/// What a varied model does over a step.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Does {
    /// What shows only when it has made the step.
    Step,
    /// What it does in the filter's state, until the end.
    Act,
    /// A torque more than the filter's model, until the end.
    Push,
    /// The same as the filter's model.
    TheSame,
}

impl<'a> Other<'a> {
    /// Another model on the same recording, from the same instant on.
    pub fn new(case: &Prepared<'a>, model: &PlatformModel, step: f64) -> Result<Self, PredictionError> {
        let (model, of_case) = (as_driven(case.recording, model), case.plant.gyrostat());
        let own = Gyrostat::new(&model)?;
        // Few parameters change when a command comes or what it is.
        let has_same_valves = own.has_valves_of(of_case);
        let is_told_the_same = case.driven.is_none() && has_same_valves;
        let told = (!is_told_the_same).then(|| Commands::along(case.recording, &own, case.driven.as_ref()));
        let commands = told.as_ref().unwrap_or(&case.commands);
        let supplies = of_case.supplies().clone();
        let plant = plant_before(&model, commands, case.first_ns(), case.clamped, supplies)?;
        let (sensors, of) = (own.model().sensors, &case.model.sensors);
        let differing = |number: fn(&SensorSuite) -> [f64; 2]| {
            let [own, of] = [number(&sensors), number(of)];
            [own[0] - of[0], own[1] - of[1]]
        };
        let low_pass_s =
            differing(|s| [s.gyro.errors.time_constant_s, s.accelerometer.errors.time_constant_s]);
        let has_own_low_pass = low_pass_s != [0.0; 2];
        let plant = plant.with_step_ns(case.difference_step_ns).for_differences(has_own_low_pass);
        let (plant, event) = commands.at_first_reading(plant, case.first_ns());
        // Both without noise, and with the supplies of the run.
        let of_plant = plant.gyrostat();
        let turns_vectors = of_plant.model().sensors.vector != of_case.model().sensors.vector;
        let (mut differs, torque) = Differs::of(of_plant, of_case);
        if has_own_low_pass || !own.model().gyros().is_empty() || !has_same_valves {
            differs = Differs::WithinSteps;
        } else if turns_vectors {
            differs = Differs::InMotion;
        }
        Ok(Self {
            acts: Acts::none(&plant),
            plant,
            event,
            commands: told.filter(|told| *told != case.commands),
            sensors,
            step,
            late_s: differing(|s| [s.gyro.errors.latency_s, s.accelerometer.errors.latency_s]),
            behind: has_own_low_pass.then(Default::default),
            differs,
            torque,
            turns_vectors,
            does: Does::Step,
            pushes: Vec::new(),
        })
    }

    /// Takes over the motion of the first model's plant before readings that show this instant \[ns\], a little changed or not at all.
    pub fn take_motion_of(&mut self, plant: &Plant, change: &[f64], instant_ns: i64) {
        self.plant.take_motion_of(plant, change);
        if let Some(own) = &self.commands {
            self.plant.average_readings(own.mean_inputs(&self.sensors, instant_ns));
        }
        self.behind.iter().for_each(|behind| self.plant.move_behind_filter(behind));
    }

    /// Takes over commands and valves of the first model's plant as well, whose next command this is: of a model that is told the same, and for
    /// which they were not followed while its way of acting alone was asked for.
    pub fn stand_in_for(&mut self, plant: &Plant, change: &[f64], event: usize, instant_ns: i64) {
        if self.differs == Differs::WithinSteps {
            return self.take_motion_of(plant, change, instant_ns);
        }
        self.plant.stand_in_for(plant, change);
        self.event = event;
        if let Some(own) = &self.commands {
            own.tell_wheels(event, &mut self.plant);
            self.plant.average_readings(own.mean_inputs(&self.sensors, instant_ns));
        }
    }

    /// The inputs that drive it from now until an instant ([`Commands::moments_between`]).
    pub fn inputs_until(&self, case: &Prepared<'_>, end_ns: i64) -> [MeanInputs; 2] {
        let commands = self.commands.as_ref().unwrap_or(&case.commands);
        commands.moments_between(self.plant.now_ns() as f64 * 1e-9, end_ns as f64 * 1e-9)
    }

    /// Hears what is due by now: masses that are moved drive it until the next reading.
    pub fn hear(&mut self, case: &Prepared<'_>) {
        let commands = self.commands.as_ref().unwrap_or(&case.commands);
        while commands.event_ns(self.event).is_some_and(|due_ns| due_ns <= self.plant.now_ns()) {
            commands.tell(self.event, &mut self.plant);
            self.event += 1;
        }
    }

    /// Whether its commands are others than those of the filter's model.
    pub fn is_told_otherwise(&self) -> bool {
        self.commands.is_some()
    }

    pub fn run_to(&mut self, case: &Prepared<'_>, time_ns: i64) -> bool {
        let commands = self.commands.as_ref().unwrap_or(&case.commands);
        commands.run_to(&mut self.plant, &mut self.event, time_ns)
    }

    /// Finds the torques that it makes more in the filter's state, of so many wheels.
    pub fn push(&mut self, environment: &Environment<'_>, wheels: usize) {
        let mut wheels_n_m = [0.0; MAX_WHEELS];
        let (body_n_m, imu) = self.torque.in_state(environment, &mut wheels_n_m[..wheels]);
        self.pushes.clear();
        self.pushes.extend([Push::Body(body_n_m), Push::Gyro(imu.fixed_rows::<3>(0).into())]);
        let of_wheels = wheels_n_m.into_iter().enumerate().filter(|(_, torque_n_m)| *torque_n_m != 0.0);
        self.pushes.extend(of_wheels.map(|(position, torque_n_m)| Push::Wheel(position, torque_n_m)));
        self.does = Does::Push;
    }
}
