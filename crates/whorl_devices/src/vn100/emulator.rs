//! A VN-100 as it looks from its serial port.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_math::CELSIUS_ZERO_K;

use super::protocol::{FIELDS, Parser, Said, Sample, line};
use super::{INTERNAL_HZ, Vn100};
use crate::emulation::{Emulator, SerialEmulator, Wire, World};

/// From a sample to the first bit of its packet \[ns\]; assumed.
const COMPUTES_NS: i64 = 100_000;
/// Its crystal is fast by this; assumed.
const DRIFT: f64 = 20e-6;
/// The field at the laboratory \[gauss\]; its direction is that of the model's vector sensor.
const FIELD_GAUSS: f64 = 0.5;
/// Air pressure \[kPa\].
const PRESSURE_KPA: f64 = 101.3;

struct Emulated {
    sensor: Vn100,
    parser: Parser,
    /// When it was switched on.
    began_ns: Option<i64>,
    /// Of the binary output: period, and when the next sample is due.
    output: Option<(i64, i64)>,
    field_b: Vector3<f64>,
    field_until_ns: i64,
    vector_period_ns: i64,
}

pub(super) fn new(sensor: &Vn100, model: &PlatformModel) -> Emulator {
    let vector_hz = model.sensors.vector.map_or(1.0, |vector| vector.rate_hz);
    Emulator::Serial {
        port: sensor.port.clone(),
        baud: sensor.baud,
        device: Box::new(Emulated {
            sensor: sensor.clone(),
            parser: Parser::default(),
            began_ns: None,
            output: None,
            field_b: Vector3::x() * FIELD_GAUSS,
            field_until_ns: i64::MIN,
            vector_period_ns: (1e9 / vector_hz) as i64,
        }),
    }
}

impl Emulated {
    /// The answer to a line of text.
    fn answer(&mut self, now_ns: i64, text: &str) -> Option<String> {
        let error = |code: &str| Some(format!("VNERR,{code}"));
        let fields: Vec<&str> = text.split(',').collect();
        match fields.as_slice() {
            ["VNWRG", "06", "0"] => Some(text.to_owned()),
            ["VNWRG", "75", mode, divisor, groups, bits] => {
                let divisor: f64 = divisor.parse().ok().filter(|d| *d >= 1.0)?;
                if *groups != "01" || u16::from_str_radix(bits, 16) != Ok(FIELDS) {
                    return error("07");
                }
                let period_ns = (divisor * 1e9 / INTERNAL_HZ) as i64;
                self.output = (*mode != "0").then_some((period_ns, now_ns + period_ns));
                Some(text.to_owned())
            }
            ["VNWRG", ..] => error("08"),
            _ => error("04"),
        }
    }

    fn sample(&mut self, at_ns: i64, world: &mut World) -> Sample {
        if at_ns >= self.field_until_ns {
            self.field_until_ns = at_ns + self.vector_period_ns;
            if let Some(vector) = world.plant.sample_vector() {
                self.field_b = vector.direction.into_inner() * FIELD_GAUSS;
            }
        }
        let imu = world.plant.sample_imu();
        let own = |vector: &Vector3<f64>| (self.sensor.q_body_sensor.inverse() * vector).into();
        Sample {
            since_start_s: (at_ns - self.began_ns.unwrap_or(at_ns)) as f64 * 1e-9 * (1.0 + DRIFT),
            rate_rad_s: own(&imu.angular_velocity_rad_s),
            specific_force_m_s2: own(&imu.specific_force_m_s2),
            field_gauss: own(&self.field_b),
            temperature_c: world.plant.sample_temperature_k() - CELSIUS_ZERO_K,
            pressure_kpa: PRESSURE_KPA,
        }
    }
}

impl SerialEmulator for Emulated {
    fn switched_on(&mut self, now_ns: i64) {
        (self.began_ns, self.output, self.parser) = (Some(now_ns), None, Parser::default());
    }

    fn byte(&mut self, at_ns: i64, byte: u8, _: &mut World, wire: &mut Wire) {
        self.parser.push(&[byte]);
        while let Some(said) = self.parser.next_said() {
            if let Said::Line(text) = said
                && let Some(answer) = self.answer(at_ns, &text)
            {
                wire.send(at_ns + COMPUTES_NS, &line(&answer));
            }
        }
    }

    fn due_ns(&self) -> Option<i64> {
        self.output.map(|(_, next)| next)
    }

    fn act(&mut self, now_ns: i64, world: &mut World, wire: &mut Wire) {
        let Some((period_ns, next)) = self.output.filter(|(_, next)| *next <= now_ns) else { return };
        self.output = Some((period_ns, next + period_ns));
        world.advance_to(next);
        let sample = self.sample(next, world);
        world.sampled_ns = Some(next);
        wire.send_message(next + self.sensor.latency.as_nanos() as i64 + COMPUTES_NS, sample.packet());
    }
}
