//! A running experiment: steps, goals, law and references.

mod resume;
mod steps;

use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_control::formation::{
    Goals, LawInput, Member, MotionDemand, Offset, ReferenceShaper, Relation, RelativeAttitudeLaw, Shaped,
    YawPitchRoll,
};
use whorl_control::reference::Reference;
use whorl_math::attitude_error;
use whorl_node::{Outputs, Timestamp};

use crate::goal::{Goal, Planning, scan_motion};
use crate::parameters::{CoObservation, Parameters, Scan, Step, StepKind, YawZero};
use crate::pause::{PauseDecision, PauseWatch, PlatformCondition};
use crate::progress::fingerprint;

/// Period of the references \[s\].
pub(crate) const REFERENCE_PERIOD_S: f64 = 0.02;
/// A platform slower than this counts as at rest when its reference starts from its motion \[rad/s\].
const STANDING_RAD_S: f64 = 0.01;

/// State of one platform at one instant, as used by the run.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sight {
    /// Attitude and rate; `None` unless fresh and healthy.
    pub motion: Option<(UnitQuaternion<f64>, Vector3<f64>)>,
    /// Age of its estimate \[s\].
    pub age_s: f64,
    /// Whether its estimate is fresh.
    pub fresh: bool,
    /// Whether it has stopped moving as its model says.
    pub mismatch: bool,
    /// Whether its controller follows its reference.
    pub following: bool,
    /// Whether its controller says that it does not get what is being sent to it.
    pub deaf: bool,
    /// Whether it plays an excitation instead of tracking its reference.
    pub excited: bool,
    /// The reference that another coordinator gives it, if fresh.
    pub reference: Option<Reference>,
}

/// A platform's part of the run.
#[derive(Debug, Clone)]
pub(crate) struct Leg {
    /// Where its reference started.
    start: UnitQuaternion<f64>,
    shaper: ReferenceShaper,
    offset_angles: YawPitchRoll,
    /// How the offset moves, and the time since its start \[s\].
    offset_motion: Option<(OffsetMotion, f64)>,
    /// Its own motion, for a platform that leads.
    goal: Option<Goal>,
    was_usable: bool,
    /// Its reference follows the platform because it is excited, or was until just now.
    carried: bool,
    /// The reference at this instant.
    pub shaped: Shaped,
    /// Whether it is commanded to come to rest.
    pub holding: bool,
}

/// An offset that moves.
#[derive(Debug, Clone)]
enum OffsetMotion {
    /// It swings.
    Scan(Scan),
    /// It follows a co-observation pass.
    Pass { pass: Arc<CoObservation>, leader: usize, platform: usize },
}

/// How a tick ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Progress {
    /// Continues, or waits.
    Running,
    /// The last step is over.
    Finished,
    /// The experiment must be aborted; the reason.
    Abort(String),
}

/// The run.
#[derive(Debug)]
pub(crate) struct Run {
    law: Box<dyn RelativeAttitudeLaw>,
    pub legs: Vec<Leg>,
    /// Which experiment this is.
    fingerprint: u64,
    /// The virtual structure's motion, when the law has one.
    structure_goal: Option<Goal>,
    step: usize,
    pub step_elapsed_s: f64,
    pub paused_s: f64,
    pub started: Timestamp,
    watch: PauseWatch,
    /// Since when it holds because a platform does not move as its model says.
    mismatch_since: Option<Timestamp>,
    /// Why a person holds it, until it is started again.
    pub held: Option<String>,
    pub paused: bool,
    members: Vec<Member>,
    goals: Goals,
    offsets: Vec<Offset>,
    demands: Vec<MotionDemand>,
}

impl Run {
    /// Starts from the platforms' current attitudes. `Err` names a platform whose attitude is unknown.
    pub fn start(
        parameters: &Parameters,
        sights: &[Sight],
        now: Timestamp,
        outputs: &mut Outputs,
    ) -> Result<Self, String> {
        let mut run = Self::at_rest(parameters, sights, now)?;
        run.begin_step(parameters, outputs);
        Ok(run)
    }

