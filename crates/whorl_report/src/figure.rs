//! A figure, drawn in the reader's browser by uPlot. No other file knows how a figure is stored in a page.

use serde_json::{Map, Value, json};

use crate::series::Curve;

/// Largest number of points per curve; longer curves are thinned without losing peaks.
const POINTS: usize = 2400;
/// Number of line colours (Okabe-Ito, set in `page.css`), which can be told apart in grey and by colour-blind readers.
const COLOURS: usize = 8;
/// Colours of words in the name of a curve: an axis, or the angle about it, has one colour in all figures; so has what a
/// model predicts, which is drawn over what was measured.
const CHANNELS: [(&str, usize); 7] =
    [("predicted", 6), ("x", 0), ("y", 1), ("z", 2), ("roll", 0), ("pitch", 1), ("yaw", 2)];
/// The first colour that belongs to no axis.
const OTHERS: usize = 3;
/// Styles of lines: solid, dashed, dotted, dashed and dotted in turn.
pub(crate) const STYLES: usize = 4;

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

/// How a curve is drawn: indices of its colour and of its style (solid, dashed, dotted, dashed and dotted).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Look {
    pub colour: usize,
    pub style: usize,
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
    /// Dotted curves, likewise.
    pub dotted: Vec<Curve>,
    /// Curves of dashes and dots in turn, likewise.
    pub dash_dotted: Vec<Curve>,
    /// A band that is about all curves, in grey: lower and upper edge.
    pub band_of_all: Option<(Curve, Curve)>,
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
        self.each_curve().all(|c| c.time_s.is_empty())
    }

    /// The curves by their style.
    fn by_style(&self) -> [&[Curve]; STYLES] {
        [&self.curves, &self.dashed, &self.dotted, &self.dash_dotted]
    }

    fn each_curve(&self) -> impl Iterator<Item = &Curve> {
        self.by_style().into_iter().flatten()
    }

    /// Smallest and largest value from this time on, that of the band of all curves included.
    fn range_from(&self, start_s: f64) -> Option<[f64; 2]> {
        let edges = self.band_of_all.iter().flat_map(|(lower, upper)| [lower, upper]);
        let points = self.each_curve().chain(edges).flat_map(|c| c.time_s.iter().zip(&c.value));
        range(points.filter(|(t, _)| **t >= start_s).map(|(_, v)| *v))
    }

    /// What a reader hears who does not see it: what is drawn and between which values.
    pub fn spoken(&self) -> String {
        let curves = self.each_curve().filter_map(|c| {
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
        let looks = self.looks();
        let colour = |position: usize| looks.get(position).map_or(position % COLOURS, |(colour, _)| *colour);
        let over_time = self.x_label.is_empty();
        let kept = |curve: &Curve, colour: usize, style: usize| {
            let curve = curve.clone().thinned(POINTS);
            let mut entry = stored_x(&curve.time_s, over_time);
            entry.insert("n".to_owned(), json!(curve.name));
            entry.insert("c".to_owned(), json!(colour));
            entry.insert("y".to_owned(), json!(rounded(&curve.value)));
            if style > 0 {
                entry.insert("d".to_owned(), json!(style));
            }
            Value::Object(entry)
        };
        let curves: Vec<Value> =
            self.looked().into_iter().map(|(curve, look)| kept(curve, look.colour, look.style)).collect();
        let bands = self.bands.iter().enumerate().map(|(i, band)| (band, Some(colour(i))));
        let bands = self.band_of_all.iter().map(|band| (band, None)).chain(bands);
        let bands = bands.filter(|(band, _)| !band.0.time_s.is_empty());
        let bands = bands.map(|((lower, upper), colour)| stored_band(lower, upper, colour, over_time));
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

    /// Every curve that has points, with its look.
    pub(crate) fn looked(&self) -> Vec<(&Curve, Look)> {
        let looks = self.looks();
        let mut all = Vec::new();
        for (style, list) in self.by_style().into_iter().enumerate() {
            for (i, curve) in list.iter().enumerate().filter(|(_, c)| !c.time_s.is_empty()) {
                let (colour, own) = looks.get(i).copied().unwrap_or((i % COLOURS, 0));
                all.push((curve, Look { colour, style: if style == 0 { own } else { style } }));
            }
        }
        all
    }

    /// Colour and style of each solid curve: the colour of the channel that its name says, else one of those that are left;
    /// where none says one, that of its position. Curves that share a colour differ in their style.
    fn looks(&self) -> Vec<(usize, usize)> {
        let channel = |curve: &Curve| {
            let word = |named: &str| curve.name.split([' ', '_']).any(|word| word == named);
            CHANNELS.iter().find(|(named, _)| word(named)).map(|(_, colour)| *colour)
        };
        let channels: Vec<Option<usize>> = self.curves.iter().map(channel).collect();
        let by_channel = channels.iter().any(Option::is_some);
        let mut further = OTHERS..;
        let colours = channels.iter().enumerate().map(|(i, channel)| match channel {
            Some(colour) => *colour,
            None if by_channel => further.next().unwrap_or(i) % COLOURS,
            None => i % COLOURS,
        });
        let colours: Vec<usize> = colours.collect();
        let before = |i: usize| colours[..i].iter().filter(|c| **c == colours[i]).count();
        (0..colours.len()).map(|i| (colours[i], before(i).min(STYLES - 1))).collect()
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
fn stored_band(lower: &Curve, upper: &Curve, colour: Option<usize>, over_time: bool) -> Value {
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
        let looks = |names: &[&str]| {
            let curves = names.iter().map(|n| Curve::new(*n, [(0.0, 1.0)])).collect();
            Figure { curves, ..Figure::default() }.looks()
        };
        assert_eq!(looks(&["gyro_z", "gyro_x"]), [(2, 0), (0, 0)]);
        assert_eq!(looks(&["wheel_y"]), [(1, 0)]);
        assert_eq!(
            looks(&["yaw", "pitch", "roll"]),
            [(2, 0), (1, 0), (0, 0)],
            "angles as the axes that they are about"
        );
        assert_eq!(looks(&["gyro x measured", "gyro x predicted"]), [(0, 0), (6, 0)]);
        let several = looks(&["gyro_x", "gyro_y", "wheel_x_speed", "vector", "jet_x"]);
        assert_eq!(several, [(0, 0), (1, 0), (0, 1), (3, 0), (0, 2)], "one axis several times: by style");
        assert_eq!(looks(&["total", "estimator"]), [(0, 0), (1, 0)]);
        assert_eq!(looks(&["jet"; 9])[8], (0, 1), "more curves than colours");
    }

    #[test]
    fn a_band_of_all_curves_has_no_curves_colour_and_stays_in_view() {
        let line = |v: f64| Curve::new("x", [(0.0, v), (9.0, v)]);
        let figure = Figure {
            curves: vec![line(0.1)],
            dotted: vec![line(0.2)],
            band_of_all: Some((line(-3.0), line(3.0))),
            fitted_from_s: Some(1.0),
            ..Figure::default()
        };
        let stored = figure.stored("f", None, true);
        assert_eq!(stored["bands"][0]["c"], Value::Null);
        assert_eq!(stored["fit"], json!([-3.0, 3.0]));
        assert_eq!((&stored["curves"][1]["c"], &stored["curves"][1]["d"]), (&json!(0), &json!(2)));
    }

    #[test]
    fn what_is_not_finite_is_a_gap_and_bands_keep_their_width() {
        assert_eq!(rounded(&[f64::NAN, 1.0]), [None, Some(1.0)]);
        let edge = |v: f64| {
            Curve::new("e", (0..10_000).map(move |i| (i as f64, if i == 5000 { 9.0 * v } else { v })))
        };
        let band = stored_band(&edge(-1.0), &edge(1.0), Some(0), true);
        let largest = |key: &str| {
            band[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap().abs()).fold(0.0, f64::max)
        };
        assert_eq!((largest("low"), largest("high")), (9.0, 9.0));
    }
}
