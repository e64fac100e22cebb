//! States, drives and forces of all kinds, and what [`KindDynamics`] says of each, of all of them.

use nalgebra::{Matrix3, Vector3};

use super::dynamics::{Instant, KindDynamics, OnBody};
use super::{Actuators, Kind};
use crate::Environment;
use crate::effects::{EffectSet, ThrustLag};
use crate::platform::sensors::SensorSuite;
use crate::sensing::JointSample;

macro_rules! motion {
    ($($(#[$row:meta])* $module:ident: $kind:ident, $prior:ident;)*) => {
        /// Continuous states of the actuators by kind, or their rates.
        #[derive(Debug, Clone, Copy, PartialEq, Default)]
        pub struct States {
            $(
                $(#[$row])*
                #[doc = concat!("See [`super::", stringify!($module), "`].")]
                pub $module: super::$module::State,
            )*
        }

        /// What holds between two events, by kind.
        #[derive(Debug, Clone)]
        pub(crate) struct Drives {
            $($(#[$row])* pub $module: super::$module::Drive,)*
        }

        /// Torques and flows within each kind at one instant.
        #[derive(Debug, Clone, Default)]
        pub(crate) struct Forces {
            $($(#[$row])* pub(crate) $module: super::$module::Forces,)*
        }

        /// What [`KindDynamics`] says of each kind, of all of them in the order of the table.
        impl Actuators {
            pub(crate) fn at_rest(&self) -> States {
                States { $($(#[$row])* $module: self.$module.at_rest()),* }
            }

            pub(crate) fn idle(&self, lag: ThrustLag, now_ns: i64) -> Drives {
                Drives { $($(#[$row])* $module: self.$module.idle(lag, now_ns)),* }
            }

            #[inline]
            pub(crate) fn moved(&self, states: &States, rates: &States, factor: f64, to: &mut States) {
                $($(#[$row])* { self.$module.moved(&states.$module, &rates.$module, factor, &mut to.$module); })*
            }

            #[inline]
            pub(crate) fn add_scaled(&self, states: &mut States, rates: &States, factor: f64) {
                $($(#[$row])* { self.$module.add_scaled(&mut states.$module, &rates.$module, factor); })*
            }

            #[inline]
            pub(crate) fn bound(&self, states: &mut States) {
                $($(#[$row])* { self.$module.bound(&mut states.$module); })*
            }

            #[inline]
            pub(crate) fn is_finite(&self, states: &States) -> bool {
                let mut finite = true;
                $($(#[$row])* { finite &= self.$module.is_finite(&states.$module); })*
                finite
            }

            #[inline]
            pub(crate) fn show<'a>(
                &'a self,
                states: &'a States,
                drives: &'a Drives,
                environment: &mut Environment<'a>,
            ) -> f64 {
                let mut load = 0.0;
                $($(#[$row])* { load += self.$module.show(&states.$module, &drives.$module, environment); })*
                load
            }

            #[inline]
            pub(crate) fn add_momentum(&self, states: &States, sum_b_n_m_s: &mut Vector3<f64>) {
                $($(#[$row])* { self.$module.add_momentum(&states.$module, sum_b_n_m_s); })*
            }

            pub(crate) fn take_out(&self, drives: Option<&Drives>, left: &mut Matrix3<f64>) {
                $($(#[$row])* { self.$module.take_out(drives.map(|drives| &drives.$module), left); })*
            }

            #[inline]
            pub(crate) fn act(
                &self,
                at: &Instant,
                states: &States,
                drives: &Drives,
                omega_wb_b_rad_s: &Vector3<f64>,
                body: &mut OnBody,
                to: &mut Forces,
            ) {
                $(
                    $(#[$row])*
                    {
                        let (state, drive) = (&states.$module, &drives.$module);
                        self.$module.act(at, state, drive, omega_wb_b_rad_s, body, &mut to.$module);
                    }
                )*
            }

            #[inline]
            pub(crate) fn add_effects(
                &self,
                effects: &EffectSet,
                environment: &Environment<'_>,
                states: &States,
                forces: &mut Forces,
            ) {
                $($(#[$row])* { self.$module.add_effects(effects, environment, &states.$module, &mut forces.$module); })*
            }

            #[inline]
            pub(crate) fn reaction_b_n_m(&self, drives: &Drives, forces: &Forces) -> Vector3<f64> {
                let mut sum = Vector3::zeros();
                $($(#[$row])* { self.$module.add_reaction(&drives.$module, &forces.$module, &mut sum); })*
                sum
            }

            #[inline]
            pub(crate) fn rates(
                &self,
                states: &States,
                drives: &Drives,
                forces: &Forces,
                omega_dot_wb_b_rad_s2: &Vector3<f64>,
                to: &mut States,
            ) {
                $(
                    $(#[$row])*
                    {
                        let (state, drive) = (&states.$module, &drives.$module);
                        self.$module.rate(state, drive, &forces.$module, omega_dot_wb_b_rad_s2, &mut to.$module);
                    }
                )*
            }

            #[inline]
            pub(crate) fn next_event_ns(&self, drives: &Drives) -> i64 {
                let mut next_ns = i64::MAX;
                $($(#[$row])* { next_ns = next_ns.min(self.$module.next_event_ns(&drives.$module)); })*
                next_ns
            }

            #[inline]
            pub(crate) fn take_over(&self, drives: &mut Drives, other: &Drives, now_ns: i64) {
                $($(#[$row])* { self.$module.take_over(&mut drives.$module, &other.$module, now_ns); })*
            }

            pub(crate) fn settle(&self, drives: &mut Drives, now_ns: i64) {
                $(
                    $(#[$row])*
                    if self.$module.next_event_ns(&drives.$module) <= now_ns {
                        self.$module.settle(&mut drives.$module, now_ns);
                    }
                )*
            }

            pub(crate) fn set_out(&self, states: &States, drives: &mut Drives) {
                $($(#[$row])* { self.$module.set_out(&states.$module, &mut drives.$module); })*
            }

            /// A part of a kind, and the sense in which it slips.
            #[inline]
            pub(crate) fn first_slip<'a>(
                &self,
                effects: &EffectSet,
                environment: &dyn Fn() -> Environment<'a>,
                drives: &Drives,
                omega_dot_wb_b_rad_s2: &Vector3<f64>,
            ) -> Option<(Part, f64)> {
                $(
                    $(#[$row])*
                    {
                        let slip =
                            self.$module.first_slip(effects, environment, &drives.$module, omega_dot_wb_b_rad_s2);
                        if let Some((member, sense)) = slip {
                            return Some((Part { kind: Kind::$kind, member }, sense));
                        }
                    }
                )*
                None
            }

            /// The part that stops first, and roughly when [s].
            #[inline]
            pub(crate) fn first_stop(
                &self,
                from: &States,
                to: &States,
                drives: &Drives,
                h_s: f64,
            ) -> Option<(Part, f64)> {
                let mut first: Option<(Part, f64)> = None;
                $(
                    $(#[$row])*
                    {
                        let stop = self.$module.first_stop(&from.$module, &to.$module, &drives.$module, h_s);
                        if let Some((member, stop_s)) = stop
                            && first.is_none_or(|(_, earliest_s)| stop_s < earliest_s)
                        {
                            first = Some((Part { kind: Kind::$kind, member }, stop_s));
                        }
                    }
                )*
                first
            }

            pub(crate) fn speed(&self, states: &States, part: Part) -> f64 {
                match part.kind {
                    $($(#[$row])* Kind::$kind => self.$module.speed(&states.$module, part.member),)*
                }
            }

            pub(crate) fn slide(&self, states: &mut States, drives: &mut Drives, part: Part, sense: f64) {
                match part.kind {
                    $($(#[$row])* Kind::$kind => {
                        self.$module.slide(&mut states.$module, &mut drives.$module, part.member, sense);
                    })*
                }
            }

            pub(crate) fn sample(
                &self,
                kind: Kind,
                states: &States,
                drives: &Drives,
                sensors: &SensorSuite,
                noise: &mut dyn FnMut() -> f64,
            ) -> JointSample {
                match kind {
                    $($(#[$row])* Kind::$kind => {
                        self.$module.sample(&states.$module, &drives.$module, sensors, noise)
                    })*
                }
            }

            pub(crate) fn command(&self, drives: &mut Drives, kind: Kind, command: &[f64]) {
                match kind {
                    $($(#[$row])* Kind::$kind => self.$module.command(&mut drives.$module, command),)*
                }
            }
        }

    };
}

with_kinds!(motion);

/// One moving part of a kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Part {
    kind: Kind,
    member: usize,
}
