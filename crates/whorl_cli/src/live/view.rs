//! What the live page shows, gathered from messages.

use std::collections::{BTreeMap, VecDeque};

use nalgebra::Vector3;
use serde::Serialize;
use whorl_math::deg_from_rad;
use whorl_msgs::diagnostic_msgs::DiagnosticStatus;
use whorl_msgs::topics::{Message, Route};
use whorl_msgs::whorl::{
    AttitudeEstimate, AttitudeReference, ControlStatus, FormationState, ModelFit, ThrusterState,
};
use whorl_report::{alarming, mode_name, phase_name};

use super::load::Load;

/// What is older than this is not shown any more \[s\].
const STALE_S: f64 = 1.0;
/// A model monitor speaks once a second, by default \[s\].
const FIT_STALE_S: f64 = 3.0;
/// The innovations of this many last seconds are averaged \[s\].
const WHITENESS_S: f64 = 5.0;
/// Diagnostics that are kept, by their names: a formation of eight platforms has some fifty.
const DIAGNOSED: usize = 256;
/// Innovations that are kept: 5 s of ten times the usual rate.
const INNOVATIONS: usize = 5000;
/// Diagnostics that are shown: the worst, this many.
const FAULTS: usize = 6;

/// Latest messages; times are seconds on any clock that only goes forward.
#[derive(Debug, Default)]
pub struct View {
    formation: Option<(f64, FormationState)>,
    platforms: BTreeMap<u16, Platform>,
    diagnostics: BTreeMap<String, (u8, String)>,
    load: Load,
}

#[derive(Debug, Default)]
struct Platform {
    estimate: Option<(f64, AttitudeEstimate)>,
    reference: Option<(f64, AttitudeReference)>,
    control: Option<(f64, ControlStatus)>,
    thrusters: Option<(f64, ThrusterState)>,
    fit: Option<(f64, ModelFit)>,
    /// On-time of each jet at the last frame, and when that was \[s\].
    on_time_s: Option<(f64, Vec<f64>)>,
    /// When \[s\], normalised innovation squared, degrees of freedom.
    innovations: VecDeque<(f64, f64, u32)>,
}

/// One frame, as the page's script reads it.
#[derive(Debug, Serialize, PartialEq)]
pub struct Frame {
    /// Time of the frame \[s\].
    t: f64,
    experiment: String,
    law: String,
    phase: &'static str,
    step: String,
    run_s: f64,
    length_s: f64,
    platforms: Vec<PlatformFrame>,
    /// Computers that do not keep up, messages that do not arrive, and faults that the nodes report: who, and what.
    faults: Vec<(String, String)>,
}

/// One platform; `None` is unknown or stale.
#[derive(Debug, Default, Serialize, PartialEq)]
struct PlatformFrame {
    /// Rotates body axes into world axes: w, x, y, z.
    q: Option<[f64; 4]>,
    #[serde(rename = "ref")]
    reference: Option<[f64; 4]>,
    /// Momentum of the wheels, body axes \[N m s\].
    h: Option<[f64; 3]>,
    /// Share of the time since the last frame over which each valve was open.
    jets: Vec<f64>,
    mode: Option<&'static str>,
    alarm: bool,
    error_deg: Option<f64>,
    gas_g: Option<f64>,
    link_ms: Option<f64>,
    /// Age of the estimate when the controller acted on it \[ms\].
    latency_ms: Option<f64>,
    /// Mean square of the whitened innovations of the last seconds: 1 is what the filter's model expects.
    innovation: Option<f64>,
    tilt_deg: Option<f64>,
    /// Evidence against the platform's model over what is a mismatch: 1 is one.
    evidence: Option<f64>,
    /// What the model monitor says, unless it agrees.
    mismatch: Option<String>,
}

