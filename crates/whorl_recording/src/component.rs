//! Components of samples.

use whorl_bag::{Channel, Form};

/// One component of a channel's samples: an axis, a wheel. Residuals are reported per component.
///
/// Components are in the order of the channels, then of the sensors, then of their own. Of a direction only two
/// components are free: they lie across it, along axes that the caller chooses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Component {
    /// The channel.
    pub channel: Channel,
    sensor: u8,
    index: u8,
}

impl Component {
    /// Component `index` of a sensor; both count from 0, and of channels other than vector sensors there is one
    /// sensor.
    #[must_use]
    pub fn new(channel: Channel, sensor: usize, index: usize) -> Self {
        // Platforms have a few sensors and wheels.
        Self { channel, sensor: sensor as u8, index: index as u8 }
    }

    /// Which sensor, from 0.
    #[must_use]
    pub fn sensor(self) -> usize {
        usize::from(self.sensor)
    }

    /// Which axis, wheel or side, from 0.
    #[must_use]
    pub fn index(self) -> usize {
        usize::from(self.index)
    }

    /// Of a sensor of a channel on a platform with so many wheels.
    pub fn of(channel: Channel, sensor: usize, wheels: usize) -> impl Iterator<Item = Self> {
        let count = match channel.info().form {
            Form::Axes => 3,
            Form::Directions => 2,
            Form::Wheels { .. } => wheels,
            Form::Scalar => 1,
            // Attitudes have no separate components, and pulses are not samples.
            // The motion of gimbals is an input of the model, which predicts none of it.
            Form::Attitude | Form::Pulses | Form::Gimbals { .. } => 0,
        };
        (0..count).map(move |index| Self::new(channel, sensor, index))
    }

    /// Its name: `gyro_x`, `vector_1a`, `wheel_x_speed`. `wheels` names the platform's wheels.
    #[must_use]
    pub fn name<S: AsRef<str>>(self, wheels: &[S]) -> String {
        let name = self.channel.component_name(self.index(), wheels);
        match self.channel.info().form {
            Form::Directions => {
                let side = if self.index == 0 { "a" } else { "b" };
                format!("{name}_{}{side}", self.sensor + 1)
            }
            _ => name,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_named_and_ordered_as_a_report_lists_them() {
        let all = [Channel::WheelSpeed, Channel::Vector, Channel::Gyro, Channel::BusVoltage];
        let mut all: Vec<Component> =
            all.into_iter().flat_map(|channel| Component::of(channel, 0, 2)).collect();
        all.push(Component::new(Channel::Vector, 1, 1));
        all.sort_unstable();
        let names: Vec<String> = all.iter().map(|component| component.name(&["wheel_x"])).collect();
        let expected = [
            "gyro_x",
            "gyro_y",
            "gyro_z",
            "vector_1a",
            "vector_1b",
            "vector_2b",
            "wheel_x_speed",
            "wheel_2_speed",
            "bus_voltage",
        ];
        assert_eq!(names, expected);
    }
}
