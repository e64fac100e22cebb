//! The figures of a report.

use whorl_math::{deg_from_rad, rpm_from_rad_s};
use whorl_msgs::whorl::ModelFit;

use crate::data::RunData;
use crate::figure::{Figure, Limit};
use crate::pair::PairData;
use crate::platform::{AngleCurves, PlatformData};
use crate::replay::PlatformShape;
use crate::series::{Curve, named};

const XYZ: [&str; 3] = ["x", "y", "z"];

/// Time from the first usable estimate to where the scaling of a figure's vertical axis begins [s]: by then the
/// filter's initial transient has decayed.
const FILTER_SETTLING_S: f64 = 2.0;

/// Relative error of a pair and the links.
pub fn pair_figures(follower: &str, leader: &str, errors: &PairData, target_rad: Option<f64>) -> Vec<Figure> {
    vec![
        Figure {
            title: format!("Relative pointing error of {follower} to {leader}"),
            caption:
                "Angle between the relative attitude and the commanded one, and its two parts: the error \
                      of the estimators and the error of the controllers. Shaded: hold."
                    .to_owned(),
            y_label: "angle [deg]".to_owned(),
            curves: vec![
                Curve::of("total", &errors.total),
                Curve::of("estimator", &errors.estimator),
                Curve::of("control", &errors.control),
            ],
            limits: target_rad
                .map(|t| Limit { name: "target (RMS in hold)".to_owned(), value: deg_from_rad(t) })
                .into_iter()
                .collect(),
            log: true,
            ..Figure::default()
        },
        Figure {
            title: format!("Relative pointing error of {follower} to {leader}, by axis"),
            caption: "Total error as a rotation vector in the follower's body axes.".to_owned(),
            y_label: "error [deg]".to_owned(),
            curves: named(XYZ, &errors.axes),
            ..Figure::default()
        },
    ]
}

/// Age of every platform's estimate at the coordinator.
pub fn link_figure(run: &RunData, stale_s: Option<f64>) -> Figure {
    let names = run.formation.last().map(|s| s.message.platforms.clone()).unwrap_or_default();
    let curves = names.iter().enumerate().map(|(i, name)| {
        let ages = run.formation.iter().filter_map(|s| {
            let age_s = s.message.link_age_s.get(i).copied().filter(|a| a.is_finite())?;
            Some((s.stamp_s, age_s * 1e3))
        });
        Curve::new(name.as_str(), ages)
    });
    Figure {
        title: "Link age".to_owned(),
        caption: "Age of each platform's newest estimate whenever the coordinator used it.".to_owned(),
        y_label: "age [ms]".to_owned(),
        curves: curves.collect(),
        limits: stale_s.map(|s| Limit { name: "stale".to_owned(), value: s * 1e3 }).into_iter().collect(),
        ..Figure::default()
    }
}

/// Everything about one platform.
pub fn platform_figures(data: &PlatformData, shape: Option<&PlatformShape>) -> Vec<Figure> {
    let mut figures = attitude_figures(data);
    figures.push(tilt_figure(data, shape));
    figures.push(Figure {
        title: "Control error".to_owned(),
        caption: "Rotation from reference to estimated attitude, body axes, as used by the controller."
            .to_owned(),
        y_label: "error [deg]".to_owned(),
        curves: named(XYZ, &data.control_error),
        ..Figure::default()
    });
    figures.push(Figure {
        title: "Estimator error".to_owned(),
        caption:
            "Rotation from estimated to true attitude, world axes (z is heading). Band: three of the filter's own \
                  standard deviations, of its largest axis."
                .to_owned(),
        y_label: "error [deg]".to_owned(),
        curves: named(XYZ, &data.estimator_error),
        band_of_all: three_sigma(data),
        fitted_from_s: settled_s(data),
        ..Figure::default()
    });
    figures.push(Figure {
        title: "Gyro bias".to_owned(),
        caption: "Estimated (solid) and true (dashed), body axes.".to_owned(),
        y_label: "bias [deg/s]".to_owned(),
        curves: named(XYZ, &data.bias),
        dashed: named(["x true", "y true", "z true"], &data.true_bias),
        fitted_from_s: settled_s(data),
        ..Figure::default()
    });
    figures.push(Figure {
        title: "Wheel speeds".to_owned(),
        caption: "Relative to the body.".to_owned(),
        y_label: "speed [rpm]".to_owned(),
        curves: data.wheels.iter().map(|(name, speed)| Curve::of(name.as_str(), speed)).collect(),
        limits: wheel_limits(shape),
        ..Figure::default()
    });
    figures.push(Figure {
        title: "Gimbal angles".to_owned(),
        caption: "Of the control moment gyros.".to_owned(),
        y_label: "angle [deg]".to_owned(),
        curves: data.gimbals.iter().map(|(name, [angle, _])| Curve::of(name.as_str(), angle)).collect(),
        ..Figure::default()
    });
    figures.push(Figure {
        title: "Gimbal rates".to_owned(),
        caption: "Of the control moment gyros.".to_owned(),
        y_label: "rate [deg/s]".to_owned(),
        curves: data.gimbals.iter().map(|(name, [_, rate])| Curve::of(name.as_str(), rate)).collect(),
        ..Figure::default()
    });
    figures.push(Figure {
        title: "Torque".to_owned(),
        caption:
            "Achieved by the actuators' model (solid) and asked for by the controller (dashed), body axes. \
                  They differ where the actuators are at their limits."
                .to_owned(),
        y_label: "torque [mN m]".to_owned(),
        curves: named(XYZ, &data.torque),
        dashed: named(["x asked", "y asked", "z asked"], &data.torque_asked),
        ..Figure::default()
    });
    figures.extend(jet_figures(data));
    figures.extend(mass_property_figures(data));
    figures.extend(fit_figures(data));
    figures.retain(|f| !f.is_empty());
    figures
}

