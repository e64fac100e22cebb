//! The members of a logical inertial sensor, sample by sample.

use std::time::{Duration, Instant};

use nalgebra::Vector3;

use super::vote::{Outcome, Row, vote};
use super::{ImuSetup, Member};

/// Periods without a sample after which a member is silent.
const SILENT_PERIODS: f64 = 3.5;
/// Equal samples in a row that count as stuck: with noise, every sample of a working sensor differs.
const STUCK_SAMPLES: u32 = 10;
/// Samples in a row after which a change is told.
const TOLD_AFTER: u32 = 5;

/// What is known of a member.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Verdict {
    Good,
    Silent,
    Stuck,
    /// By how much, and of what.
    Outvoted(f64, Quantity),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Quantity {
    Rate,
    Force,
}

impl Quantity {
    fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Rate => ("angular rate", "rad/s"),
            Self::Force => ("specific force", "m/s^2"),
        }
    }
}

impl Verdict {
    /// The same kind of verdict.
    fn is_like(self, other: Self) -> bool {
        std::mem::discriminant(&self) == std::mem::discriminant(&other)
    }
}

#[derive(Debug, Clone)]
struct State {
    latest: Option<(Instant, Vec<f64>, Vec<f64>)>,
    equal: u32,
    told: Verdict,
    /// Samples in a row with another verdict than what was told.
    otherwise: u32,
}

/// The sensor at work.
#[derive(Debug, Clone)]
pub struct LogicalImu {
    setup: ImuSetup,
    states: Vec<State>,
    began: Option<Instant>,
    /// Votes in a row that nobody won.
    undecided: u32,
    last_at: Option<Instant>,
    news: Vec<(bool, String)>,
}

/// What the sensor measures.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Mean of the instants of the members' samples.
    pub at: Instant,
    /// Angular rate, body axes [rad/s].
    pub rate_b_rad_s: Vector3<f64>,
    /// Specific force, body axes [m/s^2].
    pub specific_force_b_m_s2: Vector3<f64>,
}

impl LogicalImu {
    /// Without a sample yet.
    #[must_use]
    pub fn new(setup: ImuSetup) -> Self {
        let state = State { latest: None, equal: 0, told: Verdict::Good, otherwise: 0 };
        let states = vec![state; setup.members.len()];
        Self { setup, states, began: None, undecided: 0, last_at: None, news: Vec::new() }
    }

    /// As the list has it.
    #[must_use]
    pub fn setup(&self) -> &ImuSetup {
        &self.setup
    }

    /// Whether its members disagree and none can be named.
    #[must_use]
    pub fn is_undecided(&self) -> bool {
        self.undecided >= TOLD_AFTER
    }

    /// Whether this device is a member.
    #[must_use]
    pub fn has(&self, device: usize) -> bool {
        self.setup.members.iter().any(|member| member.device == device)
    }

    /// What is to be told: whether it is a warning, and a sentence.
    pub fn take_news(&mut self) -> Vec<(bool, String)> {
        std::mem::take(&mut self.news)
    }

    /// A device's sample, in the order of its axes; the sensor's own when this was the member that sets the pace.
    pub fn sampled(&mut self, device: usize, at: Instant, rate: &[f64], force: &[f64]) -> Option<Sample> {
        let index = self.setup.members.iter().position(|member| member.device == device)?;
        let began = *self.began.get_or_insert(at);
        let state = self.states.get_mut(index)?;
        let same = state.latest.as_ref().is_some_and(|(_, r, f)| r == rate && f == force);
        state.equal = if same { state.equal.saturating_add(1) } else { 0 };
        state.latest = Some((at, rate.to_vec(), force.to_vec()));
        let voters: Vec<Verdict> = self.states.iter().map(|state| self.own_verdict(state, at)).collect();
        let leader = voters.iter().position(|verdict| *verdict == Verdict::Good)?;
        // Those that are still being switched on are waited for.
        let starting = at.saturating_duration_since(began) < self.silence();
        if index != leader || (starting && voters.contains(&Verdict::Silent)) {
            return None;
        }
        let mut verdicts = voters.clone();
        let rates = self.ballot(&voters, self.setup.disagreement_rad_s, Quantity::Rate);
        mark(&mut verdicts, &rates, Quantity::Rate);
        let forces = self.ballot(&voters, self.setup.disagreement_m_s2, Quantity::Force);
        mark(&mut verdicts, &forces, Quantity::Force);
        let mean = self.mean_instant(&verdicts, at);
        self.tell(&verdicts);
        let (rate_b_rad_s, specific_force_b_m_s2) = self.decide(rates, forces)?;
        // Whoever sets the pace may change; time does not go back.
        if self.last_at.is_some_and(|last| mean <= last) {
            return None;
        }
        self.last_at = Some(mean);
        Some(Sample { at: mean, rate_b_rad_s, specific_force_b_m_s2 })
    }

