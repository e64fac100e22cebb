//! Angles of encoders, quantised and wrapping, as rates: of wheels by their motors, of a hinge by its own.

use std::f64::consts::TAU;

use whorl_params::{Reader, range};

use super::error::CsvError;
use super::table::{Column, NO_COLUMN, Table};
use crate::channels::Channel;

/// Keys of angles, and the channel of rates that each becomes.
pub(super) const KEYS: [(&str, Channel); 2] =
    [("wheel_angle", Channel::WheelSpeed), ("hinge_angle", Channel::Gyro)];

/// Columns of angles. Their rate over a time is the change of the angle, wrapped to half a turn from line to line, over that time,
/// and is stamped at its end.
#[derive(Debug, Clone, PartialEq)]
pub struct AngleMap {
    /// What the rates are: of wheels, or of the gyro about one axis.
    pub channel: Channel,
    /// Columns in the order of the channel, [`NO_COLUMN`] for an axis without one.
    pub columns: Vec<String>,
    /// What a column counts in a turn.
    pub per_turn: f64,
    /// Whether the angle begins anew after a turn.
    pub wraps: bool,
    /// Time over which a rate is taken \[ns\]; 0: from line to line.
    pub over_ns: i64,
}

/// Reads the group of an angle; `columns` are those of wheels, of a hinge the axis is read.
pub(super) fn read(r: &mut Reader<'_>, channel: Channel, wheels: Option<Vec<String>>) -> AngleMap {
    let columns = wheels.unwrap_or_else(|| {
        let column = r.string("column", "name of the column of the hinge's angle");
        let axis =
            r.choice_or("axis", "z", &["x", "y", "z"], "body axis of the hinge, right-handed about it");
        ["x", "y", "z"].map(|name| if name == axis { column.clone() } else { NO_COLUMN.to_owned() }).to_vec()
    });
    let unit = r.choice_or("unit", "rad", &["rad", "deg", "rev", "counts"], "unit of the angle");
    let per_turn = match unit {
        "deg" => 360.0,
        "rev" => 1.0,
        "counts" => {
            r.f64("counts_per_turn", range(1.0..=1e9), "what the encoder counts in a turn, all edges")
        }
        _ => TAU,
    };
    let wraps = r.bool_or(
        "wraps",
        true,
        "whether the angle begins anew after a turn; then it turns by less than half of one from line to line",
    );
    let over_s = r.f64_or(
        "over_s",
        0.0,
        range(0.0..=10.0),
        "time over which a rate is taken: longer has less noise of the steps; 0: from line to line [s]",
    );
    AngleMap { channel, columns, per_turn, wraps, over_ns: (over_s * 1e9).round() as i64 }
}

/// Rates of the angles in a file, line by line.
pub(super) struct Rates {
    map: AngleMap,
    columns: Vec<Option<Column>>,
    /// Of the latest line with angles.
    last: Option<Vec<f64>>,
    /// When the present time began \[ns\], and how far each has turned since.
    since_ns: i64,
    turned: Vec<f64>,
}

impl Rates {
    pub fn find(table: &Table, map: &AngleMap) -> Result<Self, CsvError> {
        let find = |name: &String| (name != NO_COLUMN).then(|| table.column(name)).transpose();
        let columns: Vec<Option<Column>> = map.columns.iter().map(find).collect::<Result<_, _>>()?;
        let turned = vec![0.0; columns.len()];
        Ok(Self { map: map.clone(), columns, last: None, since_ns: 0, turned })
    }

    pub fn channel(&self) -> Channel {
        self.map.channel
    }

