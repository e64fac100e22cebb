//! Samples as the page draws them: columns of numbers, thinned without losing peaks, and what is to be said of stretches.

use std::path::Path;
use std::sync::Arc;

use whorl_bag::{Channel, Form};
use whorl_commands::runs::{RunSources, is_csv};
use whorl_math::noise::{from_second_differences, typical_step_s};
use whorl_recording::{KnownPlatform, Recording, usable_readings};

use crate::api::{AskSeries, Mark, SeriesHead, SignalRow};
use crate::marks::{gaps, held, left_out, rests};

/// Lines of a CSV file without a map that are looked at: an hour at 100 Hz.
const LOOKED_AT: usize = 360_000;
/// Columns of such a file that are drawn.
const MOST_SIGNALS: usize = 60;
/// Largest number of numbers of a signal in an answer, and the least.
const MOST: usize = 400_000;
const LEAST: usize = 200;
/// One signal.
#[derive(Debug, Clone)]
struct Signal {
    name: String,
    group: String,
    unit: String,
    time_s: Arc<Vec<f64>>,
    value: Vec<f32>,
    holds: bool,
    noise: Option<f64>,
}

/// The samples of a recording.
#[derive(Debug, Clone)]
pub struct Columns {
    is_mapped: bool,
    signals: Vec<Signal>,
    marks: Vec<Mark>,
    remarks: Vec<String>,
}

impl Columns {
    /// Of a recording with its map and model; of a CSV file that these do not read the columns as they are, with the reason.
    ///
    /// # Errors
    /// When it is no recording.
    pub fn read(path: &Path, sources: &RunSources) -> anyhow::Result<Self> {
        let mapped = || -> anyhow::Result<Self> {
            let known = sources.read_model()?;
            let recording = sources.recording(path, &known)?;
            Ok(Self::of(&recording, &known))
        };
        match mapped() {
            Ok(columns) => Ok(columns),
            Err(why) if is_csv(path) => Self::plain(path, sources.channels.is_some().then_some(why)),
            Err(why) => Err(why),
        }
    }

    /// Whether units and axes are known.
    pub fn is_mapped(&self) -> bool {
        self.is_mapped
    }

    /// The columns of a CSV file as they are.
    fn plain(path: &Path, why: Option<anyhow::Error>) -> anyhow::Result<Self> {
        let look = whorl_bag::look(path, LOOKED_AT)?;
        let is_number = |column: &&whorl_bag::LookedColumn| column.present().next().is_some();
        let columns: Vec<&whorl_bag::LookedColumn> = look.columns.iter().filter(is_number).collect();
        if columns.is_empty() {
            anyhow::bail!("{}: no column holds a number: this is no recording", path.display());
        }
        // The first column that only grows is the time; the map will say it for certain.
        let grows = |column: &&&whorl_bag::LookedColumn| {
            let numbers = &column.numbers;
            numbers.len() > 2 && numbers.windows(2).all(|two| matches!(two, [a, b] if b > a))
        };
        let clock = columns.iter().find(grows);
        let scale = clock.map_or(1.0, |column| seconds_of(&column.numbers));
        let start = clock.and_then(|column| column.numbers.first().copied()).unwrap_or(0.0);
        let time_s: Vec<f64> = match clock {
            Some(column) => column.numbers.iter().map(|t| (t - start) * scale).collect(),
            None => (0..look.lines).map(|k| k as f64).collect(),
        };
        let time_s = Arc::new(time_s);
        let signal = |column: &&whorl_bag::LookedColumn| Signal {
            name: column.name.clone(),
            group: column.name.clone(),
            unit: "as in the file".to_owned(),
            time_s: Arc::clone(&time_s),
            value: column.numbers.iter().map(|x| *x as f32).collect(),
            holds: false,
            noise: None,
        };
        let is_clock =
            |column: &&whorl_bag::LookedColumn| clock.is_some_and(|clock| std::ptr::eq(*clock, *column));
        let signals: Vec<Signal> =
            columns.iter().filter(|column| !is_clock(column)).take(MOST_SIGNALS).map(signal).collect();
        let why = why.map(|why| {
            format!(
                "Drawn as in the file, as the chosen map and model do not read it: {}",
                whorl_commands::in_words(&why)
            )
        });
        Ok(Self { is_mapped: false, signals, marks: gaps(&time_s, ""), remarks: why.into_iter().collect() })
    }

