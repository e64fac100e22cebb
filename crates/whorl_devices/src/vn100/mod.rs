//! VectorNav VN-100 class inertial sensor over a serial port: rates, specific force, and the magnetic field as the
//! platform's second direction.
//!
//! The session sets two registers (text protocol, UM001 section 4.2): 6, asynchronous text output, to none, and 75, the first
//! binary output, to one group of fields at the model's sensor rate. Both are lost when the sensor is switched off; nothing is
//! written to its permanent memory. The baud rate is set with the maker's program.

mod emulator;
pub mod protocol;
#[cfg(test)]
mod tests;

use std::time::{Duration, Instant};

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_math::{CELSIUS_ZERO_K, rad_from_deg};
use whorl_params::{Reader, range};

use crate::DeviceError;
use crate::bus::{Serial, transmission};
use crate::device::{Address, Device, DeviceKind, Role};
use crate::emulation::Emulator;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::{Measured, Reporter, State};
use crate::timing::DeviceClock;
use protocol::{FIELDS, Parser, Said, Sample, line};

/// Its row in the table.
pub const KIND: DeviceKind = DeviceKind {
    name: "vn100",
    what: "VectorNav VN-100 class inertial sensor, serial: gyro, accelerometer, magnetometer",
    read,
};

/// Rates that the sensor's serial port has (UM001, serial baud rate register).
const BAUD: [i64; 9] = [9600, 19_200, 38_400, 57_600, 115_200, 128_000, 230_400, 460_800, 921_600];
/// Internal rate of the sensor \[Hz\]; outputs are whole fractions of it (4.2).
const INTERNAL_HZ: f64 = 800.0;
/// Time that the sensor has to answer.
const ANSWER: Duration = Duration::from_millis(500);
/// A sensor without a sample for so long is lost.
const SILENT: Duration = Duration::from_millis(250);
/// Temperature changes slowly \[s\].
const TEMPERATURE_PERIOD_S: f64 = 1.0;
/// A magnetic field below this is no direction \[gauss\]; the Earth's is 0.25 to 0.65.
const WEAKEST_FIELD_GAUSS: f64 = 0.05;

/// One sensor.
#[derive(Debug, Clone)]
struct Vn100 {
    port: String,
    baud: u32,
    q_body_sensor: UnitQuaternion<f64>,
    /// From the instant of a sample to the first bit of its packet.
    latency: Duration,
    /// Of the packets.
    rate_hz: f64,
    /// Every so many packets have a direction; `None`: the platform has no vector sensor, or another one.
    direction_every: Option<u32>,
}

fn read(r: &mut Reader<'_>, model: &PlatformModel) -> Option<Box<dyn Device>> {
    let before = r.error_count();
    let port = r.string("port", "serial port, such as /dev/whorl/imu");
    let baud = r.i64_or(
        "baud",
        921_600,
        range(9600..=921_600),
        "rate of the serial port [bit/s], as set in the sensor",
    );
    if !BAUD.contains(&baud) {
        r.reject(
            "baud",
            format!("the sensor has no such rate; allowed: {}", BAUD.map(|b| b.to_string()).join(", ")),
        );
    }
    let angles = r.vector3_or(
        "mounting_deg",
        Vector3::zeros(),
        range(-180.0..=180.0),
        "roll, pitch, yaw of the sensor's axes in the body's (x forward, y left, z up) [deg]; the sensor's own z points out of its \
         bottom: lying flat, it has roll 180",
    );
    let latency_s =
        r.f64_or("latency_s", 0.0, range(0.0..=0.1), "from a sample to the first bit of its packet [s]");
    let magnetometer = r.bool_or(
        "magnetometer_is_vector_sensor",
        true,
        "whether the magnetic field is the direction model.sensors.vector speaks of",
    );
    let rate_hz = model.sensors.rate_hz;
    let divisor = INTERNAL_HZ / rate_hz;
    if (divisor - divisor.round()).abs() > 1e-9 || divisor < 1.0 {
        r.reject(
            "kind",
            format!(
                "model.sensors.rate_hz is {rate_hz}; allowed for this sensor: 800 Hz over a whole number"
            ),
        );
    }
    let baud = u32::try_from(baud).unwrap_or(921_600);
    let busy = rate_hz * transmission(Sample::PACKET_BYTES, baud).as_secs_f64();
    if busy > 0.9 {
        let problem = format!(
            "{rate_hz} packets a second of {} bytes need {:.0} % of this rate; allowed: at most 90 %",
            Sample::PACKET_BYTES,
            busy * 100.0
        );
        r.reject("baud", problem);
    }
    let vector = model.sensors.vector.filter(|_| magnetometer);
    let [roll, pitch, yaw] = [angles.x, angles.y, angles.z].map(rad_from_deg);
    (r.error_count() == before).then(|| {
        Box::new(Vn100 {
            port,
            baud,
            q_body_sensor: UnitQuaternion::from_euler_angles(roll, pitch, yaw),
            latency: Duration::from_secs_f64(latency_s),
            rate_hz,
            direction_every: vector.map(|vector| (rate_hz / vector.rate_hz).round().max(1.0) as u32),
        }) as Box<dyn Device>
    })
}

impl Device for Vn100 {
    fn addresses(&self) -> Vec<Address> {
        vec![Address(self.port.clone())]
    }

    fn path(&self) -> Option<&str> {
        Some(&self.port)
    }

