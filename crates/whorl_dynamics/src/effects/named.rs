//! Values of parameters by name: `parameters!` declares each parameter once, with the field that holds its value.
//!
//! ```text
//! parameters! {
//!     Spring(_model: PlatformModel) {
//!         k_n_m_rad: f64 = ParameterSpec::new("k_n_m_rad", "N m/rad", (0.0, 5.0), 0.01, "Stiffness."),
//!         yaw0_rad: f64 = ParameterSpec::new("yaw0_rad", "rad", (-PI, PI), PI, "Heading at rest.").angle(),
//!     }
//! }
//! ```
//!
//! `Spring::specs(model)` lists them for [`super::Effect::parameters`]; `Spring::of(values).k_n_m_rad` reads one in a
//! hook. Where each value stands is settled when the program is compiled, so that reading costs no search.

use nalgebra::Vector3;

use super::{ParameterSpec, Part};
use crate::PlatformModel;
use crate::actuators::control_moment_gyros::Gyro;
use crate::platform::{Jet, Wheel};

/// Declares a struct of named values and the parameters behind them; see the module's page. `$of` is what the
/// parameters depend on: the platform, or one wheel, jet or gyro of it.
macro_rules! parameters {
    ($(#[$doc:meta])* $name:ident($of:ident: $kind:ty) { $($field:ident: $value:ty = $specs:expr),+ $(,)? }) => {
        $(#[$doc])*
        struct $name {
            $($field: $value),+
        }

        impl $crate::effects::named::Named for $name {
            type Of = $kind;
            const COUNT: usize = 0 $(+ <$value as $crate::effects::named::Value>::COUNT)+;

            fn specs($of: &$kind) -> Vec<$crate::effects::ParameterSpec> {
                let mut specs = Vec::with_capacity(Self::COUNT);
                $(specs.extend(<$value as $crate::effects::named::Value>::list($specs));)+
                specs.into_iter().map(|spec| $crate::effects::size::for_size_of($of, spec)).collect()
            }

            #[inline]
            fn of(values: &[f64]) -> Self {
                let mut rest = values;
                // In the order of the declaration, which is that of `specs`.
                Self { $($field: $crate::effects::named::take(&mut rest)),+ }
            }

            fn values(&self) -> Vec<f64> {
                let mut values = Vec::with_capacity(Self::COUNT);
                $($crate::effects::named::Value::write(&self.$field, &mut values);)+
                values
            }
        }
    };
}
pub(super) use parameters;

/// Named values, and the parameters behind them in the same order.
pub(super) trait Named: Sized {
    /// What the parameters depend on.
    type Of;
    /// Number of values.
    const COUNT: usize;

    /// The parameters.
    fn specs(of: &Self::Of) -> Vec<ParameterSpec>;

    /// The first of these values; zero where there are none, so that a short slice cannot panic.
    fn of(values: &[f64]) -> Self;

    /// These values as a list.
    fn values(&self) -> Vec<f64>;

    /// The same for part `part`, where each part of the platform has its own.
    #[inline]
    fn nth(values: &[f64], part: usize) -> Self {
        Self::of(values.get(part * Self::COUNT..).unwrap_or(&[]))
    }

    /// What follows these values.
    #[inline]
    fn rest(values: &[f64]) -> &[f64] {
        values.get(Self::COUNT..).unwrap_or(&[])
    }
}

/// What a field of named values can be.
pub(super) trait Value: Sized {
    /// What declares its parameters: as many as it has values.
    type Specs;
    /// Number of values.
    const COUNT: usize;

    /// Its parameters as a list.
    fn list(specs: Self::Specs) -> impl IntoIterator<Item = ParameterSpec>;

    /// The first `COUNT` values.
    fn read(values: &[f64]) -> Self;

    /// Adds its values to a list.
    fn write(&self, values: &mut Vec<f64>);
}

impl Value for f64 {
    type Specs = ParameterSpec;
    const COUNT: usize = 1;

    fn list(specs: ParameterSpec) -> impl IntoIterator<Item = ParameterSpec> {
        [specs]
    }

    #[inline]
    fn read(values: &[f64]) -> Self {
        values.first().copied().unwrap_or(0.0)
    }

    fn write(&self, values: &mut Vec<f64>) {
        values.push(*self);
    }
}

impl Value for Vector3<f64> {
    type Specs = [ParameterSpec; 3];
    const COUNT: usize = 3;

    fn list(specs: [ParameterSpec; 3]) -> impl IntoIterator<Item = ParameterSpec> {
        specs
    }

    #[inline]
    fn read(values: &[f64]) -> Self {
        <[f64; 3]>::read(values).into()
    }

    fn write(&self, values: &mut Vec<f64>) {
        values.extend(self);
    }
}

impl<const N: usize> Value for [f64; N] {
    type Specs = [ParameterSpec; N];
    const COUNT: usize = N;

    fn list(specs: [ParameterSpec; N]) -> impl IntoIterator<Item = ParameterSpec> {
        specs
    }

    #[inline]
    fn read(values: &[f64]) -> Self {
        std::array::from_fn(|i| values.get(i).copied().unwrap_or(0.0))
    }

    fn write(&self, values: &mut Vec<f64>) {
        values.extend(self);
    }
}

/// Reads one field and goes on behind it.
#[inline]
pub(super) fn take<V: Value>(rest: &mut &[f64]) -> V {
    let value = V::read(rest);
    *rest = rest.get(V::COUNT..).unwrap_or(&[]);
    value
}

/// Parameters of every wheel: the wheel's name, and behind it the name that `specs` gives.
pub(super) fn per_wheel<N: Named<Of = Wheel>>(model: &PlatformModel) -> Vec<ParameterSpec> {
    let of = |(j, wheel): (usize, &Wheel)| of_part(N::specs(wheel), &wheel.name, Part::Wheel(j));
    model.wheels().iter().enumerate().flat_map(of).collect()
}

/// Parameters of every jet: the jet's name, and behind it the name that `specs` gives.
pub(super) fn per_jet<N: Named<Of = Jet>>(model: &PlatformModel) -> Vec<ParameterSpec> {
    let of = |(j, jet): (usize, &Jet)| of_part(N::specs(jet), &jet.name, Part::Jet(j));
    model.jets().iter().enumerate().flat_map(of).collect()
}

/// Parameters of every control moment gyro: the gyro's name, and behind it the name that `specs` gives.
pub(super) fn per_gyro<N: Named<Of = Gyro>>(model: &PlatformModel) -> Vec<ParameterSpec> {
    let of = |(j, gyro): (usize, &Gyro)| of_part(N::specs(gyro), &gyro.name, Part::Gyro(j));
    model.gyros().iter().enumerate().flat_map(of).collect()
}

fn of_part(specs: Vec<ParameterSpec>, owner: &str, part: Part) -> Vec<ParameterSpec> {
    let own = |spec: ParameterSpec| ParameterSpec { name: format!("{owner}{}", spec.name), part, ..spec };
    specs.into_iter().map(own).collect()
}