    /// Every reference at rest where its platform is; no step has begun.
    fn at_rest(parameters: &Parameters, sights: &[Sight], now: Timestamp) -> Result<Self, String> {
        let law = parameters.law.laws.first().ok_or("the experiment has no law")?.clone();
        let mut legs = Vec::with_capacity(sights.len());
        for (platform, sight) in sights.iter().enumerate() {
            let name = parameters.platforms.get(platform).map_or("?", String::as_str);
            let (q, _) = match sight.motion {
                // A platform's own coordinator needs to see its neighbours only.
                None if !parameters.hears(platform) => (UnitQuaternion::identity(), Vector3::zeros()),
                seen => seen.ok_or_else(|| format!("{name}: its attitude is not known"))?,
            };
            let limits = parameters.limits.get(platform).ok_or_else(|| format!("{name}: no limits"))?;
            let shaper = ReferenceShaper::new(*limits, parameters.bandwidth_rad_s, &q)
                .map_err(|e| format!("{name}: {e}"))?;
            let start = shaper.reference();
            let goal = law.leads(platform).then(|| goal_at(parameters, &start.q_world_reference));
            legs.push(Leg {
                start: start.q_world_reference,
                shaped: Shaped { reference: start, clipped: false },
                shaper,
                offset_angles: parameters.law.offsets.get(platform).copied().unwrap_or_default(),
                offset_motion: None,
                goal,
                was_usable: true,
                carried: false,
                holding: true,
            });
        }
        let structure_goal = law.moves_a_structure().then(|| {
            let first = legs.first().map(|leg| leg.shaped.reference.q_world_reference).unwrap_or_default();
            goal_at(parameters, &(first * parameters.law.offset(0).inverse()))
        });
        let platforms = legs.len();
        let mut run = Self {
            law,
            legs,
            fingerprint: fingerprint(parameters),
            structure_goal,
            step: 0,
            step_elapsed_s: 0.0,
            paused_s: 0.0,
            started: now,
            watch: PauseWatch::new(platforms),
            mismatch_since: None,
            held: None,
            paused: false,
            members: Vec::with_capacity(platforms),
            goals: Goals {
                formation: Reference::at_rest(UnitQuaternion::identity()),
                individual: vec![None; platforms],
            },
            offsets: Vec::with_capacity(platforms),
            demands: Vec::with_capacity(platforms),
        };
        run.look(parameters, sights);
        run.restart_law();
        Ok(run)
    }

