//! `whorl monitor`: the formation at a glance, live.

use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

use anyhow::bail;
use clap::Args;
use nalgebra::Vector3;
use serde_json::{Value, json};
use whorl_math::words::one_line;
use whorl_math::{EulerAngles, EulerSequence, deg_from_rad};
use whorl_msgs::diagnostic_msgs::DiagnosticStatus;
use whorl_msgs::topics::{Message, Route, Topic};
use whorl_msgs::whorl::{AttitudeEstimate, ControlStatus, FormationState, ModelFit};
use whorl_report::phase_name;
use whorl_ros::SECOND_PUBLISHER;
use whorl_ros::environment::Network;
use whorl_security::policy::MONITOR;

use crate::output::{JsonArgument, draw, is_closed, printable, tell, text};
use crate::subscription::Subscription;

/// Name under which the recorder reports in `/diagnostics`.
const RECORDER_STATUS: &str = "recorder: bag";
/// Update interval.
const LOOK: Duration = Duration::from_millis(100);
/// Silence after which the reason is looked for.
const SILENCE: Duration = Duration::from_secs(5);
/// Time between two lines when the output is not a terminal.
const LINE: Duration = Duration::from_secs(2);

/// A second publisher is told of again after this time.
const CONTEST_AGAIN: Duration = Duration::from_secs(5);

#[derive(Debug, Args)]
pub struct Arguments {
    /// Names of the platforms.
    #[arg(default_values_t = ["whorl_1".to_owned(), "whorl_2".to_owned()], value_name = "PLATFORM")]
    platforms: Vec<String>,
    /// Keep running after the end of the experiment.
    #[arg(long)]
    stay: bool,
    /// Goes on without a reader: whoever started it waits for its status.
    #[arg(long, hide = true)]
    to_the_end: bool,
    #[command(flatten)]
    json: JsonArgument,
}

/// Current state.
#[derive(Debug, Default)]
struct View {
    formation: Option<FormationState>,
    platforms: BTreeMap<u16, PlatformView>,
    /// Why nothing is recorded any more, as the recorder says.
    not_recording: Option<String>,
    /// Which node refuses a second publisher, and of what.
    contested: Option<String>,
}

#[derive(Debug, Default)]
struct PlatformView {
    estimate: Option<AttitudeEstimate>,
    control: Option<ControlStatus>,
    fit: Option<ModelFit>,
    /// Estimates since the last rate was computed.
    estimates: u32,
    rate_hz: f64,
}

/// Carries out `whorl monitor`. Fails when the experiment was aborted.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    whorl_ros::end_with_launcher();
    whorl_ros::limit_memory();
    watch(arguments)
}

/// Shows the formation until the experiment ends, unless `stay` is set. Fails when the experiment was aborted.
fn watch(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { platforms, stay, to_the_end, json } = arguments;
    let network = Network::from_environment()?.secured(MONITOR)?;
    let shared = [Topic::FormationState, Topic::Diagnostics];
    let of_platforms = [Topic::AttitudeEstimate, Topic::ControlStatus, Topic::ModelFit];
    let mut formation = Subscription::new(&network, platforms, &shared, &of_platforms)?;
    let begun = Instant::now();
    let (mut heard, mut hinted) = (false, false);
    let mut view = View::default();
    let mut screen = Screen::new();
    let mut told = false;
    let mut last_contest: Option<Instant> = None;
    let mut last_rates = Instant::now();
    loop {
        std::thread::sleep(LOOK);
        formation.drain(|route, message| {
            heard = true;
            view.take(route, message);
        })?;
        if !heard && !hinted && begun.elapsed() >= SILENCE {
            hinted = true;
            tell(format_args!("{}", formation.hint()));
        }
        let since = last_rates.elapsed();
        if since >= Duration::from_secs(1) {
            view.platforms.values_mut().for_each(|p| {
                p.rate_hz = f64::from(p.estimates) / since.as_secs_f64();
                p.estimates = 0;
            });
            last_rates = Instant::now();
        }
        if let (Some(reason), false) = (&view.not_recording, told) {
            told = true;
            // Above the status, which is written over.
            tell(format_args!("error: {reason}; the experiment goes on without a recording"));
        }
        if let Some(text) = view.contested.take()
            && last_contest.is_none_or(|at| at.elapsed() >= CONTEST_AGAIN)
        {
            last_contest = Some(Instant::now());
            tell(format_args!("error: {text}"));
        }
        screen.show(&view.lines(platforms));
        json.write_line(|| view.as_json(platforms))?;
        if is_closed() && !to_the_end {
            return Ok(());
        }
        match view.formation.as_ref().map(|f| f.phase) {
            Some(FormationState::PHASE_FINISHED) if !stay => {
                return Ok(());
            }
            Some(FormationState::PHASE_ABORTED) if !stay => {
                match view.formation.as_ref().map(|f| f.step.as_str()).filter(|why| !why.is_empty()) {
                    Some(why) => bail!("the experiment was aborted: {why}"),
                    None => bail!("the experiment was aborted; the coordinator's log says why"),
                }
            }
            _ => {}
        }
    }
}