    /// Every component of every channel.
    fn of(recording: &Recording, known: &KnownPlatform) -> Self {
        let wheels: Vec<&str> = known.model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
        let (mut signals, mut marks) = (Vec::new(), Vec::new());
        let (usable, of_readings) = usable_readings(recording, &known.model);
        for (channel, sensor, series) in recording.sampled() {
            let info = channel.info();
            let group = if channel.most_sensors() > 1 && sensor > 0 {
                format!("{} {}", channel, sensor + 1)
            } else {
                channel.to_string()
            };
            let (unit, factor) =
                if info.form == Form::Directions { ("1", 1.0) } else { channel.shown_unit() };
            let time_s = Arc::new(series.time_s().to_vec());
            let lacks = recording.lacks(channel);
            let parts = series.numbers(0).len();
            let of_part = |index: usize| -> Vec<f64> {
                (0..time_s.len()).map(|k| series.number(k, index).unwrap_or(f64::NAN)).collect()
            };
            let measured: Vec<usize> = (0..parts).filter(|index| lacks.get(*index) != Some(&true)).collect();
            let values: Vec<Vec<f64>> = measured.iter().map(|index| of_part(*index)).collect();
            let noise: Vec<Option<f64>> =
                values.iter().map(|values| from_second_differences(values)).collect();
            marks.extend(gaps(&time_s, &group));
            if info.is_motion {
                marks.extend(held(&time_s, &values, &noise, &group));
            }
            let used = match channel {
                Channel::Gyro => Some(&usable.gyro_b_rad_s.time_s),
                Channel::Accelerometer => Some(&usable.specific_force_b_m_s2.time_s),
                _ => None,
            };
            marks.extend(used.into_iter().flat_map(|used| left_out(&time_s, used, &group)));
            if channel == Channel::Gyro {
                marks.extend(rests(&time_s, &values, &noise));
            }
            for ((index, values), noise) in measured.iter().zip(&values).zip(&noise) {
                signals.push(Signal {
                    name: part_name(channel, sensor, *index, &wheels),
                    group: group.clone(),
                    unit: unit.to_owned(),
                    time_s: Arc::clone(&time_s),
                    value: values.iter().map(|x| (x * factor) as f32).collect(),
                    holds: info.is_held,
                    noise: noise.map(|noise| noise * factor),
                });
            }
        }
        signals.extend(jets(recording, known));
        let mut remarks = recording.remarks.clone();
        remarks.extend(of_readings);
        remarks.extend(recording.suspicions(Some(&known.model)));
        remarks.extend(recording.missing_channels(&known.model));
        remarks.extend(recording.gaps());
        Self { is_mapped: true, signals, marks, remarks }
    }

