//! Watches the axes of a recording's sensors for filters that do not.

use whorl_free_motion::{AxisCheck, Contradiction, Sample, doubts};

/// The axes are looked at after so many samples.
const CHECKED_EVERY: u32 = 100;

/// Finds out whether accelerometer or first vector sensor turn against the gyro.
#[derive(Debug, Clone, Default)]
pub struct AxisWatch {
    axes: AxisCheck,
    samples: u32,
    wrong: [Option<Contradiction>; 2],
}

impl AxisWatch {
    /// Takes a sample; whether the vector sensor is found to be wrong with it.
    pub fn field_turns_out_wrong(&mut self, sample: &Sample) -> bool {
        self.axes.on_imu(sample.stamp_ns, &sample.gyro_rad_s, sample.force_m_s2.as_ref());
        if let Some(seen) = sample.vectors.first().copied().flatten() {
            self.axes.on_field(&seen.body);
        }
        self.samples += 1;
        if self.samples < CHECKED_EVERY {
            return false;
        }
        self.samples = 0;
        let was_wrong = self.field_is_wrong();
        for (wrong, found) in self.wrong.iter_mut().zip(self.axes.contradictions()) {
            *wrong = wrong.take().or(found);
        }
        self.field_is_wrong() && !was_wrong
    }

    /// Whether the vector sensor turns against the gyro.
    #[must_use]
    pub fn field_is_wrong(&self) -> bool {
        let [_, field] = &self.wrong;
        field.is_some()
    }

    /// What contradicts the gyro, in words.
    #[must_use]
    pub fn doubts(&self) -> Vec<String> {
        doubts(&self.wrong)
    }
}