/// The angle that the bearing limits.
fn tilt_figure(data: &PlatformData, shape: Option<&PlatformShape>) -> Figure {
    let limit = shape.and_then(|s| s.tilt.as_ref());
    let stop = |l: &crate::replay::TiltLimit| Limit {
        name: "stop of the bearing".to_owned(),
        value: deg_from_rad(l.max_rad),
    };
    Figure {
        title: "Tilt".to_owned(),
        caption: "Angle that the bearing limits, as estimated.".to_owned(),
        y_label: "tilt [deg]".to_owned(),
        curves: vec![Curve::of("tilt", &data.tilt)],
        limits: limit.map(stop).into_iter().collect(),
        ..Figure::default()
    }
}

fn wheel_limits(shape: Option<&PlatformShape>) -> Vec<Limit> {
    let Some(speed) = shape.and_then(|s| s.wheel_speed_max_rad_s) else { return Vec::new() };
    [1.0, -1.0]
        .map(|sign| Limit { name: "largest speed".to_owned(), value: sign * rpm_from_rad_s(speed) })
        .to_vec()
}

/// Convergence of the mass properties estimated in motion: three figures with three curves each.
fn mass_property_figures(data: &PlatformData) -> Vec<Figure> {
    let groups = [
        ("Moments of inertia", [0, 3, 5], "change [kg m^2]"),
        ("Products of inertia", [1, 2, 4], "change [kg m^2]"),
        ("Gravity offset", [6, 7, 8], "change [N m]"),
    ];
    let first = data.parameters.first();
    groups
        .into_iter()
        .map(|(title, indices, y_label)| {
            let curve = |index: usize, sigmas: f64| {
                let at = |values: &[f64]| values.get(index).copied().unwrap_or(f64::NAN);
                let start = first.map_or(f64::NAN, |f| at(&f.message.value));
                let name = first.and_then(|f| f.message.name.get(index)).cloned().unwrap_or_default();
                let points = data.parameters.iter().map(move |p| {
                    (p.stamp_s, at(&p.message.value) + sigmas * at(&p.message.stddev) - start)
                });
                Curve::new(name.as_str(), points)
            };
            Figure {
                title: format!("{title}, estimated while the platform moved"),
                caption: "Change against the first estimate. Bands: one standard deviation; a band that stays wide \
                          belongs to a parameter that the motion does not excite."
                    .to_owned(),
                y_label: y_label.to_owned(),
                curves: indices.map(|i| curve(i, 0.0)).to_vec(),
                bands: indices.map(|i| (curve(i, -1.0), curve(i, 1.0))).to_vec(),
                ..Figure::default()
            }
        })
        .collect()
}