    fn roles(&self) -> Vec<Role> {
        let direction = self.direction_every.map(|_| Role::Direction);
        [Role::Imu, Role::Temperature].into_iter().chain(direction).collect()
    }

    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError> {
        let mut serial = Serial::open(&place.path(&self.port), self.baud)?;
        let mut parser = Parser::default();
        let divisor = (INTERNAL_HZ / self.rate_hz).round();
        self.set(&mut serial, &mut parser, mailbox, "VNWRG,06,0")?;
        self.set(&mut serial, &mut parser, mailbox, &format!("VNWRG,75,1,{divisor},01,{FIELDS:04X}"))?;
        let mut session =
            Session { sensor: self, reporter, clock: DeviceClock::default(), count: 0, ready: false };
        let (mut heard, mut bytes) = (Instant::now(), Vec::new());
        loop {
            let woken = mailbox.wait(Some(serial.fd()), heard + SILENT);
            while mailbox.take().is_some() {}
            if mailbox.is_closed() {
                return Ok(());
            }
            let now = Instant::now();
            if woken.device {
                bytes.clear();
                serial.read(&mut bytes)?;
                parser.push(&bytes);
                while let Some(said) = parser.next_said() {
                    if let Some(sample) = Sample::of(&said) {
                        heard = now;
                        session.sampled(&sample, now);
                    }
                }
                reporter.refused(parser.take_skipped());
            }
            if now >= heard + SILENT {
                return Err(DeviceError::Silent(SILENT.as_secs_f64()));
            }
        }
    }

    fn emulator(&self, model: &PlatformModel) -> Emulator {
        emulator::new(self, model)
    }
}

impl Vn100 {
    /// Writes a register and waits until the sensor has said that it did.
    fn set(
        &self,
        serial: &mut Serial,
        parser: &mut Parser,
        mailbox: &Mailbox,
        text: &str,
    ) -> Result<(), DeviceError> {
        serial.write(&line(text))?;
        let (until, mut bytes) = (Instant::now() + ANSWER, Vec::new());
        while Instant::now() < until && !mailbox.is_closed() {
            if mailbox.wait(Some(serial.fd()), until).device {
                bytes.clear();
                serial.read(&mut bytes)?;
                parser.push(&bytes);
            }
            while mailbox.take().is_some() {}
            while let Some(said) = parser.next_said() {
                match said {
                    Said::Line(answer) if answer.starts_with("VNERR") => {
                        return Err(DeviceError::Refused(format!("{text}: {}", error_words(&answer))));
                    }
                    // The register's number says which command is answered.
                    Said::Line(answer) if answer.get(..8) == text.get(..8) => return Ok(()),
                    Said::Line(_) | Said::Packet { .. } => {}
                }
            }
        }
        Err(DeviceError::Silent(ANSWER.as_secs_f64()))
    }

    fn to_body(&self, vector: [f64; 3]) -> Vector3<f64> {
        self.q_body_sensor * Vector3::from(vector)
    }
}

/// Error codes of the sensor (UM001, system error codes; those that a session can meet).
fn error_words(answer: &str) -> String {
    let code = answer.rsplit(',').next().unwrap_or_default();
    let words = match code.trim_start_matches('0') {
        "3" => "invalid checksum",
        "4" => "invalid command",
        "5" => "not enough parameters",
        "6" => "too many parameters",
        "7" => "invalid parameter",
        "8" => "invalid register",
        "9" => "unauthorized access",
        "C" => "insufficient baud rate",
        _ => return format!("error {code}"),
    };
    format!("error {code}, {words}")
}

/// What a session remembers.
struct Session<'a> {
    sensor: &'a Vn100,
    reporter: &'a Reporter,
    clock: DeviceClock,
    count: u32,
    ready: bool,
}

impl Session<'_> {
    fn sampled(&mut self, sample: &Sample, arrival: Instant) {
        let numbers = [sample.rate_rad_s, sample.specific_force_m_s2].concat();
        if !numbers.into_iter().all(f64::is_finite) {
            return self.reporter.refused(1);
        }
        if !std::mem::replace(&mut self.ready, true) {
            self.reporter.state(State::Ready);
        }
        let usual = self.sensor.latency + transmission(Sample::PACKET_BYTES, self.sensor.baud);
        let at = self.clock.instant(sample.since_start_s, arrival, usual);
        let field = self.sensor.to_body(sample.field_gauss);
        if self.sensor.direction_every.is_some_and(|every| self.count.is_multiple_of(every)) {
            match field.try_normalize(WEAKEST_FIELD_GAUSS).filter(|d| d.iter().all(|x| x.is_finite())) {
                Some(direction) => self.reporter.measured(at, Measured::Direction(direction)),
                None => self.reporter.refused(1),
            }
        }
        if self.count.is_multiple_of((self.sensor.rate_hz * TEMPERATURE_PERIOD_S).max(1.0) as u32) {
            self.reporter.measured(at, Measured::Temperature(sample.temperature_c + CELSIUS_ZERO_K));
        }
        self.count = self.count.wrapping_add(1);
        // Last: it wakes the control loop, which then has the rest as well.
        self.reporter.measured(
            at,
            Measured::Imu {
                rate_b_rad_s: self.sensor.to_body(sample.rate_rad_s),
                specific_force_b_m_s2: self.sensor.to_body(sample.specific_force_m_s2),
            },
        );
    }
}
