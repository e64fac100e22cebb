//! A figure, drawn in the reader's browser by uPlot. No other file knows how a figure is stored in a page.

use serde_json::{Map, Value, json};

use crate::series::Curve;

/// Largest number of points per curve; longer curves are thinned without losing peaks.
const POINTS: usize = 2400;
/// Number of line colours (Okabe-Ito, set in `page.css`), which can be told apart in grey and by colour-blind readers.
const COLOURS: usize = 8;
/// Colour of the word "x", "y" or "z" in the name of a curve.
const AXES: [&str; 3] = ["x", "y", "z"];

/// A line across a figure that the curves are meant to stay below or above.
#[derive(Debug, Clone, PartialEq)]
pub struct Limit {
    /// What it limits, in a few words.
    pub name: String,
    /// In the figure's unit.
    pub value: f64,
}

/// A stretch of the horizontal axis in which something happens.
#[derive(Debug, Clone, PartialEq)]
pub struct Span {
    /// What happens, in a few words.
    pub name: String,
    /// Where it begins and ends, in the axis's unit.
    pub from_to: [f64; 2],
    /// Position of the solid curve whose colour it has.
    pub curve: usize,
}

/// A figure to be drawn.
#[derive(Debug, Clone, Default)]
pub struct Figure {
    /// Heading above it.
    pub title: String,
    /// One sentence on how to read it.
    pub caption: String,
    /// Quantity and unit on the vertical axis.
    pub y_label: String,
    /// Solid curves.
    pub curves: Vec<Curve>,
    /// Dashed curves, coloured like the solid curve of the same position.
    pub dashed: Vec<Curve>,
    /// Bands drawn as shaded areas, coloured like the solid curve of the same position: lower and upper edge.
    pub bands: Vec<(Curve, Curve)>,
    /// Lines at fixed values; drawn where the curves come near them.
    pub limits: Vec<Limit>,
    /// Stretches that are shaded and named, in figures that share no marks with others.
    pub spans: Vec<Span>,
    /// The platform that it is about; empty: all. Faults of other platforms are not marked.
    pub platform: String,
    /// Quantity and unit on the horizontal axis; empty: time.
    pub x_label: String,
    /// Logarithmic vertical axis.
    pub log: bool,
    /// Logarithmic horizontal axis.
    pub log_x: bool,
    /// The vertical axis is scaled to the data after this time \[s\], so that an initial transient does
    /// not flatten the rest; zooming shows everything.
    pub fitted_from_s: Option<f64>,
}

impl Figure {
    /// Whether there is anything to draw.
    pub fn is_empty(&self) -> bool {
        self.curves.iter().chain(&self.dashed).all(|c| c.time_s.is_empty())
    }

    /// Smallest and largest value from this time on.
    fn range_from(&self, start_s: f64) -> Option<[f64; 2]> {
        let points = self.curves.iter().chain(&self.dashed).flat_map(|c| c.time_s.iter().zip(&c.value));
        range(points.filter(|(t, _)| **t >= start_s).map(|(_, v)| *v))
    }

    /// What a reader hears who does not see it: what is drawn and between which values.
    pub fn spoken(&self) -> String {
        let curves = self.curves.iter().chain(&self.dashed).filter_map(|c| {
            let [low, high] = range(c.value.iter().copied())?;
            Some(format!(
                "{}: {} to {}",
                c.name,
                whorl_math::three_digits(low),
                whorl_math::three_digits(high)
            ))
        });
        let curves: Vec<String> = curves.collect();
        format!("{}, {}; {}", self.title, self.y_label, curves.join("; "))
    }

