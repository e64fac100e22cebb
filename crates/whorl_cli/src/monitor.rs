//! `whorl monitor`: the formation at a glance, live.

use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use anyhow::bail;
use clap::Args;
use nalgebra::Vector3;
use whorl_math::{EulerAngles, EulerSequence, deg_from_rad};
use whorl_msgs::topics::PlatformId;
use whorl_msgs::topics::{Message, Route, Topic};
use whorl_msgs::whorl::{AttitudeEstimate, ControlStatus, FormationState};
use whorl_report::phase_name;
use whorl_ros::environment::Network;
use whorl_ros::{EndpointQos, Participant, RawReader};

/// Time between two looks.
const LOOK: Duration = Duration::from_millis(100);
/// Time between two lines when the output is not a terminal.
const LINE: Duration = Duration::from_secs(2);

#[derive(Debug, Args)]
pub struct Arguments {
    /// Names of the platforms.
    #[arg(default_values_t = ["whorl_1".to_owned(), "whorl_2".to_owned()], value_name = "PLATFORM")]
    platforms: Vec<String>,
    /// Do not end when the experiment ends.
    #[arg(long)]
    stay: bool,
}

/// What is known now.
#[derive(Debug, Default)]
struct View {
    formation: Option<FormationState>,
    platforms: BTreeMap<u16, PlatformView>,
}

#[derive(Debug, Default)]
struct PlatformView {
    estimate: Option<AttitudeEstimate>,
    control: Option<ControlStatus>,
    /// Estimates since the last rate was computed.
    estimates: u32,
    rate_hz: f64,
}

/// Carries out `whorl monitor`. Fails when the experiment was aborted.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let network = Network::from_environment()?;
    let participant = Participant::new(&network)?;
    let mut readers: Vec<(Route, RawReader)> = Vec::new();
    let mut listen = |route: Route| -> anyhow::Result<()> {
        let info = route.topic.info();
        if let Some(name) = route.name(&arguments.platforms) {
            readers.push((
                route,
                participant.reader(&name, info.message_type.name(), EndpointQos::from(info.qos))?,
            ));
        }
        Ok(())
    };
    listen(Route::shared(Topic::FormationState))?;
    for index in 0..u16::try_from(arguments.platforms.len()).unwrap_or(u16::MAX) {
        listen(Route::platform(PlatformId(index), Topic::AttitudeEstimate))?;
        listen(Route::platform(PlatformId(index), Topic::ControlStatus))?;
    }
    let mut view = View::default();
    let mut screen = Screen::new();
    let mut last_rates = Instant::now();
    loop {
        std::thread::sleep(LOOK);
        for (route, reader) in &readers {
            reader.drain_notifications();
            while let Some(sample) = reader.take()? {
                // What cannot be decoded is counted by the nodes it was meant for.
                if let Ok(message) = Message::decode(route.topic.info().message_type, &sample.bytes) {
                    view.take(*route, message);
                }
            }
        }
        let since = last_rates.elapsed();
        if since >= Duration::from_secs(1) {
            view.platforms.values_mut().for_each(|p| {
                p.rate_hz = f64::from(p.estimates) / since.as_secs_f64();
                p.estimates = 0;
            });
            last_rates = Instant::now();
        }
        screen.show(&view.line(&arguments.platforms));
        match view.formation.as_ref().map(|f| f.phase) {
            Some(FormationState::PHASE_FINISHED) if !arguments.stay => {
                screen.end();
                return Ok(());
            }
            Some(FormationState::PHASE_ABORTED) if !arguments.stay => {
                screen.end();
                bail!("the experiment was aborted; the coordinator's log says why");
            }
            _ => {}
        }
    }
}

impl View {
    fn take(&mut self, route: Route, message: Message) {
        let platform = route.platform.map(|id| self.platforms.entry(id.0).or_default());
        match (platform, message) {
            (_, Message::FormationState(m)) => self.formation = Some(m),
            (Some(platform), Message::AttitudeEstimate(m)) => {
                platform.estimate = Some(m);
                platform.estimates += 1;
            }
            (Some(platform), Message::ControlStatus(m)) => platform.control = Some(m),
            _ => {}
        }
    }