    /// Rates up to the present line [rad/s], NaN of an axis without a column; `None` where there is no angle, or too little time
    /// has passed.
    pub fn numbers(&mut self, table: &Table, time_ns: i64) -> Result<Option<Vec<f64>>, CsvError> {
        let mut angles = Vec::with_capacity(self.columns.len());
        let mut is_whole = true;
        for column in &self.columns {
            match column.map(|column| table.number(column)).transpose()? {
                None => angles.push(f64::NAN),
                Some(Some(angle)) => angles.push(angle),
                Some(None) => is_whole = false,
            }
        }
        if !is_whole {
            return Ok(None);
        }
        let Some(last) = self.last.replace(angles.clone()) else {
            self.since_ns = time_ns;
            return Ok(None);
        };
        let turn = self.map.per_turn;
        for (turned, (now, before)) in self.turned.iter_mut().zip(angles.iter().zip(&last)) {
            let change = now - before;
            *turned += if self.map.wraps { change - turn * (change / turn).round() } else { change };
        }
        let passed_ns = time_ns.saturating_sub(self.since_ns);
        if passed_ns <= 0 || passed_ns < self.map.over_ns {
            return Ok(None);
        }
        self.since_ns = time_ns;
        let per_s = TAU / turn / (passed_ns as f64 * 1e-9);
        Ok(Some(self.turned.iter_mut().map(|turned| std::mem::take(turned) * per_s).collect()))
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;
    use std::fmt::Write as _;

    use super::super::{CsvMap, CsvRows};

    fn rates(map: &str, text: &str) -> Vec<(i64, Vec<f64>)> {
        let folder = tempfile::tempdir().unwrap();
        let [csv, yaml] = ["a.csv", "map.yaml"].map(|name| folder.path().join(name));
        std::fs::write(&csv, text).unwrap();
        std::fs::write(&yaml, map).unwrap();
        let map = CsvMap::load(&yaml).unwrap();
        let channel = map.angles[0].channel;
        let mut rows = CsvRows::open(&csv, &map).unwrap();
        let mut all = Vec::new();
        while let Some(row) = rows.next_row().unwrap() {
            all.extend(row.numbers.get(&channel).map(|numbers| (row.time_ns, numbers.clone())));
        }
        all
    }

    /// An encoder of 4096 counts a turn that turns at 3 turns a second, forwards and backwards, and wraps.
    #[test]
    fn a_wrapping_encoder_gives_the_rate_to_its_step() {
        for sign in [1.0, -1.0] {
            let mut text = "t,enc\n".to_owned();
            for k in 0..500 {
                let t = f64::from(k) * 0.01;
                let counts = (sign * 3.0 * t * 4096.0).floor().rem_euclid(4096.0);
                let _ = writeln!(text, "{t:.2},{counts}");
            }
            let map = "csv: {time: {column: t}, wheel_angle: {columns: [enc], unit: counts, counts_per_turn: 4096}}";
            let found = rates(map, &text);
            assert_eq!(found.len(), 499);
            for (at_ns, numbers) in &found {
                // A count in 10 ms.
                assert!(
                    (numbers[0] - sign * 3.0 * TAU).abs() <= TAU / 4096.0 / 0.01 + 1e-9,
                    "{at_ns} {numbers:?}"
                );
            }
            let over = map.replace("counts_per_turn", "over_s: 0.25, counts_per_turn");
            let found = rates(&over, &text);
            assert_eq!(found.len(), 19);
            assert!(found.iter().all(|(_, n)| (n[0] - sign * 3.0 * TAU).abs() <= TAU / 4096.0 / 0.25 + 1e-9));
        }
    }

    #[test]
    fn a_hinge_is_a_gyro_of_one_axis_with_lines_of_its_own() {
        let text = "t,a,x\n0.0,359.0,\n0.1,,1\n0.2,1.0,\n0.3,,1\n0.4,4.0,\n";
        let found = rates("csv: {time: {column: t}, hinge_angle: {column: a, axis: y, unit: deg}}", text);
        let [(first_ns, first), (second_ns, second)] = &found[..] else { panic!("{found:?}") };
        assert_eq!((*first_ns, *second_ns), (200_000_000, 400_000_000));
        assert!((first[1] - 10f64.to_radians()).abs() < 1e-12 && first[0].is_nan() && first[2].is_nan());
        assert!((second[1] - 15f64.to_radians()).abs() < 1e-12);
        let unwrapped =
            "csv: {time: {column: t}, hinge_angle: {column: a, axis: y, unit: deg, wraps: false}}";
        assert!((rates(unwrapped, text)[0].1[1] + 1790f64.to_radians()).abs() < 1e-9);
    }

    #[test]
    fn an_angle_beside_a_rate_is_refused() {
        let tree = "csv: {time: {column: t}, wheel_speed: {columns: [n]}, wheel_angle: {columns: [a]}}";
        let folder = tempfile::tempdir().unwrap();
        let yaml = folder.path().join("map.yaml");
        std::fs::write(&yaml, tree).unwrap();
        let error = CsvMap::load(&yaml).unwrap_err().to_string();
        assert!(error.contains("wheel_speed is given as well"), "{error}");
    }
}