impl View {
    fn take(&mut self, route: Route, message: Message) {
        let platform = route.platform.map(|id| self.platforms.entry(id.0).or_default());
        match (platform, message) {
            (_, Message::FormationState(m)) => {
                self.formation = Some(FormationState { step: one_line(&m.step).into_owned(), ..m });
            }
            (_, Message::DiagnosticArray(m)) => {
                let contested = m.status.iter().find(|s| s.message.contains(SECOND_PUBLISHER));
                if let Some(status) = contested {
                    self.contested =
                        Some(one_line(&format!("{}: {}", status.name, status.message)).into_owned());
                }
                let recorder = m.status.into_iter().find(|s| s.name == RECORDER_STATUS);
                if let Some(status) = recorder {
                    let stopped = status.level >= DiagnosticStatus::ERROR;
                    self.not_recording = stopped.then(|| one_line(&status.message).into_owned());
                }
            }
            (Some(platform), Message::AttitudeEstimate(m)) => {
                platform.estimate = Some(m);
                platform.estimates += 1;
            }
            (Some(platform), Message::ControlStatus(m)) => platform.control = Some(m),
            (Some(platform), Message::ModelFit(m)) => {
                platform.fit = Some(ModelFit { effect: one_line(&m.effect).into_owned(), ..m });
            }
            _ => {}
        }
    }

    fn as_json(&self, names: &[String]) -> Value {
        let formation = self.formation.as_ref();
        let platform = |(index, name): (u16, &String)| {
            self.platforms.get(&index).map_or_else(
                || json!({"name": name, "heard": false}),
                |platform| platform.as_json(name, formation, usize::from(index)),
            )
        };
        json!({
            "phase": formation.map(|f| phase_name(f.phase)),
            "step": formation.map(|f| &f.step),
            "elapsed_s": formation.map(|f| f.run_elapsed_s),
            "length_s": formation.map(|f| f.run_length_s),
            "not_recording": self.not_recording,
            "platforms": (0u16..).zip(names).map(platform).collect::<Vec<_>>(),
        })
    }

    /// The phase, then for each platform attitude, error, link age, gas, rate.
    fn lines(&self, names: &[String]) -> Vec<String> {
        let formation = match &self.formation {
            None => "waiting for the coordinator".to_owned(),
            Some(f) => {
                let step = if f.step.is_empty() { String::new() } else { format!(" {}", f.step) };
                format!("{:5.1}/{:.0} s {}{step}", f.run_elapsed_s, f.run_length_s, phase_name(f.phase))
            }
        };
        let platform = |(index, name): (u16, &String)| match self.platforms.get(&index) {
            Some(platform) => {
                format!("{name} {}", platform.text(self.formation.as_ref(), usize::from(index)))
            }
            None => format!("{name} silent"),
        };
        let formation =
            if self.not_recording.is_some() { format!("{formation} NOT RECORDING") } else { formation };
        std::iter::once(formation).chain((0u16..).zip(names).map(platform)).collect()
    }
}

/// Modes in words; `None`: it tracks.
fn mode_name(mode: u8) -> Option<&'static str> {
    match mode {
        ControlStatus::MODE_IDLE => Some("idle"),
        ControlStatus::MODE_HOLD => Some("HOLD"),
        ControlStatus::MODE_EXCITE => Some("EXCITE"),
        ControlStatus::MODE_SAFE_DAMPING | ControlStatus::MODE_SAFE_COAST => Some("SAFE"),
        _ => None,
    }
}

impl PlatformView {
    /// Yaw, pitch and roll \[deg\] of a usable estimate.
    fn angles_deg(&self) -> Option<Vector3<f64>> {
        let estimate = self.estimate.as_ref().filter(|e| e.usable())?;
        let q = estimate.q_world_body.to_unit()?;
        Some(EulerAngles::from_quaternion(&q, EulerSequence::E321).angles_rad.map(deg_from_rad))
    }

    /// What is not known is null.
    fn as_json(&self, name: &str, formation: Option<&FormationState>, index: usize) -> Value {
        let error_rad =
            formation.and_then(|f| f.relative_error_rad.get(index)).map(|v| Vector3::from(*v).norm());
        let angles = self.angles_deg().map(|a| [a.x, a.y, a.z]);
        let model = self.fit.as_ref().map(|fit| match fit.state {
            ModelFit::STATE_AGREES => json!({"state": "agrees"}),
            ModelFit::STATE_DOUBT => json!({"state": "doubt"}),
            ModelFit::STATE_MISMATCH => {
                json!({"state": "mismatch", "effect": fit.effect, "probability": fit.probability})
            }
            _ => json!({"state": "unknown"}),
        });
        json!({
            "name": name,
            "heard": true,
            "yaw_pitch_roll_deg": angles,
            "relative_error_deg": error_rad.map(deg_from_rad),
            "link_age_s": formation.and_then(|f| f.link_age_s.get(index)),
            "gas_used_kg": self.control.as_ref().map(|c| c.gas_used_kg),
            "mode": self.control.as_ref().map(|c| mode_name(c.mode).unwrap_or("track")),
            "model": model,
            "estimates_hz": self.rate_hz,
        })
    }

