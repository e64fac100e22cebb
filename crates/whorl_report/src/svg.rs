//! A figure as SVG: for pages that have no scripts, and for drawings in papers.

use maud::{Markup, html};
use whorl_math::three_digits;

use crate::figure::{Figure, Look};
use crate::series::Curve;
use crate::times::Interval;

/// Size of a drawing, and of the frame in it, in units of the drawing.
const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 260.0;
const LEFT: f64 = 66.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 26.0;
const BOTTOM: f64 = 40.0;
/// Numbers along an axis, about.
const MARKS: f64 = 6.0;
/// Points of a curve: two to each unit of the frame are not told apart.
const POINTS: usize = 1400;
/// Width of a character of a legend, about.
const CHARACTER: f64 = 6.0;

/// An axis: from a value to a place.
#[derive(Clone, Copy)]
struct Axis {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
    log: bool,
}

impl Axis {
    fn new([low, high]: [f64; 2], (from, to): (f64, f64), log: bool) -> Self {
        let [low, high] = if log {
            [low.max(f64::MIN_POSITIVE).log10(), high.max(f64::MIN_POSITIVE).log10()]
        } else {
            [low, high]
        };
        let (low, high) = if high > low { (low, high) } else { (low - 0.5, high + 0.5) };
        Self { low, high, from, to, log }
    }

    fn at(&self, value: f64) -> f64 {
        let value = if self.log { value.max(f64::MIN_POSITIVE).log10() } else { value };
        self.from + (value - self.low) / (self.high - self.low) * (self.to - self.from)
    }

    /// Values with a number: round ones.
    fn marks(&self) -> Vec<f64> {
        if self.log {
            let decades = self.low.floor() as i32..=self.high.ceil() as i32;
            let all = decades.flat_map(|decade| [1.0, 2.0, 5.0].map(|k| k * 10f64.powi(decade)));
            return all.filter(|v| (self.low - 1e-9..=self.high + 1e-9).contains(&v.log10())).collect();
        }
        let raw = (self.high - self.low) / MARKS;
        let power = 10f64.powf(raw.log10().floor());
        let step =
            [1.0, 2.0, 5.0, 10.0].into_iter().map(|k| k * power).find(|step| *step >= raw).unwrap_or(raw);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last).map(|k| k as f64 * step).collect()
    }
}

/// The drawing, with a title for who does not see it.
pub(crate) fn svg(figure: &Figure, x_range: Option<Interval>) -> String {
    let looks = figure.looked();
    let bands: Vec<&(Curve, Curve)> = figure.bands.iter().chain(&figure.band_of_all).collect();
    let values = |of: fn(&Curve) -> &Vec<f64>| {
        let edges = bands.iter().flat_map(|(low, high)| [low, high]);
        let all = looks.iter().map(|(curve, _)| *curve).chain(edges).flat_map(of);
        let all = all.copied().filter(|v| v.is_finite());
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
    };
    let [first, last] = x_range.map_or_else(|| values(|c| &c.time_s), |(from, to)| [from, to]);
    let [low, high] = values(|c| &c.value);
    let pad = if figure.log { 0.0 } else { 0.05 * (high - low) };
    let x = Axis::new([first, last], (LEFT, WIDTH - RIGHT), figure.log_x);
    let y = Axis::new([low - pad, high + pad], (HEIGHT - BOTTOM, TOP), figure.log);
    let x_label = if figure.x_label.is_empty() { "time [s]" } else { &figure.x_label };
    let drawing = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox=(format!("0 0 {WIDTH} {HEIGHT}")) role="img" width="100%" style="max-width: 900px"
            font-family="system-ui, sans-serif" font-size="11" {
            title { (figure.spoken()) }
            (grid(&x, &y))
            @for (i, band) in figure.bands.iter().enumerate() { (area(band, &x, &y, &colour(looks.get(i).map_or(i, |(_, look)| look.colour)))) }
            @if let Some(band) = &figure.band_of_all { (area(band, &x, &y, "var(--soft, #595959)")) }
            @for (curve, look) in &looks { (line(curve, &x, &y, *look)) }
            @for limit in figure.limits.iter().filter(|l| (y.low..=y.high).contains(&l.value)) {
                line x1=(LEFT) x2=(WIDTH - RIGHT) y1=(place(y.at(limit.value))) y2=(place(y.at(limit.value)))
                    stroke="var(--limit, #a33b00)" stroke-dasharray="6 3" {}
            }
            (legend(&looks))
            text x=(place(0.5 * (LEFT + WIDTH - RIGHT))) y=(HEIGHT - 6.0) text-anchor="middle" fill="currentColor" { (x_label) }
            text transform=(format!("translate(13 {}) rotate(-90)", place(0.5 * (TOP + HEIGHT - BOTTOM)))) text-anchor="middle"
                fill="currentColor" { (figure.y_label) }
        }
    };
    drawing.into_string()
}

fn place(at: f64) -> String {
    format!("{at:.1}")
}

fn colour(index: usize) -> String {
    // Okabe-Ito, for drawings outside a page that has the colours.
    let alone = ["#0072b2", "#d55e00", "#009e73", "#b3679a", "#2f9fd6", "#c98a00", "#000000", "#858525"];
    format!("var(--c{}, {})", index % alone.len(), alone[index % alone.len()])
}