    /// Phase, then for each platform attitude, error, link age, gas, rate.
    fn line(&self, names: &[String]) -> String {
        let mut line = match &self.formation {
            None => "waiting for the coordinator".to_owned(),
            Some(f) => {
                let step = if f.step.is_empty() { String::new() } else { format!(" {}", f.step) };
                format!("{:5.1}/{:.0} s {}{step}", f.run_elapsed_s, f.run_length_s, phase_name(f.phase))
            }
        };
        for (index, name) in (0u16..).zip(names) {
            line.push_str(&format!(" | {name} "));
            match self.platforms.get(&index) {
                Some(platform) => line.push_str(&platform.text(self.formation.as_ref(), usize::from(index))),
                None => line.push_str("silent"),
            }
        }
        line
    }
}

impl PlatformView {
    fn text(&self, formation: Option<&FormationState>, index: usize) -> String {
        let mut text = match self.estimate.as_ref().map(|e| (e.usable(), e.q_world_body.to_unit())) {
            Some((true, Some(q))) => {
                let angles =
                    EulerAngles::from_quaternion(&q, EulerSequence::E321).angles_rad.map(deg_from_rad);
                format!("ypr {:7.2} {:6.2} {:6.2} deg", angles.x, angles.y, angles.z)
            }
            _ => "no attitude".to_owned(),
        };
        let error = formation.and_then(|f| f.relative_error_rad.get(index)).map(|v| Vector3::from(*v).norm());
        if let Some(error_rad) = error.filter(|e| e.is_finite()) {
            text.push_str(&format!(" err {:6.3} deg", deg_from_rad(error_rad)));
        }
        if let Some(age_s) = formation.and_then(|f| f.link_age_s.get(index)).filter(|a| a.is_finite()) {
            text.push_str(&format!(" link {:3.0} ms", age_s * 1e3));
        }
        if let Some(control) = &self.control {
            let mode = match control.mode {
                ControlStatus::MODE_IDLE => " idle",
                ControlStatus::MODE_HOLD => " HOLD",
                ControlStatus::MODE_SAFE_DAMPING | ControlStatus::MODE_SAFE_COAST => " SAFE",
                _ => "",
            };
            text.push_str(&format!(" gas {:.2} g{mode}", control.gas_used_kg * 1e3));
        }
        text.push_str(&format!(" {:.0} Hz", self.rate_hz));
        text
    }
}

/// One line that is written over on a terminal; a line now and then elsewhere.
struct Screen {
    terminal: bool,
    last: Option<Instant>,
}

impl Screen {
    fn new() -> Self {
        Self { terminal: std::io::stdout().is_terminal(), last: None }
    }

    fn show(&mut self, line: &str) {
        let mut out = std::io::stdout();
        // If nobody reads the status any more, the experiment goes on.
        if self.terminal {
            let _ = write!(out, "\r\x1b[2K{line}");
        } else if self.last.is_none_or(|t| t.elapsed() >= LINE) {
            self.last = Some(Instant::now());
            let _ = writeln!(out, "{line}");
        }
        let _ = out.flush();
    }

    fn end(&mut self) {
        if self.terminal {
            println!();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_says_what_is_silent_and_what_is_known() {
        let names = ["whorl_1".to_owned(), "whorl_2".to_owned()];
        let mut view = View::default();
        assert_eq!(view.line(&names), "waiting for the coordinator | whorl_1 silent | whorl_2 silent");
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
        let line = view.line(&names);
        assert!(
            line.starts_with(" 12.3/60 s hold | whorl_1 silent | whorl_2 ypr   30.00   0.00   0.00 deg"),
            "{line}"
        );
        assert!(line.contains("err  1.000 deg"), "{line}");
        assert_eq!(line.matches("link").count(), 0, "an infinite age is not shown: {line}");
    }
}