    /// The figure as the page's script reads it; `x_range` is that of the horizontal axis, without it the axis is
    /// fitted to the curves. A figure `on_timeline` shares cursor, zoom and marks with the others of its page.
    pub fn stored(&self, id: &str, x_range: Option<(f64, f64)>, on_timeline: bool) -> Value {
        let colours = self.colours();
        let colour = |position: usize| colours.get(position).copied().unwrap_or(position % COLOURS);
        let over_time = self.x_label.is_empty();
        let kept = |dashed: bool| {
            move |(i, curve): (usize, &Curve)| {
                let curve = curve.clone().thinned(POINTS);
                let mut entry = stored_x(&curve.time_s, over_time);
                entry.insert("n".to_owned(), json!(curve.name));
                entry.insert("c".to_owned(), json!(colour(i)));
                entry.insert("y".to_owned(), json!(rounded(&curve.value)));
                // Further curves than colours are told apart by their dashes.
                if dashed || i >= COLOURS {
                    entry.insert("d".to_owned(), json!(true));
                }
                Value::Object(entry)
            }
        };
        let drawn = |curves: &[Curve], dashed: bool| -> Vec<Value> {
            curves.iter().enumerate().filter(|(_, c)| !c.time_s.is_empty()).map(kept(dashed)).collect()
        };
        let mut curves = drawn(&self.curves, false);
        curves.extend(drawn(&self.dashed, true));
        let bands = self.bands.iter().enumerate().filter(|(_, b)| !b.0.time_s.is_empty());
        let bands = bands.map(|(i, (lower, upper))| stored_band(lower, upper, colour(i), over_time));
        json!({
            "id": id,
            "xlabel": self.x_label,
            "ylabel": self.y_label,
            "curves": curves,
            "bands": bands.collect::<Vec<_>>(),
            "limits": self.limits.iter().map(|l| json!({"n": l.name, "v": l.value})).collect::<Vec<_>>(),
            "spans": self.spans.iter().map(|s| json!({"n": s.name, "x": s.from_to, "c": colour(s.curve)})).collect::<Vec<_>>(),
            "who": self.platform,
            "log": self.log,
            "logx": self.log_x,
            "fit": self.fitted_from_s.and_then(|t| self.range_from(t)),
            "time": on_timeline && over_time,
            "range": if self.log_x { None } else { x_range },
        })
    }

    /// The colour of each solid curve: that of the axis which its name ends in, where that tells all curves apart,
    /// else that of its position.
    fn colours(&self) -> Vec<usize> {
        let axis = |curve: &Curve| {
            let words = || curve.name.split([' ', '_']);
            words().find_map(|word| AXES.iter().position(|axis| *axis == word))
        };
        let by_axis: Option<Vec<usize>> = self.curves.iter().map(axis).collect();
        match by_axis {
            Some(colours) if (1..colours.len()).all(|i| !colours[..i].contains(&colours[i])) => colours,
            _ => (0..self.curves.len()).map(|i| i % COLOURS).collect(),
        }
    }
}

fn range(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    let [low, high] = values
        .filter(|v| v.is_finite())
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
    (low <= high).then_some([low, high])
}

/// Positions on the horizontal axis: times as steps of milliseconds, which compress well.
fn stored_x(x: &[f64], over_time: bool) -> Map<String, Value> {
    let mut entry = Map::new();
    if over_time {
        let mut before = 0_i64;
        let steps: Vec<i64> = x
            .iter()
            .map(|t| {
                let now = (t * 1e3).round() as i64;
                now - std::mem::replace(&mut before, now)
            })
            .collect();
        entry.insert("dt".to_owned(), json!(steps));
    } else {
        entry.insert("x".to_owned(), json!(rounded(x)));
    }
    entry
}

/// A band; where it is thinned, each stretch keeps its lowest and its highest value.
fn stored_band(lower: &Curve, upper: &Curve, colour: usize, over_time: bool) -> Value {
    let stretch = lower.time_s.len().div_ceil(POINTS).max(1);
    let first: Vec<f64> = lower.time_s.chunks(stretch).filter_map(|c| c.first().copied()).collect();
    let low: Vec<f64> =
        lower.value.chunks(stretch).map(|c| c.iter().copied().fold(f64::INFINITY, f64::min)).collect();
    let high: Vec<f64> =
        upper.value.chunks(stretch).map(|c| c.iter().copied().fold(f64::NEG_INFINITY, f64::max)).collect();
    let mut entry = stored_x(&first, over_time);
    entry.insert("c".to_owned(), json!(colour));
    entry.insert("low".to_owned(), json!(rounded(&low)));
    entry.insert("high".to_owned(), json!(rounded(&high)));
    Value::Object(entry)
}