    /// Head and numbers of an answer, see [`SignalRow`].
    pub fn answer(&self, asked: &AskSeries) -> Vec<u8> {
        let ends = self.signals.iter().filter_map(|s| Some((s.time_s.first()?, s.time_s.last()?)));
        let span =
            ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], (from, to)| [a.min(*from), b.max(*to)]);
        let span_s = if span[0] <= span[1] { span } else { [0.0, 0.0] };
        let most = asked.most.clamp(LEAST, MOST);
        let (from, to) = (asked.from_s.unwrap_or(span_s[0]), asked.to_s.unwrap_or(span_s[1]));
        let (mut numbers, mut is_thinned) = (Vec::new(), false);
        let mut rows = Vec::new();
        let mut last: Option<(*const Vec<f64>, usize, usize)> = None;
        for signal in &self.signals {
            let time_s = signal.time_s.as_slice();
            // One more on either side: lines go on to the edge.
            let begin = time_s.partition_point(|t| *t < from).saturating_sub(1);
            let end = (time_s.partition_point(|t| *t <= to) + 1).min(time_s.len()).max(begin);
            let (times, values) =
                (time_s.get(begin..end).unwrap_or(&[]), signal.value.get(begin..end).unwrap_or(&[]));
            let stretch = times.len().div_ceil(most / 2).max(1);
            let whole = times.len() <= most;
            is_thinned |= !whole;
            // Signals of one channel share their times.
            let (times_at, count) = match last {
                Some((of, at, count)) if of == Arc::as_ptr(&signal.time_s) => (at, count),
                _ => {
                    let at = numbers.len();
                    let kept: Vec<f64> = if whole { times.to_vec() } else { thinned_times(times, stretch) };
                    numbers.extend(kept.iter().flat_map(|t| t.to_le_bytes()));
                    (at, kept.len())
                }
            };
            last = Some((Arc::as_ptr(&signal.time_s), times_at, count));
            let values_at = numbers.len();
            if whole {
                numbers.extend(values.iter().flat_map(|v| v.to_le_bytes()));
            } else {
                numbers.extend(thinned_values(values, stretch).iter().flat_map(|v| v.to_le_bytes()));
            }
            numbers.resize(numbers.len().next_multiple_of(8), 0);
            rows.push(SignalRow {
                name: signal.name.clone(),
                group: signal.group.clone(),
                unit: signal.unit.clone(),
                count,
                times_at,
                values_at,
                holds: signal.holds,
                noise: signal.noise,
            });
        }
        let head = SeriesHead {
            file: asked.file.clone(),
            is_mapped: self.is_mapped,
            span_s,
            is_thinned,
            signals: rows,
            marks: self.marks.clone(),
            remarks: self.remarks.clone(),
        };
        let mut head = serde_json::to_vec(&head).unwrap_or_default();
        head.resize((head.len() + 4).next_multiple_of(8) - 4, b' ');
        let length = u32::try_from(head.len()).unwrap_or(0).to_le_bytes();
        [length.as_slice(), &head, &numbers].concat()
    }
}

/// Seconds in a unit of a clock, by the usual step: samples come every second or more often.
fn seconds_of(numbers: &[f64]) -> f64 {
    let step = typical_step_s(numbers);
    [1.0, 1e-3, 1e-6, 1e-9].into_iter().find(|unit| step * unit <= 1.0).unwrap_or(1.0)
}

fn part_name(channel: Channel, sensor: usize, index: usize, wheels: &[&str]) -> String {
    let name = channel.component_name(index, wheels);
    match channel.info().form {
        Form::Directions => format!("{name}_{}_{}", sensor + 1, ["x", "y", "z"].get(index).unwrap_or(&"")),
        Form::Attitude => format!("{name}_{}", ["w", "x", "y", "z"].get(index).unwrap_or(&"")),
        _ => name,
    }
}

/// Valves as steps between shut and open.
fn jets(recording: &Recording, known: &KnownPlatform) -> Vec<Signal> {
    let names = known.model.jets().iter().map(|jet| jet.name.as_str());
    let of_jet = |(name, pulses): (&str, &Vec<whorl_recording::OnInterval>)| {
        let steps =
            pulses.iter().flat_map(|p| [(p.on_s, 0.0), (p.on_s, 1.0), (p.off_s, 1.0), (p.off_s, 0.0)]);
        let (time_s, value): (Vec<f64>, Vec<f32>) = steps.unzip();
        Signal {
            name: name.to_owned(),
            group: "jets".to_owned(),
            unit: "open".to_owned(),
            time_s: Arc::new(time_s),
            value,
            holds: true,
            noise: None,
        }
    };
    names.zip(&recording.jet_pulses).map(of_jet).filter(|signal| !signal.value.is_empty()).collect()
}

/// First and last time of each stretch, for its smallest and its largest value.
fn thinned_times(times: &[f64], stretch: usize) -> Vec<f64> {
    times.chunks(stretch).flat_map(|c| [c.first(), c.last()].into_iter().flatten().copied()).collect()
}