    /// The current step.
    pub fn step<'p>(&self, parameters: &'p Parameters) -> Option<&'p Step> {
        parameters.steps.get(self.step)
    }

    /// Name of the law in force.
    pub fn law_name(&self) -> &'static str {
        self.law.name()
    }

    /// Messages between neighbours so far, if the law counts them.
    pub fn broadcasts(&self) -> Option<u64> {
        self.law.broadcasts()
    }

    /// Attitude of a platform relative to its leader that the law demands.
    pub fn relation(&self, platform: usize) -> Option<Relation> {
        self.law.relation(&self.input(), platform)
    }

    /// Error against that attitude \[rad\].
    pub fn relative_error_rad(&self, platform: usize) -> Option<Vector3<f64>> {
        self.law.relative_error_rad(&self.input(), platform)
    }

    /// Applies limits that were changed while running.
    pub fn apply_limits(&mut self, parameters: &Parameters) {
        for (leg, limits) in self.legs.iter_mut().zip(&parameters.limits) {
            // Both were checked when they were read.
            let _ = leg.shaper.set_limits(*limits, parameters.bandwidth_rad_s);
        }
    }

    /// One period: references for `now`.
    pub fn tick(
        &mut self,
        parameters: &Parameters,
        sights: &[Sight],
        now: Timestamp,
        outputs: &mut Outputs,
    ) -> Progress {
        let step = parameters.steps.get(self.step).map(|step| &step.kind);
        for (platform, (leg, sight)) in self.legs.iter_mut().zip(sights).enumerate() {
            leg.shaper.advance(REFERENCE_PERIOD_S);
            let exciting = matches!(step, Some(StepKind::Excite(excite)) if excite.concerns(platform));
            leg.rejoin(sight, parameters.link.rejoin_error_rad, exciting);
        }
        self.look(parameters, sights);
        let verdict = self.watch.evaluate(
            now,
            &self.conditions(parameters, sights),
            &parameters.link,
            &parameters.faults,
        );
        let holds_for_s = parameters.experiment.holds_on_mismatch;
        let mismatch = holds_for_s.is_some() && sights.iter().any(|sight| sight.mismatch);
        self.mismatch_since = if mismatch { self.mismatch_since.or(Some(now)) } else { None };
        if let (Some(since), Some(for_s)) = (self.mismatch_since, holds_for_s)
            && now.seconds_since(since) > for_s
        {
            return Progress::Abort(format!(
                "a platform has not moved as its model says for more than {for_s} s"
            ));
        }
        match verdict {
            PauseDecision::Go if mismatch || self.held.is_some() => {
                self.paused = true;
                self.paused_s += REFERENCE_PERIOD_S;
            }
            PauseDecision::Go => {
                if self.paused {
                    self.resume(parameters);
                }
                self.advance_steps(parameters, outputs);
            }
            PauseDecision::Wait => {
                self.paused = true;
                self.paused_s += REFERENCE_PERIOD_S;
            }
            PauseDecision::LinkTimeout => {
                return Progress::Abort(format!(
                    "a link stayed stale for more than {} s",
                    parameters.link.timeout_s
                ));
            }
            PauseDecision::FaultTimeout => {
                return Progress::Abort(format!(
                    "a platform did not follow its reference for more than {} s",
                    parameters.faults.timeout_s
                ));
            }
        }
        self.ask_law();
        for ((leg, sight), demand) in self.legs.iter_mut().zip(sights).zip(&self.demands) {
            leg.holding = *demand == MotionDemand::Hold || sight.motion.is_none() || !sight.following;
            // An excited platform gets no reference; the reference follows it, ready to resume.
            let demand = if leg.holding || sight.excited { &MotionDemand::Hold } else { demand };
            leg.shaped = leg.shaper.plan(demand, REFERENCE_PERIOD_S);
        }
        if self.step < parameters.steps.len() { Progress::Running } else { Progress::Finished }
    }

    /// One period after the last step: every reference comes to rest and stays.
    pub fn tick_finished(&mut self) {
        for leg in &mut self.legs {
            leg.shaper.advance(REFERENCE_PERIOD_S);
            leg.shaped = leg.shaper.plan(&MotionDemand::Hold, REFERENCE_PERIOD_S);
            leg.holding = true;
        }
    }

    fn ask_law(&mut self) {
        if self.paused {
            self.demands.clear();
            self.demands.resize(self.legs.len(), MotionDemand::Hold);
            return;
        }
        let input = LawInput {
            dt_s: REFERENCE_PERIOD_S,
            members: &self.members,
            goals: &self.goals,
            offsets: &self.offsets,
        };
        self.law.demands(&input, &mut self.demands);
    }

    fn restart_law(&mut self) {
        let input = LawInput {
            dt_s: REFERENCE_PERIOD_S,
            members: &self.members,
            goals: &self.goals,
            offsets: &self.offsets,
        };
        self.law.restart(&input);
    }

    fn input(&self) -> LawInput<'_> {
        LawInput {
            dt_s: REFERENCE_PERIOD_S,
            members: &self.members,
            goals: &self.goals,
            offsets: &self.offsets,
        }
    }

    /// Collects the inputs of the law.
    fn look(&mut self, parameters: &Parameters, sights: &[Sight]) {
        self.members.clear();
        self.offsets.clear();
        for (platform, (leg, sight)) in self.legs.iter().zip(sights).enumerate() {
            let own = parameters.commands(platform);
            let present = sight.motion.map_or(UnitQuaternion::identity(), |(q, _)| q);
            let reference = if own {
                leg.shaper.reference()
            } else {
                sight.reference.unwrap_or(Reference::at_rest(present))
            };
            let (q_world_body, omega_wb_b_rad_s) =
                sight.motion.unwrap_or((reference.q_world_reference, Vector3::zeros()));
            self.members.push(Member {
                q_world_body,
                omega_wb_b_rad_s,
                age_s: sight.age_s,
                usable: sight.motion.is_some(),
                // Without a reference, the estimated rate is the only information about the platform's motion.
                tracking: sight.following && (own || sight.reference.is_some()),
                reference,
            });
            self.offsets.push(leg.offset());
        }
        self.gather_goals();
    }

    fn gather_goals(&mut self) {
        if let Some(goal) = &self.structure_goal {
            self.goals.formation = goal.reference();
        }
        for (individual, leg) in self.goals.individual.iter_mut().zip(&self.legs) {
            *individual = leg.goal.as_ref().map(Goal::reference);
        }
    }

    fn conditions(&self, parameters: &Parameters, sights: &[Sight]) -> Vec<PlatformCondition> {
        let other =
            PlatformCondition { fresh: true, usable: true, following: true, deaf: false, leads: false };
        let condition = |(platform, sight): (usize, &Sight)| PlatformCondition {
            fresh: sight.fresh,
            usable: sight.motion.is_some(),
            following: sight.following,
            deaf: sight.deaf,
            leads: self.law.needs_all() || self.law.leads(platform),
        };
        // Other platforms have their own coordinators.
        let judged = |(platform, sight)| {
            if parameters.commands(platform) { condition((platform, sight)) } else { other }
        };
        sights.iter().enumerate().map(judged).collect()
    }
}