/// How well the model fitted while the platform moved.
fn fit_figures(data: &PlatformData) -> Vec<Figure> {
    let limit = data.fit.last().map_or(f64::NAN, |fit| fit.message.ln_limit);
    let said = data.fit.iter().find(|fit| fit.message.state == ModelFit::STATE_MISMATCH);
    let said = said.map_or(String::new(), |fit| {
        format!(" At {:.1} s the monitor said that the platform {}.", fit.stamp_s, fit.message.in_words())
    });
    let squares = data.fit.iter().filter(|fit| fit.message.squares_dof > 0);
    vec![
        Figure {
            title: "Evidence against the model".to_owned(),
            caption: format!(
                "Natural logarithm of how much likelier the motion is with any one effect that the model lacks. While the \
                 model is right it reaches its limit at most once in ten hours, unless another rate was asked for.{said}"
            ),
            y_label: "evidence [nats]".to_owned(),
            curves: vec![Curve::new(
                "evidence",
                data.fit.iter().map(|fit| (fit.stamp_s, fit.message.ln_evidence)).filter(|(_, x)| x.is_finite()),
            )],
            limits: (limit.is_finite() && !data.fit.is_empty())
                .then(|| Limit { name: "mismatch".to_owned(), value: limit })
                .into_iter()
                .collect(),
            ..Figure::default()
        },
        Figure {
            title: "Whitened residual".to_owned(),
            caption: "Mean square of gyro and wheel speeds less the model's prediction, in standard deviations: 1 is \
                      what the model expects."
                .to_owned(),
            y_label: "mean square [1]".to_owned(),
            curves: vec![Curve::new(
                "mean square",
                squares.map(|fit| (fit.stamp_s, fit.message.squares / f64::from(fit.message.squares_dof))),
            )],
            limits: vec![Limit { name: "expected".to_owned(), value: 1.0 }],
            ..Figure::default()
        },
    ]
}

/// Time when the filter has settled, if there is an estimate.
fn settled_s(data: &PlatformData) -> Option<f64> {
    data.estimate.first_s.map(|t| t + FILTER_SETTLING_S)
}

fn three_sigma(data: &PlatformData) -> Option<(Curve, Curve)> {
    let upper = Curve::of("three sigma", &data.three_sigma);
    let value = upper.value.iter().map(|v| -v).collect();
    let lower = Curve { name: upper.name.clone(), time_s: upper.time_s.clone(), value };
    (!upper.time_s.is_empty()).then_some((lower, upper))
}

fn jet_figures(data: &PlatformData) -> Vec<Figure> {
    // A run without pulses needs no figure of pulses.
    let fired = data.numbers.jet_on_time_s > 0.0;
    let jets = if fired { data.jets.as_slice() } else { &[] };
    let on_time = (1..).zip(jets).map(|(number, jet)| Curve::of(format!("jet {number}"), jet));
    vec![
        Figure {
            title: "Jets".to_owned(),
            caption: "Accumulated open time of each valve.".to_owned(),
            y_label: "on-time [s]".to_owned(),
            curves: on_time.collect(),
            ..Figure::default()
        },
        Figure {
            title: "Gas".to_owned(),
            caption: "Gas used so far, by the controller's model.".to_owned(),
            y_label: "gas [g]".to_owned(),
            curves: if fired { vec![Curve::of("gas used", &data.gas)] } else { Vec::new() },
            ..Figure::default()
        },
        Figure {
            title: "Tank pressure".to_owned(),
            caption: "As measured.".to_owned(),
            y_label: "pressure [MPa]".to_owned(),
            curves: vec![Curve::of("tank", &data.tank_pressure)],
            ..Figure::default()
        },
    ]
}

fn attitude_figures(data: &PlatformData) -> Vec<Figure> {
    let figure = |title: &str, angles: &[(usize, &str)]| {
        let curves = |name: &str, series: &AngleCurves| -> Vec<Curve> {
            angles.iter().map(|(i, angle)| Curve::of(format!("{angle} {name}"), &series.curves[*i])).collect()
        };
        Figure {
            title: title.to_owned(),
            caption: "Estimate (solid), reference (dashed) and truth (dotted), as z-y-x Euler angles."
                .to_owned(),
            y_label: "angle [deg]".to_owned(),
            curves: curves("estimate", &data.estimate),
            dashed: curves("reference", &data.reference),
            dotted: curves("truth", &data.truth),
            ..Figure::default()
        }
    };
    vec![figure("Yaw", &[(0, "yaw")]), figure("Pitch and roll", &[(1, "pitch"), (2, "roll")])]
}
