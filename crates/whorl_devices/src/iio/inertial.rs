//! Inertial sensors along single axes through Linux's Industrial I/O: gyros and accelerometers of one axis or more, with a
//! driver of their own (`in_anglvel_x`, `in_accel_z`) or analog behind a converter (`in_voltage0`), as the dissertation's
//! MotionPak II (section 4.4). Together with others they make a sensor: see [`crate::logical`].
//!
//! A channel is `(raw + offset) * scale`, in rad/s, m/s^2 or mV (Linux, Documentation/ABI/testing/sysfs-bus-iio). A voltage is
//! made a rate or a specific force by `gain` and `zero`: quantity = zero + gain * volt. Files are read one after the other: a
//! converter with a buffer would sample its channels at one instant, which this does not use.

use std::path::Path;
use std::time::{Duration, Instant};

use nalgebra::{Unit, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_params::{Limits, Reader, any, range};

use super::channel;
use crate::DeviceError;
use crate::device::{Address, Device, DeviceKind, InertialAxes, Role};
use crate::emulation::{Emulator, FileEmulator, World};
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::{Measured, Reporter, State};

/// Its row in the table.
pub const KIND: DeviceKind = DeviceKind {
    name: "iio_inertial",
    what: "gyros and accelerometers along single axes, Linux Industrial I/O: parts of logical.imu",
    read,
};

/// Emulated converters: 16 bit over 5.12 V; 2^-15 of 4 rad/s and of 8 g.
const VOLTAGE_SCALE: f64 = 0.15625;
const RATE_SCALE: f64 = 4.0 / 32768.0;
const FORCE_SCALE: f64 = 80.0 / 32768.0;
const LARGEST: f64 = 32767.0;

#[derive(Debug, Clone)]
struct Converter {
    folder: String,
    inputs: Vec<Input>,
    /// Between readings.
    period: Duration,
    /// Readings of which a sample is the mean.
    oversampling: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Quantity {
    Rate,
    Force,
}

#[derive(Debug, Clone, PartialEq)]
struct Input {
    channel: String,
    quantity: Quantity,
    axis_b: Unit<Vector3<f64>>,
    /// In the quantity's unit.
    zero: f64,
    /// In the quantity's unit per unit of the channel: V, rad/s or m/s^2.
    gain: f64,
    /// In that unit for each step of the raw number's scale.
    factor: f64,
}

fn read(r: &mut Reader<'_>, model: &PlatformModel) -> Option<Box<dyn Device>> {
    let before = r.error_count();
    let folder = channel::folder(r);
    let names = r.children("inputs");
    let inputs: Vec<Input> =
        names.iter().filter_map(|name| r.group("inputs", |r| r.group(name, read_input))).collect();
    if names.is_empty() && r.error_count() == before {
        r.reject(
            "kind",
            "the converter measures nothing; allowed: inputs.<name>.channel for one axis or more",
        );
    }
    for (index, name) in names.iter().enumerate() {
        let channel = |input: Option<&Input>| input.map(|input| input.channel.clone());
        let own = channel(inputs.get(index));
        if inputs.len() == names.len()
            && inputs.iter().take(index).any(|earlier| Some(&earlier.channel) == own.as_ref())
        {
            r.reject(&format!("inputs.{name}.channel"), "another input has this channel; allowed: each once");
        }
    }
    let doc = "each sample is the mean of so many readings, spread over its period: an analog low-pass filter before the \
         converter need then only be below half of their rate";
    let oversampling = r.i64_or("oversampling", 1, range(1..=32), doc);
    let oversampling = u32::try_from(oversampling).unwrap_or(1);
    let period = Duration::from_secs_f64(1.0 / (model.sensors.rate_hz * f64::from(oversampling)));
    (r.error_count() == before)
        .then(|| Box::new(Converter { folder, inputs, period, oversampling }) as Box<dyn Device>)
}

fn read_input(r: &mut Reader<'_>) -> Option<Input> {
    let before = r.error_count();
    let channel = r.string("channel", "name of the channel, such as in_anglvel_x, in_accel_z or in_voltage0");
    let axis_b = r.direction(
        "axis",
        "direction of the sensitive axis, body axes; turned round for a sign that is wrong",
    );
    let kind = |prefix: &str| channel.starts_with(prefix);
    let is_voltage = kind("in_voltage");
    let all: fn() -> Limits<f64> = any;
    let zero = r.f64_or("zero", 0.0, all(), "what is measured when the channel says 0 [rad/s or m/s^2]");
    let gain = if is_voltage {
        r.f64("gain", all(), "rate or specific force per volt [rad/s/V or m/s^2/V]")
    } else {
        r.f64_or("gain", 1.0, all(), "correction of the channel's own scale [1]; of voltages: per volt")
    };
    let quantity = if is_voltage {
        let words = ["angular_rate", "specific_force"];
        let measured = r.choice("measures", &words, "what the voltage means");
        if measured == "specific_force" { Quantity::Force } else { Quantity::Rate }
    } else if kind("in_accel") {
        Quantity::Force
    } else {
        Quantity::Rate
    };
    if !(is_voltage || kind("in_accel") || kind("in_anglvel")) && r.error_count() == before {
        r.reject("channel", "no inertial channel; allowed: in_anglvel_..., in_accel_..., in_voltage...");
    }
    if gain == 0.0 && r.error_count() == before {
        r.reject("gain", "allowed: any number but 0");
    }
    let factor = if is_voltage { 1e-3 } else { 1.0 };
    (r.error_count() == before).then_some(Input { channel, quantity, axis_b, zero, gain, factor })
}

impl Input {
    fn measure(&self, folder: &Path) -> Result<f64, DeviceError> {
        let [raw, offset, scale] = channel::read(folder, &self.channel)?;
        Ok(self.zero + self.gain * (raw + offset) * scale * self.factor)
    }

    /// Of the emulated converter.
    fn scale(&self) -> f64 {
        match self.quantity {
            _ if self.factor < 1.0 => VOLTAGE_SCALE,
            Quantity::Rate => RATE_SCALE,
            Quantity::Force => FORCE_SCALE,
        }
    }
}

impl Converter {
    fn of(&self, quantity: Quantity) -> impl Iterator<Item = &Input> {
        self.inputs.iter().filter(move |input| input.quantity == quantity)
    }

    fn all_of(&self, quantity: Quantity, folder: &Path) -> Result<Vec<f64>, DeviceError> {
        self.of(quantity).map(|input| input.measure(folder)).collect()
    }
}

impl Device for Converter {
    fn addresses(&self) -> Vec<Address> {
        self.inputs.iter().map(|input| channel::address(&self.folder, &input.channel)).collect()
    }

    fn path(&self) -> Option<&str> {
        Some(&self.folder)
    }

    fn roles(&self) -> Vec<Role> {
        vec![Role::InertialAxes]
    }

    fn inertial_axes(&self) -> InertialAxes {
        let axes = |quantity| self.of(quantity).map(|input| input.axis_b).collect();
        InertialAxes { rate_b: axes(Quantity::Rate), force_b: axes(Quantity::Force) }
    }

    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError> {
        let folder = place.path(&self.folder);
        let mut ready = false;
        let mut next = Instant::now();
        let mut mean = Mean::new(self.oversampling);
        while !mailbox.is_closed() {
            let begin = Instant::now();
            let rate_rad_s = self.all_of(Quantity::Rate, &folder)?;
            let specific_force_m_s2 = self.all_of(Quantity::Force, &folder)?;
            // Read one after the other: all of them as of the middle.
            let at = begin + begin.elapsed() / 2;
            if let Some((at, rate_rad_s, specific_force_m_s2)) = mean.add(at, rate_rad_s, specific_force_m_s2)
            {
                reporter.measured(at, Measured::Axes { rate_rad_s, specific_force_m_s2 });
                if !std::mem::replace(&mut ready, true) {
                    reporter.state(State::Ready);
                }
            }
            // What was missed is not made up for.
            next = (next + self.period).max(Instant::now());
            mailbox.idle(next.saturating_duration_since(Instant::now()));
        }
        Ok(())
    }

    fn emulator(&self, _: &PlatformModel) -> Emulator {
        Emulator::Files {
            folder: self.folder.clone(),
            device: Box::new(Emulated { converter: self.clone(), due_ns: i64::MIN }),
        }
    }
}

/// When, rates and specific forces.
type Reading = (Instant, Vec<f64>, Vec<f64>);

/// Readings that become one sample.
struct Mean {
    of: u32,
    readings: Vec<Reading>,
}

impl Mean {
    fn new(of: u32) -> Self {
        Self { of, readings: Vec::new() }
    }

    /// The mean of the readings and of their times, with the last of them.
    fn add(&mut self, at: Instant, rates: Vec<f64>, forces: Vec<f64>) -> Option<Reading> {
        self.readings.push((at, rates, forces));
        let (first, ..) = self.readings.first()?;
        let (first, count) = (*first, u32::try_from(self.readings.len()).ok()?);
        if count < self.of {
            return None;
        }
        let since: Duration = self.readings.iter().map(|(at, ..)| at.saturating_duration_since(first)).sum();
        let mean = |of: fn(&Reading) -> &Vec<f64>| -> Vec<f64> {
            let axes = self.readings.first().map_or(0, |reading| of(reading).len());
            let sum = |axis: usize| self.readings.iter().filter_map(|r| of(r).get(axis)).sum::<f64>();
            (0..axes).map(|axis| sum(axis) / f64::from(count)).collect()
        };
        let sample = (first + since / count, mean(|reading| &reading.1), mean(|reading| &reading.2));
        self.readings.clear();
        Some(sample)
    }
}

/// A converter as its files look.
struct Emulated {
    converter: Converter,
    due_ns: i64,
}

impl FileEmulator for Emulated {
    fn due_ns(&self) -> i64 {
        self.due_ns
    }

    fn act(&mut self, now_ns: i64, world: &mut World) -> Vec<(String, String)> {
        self.due_ns = now_ns + self.converter.period.as_nanos() as i64;
        world.advance_to(now_ns);
        let imu = world.plant.sample_imu();
        let mut files = Vec::new();
        for input in &self.converter.inputs {
            let vector = match input.quantity {
                Quantity::Rate => imu.angular_velocity_rad_s,
                Quantity::Force => imu.specific_force_m_s2,
            };
            let shown = (input.axis_b.dot(&vector) - input.zero) / input.gain / input.factor;
            let raw = (shown / input.scale()).round().clamp(-LARGEST, LARGEST);
            files.push((format!("{}_raw", input.channel), format!("{raw}\n")));
            files.push((format!("{}_scale", input.channel), format!("{}\n", input.scale())));
        }
        world.sampled_ns = Some(now_ns);
        files
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input(channel: &str, quantity: Quantity, zero: f64, gain: f64) -> Input {
        let factor = if channel.starts_with("in_voltage") { 1e-3 } else { 1.0 };
        Input { channel: channel.into(), quantity, axis_b: Vector3::z_axis(), zero, gain, factor }
    }

    /// By hand: 100 of 0.5 mrad/s; and 2.4 V of a gyro with 2.5 V at rest and 0.5 rad/s a volt.
    #[test]
    fn channels_are_rates_and_voltages() {
        let folder = tempfile::tempdir().unwrap();
        let write = |file: &str, text: &str| std::fs::write(folder.path().join(file), text).unwrap();
        write("in_anglvel_z_raw", "100\n");
        write("in_anglvel_scale", "0.0005\n");
        let rate = input("in_anglvel_z", Quantity::Rate, 0.0, 1.0);
        assert!((rate.measure(folder.path()).unwrap() - 0.05).abs() < 1e-12);
        write("in_voltage2_raw", "24000\n");
        write("in_voltage_scale", "0.1\n");
        let analog = input("in_voltage2", Quantity::Rate, -1.25, 0.5);
        assert!((analog.measure(folder.path()).unwrap() + 0.05).abs() < 1e-12);
        let missing = input("in_accel_z", Quantity::Force, 0.0, 1.0);
        assert!(missing.measure(folder.path()).unwrap_err().to_string().contains("in_accel_z_raw"));
    }

    /// By hand: readings at 0, 2, 4 and 6 ms are a sample of 3 ms.
    #[test]
    fn a_sample_is_the_mean_of_its_readings_and_of_their_times() {
        let begin = Instant::now();
        let ms = |ms: u64| begin + Duration::from_millis(ms);
        let mut mean = Mean::new(4);
        for (k, rate) in [1.0, 2.0, 3.0].into_iter().enumerate() {
            assert_eq!(mean.add(ms(2 * k as u64), vec![rate, 0.0], vec![9.0]), None);
        }
        assert_eq!(mean.add(ms(6), vec![6.0, 2.0], vec![13.0]), Some((ms(3), vec![3.0, 0.5], vec![10.0])));
        // The next ones begin anew.
        assert_eq!(mean.add(ms(8), vec![7.0, 0.0], vec![9.0]), None);
        assert_eq!(Mean::new(1).add(ms(1), vec![7.0], vec![]), Some((ms(1), vec![7.0], vec![])));
    }
}