impl Leg {
    /// The current commanded offset.
    fn offset(&self) -> Offset {
        let constant = Offset::constant(self.offset_angles.attitude());
        match &self.offset_motion {
            Some((OffsetMotion::Scan(scan), elapsed_s)) if *elapsed_s < scan.duration_s => {
                Offset::moving(&scan_motion(scan, &self.offset_angles, *elapsed_s).reference())
            }
            Some((OffsetMotion::Pass { pass, leader, platform }, elapsed_s)) => {
                let motion = |index: usize| pass.motion(index, *elapsed_s, 0.0);
                motion(*leader).zip(motion(*platform)).map_or(constant, |(l, p)| Offset::between(&l, &p))
            }
            _ => constant,
        }
    }

    /// The reference of a platform that does not follow, or is `exciting`, follows the platform. If a platform was lost and
    /// returns far from its reference, the reference restarts from its attitude. Otherwise no reference jumps.
    fn rejoin(&mut self, sight: &Sight, rejoin_error_rad: f64, exciting: bool) {
        let returned = sight.motion.is_some() && !self.was_usable;
        self.was_usable = sight.motion.is_some();
        let Some((q, omega)) = sight.motion else { return };
        let far = || {
            let reference = self.shaper.reference().q_world_reference;
            attitude_error(&reference, &q).norm() > rejoin_error_rad
        };
        // The old goal is obsolete; a slew that has begun since starts from the current attitude.
        if let Some(goal) = &mut self.goal {
            if sight.excited && exciting {
                *goal = Goal::new(&q, goal.yaw_zero_rad());
            } else if self.carried && !sight.excited {
                goal.moved_to(&q, Planning::Smooth(self.shaper.limits()));
            }
        }
        let was_carried = std::mem::replace(&mut self.carried, sight.excited);
        if !sight.following || sight.excited || was_carried || (returned && far()) {
            let omega = if omega.norm() > STANDING_RAD_S { omega } else { Vector3::zeros() };
            self.shaper.restart_moving(&q, &omega, REFERENCE_PERIOD_S);
        }
    }
}

fn goal_at(parameters: &Parameters, q_world_goal: &UnitQuaternion<f64>) -> Goal {
    let yaw_zero_rad = match parameters.experiment.yaw_zero {
        YawZero::Start => YawPitchRoll::of(q_world_goal).yaw_rad,
        YawZero::World => 0.0,
    };
    Goal::new(q_world_goal, yaw_zero_rad)
}
