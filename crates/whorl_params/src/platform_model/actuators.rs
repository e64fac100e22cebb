//! Wheels, jets, gas and the electrical bus.

use nalgebra::Vector3;
use whorl_dynamics::platform::{BusVoltage, Jet, Tank, Wheel};

use super::sensors::ROOM_K;
use crate::limits::{any, non_negative, positive, range};
use crate::reader::Reader;

/// Specific gas constant of nitrogen.
const NITROGEN_J_KG_K: f64 = 296.8;

/// Wheels in file order. A value that all wheels share may stand once, in `wheel_defaults`.
pub(super) fn wheels(r: &mut Reader<'_>) -> Vec<Wheel> {
    let names = r.children("wheels");
    let shared = Shared { group: "wheel_defaults", is_used: !names.is_empty() };
    names
        .into_iter()
        .map(|name| {
            let member = format!("wheels.{name}");
            Wheel {
                spin_axis_b: r.direction(
                    &format!("{member}.spin_axis"),
                    "spin axis, body axes; positive speed is right-handed about it",
                ),
                spin_inertia_kg_m2: shared.f64(
                    r,
                    &member,
                    "spin_inertia_kg_m2",
                    positive(),
                    "inertia about the spin axis [kg m^2]",
                ),
                max_torque_n_m: shared.f64(
                    r,
                    &member,
                    "max_torque_n_m",
                    positive(),
                    "largest motor torque, either sign [N m]",
                ),
                max_speed_rad_s: shared.f64(
                    r,
                    &member,
                    "max_speed_rad_s",
                    positive(),
                    "largest speed relative to the body [rad/s]",
                ),
                viscous_friction_n_m_s: shared.f64_or_zero(
                    r,
                    &member,
                    "viscous_friction_n_m_s",
                    non_negative(),
                    "viscous drag of bearing and motor [N m s]",
                ),
                coulomb_friction_n_m: shared.f64_or_zero(
                    r,
                    &member,
                    "coulomb_friction_n_m",
                    non_negative(),
                    "Coulomb drag [N m]",
                ),
                name,
            }
        })
        .collect()
}

/// Jets in file order. A value that all jets share may stand once, in `jet_defaults`.
pub(super) fn jets(r: &mut Reader<'_>) -> Vec<Jet> {
    let names = r.children("jets");
    let shared = Shared { group: "jet_defaults", is_used: !names.is_empty() };
    let delay = || range(0.0..=1.0);
    names
        .into_iter()
        .map(|name| {
            let member = format!("jets.{name}");
            let position_b_m: Vector3<f64> = r.vector3(
                &format!("{member}.position_m"),
                any(),
                "nozzle from the centre of rotation, body axes [m]",
            );
            Jet {
                position_b_m,
                force_direction_b: r.direction(
                    &format!("{member}.force_direction"),
                    "force on the platform, opposite to the plume, body axes",
                ),
                thrust_n: shared.f64(
                    r,
                    &member,
                    "thrust_n",
                    positive(),
                    "thrust at the reference pressure [N]",
                ),
                min_on_time_s: shared.f64_or_zero(
                    r,
                    &member,
                    "min_on_time_s",
                    delay(),
                    "shortest pulse of the valve [s]",
                ),
                opening_delay_s: shared.f64_or_zero(
                    r,
                    &member,
                    "opening_delay_s",
                    delay(),
                    "from the command to full thrust [s]",
                ),
                closing_delay_s: shared.f64_or_zero(
                    r,
                    &member,
                    "closing_delay_s",
                    delay(),
                    "from the end of the command to no thrust [s]",
                ),
                name,
            }
        })
        .collect()
}

/// A group of values that the members of a list share.
struct Shared {
    group: &'static str,
    is_used: bool,
}

impl Shared {
    /// The member's own value, else the shared one. The overlay decides between model and truth
    /// for each of the two keys, so a model's own value of one member stands above a shared value
    /// of the truth.
    fn f64(&self, r: &mut Reader<'_>, member: &str, key: &str, limits: crate::Limits<f64>, doc: &str) -> f64 {
        let own = format!("{member}.{key}");
        let common = format!("{}.{key}", self.group);
        let shared = self.is_used.then(|| r.optional_f64(&common, limits, doc)).flatten();
        // `has` and not the value: a shared value that was refused is reported once, as itself.
        if r.has(&own) || !r.has(&common) {
            r.f64(&own, limits, doc)
        } else {
            r.optional_f64(&own, limits, doc).or(shared).unwrap_or_else(|| limits.placeholder())
        }
    }

    /// As [`Shared::f64`]; zero where neither the member nor the group says a value.
    fn f64_or_zero(
        &self,
        r: &mut Reader<'_>,
        member: &str,
        key: &str,
        limits: crate::Limits<f64>,
        doc: &str,
    ) -> f64 {
        let own = format!("{member}.{key}");
        if r.has(&own) || r.has(&format!("{}.{key}", self.group)) {
            self.f64(r, member, key, limits, doc)
        } else {
            r.f64_or(&own, 0.0, limits, doc)
        }
    }
}

/// A platform without the group has a supply that neither falls nor runs out.
pub(super) fn tank(r: &mut Reader<'_>) -> Tank {
    if !r.has("tank") {
        return Tank {
            volume_m3: 1.0e3,
            initial_pressure_pa: 1.0e6,
            reference_pressure_pa: 1.0e6,
            thrust_pressure_exponent: 0.0,
            temperature_k: ROOM_K,
            gas_constant_j_kg_k: NITROGEN_J_KG_K,
            specific_impulse_s: 60.0,
        };
    }
    r.group("tank", |r| Tank {
        volume_m3: r.f64("volume_m3", positive(), "volume of the tank [m^3]"),
        initial_pressure_pa: r.f64("initial_pressure_pa", positive(), "pressure at the start of a run [Pa]"),
        reference_pressure_pa: r.f64(
            "reference_pressure_pa",
            positive(),
            "tank pressure at which jets give their nominal thrust [Pa]",
        ),
        thrust_pressure_exponent: r.f64(
            "thrust_pressure_exponent",
            range(0.0..=2.0),
            "exponent of thrust over tank pressure: 0 = perfect regulator, 1 = plain blow-down",
        ),
        temperature_k: r.f64_or("temperature_k", ROOM_K, positive(), "gas temperature [K]"),
        gas_constant_j_kg_k: r.f64_or(
            "gas_constant_j_kg_k",
            NITROGEN_J_KG_K,
            positive(),
            "specific gas constant [J/(kg K)]",
        ),
        specific_impulse_s: r.f64("specific_impulse_s", positive(), "specific impulse of the jets [s]"),
    })
}

/// A platform without the group has a steady supply.
pub(super) fn bus(r: &mut Reader<'_>) -> BusVoltage {
    if !r.has("bus") {
        return BusVoltage { initial_v: 24.0, discharge_v_s: 0.0, sag_v_n_m: 0.0 };
    }
    r.group("bus", |r| BusVoltage {
        initial_v: r.f64("initial_v", positive(), "bus voltage at the start of a run [V]"),
        discharge_v_s: r.f64_or("discharge_v_s", 0.0, non_negative(), "fall of the bus voltage [V/s]"),
        sag_v_n_m: r.f64_or("sag_v_n_m", 0.0, non_negative(), "drop per total wheel torque [V/(N m)]"),
    })
}