impl View {
    /// Takes a message that arrived at `now_s`.
    pub fn take(&mut self, now_s: f64, route: Route, message: Message) {
        let platform = route.platform.map(|id| self.platforms.entry(id.0).or_default());
        match (platform, message) {
            (_, Message::FormationState(m)) => self.formation = Some((now_s, m)),
            (_, Message::DiagnosticArray(m)) => {
                for status in m.status {
                    self.load.take(now_s, &status);
                    if self.diagnostics.len() < DIAGNOSED || self.diagnostics.contains_key(&status.name) {
                        self.diagnostics.insert(status.name, (status.level, status.message));
                    }
                }
            }
            (Some(p), Message::AttitudeEstimate(m)) => {
                if m.nis.is_finite() && m.nis_dof > 0 {
                    p.innovations.push_back((now_s, m.nis, u32::from(m.nis_dof)));
                }
                while p.innovations.len() > INNOVATIONS
                    || p.innovations.front().is_some_and(|(t, ..)| now_s - t > WHITENESS_S)
                {
                    p.innovations.pop_front();
                }
                p.estimate = Some((now_s, m));
            }
            (Some(p), Message::AttitudeReference(m)) => p.reference = Some((now_s, m)),
            (Some(p), Message::ControlStatus(m)) => p.control = Some((now_s, m)),
            (Some(p), Message::ThrusterState(m)) => p.thrusters = Some((now_s, m)),
            (Some(p), Message::ModelFit(m)) => p.fit = Some((now_s, m)),
            _ => {}
        }
    }

    /// What has arrived by `now_s` was taken.
    pub fn look(&mut self, now_s: f64) {
        self.load.look(now_s);
    }

    /// The frame at `now_s` of platforms with these names.
    pub fn frame(&mut self, now_s: f64, names: &[String]) -> Frame {
        let formation = fresh(&self.formation, now_s);
        let platforms = (0u16..)
            .zip(names)
            .map(|(id, name)| {
                let index = formation.and_then(|f| f.platforms.iter().position(|p| p == name));
                let mut frame = self.platforms.get_mut(&id).map(|p| p.frame(now_s)).unwrap_or_default();
                if let Some((f, i)) = formation.zip(index) {
                    let error = f.relative_error_rad.get(i).map(|e| deg_from_rad(Vector3::from(*e).norm()));
                    frame.error_deg = error.filter(|e| e.is_finite());
                    frame.link_ms = f.link_age_s.get(i).map(|s| s * 1e3).filter(|a| a.is_finite());
                }
                frame
            })
            .collect();
        let mut faults: Vec<_> =
            self.diagnostics.iter().filter(|(_, (level, _))| *level != DiagnosticStatus::OK).collect();
        faults.sort_by_key(|(_, (level, _))| std::cmp::Reverse(*level));
        Frame {
            t: now_s,
            experiment: formation.map(|f| f.experiment.clone()).unwrap_or_default(),
            law: formation.map(|f| f.law.clone()).unwrap_or_default(),
            phase: formation.map_or("no coordinator", |f| phase_name(f.phase)),
            step: formation.map(|f| f.step.clone()).unwrap_or_default(),
            run_s: formation.map_or(0.0, |f| f.run_elapsed_s),
            length_s: formation.map_or(0.0, |f| f.run_length_s),
            platforms,
            faults: self
                .load
                .faults(now_s)
                .into_iter()
                .chain(faults.into_iter().map(|(who, (_, what))| (who.clone(), what.clone())))
                .take(FAULTS)
                .collect(),
        }
    }
}

impl Platform {
    fn frame(&mut self, now_s: f64) -> PlatformFrame {
        let estimate = fresh(&self.estimate, now_s).filter(|e| e.usable());
        let control = fresh(&self.control, now_s);
        let finite = |x: f64| x.is_finite().then_some(x);
        let (sum, dof) = self
            .innovations
            .iter()
            .filter(|(t, ..)| now_s - t <= WHITENESS_S)
            .fold((0.0, 0), |(sum, dof), (_, nis, n)| (sum + nis, dof + n));
        PlatformFrame {
            q: estimate.and_then(|e| parts(e.q_world_body)),
            reference: fresh(&self.reference, now_s).and_then(|r| parts(r.q_world_reference)),
            h: control.map(|c| Vector3::from(c.wheel_momentum_b_n_m_s).into()),
            mode: control.map(|c| mode_name(c.mode)),
            alarm: control.is_none_or(|c| alarming(c.mode)),
            gas_g: control.and_then(|c| finite(c.gas_used_kg * 1e3)),
            latency_ms: control.and_then(|c| finite(c.estimate_age_s * 1e3)),
            innovation: (dof > 0).then(|| sum / f64::from(dof)),
            tilt_deg: control.and_then(|c| finite(deg_from_rad(c.tilt_rad))),
            evidence: self.fit(now_s).map(|fit| fit.ln_evidence / fit.ln_limit).and_then(finite),
            mismatch: self
                .fit(now_s)
                .filter(|fit| fit.state == ModelFit::STATE_MISMATCH)
                .map(ModelFit::in_words),
            jets: self.jets(now_s),
            ..PlatformFrame::default()
        }
    }

