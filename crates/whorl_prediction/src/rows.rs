//! Readings less what is predicted of them in a state.

use nalgebra::Vector3;
use whorl_dynamics::plant::MeanInputs;
use whorl_math::lanes::Sparse;
use whorl_recording::Component;

use crate::commands::Inputs;

/// What a reading shows of the state about a prediction.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    pub component: Component,
    pub track: usize,
    pub sample: usize,
    /// What was read; of a direction NaN.
    pub reading: f64,
    /// Reading less prediction; of a cell the mean.
    pub value: f64,
    /// That of the last reading, in the state of the present instant.
    pub last: f64,
    /// About which a direction's value is an angle, sensor axes.
    axis: Vector3<f64>,
    /// How long before the present instant it was read on average, and the mean square of that \[s\] \[s^2\].
    pub lag_s: f64,
    pub lag_squared_s2: f64,
}

#[derive(Debug, Clone, Default)]
pub(crate) struct Readings {
    pub rows: Vec<Row>,
    /// Derivatives of the readings by the state's coordinates, a row each; none: nobody asked.
    pub by_state: Sparse,
    pub variances: Vec<f64>,
}

impl Readings {
    pub fn clear(&mut self) {
        self.rows.clear();
        self.by_state.clear();
        self.variances.clear();
    }

    pub fn push(
        &mut self,
        (component, variance): (Component, f64),
        (track, sample): (usize, usize),
        (reading, value): (f64, f64),
        axis: Vector3<f64>,
    ) {
        let (last, lag_s, lag_squared_s2) = (value, 0.0, 0.0);
        self.rows.push(Row { component, track, sample, reading, value, last, axis, lag_s, lag_squared_s2 });
        self.variances.push(variance);
        self.by_state.end_row();
    }
}

/// Sums of readings of a cell less their predictions, on the way to its end, one for each component.
#[derive(Debug, Clone, Default)]
pub(crate) struct Collected {
    pub sums: Vec<Sum>,
}

#[derive(Debug, Clone)]
pub(crate) struct Sum {
    /// Of values and lags, of which the samples are the last.
    row: Row,
    pub count: f64,
    /// The same of directions, sensor axes.
    along: Vector3<f64>,
    /// Of squares, and of what inputs were until then, by themselves and times the value.
    pub squares: f64,
    pub inputs: Inputs,
    pub by_input: Inputs,
}

impl Sum {
    pub fn component(&self) -> Component {
        self.row.component
    }

    pub fn value(&self) -> f64 {
        self.row.value
    }
}

impl Collected {
    /// Adds what was read so long before the end \[s\], until when inputs had come to so much, if anybody asks.
    pub fn add(&mut self, readings: &Readings, lag_s: f64, inputs: Option<&Inputs>) {
        for row in &readings.rows {
            let position = self.sums.iter().position(|sum| sum.row.component == row.component);
            let position = position.unwrap_or_else(|| {
                let (row, none) =
                    (Row { value: 0.0, lag_s: 0.0, lag_squared_s2: 0.0, ..*row }, [0.0; MeanInputs::COUNT]);
                let (along, inputs, by_input) = (Vector3::zeros(), none, none);
                self.sums.push(Sum { row, count: 0.0, along, squares: 0.0, inputs, by_input });
                self.sums.len() - 1
            });
            let sum = &mut self.sums[position];
            sum.row.sample = row.sample;
            sum.row.value += row.value;
            sum.row.lag_s += lag_s;
            sum.row.lag_squared_s2 += lag_s * lag_s;
            sum.count += 1.0;
            sum.along += row.axis * row.value;
            sum.squares += row.value * row.value;
            for ((sum, by), x) in
                sum.inputs.iter_mut().zip(&mut sum.by_input).zip(inputs.into_iter().flatten())
            {
                (*sum, *by) = (*sum + x, *by + x * row.value);
            }
        }
    }

    /// The last of each sensor: track and sample.
    pub fn last(&self, due: &mut Vec<(usize, usize)>) {
        due.clear();
        due.extend(self.sums.iter().map(|Sum { row, .. }| (row.track, row.sample)));
        due.sort_unstable_by(|a, b| b.cmp(a));
        due.dedup_by_key(|(track, _)| *track);
        due.reverse();
    }

    /// Means in the place of the last of each.
    pub fn put(&self, readings: &mut Readings) {
        for (row, variance) in readings.rows.iter_mut().zip(&mut readings.variances) {
            let sum = self.sums.iter().find(|sum| sum.row.component == row.component);
            let Some(Sum { row: sum, count, .. }) = sum else { continue };
            let of_track = self.sums.iter().filter(|other| other.row.track == sum.track);
            let along = || of_track.map(|other| other.along.dot(&row.axis)).sum();
            let value: f64 = if row.axis != Vector3::zeros() { along() } else { sum.value };
            row.value = value / count;
            *variance /= count;
            (row.lag_s, row.lag_squared_s2) = (sum.lag_s / count, sum.lag_squared_s2 / count);
        }
    }
}