/// Smallest and largest value of each stretch, in the order in which they come.
fn thinned_values(values: &[f32], stretch: usize) -> Vec<f32> {
    let of = |chunk: &[f32]| {
        let (mut low, mut high) = ((0, f32::INFINITY), (0, f32::NEG_INFINITY));
        for (k, v) in chunk.iter().enumerate() {
            if *v < low.1 {
                low = (k, *v);
            }
            if *v > high.1 {
                high = (k, *v);
            }
        }
        match (low.1 <= high.1, low.0 <= high.0) {
            (false, _) => [f32::NAN, f32::NAN],
            (true, true) => [low.1, high.1],
            (true, false) => [high.1, low.1],
        }
    };
    values.chunks(stretch).flat_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(time_s: Vec<f64>, value: Vec<f32>) -> Columns {
        let signal = Signal {
            name: "gyro_x".to_owned(),
            group: "gyro".to_owned(),
            unit: "deg/s".to_owned(),
            time_s: Arc::new(time_s),
            value,
            holds: false,
            noise: None,
        };
        Columns { is_mapped: true, signals: vec![signal], marks: Vec::new(), remarks: Vec::new() }
    }

    fn read(answer: &[u8]) -> (serde_json::Value, Vec<f64>, Vec<f32>) {
        let length = u32::from_le_bytes(answer[..4].try_into().unwrap()) as usize;
        assert_eq!((4 + length) % 8, 0);
        let head: serde_json::Value = serde_json::from_slice(&answer[4..4 + length]).unwrap();
        let data = &answer[4 + length..];
        let number = |key: &str| head["signals"][0][key].as_u64().unwrap() as usize;
        let (count, times, values) = (number("count"), number("times_at"), number("values_at"));
        let t = data[times..times + 8 * count].chunks(8).map(|b| f64::from_le_bytes(b.try_into().unwrap()));
        let v = data[values..values + 4 * count].chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap()));
        let numbers = (t.collect(), v.collect());
        (head, numbers.0, numbers.1)
    }

    fn asked(from_s: Option<f64>, to_s: Option<f64>, most: usize) -> AskSeries {
        AskSeries { file: "a.csv".to_owned(), from_s, to_s, most }
    }

    #[test]
    fn what_is_thinned_keeps_its_peaks_and_a_part_of_it_is_whole() {
        let time_s: Vec<f64> = (0..60_000).map(|k| f64::from(k) * 0.01).collect();
        let value = (0..60_000).map(|k| if k == 31_415 { 9.0 } else { (k as f32 * 0.01).sin() }).collect();
        let columns = columns(time_s, value);
        let (head, t, v) = read(&columns.answer(&asked(None, None, 2_000)));
        assert_eq!((head["is_thinned"].as_bool(), t.len()), (Some(true), v.len()));
        assert!(v.len() <= 2_000 && t.windows(2).all(|w| w[0] <= w[1]), "{}", v.len());
        let peak = v.iter().position(|v| *v == 9.0).unwrap();
        assert!((t[peak] - 314.15).abs() < 0.7, "{}", t[peak]);
        assert!(v.contains(&-1.0) || v.iter().any(|v| *v < -0.999_9), "and its valleys");
        let (head, t, v) = read(&columns.answer(&asked(Some(314.0), Some(314.3), 2_000)));
        assert_eq!(head["is_thinned"].as_bool(), Some(false));
        // One more on either side.
        assert!(t[0] < 314.0 && t[1] >= 314.0 && *t.last().unwrap() > 314.3 && t.len() < 36, "{t:?}");
        assert!(v.contains(&9.0));
        assert_eq!(head["span_s"], serde_json::json!([0.0, 599.99]));
    }

    #[test]
    fn a_file_without_a_map_is_drawn_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.csv");
        let lines: String = (0..50).map(|k| format!("{},{},word\n", 1_000_000 + k * 10_000, k * k)).collect();
        std::fs::write(&path, format!("time_us,gx,name\n{lines}")).unwrap();
        let columns = Columns::read(&path, &RunSources::default()).unwrap();
        let (head, t, v) = read(&columns.answer(&asked(None, None, 1_000)));
        assert_eq!((&head["signals"][0]["name"], head["is_mapped"].as_bool()), (&"gx".into(), Some(false)));
        assert_eq!((t.len(), v[49]), (50, 2_401.0));
        assert!((t[49] - 0.49).abs() < 1e-9, "{}", t[49]);
        std::fs::write(&path, "Dear Sir,\nthis is a letter,\nand no recording,\n").unwrap();
        assert!(Columns::read(&path, &RunSources::default()).is_err());
    }
}