fn grid(x: &Axis, y: &Axis) -> Markup {
    let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
    html! {
        g stroke="var(--grid, #e8e8e8)" fill="currentColor" {
            @for mark in x.marks() {
                @let at = place(x.at(mark));
                line x1=(at) x2=(at) y1=(TOP) y2=(bottom) {}
                text x=(at) y=(bottom + 14.0) text-anchor="middle" stroke="none" { (number(mark)) }
            }
            @for mark in y.marks() {
                @let at = y.at(mark);
                line x1=(LEFT) x2=(right) y1=(place(at)) y2=(place(at)) {}
                text x=(LEFT - 5.0) y=(place(at + 4.0)) text-anchor="end" stroke="none" { (number(mark)) }
            }
        }
    }
}

fn number(mark: f64) -> String {
    if mark == 0.0 {
        return "0".to_owned();
    }
    let text = three_digits(mark);
    if text.contains('.') && !text.contains('e') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

fn points(curve: &Curve, x: &Axis, y: &Axis) -> Vec<String> {
    let curve = curve.clone().thinned(POINTS);
    let inside = |v: f64| v.clamp(TOP - 400.0, HEIGHT + 400.0);
    let all = curve.time_s.iter().zip(&curve.value).filter(|(_, v)| v.is_finite());
    all.map(|(t, v)| format!("{},{}", place(x.at(*t)), place(inside(y.at(*v))))).collect()
}

fn line(curve: &Curve, x: &Axis, y: &Axis, look: Look) -> Markup {
    let dashes = ["", "6 4", "2 3", "8 3 2 3"][look.style % 4];
    html! {
        polyline points=(points(curve, x, y).join(" ")) fill="none" stroke=(colour(look.colour)) stroke-width="1.3"
            stroke-dasharray=[(!dashes.is_empty()).then_some(dashes)] {}
    }
}

fn area((low, high): &(Curve, Curve), x: &Axis, y: &Axis, colour: &str) -> Markup {
    let mut edge = points(low, x, y);
    edge.extend(points(high, x, y).into_iter().rev());
    html! { polygon points=(edge.join(" ")) fill=(colour) fill-opacity="0.18" {} }
}

fn legend(looks: &[(&Curve, Look)]) -> Markup {
    let mut at = LEFT;
    let entries: Vec<(f64, &Curve, Look)> = looks
        .iter()
        .map(|(curve, look)| {
            let from = at;
            at += 30.0 + CHARACTER * curve.name.chars().count() as f64;
            (from, *curve, *look)
        })
        .collect();
    html! {
        @for (from, curve, look) in entries.iter().filter(|(from, ..)| *from < WIDTH - 60.0) {
            @let dashes = ["", "6 4", "2 3", "8 3 2 3"][look.style % 4];
            line x1=(place(*from)) x2=(place(from + 18.0)) y1="12" y2="12" stroke=(colour(look.colour)) stroke-width="2"
                stroke-dasharray=[(!dashes.is_empty()).then_some(dashes)] {}
            text x=(place(from + 22.0)) y="16" fill="currentColor" { (curve.name) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attribute<'a>(node: &'a str, name: &str) -> &'a str {
        node.split_once(&format!("{name}=\"")).unwrap().1.split_once('"').unwrap().0
    }

    #[test]
    fn a_straight_line_is_drawn_straight_across_the_frame() {
        let curve = Curve::new("a < b", [(0.0, -1.0), (5.0, 0.0), (10.0, 1.0)]);
        let figure = Figure {
            title: "F".to_owned(),
            y_label: "v [m]".to_owned(),
            curves: vec![curve],
            ..Figure::default()
        };
        let drawing = svg(&figure, Some((0.0, 10.0)));
        let points: Vec<(f64, f64)> = attribute(drawing.split_once("<polyline").unwrap().1, "points")
            .split(' ')
            .map(|point| point.split_once(',').unwrap())
            .map(|(x, y)| (x.parse().unwrap(), y.parse().unwrap()))
            .collect();
        assert_eq!((points[0].0, points[2].0), (LEFT, WIDTH - RIGHT), "{drawing}");
        // Values grow upwards, and the middle is in the middle.
        assert!(points[0].1 > points[1].1 && points[1].1 > points[2].1);
        assert!((points[1].1 - 0.5 * (TOP + HEIGHT - BOTTOM)).abs() < 0.11, "{points:?}");
        assert!(drawing.contains("a &lt; b") && drawing.contains("<title>F, v [m]"), "{drawing}");
    }

    #[test]
    fn marks_are_round_and_inside() {
        let axis = Axis::new([0.0, 61.3], (0.0, 1.0), false);
        assert_eq!(axis.marks(), [0.0, 20.0, 40.0, 60.0]);
        let decades = Axis::new([0.1, 10.0], (0.0, 1.0), true);
        assert_eq!(decades.marks().len(), 7, "{:?}", decades.marks());
        assert_eq!(
            (number(0.0), number(0.5), number(20.0)),
            ("0".to_owned(), "0.5".to_owned(), "20".to_owned())
        );
        // One value is no range.
        assert!(Axis::new([3.0, 3.0], (0.0, 1.0), false).at(3.0).is_finite());
    }
}