/// Five significant digits of each value, and of what the values differ by: more than a plot shows, at a third of the size.
/// What is not finite becomes `null`: a gap.
fn rounded(values: &[f64]) -> Vec<Option<f64>> {
    let [low, high] = range(values.iter().copied()).unwrap_or_default();
    let decimals =
        if high > low { (4.0 - (high - low).log10().floor()).clamp(0.0, 12.0) as usize } else { 0 };
    let five = |x: f64| {
        let step = if x == 0.0 { 0.0 } else { x.abs().log10().floor() };
        // A small difference of large values has more digits than the values need.
        let text = if step + decimals as f64 > 4.0 { format!("{x:.decimals$}") } else { format!("{x:.4e}") };
        text.parse().unwrap_or(x)
    };
    values.iter().map(|x| x.is_finite().then(|| five(*x))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_differences_of_large_values_are_kept() {
        let values = [88.301_23, 88.305_67, f64::NAN, 88.345_89];
        let kept = rounded(&values);
        assert_eq!(kept[2], None);
        for (kept, value) in kept.iter().zip(values).filter(|(_, value)| value.is_finite()) {
            assert!((kept.unwrap() - value).abs() <= 0.5e-6, "{kept:?} {value}");
        }
        assert_eq!(
            rounded(&[0.0, 123.456_789, -1.234_567_8e-3]),
            [Some(0.0), Some(123.46), Some(-1.2346e-3)]
        );
    }

    #[test]
    fn times_are_stored_as_steps_and_peaks_survive() {
        let spike = |i: usize| if i == 31_415 { 7.0 } else { 0.123_456_789 };
        let curve = Curve::new("x", (0..60_000).map(|i| (i as f64 * 0.01, spike(i))));
        let figure = Figure { curves: vec![curve], ..Figure::default() };
        let stored = figure.stored("f", Some((0.0, 600.0)), true);
        let (steps, values) = (&stored["curves"][0]["dt"], &stored["curves"][0]["y"]);
        let times: Vec<i64> = steps
            .as_array()
            .unwrap()
            .iter()
            .scan(0, |t, d| {
                *t += d.as_i64().unwrap();
                Some(*t)
            })
            .collect();
        assert!(times.len() <= POINTS && times.len() == values.as_array().unwrap().len());
        let peak = values.as_array().unwrap().iter().position(|v| v == 7.0).unwrap();
        assert_eq!(times[peak], 314_150);
        assert_eq!(values[0], 0.123_46);
        assert_eq!(stored["time"], true);
    }

    #[test]
    fn a_channel_has_one_colour_wherever_it_stands() {
        let named = |names: &[&str]| Figure {
            curves: names.iter().map(|n| Curve::new(*n, [(0.0, 1.0)])).collect(),
            ..Figure::default()
        };
        assert_eq!(named(&["gyro_z", "gyro_x"]).colours(), [2, 0]);
        assert_eq!(named(&["wheel_y"]).colours(), [1]);
        assert_eq!(named(&["x measured", "x predicted"]).colours(), [0, 1], "one axis twice: by position");
        assert_eq!(named(&["total", "estimator"]).colours(), [0, 1]);
    }

    #[test]
    fn what_is_not_finite_is_a_gap_and_bands_keep_their_width() {
        assert_eq!(rounded(&[f64::NAN, 1.0]), [None, Some(1.0)]);
        let edge = |v: f64| {
            Curve::new("e", (0..10_000).map(move |i| (i as f64, if i == 5000 { 9.0 * v } else { v })))
        };
        let band = stored_band(&edge(-1.0), &edge(1.0), 0, true);
        let largest = |key: &str| {
            band[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap().abs()).fold(0.0, f64::max)
        };
        assert_eq!((largest("low"), largest("high")), (9.0, 9.0));
    }
}