    fn text(&self, formation: Option<&FormationState>, index: usize) -> String {
        let mut text = self.angles_deg().map_or_else(
            || "no attitude".to_owned(),
            |angles| format!("ypr {:7.2} {:6.2} {:6.2} deg", angles.x, angles.y, angles.z),
        );
        let error = formation.and_then(|f| f.relative_error_rad.get(index)).map(|v| Vector3::from(*v).norm());
        if let Some(error_rad) = error.filter(|e| e.is_finite()) {
            text.push_str(&format!(" err {:6.3} deg", deg_from_rad(error_rad)));
        }
        if let Some(age_s) = formation.and_then(|f| f.link_age_s.get(index)).filter(|a| a.is_finite()) {
            text.push_str(&format!(" link {:3.0} ms", age_s * 1e3));
        }
        if let Some(control) = &self.control {
            let mode = mode_name(control.mode).map_or_else(String::new, |mode| format!(" {mode}"));
            text.push_str(&format!(" gas {:.2} g{mode}", control.gas_used_kg * 1e3));
        }
        match self.fit.as_ref().map(|fit| (fit.state, fit)) {
            Some((ModelFit::STATE_AGREES, _)) => text.push_str(" model ok"),
            Some((ModelFit::STATE_DOUBT, _)) => text.push_str(" model?"),
            Some((ModelFit::STATE_MISMATCH, fit)) => {
                text.push_str(&format!(" MODEL: {} {:.0} %", fit.effect, 100.0 * fit.probability));
            }
            _ => {}
        }
        text.push_str(&format!(" {:.0} Hz", self.rate_hz));
        text
    }
}

/// Lines that are overwritten on a terminal; elsewhere a line from time to time.
struct Screen {
    terminal: bool,
    last: Option<Instant>,
}

impl Screen {
    fn new() -> Self {
        Self { terminal: std::io::stdout().is_terminal(), last: None }
    }

    fn show(&mut self, lines: &[String]) {
        if self.terminal {
            // Back to the first line of the last view. Long lines are cut at the edge: wrapped ones
            // would not be written over.
            let up = if self.last.is_some() { format!("\x1b[{}A", lines.len()) } else { String::new() };
            let view: String = lines.iter().map(|line| format!("\x1b[2K{}\n", printable(line))).collect();
            draw(&format!("\x1b[?7l{up}\r{view}\x1b[?7h"));
            self.last = Some(Instant::now());
        } else if self.last.is_none_or(|t| t.elapsed() >= LINE) {
            self.last = Some(Instant::now());
            text(&format!("{}\n", lines.join(" | ")));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_msgs::topics::PlatformId;

    #[test]
    fn the_line_says_what_is_silent_and_what_is_known() {
        let names = ["whorl_1".to_owned(), "whorl_2".to_owned()];
        let mut view = View::default();
        assert_eq!(view.lines(&names), ["waiting for the coordinator", "whorl_1 silent", "whorl_2 silent"]);
        view.take(
            Route::shared(Topic::FormationState),
            FormationState {
                phase: FormationState::PHASE_HOLD,
                run_elapsed_s: 12.34,
                run_length_s: 60.0,
                relative_error_rad: vec![[0.0, 0.0, 0.0].into(), [0.0, 1.0f64.to_radians(), 0.0].into()],
                link_age_s: vec![0.004, f64::INFINITY],
                ..FormationState::default()
            }
            .into(),
        );
        let q = nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, 30f64.to_radians());
        let estimate = AttitudeEstimate { health: 1, q_world_body: q.into(), ..AttitudeEstimate::default() };
        view.take(Route::platform(PlatformId(1), Topic::AttitudeEstimate), estimate.into());
        let lines = view.lines(&names);
        assert_eq!(lines[..2], [" 12.3/60 s hold", "whorl_1 silent"]);
        let platform = &lines[2];
        assert!(platform.starts_with("whorl_2 ypr   30.00   0.00   0.00 deg"), "{platform}");
        assert!(platform.contains("err  1.000 deg"), "{platform}");
        assert_eq!(platform.matches("link").count(), 0, "an infinite age is not shown: {platform}");
        let stopped = DiagnosticStatus {
            level: DiagnosticStatus::ERROR,
            name: RECORDER_STATUS.to_owned(),
            message: "recording stopped: the disk is full".to_owned(),
            ..DiagnosticStatus::default()
        };
        let array =
            whorl_msgs::diagnostic_msgs::DiagnosticArray { status: vec![stopped], ..Default::default() };
        view.take(Route::shared(Topic::Diagnostics), array.into());
        assert_eq!(view.lines(&names)[0], " 12.3/60 s hold NOT RECORDING");
        assert_eq!(view.not_recording.as_deref(), Some("recording stopped: the disk is full"));
    }
}