    fn silence(&self) -> Duration {
        self.setup.period.mul_f64(SILENT_PERIODS)
    }

    /// What a member's own samples say of it.
    fn own_verdict(&self, state: &State, now: Instant) -> Verdict {
        match &state.latest {
            Some((at, ..)) if now.saturating_duration_since(*at) <= self.silence() => {
                if state.equal >= STUCK_SAMPLES { Verdict::Stuck } else { Verdict::Good }
            }
            _ => Verdict::Silent,
        }
    }

    fn ballot(&self, verdicts: &[Verdict], tolerance: f64, quantity: Quantity) -> Outcome {
        let mut rows = Vec::new();
        let members = self.setup.members.iter().zip(&self.states).zip(verdicts).enumerate();
        for (index, ((member, state), _)) in members.filter(|(_, (_, verdict))| **verdict == Verdict::Good) {
            let Some((_, rate, force)) = &state.latest else { continue };
            let (axes, values) = match quantity {
                Quantity::Rate => (&member.axes.rate_b, rate),
                Quantity::Force => (&member.axes.force_b, force),
            };
            let own = axes.iter().zip(values);
            rows.extend(own.map(|(axis, value)| Row {
                member: index,
                direction_b: axis.into_inner(),
                value: *value,
            }));
        }
        vote(&rows, tolerance)
    }

    fn mean_instant(&self, verdicts: &[Verdict], at: Instant) -> Instant {
        let used = self.states.iter().zip(verdicts).filter(|(_, verdict)| **verdict == Verdict::Good);
        let ages: Vec<f64> = used
            .filter_map(|(state, _)| {
                Some(at.saturating_duration_since(state.latest.as_ref()?.0).as_secs_f64())
            })
            .collect();
        let mean_s = ages.iter().sum::<f64>() / ages.len().max(1) as f64;
        at.checked_sub(Duration::from_secs_f64(mean_s)).unwrap_or(at)
    }

    fn decide(&mut self, rates: Outcome, forces: Outcome) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let why = match (rates, forces) {
            (Outcome::Agreed { vector_b: rate, .. }, Outcome::Agreed { vector_b: force, .. }) => {
                if self.is_undecided() {
                    self.news.push((false, "logical imu: its devices agree again".to_owned()));
                }
                self.undecided = 0;
                return Some((rate, force));
            }
            (Outcome::Undecided(by), _) => {
                format!("angular rates disagree by {by:.3} rad/s, and nobody can say which is wrong")
            }
            (_, Outcome::Undecided(by)) => {
                format!("specific forces disagree by {by:.2} m/s^2, and nobody can say which is wrong")
            }
            _ => "the devices that still work do not measure along every direction".to_owned(),
        };
        self.undecided = self.undecided.saturating_add(1);
        if self.undecided == TOLD_AFTER {
            self.news.push((true, format!("logical imu: {why}: no inertial measurements")));
        }
        None
    }

    /// Tells what has been so for a few samples.
    fn tell(&mut self, verdicts: &[Verdict]) {
        let working = |except: usize| -> Vec<&str> {
            let others = self.setup.members.iter().zip(verdicts).enumerate();
            others
                .filter(|(index, (_, verdict))| *index != except && **verdict == Verdict::Good)
                .map(|(_, (member, _))| member.name.as_str())
                .collect()
        };
        let mut news = Vec::new();
        for (index, ((member, state), verdict)) in
            self.setup.members.iter().zip(&mut self.states).zip(verdicts).enumerate()
        {
            if verdict.is_like(state.told) {
                state.otherwise = 0;
                continue;
            }
            state.otherwise += 1;
            if state.otherwise < TOLD_AFTER {
                continue;
            }
            (state.told, state.otherwise) = (*verdict, 0);
            news.push(sentence(member, *verdict, &working(index)));
        }
        self.news.append(&mut news);
    }
}

