//! The terms of a diagnosis: functions of one recorded quantity about an axis, along the rate, on a wheel, by jets, or in what a sensor reads.

use std::f64::consts::TAU;

use whorl_dynamics::PlatformModel;
use whorl_validation::{OF_DIAGNOSIS, Parity, SHAPES, Shape, quantities};

use super::{At, Grammar, Term, Way, ranges};
use crate::signals::lines::Lines;
use crate::signals::observed::Observed;

/// Knots of the friction of any law, a factor of e apart in the rate.
const FRICTION_KNOTS: u32 = 6;
/// Scale of the lowest of them, as a share of the largest rate.
const SLOWEST: f64 = 0.01;
/// Highest harmonic of the heading: so many teeth has a small motor or a ring of nozzles.
const MOST_TEETH: u32 = 24;
/// Widths of a gyro's dead band, as shares of the largest rate.
const DEAD_BANDS: [f64; 4] = [0.003, 0.012, 0.05, 0.2];

/// The quantities that runs hold, and all terms of them.
pub(crate) fn of_diagnosis(observed: &[Observed<'_>], model: &PlatformModel, lines: &Lines) -> Grammar {
    // A motor's torque acts on its wheel, and the tilt is that about two axes.
    let mut quantities = quantities(model, observed.iter().map(|run| run.recording));
    quantities.retain(|of| of.name != "tilt" && !of.name.ends_with("_torque_command"));
    let ranges = ranges(&quantities, observed, model);
    let largest = |is: &dyn Fn(&str) -> bool| {
        let own = quantities.iter().zip(&ranges).filter(|(quantity, _)| is(&quantity.name));
        own.map(|(_, (low, high))| high.max(-low)).fold(1e-9, f64::max)
    };
    let rate = largest(&|name| name == "rate");
    let mut groups: Vec<Vec<Term>> = Vec::new();
    for (i, (quantity, &ends)) in quantities.iter().zip(&ranges).enumerate() {
        let name = quantity.name.as_str();
        if quantity.is_angle() {
            let turns = |n: u32, way| harmonic(name, way, move |at| f64::from(n) * at.values[i]);
            // Above the third those of what turns with teeth, magnets or nozzles.
            let way = |n: u32| if n > 3 { Way::Vertical } else { Way::BodyOrRoom };
            groups.extend((1..=MOST_TEETH).map(|n| turns(n, way(n))));
            groups.push([turns(1, Way::Heading), turns(2, Way::Heading)].concat());
            continue;
        }
        let Some((centre, own)) = quantity.scale(ends) else { continue };
        let scale = match name {
            _ if name.starts_with("tilt") => 0.5 * largest(&|name| name.starts_with("tilt")),
            _ if name.ends_with("rate") => 0.5 * rate,
            _ => own,
        };
        let way = if quantity.is_of_body { Way::Body } else { Way::BodyOrRoom };
        let u = move |at: &At<'_>| (at.values[i] - centre) / scale;
        let shaped = |shape: &'static Shape| Term::new(name, shape.parity, way, move |at| (shape.of)(u(at)));
        groups.extend(SHAPES.iter().take(OF_DIAGNOSIS).map(|shape| vec![shaped(shape)]));
        if quantity.is_slow {
            // A line through a zero of its own.
            let line = Term::new(name, Parity::Odd, way, u);
            groups.push(vec![line, Term::new(name, Parity::Odd, way, |_| 1.0)]);
        }
        if let Some(wheel) = model.wheels().iter().position(|wheel| name == format!("{}_speed", wheel.name)) {
            // Drag of a wheel by any law, which may change with time.
            let drag: [fn(f64, f64) -> f64; 5] =
                [|u, _| u, |u, _| u / u.hypot(0.02), |u, _| u.powi(3), |u, t| u * t, |u, t| u * t * t];
            let on_wheel = drag.map(|of| {
                Term::new(name, Parity::Odd, Way::Wheel(wheel), move |at| of(u(at), at.time_in_run))
            });
            groups.push(on_wheel.to_vec());
            // What a wheel that turns does to the gyro beside it.
            for (parity, power) in [(Parity::Odd, 1), (Parity::Even, 2)] {
                groups.push(vec![Term::new(name, parity, Way::GyroBy, move |at| (0.5 * u(at)).powi(power))]);
            }
        }
    }
    groups.push(vec![Term::new("constant", Parity::Even, Way::BodyOrRoom, |_| 1.0)]);
    // Friction of any law: along the rate, with a size of its own at every rate.
    let friction = (0..FRICTION_KNOTS).map(|knot| {
        Term::new("rate", Parity::Odd, Way::AlongRate, move |at| {
            let place = (at.environment.omega_wb_b_rad_s.norm() / (SLOWEST * rate)).asinh();
            (1.0 - (place.min(f64::from(FRICTION_KNOTS - 1)) - f64::from(knot)).abs()).max(0.0)
        })
    });
    groups.push(friction.collect());
    if observed.iter().any(|run| run.recording.jet_pulses.iter().any(|pulses| !pulses.is_empty())) {
        // Thrust that falls with how many jets are open, and pulses whose edges are at other times than recorded, by a constant or a growing amount.
        let of = |name, i, value: fn(&At<'_>) -> f64| Term::new(name, Parity::None, Way::Jets(i), value);
        groups.push(vec![of("jets_open", 0, |at| (at.jets_open - 1.0).max(0.0))]);
        for (name, jets) in [("jet_opening", 1), ("jet_closing", 2)] {
            groups.push(vec![of(name, jets, |_| 1.0), of(name, jets, |at| at.time_in_run)]);
        }
    }
    // A gyro that sticks near zero or bends.
    let dead_band = |share: f64| Term::new("gyro_rate", Parity::Odd, Way::Gyro, move |_| share * rate);
    groups.push(DEAD_BANDS.map(dead_band).to_vec());
    for hz in lines.hz.iter().copied() {
        let mut line = harmonic("time", Way::BodyOrRoom, move |at| TAU * hz * at.environment.time_s);
        line.iter_mut().for_each(|term| term.frequency_hz = Some(hz));
        groups.push(line);
    }
    Grammar::new(quantities, groups, true)
}

/// Sine and cosine of a phase.
fn harmonic(of: &str, way: Way, phase: impl Fn(&At<'_>) -> f64 + Copy + Sync + Send + 'static) -> Vec<Term> {
    let sine = Term::new(of, Parity::None, way, move |at| phase(at).sin());
    vec![sine, Term::new(of, Parity::None, way, move |at| phase(at).cos())]
}