    /// What its model monitor said last; it speaks once a second.
    fn fit(&self, now_s: f64) -> Option<&ModelFit> {
        self.fit.as_ref().filter(|(t, _)| now_s - t <= FIT_STALE_S).map(|(_, fit)| fit)
    }

    /// Share of the time since the last frame over which each valve was open.
    fn jets(&mut self, now_s: f64) -> Vec<f64> {
        let Some(state) = fresh(&self.thrusters, now_s) else { return Vec::new() };
        let total = state.total_on_time_s.clone();
        let before = self.on_time_s.replace((now_s, total.clone()));
        match before {
            Some((then_s, before)) if now_s > then_s && before.len() == total.len() => {
                let share = |(now, then): (&f64, &f64)| ((now - then) / (now_s - then_s)).clamp(0.0, 1.0);
                total.iter().zip(&before).map(share).collect()
            }
            _ => vec![0.0; total.len()],
        }
    }
}

fn fresh<T>(latest: &Option<(f64, T)>, now_s: f64) -> Option<&T> {
    latest.as_ref().filter(|(t, _)| now_s - t <= STALE_S).map(|(_, message)| message)
}

fn parts(q: whorl_msgs::geometry_msgs::Quaternion) -> Option<[f64; 4]> {
    q.to_unit().map(|q| [q.w, q.i, q.j, q.k])
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_msgs::topics::{PlatformId, Topic};

    fn names() -> Vec<String> {
        vec!["a".to_owned(), "b".to_owned()]
    }

    #[test]
    fn what_is_silent_is_not_shown_as_if_it_were_alive() {
        let mut view = View::default();
        let estimate =
            AttitudeEstimate { health: AttitudeEstimate::HEALTH_OK, ..AttitudeEstimate::default() };
        let route = Route::platform(PlatformId(1), Topic::AttitudeEstimate);
        view.take(10.0, route, estimate.into());
        assert_eq!(view.frame(10.5, &names()).platforms[1].q, Some([1.0, 0.0, 0.0, 0.0]));
        assert_eq!(view.frame(10.5, &names()).platforms[0].q, None);
        assert_eq!(view.frame(11.5, &names()).platforms[1].q, None, "its node has died");
        assert_eq!(view.frame(11.5, &names()).phase, "no coordinator");
    }

    #[test]
    fn innovations_are_those_of_the_last_seconds_over_their_degrees_of_freedom() {
        let mut view = View::default();
        let route = Route::platform(PlatformId(0), Topic::AttitudeEstimate);
        for (t, nis) in [(0.0, 600.0), (10.0, 3.0), (11.0, 6.0)] {
            view.take(t, route, AttitudeEstimate { nis, nis_dof: 3, ..AttitudeEstimate::default() }.into());
        }
        assert_eq!(view.frame(11.0, &names()).platforms[0].innovation, Some(1.5));
    }

    #[test]
    fn jets_show_how_long_they_were_open() {
        let mut view = View::default();
        let route = Route::platform(PlatformId(0), Topic::ThrusterState);
        let mut jets = |t: f64, total: [f64; 2]| {
            let state = ThrusterState { total_on_time_s: total.to_vec(), ..ThrusterState::default() };
            view.take(t, route, state.into());
            view.frame(t, &names()).platforms.remove(0).jets
        };
        assert_eq!(jets(0.0, [1.0, 2.0]), [0.0, 0.0]);
        assert_eq!(jets(0.5, [1.25, 2.0]), [0.5, 0.0]);
        assert_eq!(jets(1.0, [0.0, 2.0]), [0.0, 0.0], "a driver that began anew");
    }
}