fn mark(verdicts: &mut [Verdict], outcome: &Outcome, quantity: Quantity) {
    let Outcome::Agreed { outvoted, .. } = outcome else { return };
    for (member, by) in outvoted {
        if let Some(verdict) = verdicts.get_mut(*member) {
            *verdict = Verdict::Outvoted(*by, quantity);
        }
    }
}

fn sentence(member: &Member, verdict: Verdict, working: &[&str]) -> (bool, String) {
    let name = &member.name;
    let what = match verdict {
        Verdict::Good => return (false, format!("logical imu: device {name} takes part again")),
        Verdict::Silent => format!("device {name} gives no samples"),
        Verdict::Stuck => format!("device {name} repeats the same sample"),
        Verdict::Outvoted(by, quantity) => {
            let (words, unit) = quantity.words();
            format!("device {name} differs from the others by {by:.3} {unit} of {words}")
        }
    };
    let rest = if working.is_empty() { "nothing".to_owned() } else { working.join(", ") };
    (true, format!("logical imu: {what}; it is left out, and {rest} carry on"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::InertialAxes;

    const RATE: [f64; 3] = [0.01, -0.02, 0.03];
    const FORCE: [f64; 3] = [0.1, 0.2, 9.8];

    fn sensors(count: usize) -> LogicalImu {
        let member =
            |device: usize| Member { device, name: format!("imu_{device}"), axes: InertialAxes::triads() };
        LogicalImu::new(ImuSetup {
            members: (0..count).map(member).collect(),
            disagreement_rad_s: 0.02,
            disagreement_m_s2: 0.2,
            period: Duration::from_millis(10),
        })
    }

    /// Ten seconds of samples at 100 Hz, devices 3 ms apart; `spoil` gives what a device says at a time, `None`: nothing.
    fn run(
        imu: &mut LogicalImu,
        spoil: impl Fn(usize, f64) -> Option<f64>,
    ) -> (Vec<(f64, Sample)>, Vec<String>) {
        let begin = Instant::now();
        let (mut samples, mut said) = (Vec::new(), Vec::new());
        for k in 0..1000_u64 {
            for device in 0..imu.setup.members.len() {
                let offset = Duration::from_millis(10 * k + 3 * device as u64);
                let t = offset.as_secs_f64();
                let Some(error) = spoil(device, t) else { continue };
                // Noise of a microradian a second: no two samples are equal, unless they are stuck.
                let noise = if error.is_nan() { 0.0 } else { 1e-6 * ((k * 37 + device as u64) % 100) as f64 };
                let error = if error.is_nan() { 0.0 } else { error };
                let rate = RATE.map(|x| x + noise + error);
                let force = FORCE.map(|x| x + noise);
                samples.extend(imu.sampled(device, begin + offset, &rate, &force).map(|s| (t, s)));
                said.extend(imu.take_news().into_iter().map(|(_, text)| text));
            }
        }
        (samples, said)
    }

    /// Largest gap between samples [s], and largest error of the rate [rad/s].
    fn quality(samples: &[(f64, Sample)]) -> (f64, f64) {
        let gaps = samples.windows(2).map(|pair| pair[1].0 - pair[0].0);
        let errors = samples.iter().map(|(_, s)| (s.rate_b_rad_s - Vector3::from(RATE)).norm());
        (gaps.fold(0.0, f64::max), errors.fold(0.0, f64::max))
    }

    #[test]
    fn three_that_work_give_one_at_the_pace_of_the_first() {
        let (samples, said) = run(&mut sensors(3), |_, _| Some(0.0));
        assert!(samples.len() > 990 && said.is_empty(), "{} {said:?}", samples.len());
        let (gap_s, error) = quality(&samples);
        assert!(gap_s < 0.0101 && error < 1e-3, "{gap_s} {error}");
    }

    #[test]
    fn one_that_dies_is_left_out_and_said_even_the_one_that_sets_the_pace() {
        for dead in 0..3 {
            let (samples, said) =
                run(&mut sensors(3), |device, t| (device != dead || t < 5.0).then_some(0.0));
            let (gap_s, error) = quality(&samples);
            assert!(gap_s < 0.06 && error < 1e-3, "{dead}: {gap_s} {error}");
            assert_eq!(said.len(), 1, "{said:?}");
            assert!(
                said[0].contains(&format!("imu_{dead} gives no samples")) && said[0].contains("carry on"),
                "{said:?}"
            );
        }
    }

    #[test]
    fn one_that_repeats_itself_or_drifts_away_is_left_out_and_comes_back() {
        let stuck = |device: usize, t: f64| Some(if device == 1 && t > 3.0 { f64::NAN } else { 0.0 });
        let (samples, said) = run(&mut sensors(3), stuck);
        assert!(quality(&samples).1 < 1e-3);
        assert!(said.len() == 1 && said[0].contains("imu_1 repeats the same sample"), "{said:?}");
        let jump =
            |device: usize, t: f64| Some(if device == 2 && (3.0..6.0).contains(&t) { 0.5 } else { 0.0 });
        let (samples, said) = run(&mut sensors(3), jump);
        assert!(quality(&samples).1 < 1e-3);
        assert_eq!(said.len(), 2, "{said:?}");
        assert!(said[0].contains("imu_2 differs from the others by 0.500 rad/s"), "{said:?}");
        assert!(said[1].contains("imu_2 takes part again"), "{said:?}");
    }

    #[test]
    fn two_that_disagree_give_nothing_and_say_why() {
        let mut imu = sensors(2);
        let (samples, said) = run(&mut imu, |device, t| Some(if device == 1 && t > 5.0 { 0.5 } else { 0.0 }));
        assert!((480..=505).contains(&samples.len()), "{}", samples.len());
        assert!(imu.is_undecided());
        assert!(said.len() == 1 && said[0].contains("nobody can say which is wrong"), "{said:?}");
    }

    /// Three gyros of one axis each, and an accelerometer: a triad, which is no more when one of them dies.
    #[test]
    fn a_triad_of_single_axes_needs_each_of_them() {
        let axis = |device: usize| {
            let axes = InertialAxes::triads();
            let one = InertialAxes { rate_b: vec![axes.rate_b[device]], force_b: vec![] };
            Member { device, name: format!("gyro_{device}"), axes: one }
        };
        let forces = InertialAxes { rate_b: vec![], ..InertialAxes::triads() };
        let mut members: Vec<Member> = (0..3).map(axis).collect();
        members.push(Member { device: 3, name: "accelerometer".into(), axes: forces });
        let setup = ImuSetup { members, ..sensors(0).setup };
        assert!(setup.is_complete(|_| true) && !setup.is_complete(|device| device != 1));
        let mut imu = LogicalImu::new(setup);
        let begin = Instant::now();
        let mut found = Vec::new();
        for k in 0..100_u64 {
            let noise = 1e-6 * (k % 7) as f64;
            let force = FORCE.map(|x| x + noise);
            let gyros = RATE.map(|x| vec![x + noise]);
            let all =
                gyros.iter().map(|rate| (rate.as_slice(), &[][..])).chain([(&[][..], force.as_slice())]);
            for (device, (rate, force)) in all.enumerate() {
                let at = begin + Duration::from_millis(10 * k + 2 * device as u64);
                if device != 1 || k < 50 {
                    found.extend(imu.sampled(device, at, rate, force));
                }
            }
        }
        assert!((45..=55).contains(&found.len()), "{}", found.len());
        assert!(found.iter().all(|s| (s.rate_b_rad_s - Vector3::from(RATE)).norm() < 2e-5));
        assert!(imu.is_undecided());
    }
}
