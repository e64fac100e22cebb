//! Builds a case: draws the platform, the runs and the effect, sets its size, simulates, measures.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use nalgebra::Vector3;
use serde::Serialize;
use sha2::{Digest, Sha256};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::ModelPrior;
use whorl_recording::Recording;

use super::catalogue::{
    Drawn, PAIRED, SINGLES, Stage, Values, draw, install, is_comparable, parameters, rivals,
};
use super::foreign;
use super::plan::{Cell, Spec};
use crate::detectability::{Lens, Seen};
use crate::scenario::{NoiseLevels, Stated, Style, index, measure, plan as make_plan, rng};
use crate::truth::body::across;
use crate::truth::run::Span;
use crate::truth::{Body, Hidden, Mechanics, Plan, simulate};

/// Separation above which an effect is clearly distinct from its rivals.
const TOLD_APART: f64 = 50.0;

/// Detectability that first data have at least, where a follow-up shall decide.
const SHOWS: f64 = 100.0;

/// Integration step of rehearsals, of which only the motion counts \[s\].
const REHEARSAL_STEP_S: f64 = 5e-3;

/// Share of a parameter's step from which its slope is taken.
const SMALL_STEP: f64 = 0.05;

/// Integration step of the truth \[s\].
const STEP_S: f64 = 1e-3;

/// Input of the tool: drawing and prior, the same for all cases except for the stated noise.
#[derive(Debug, Clone)]
pub struct Laboratory {
    pub model: PlatformModel,
    pub prior: ModelPrior,
}

impl Laboratory {
    /// Whorl-I as its parameter file says.
    ///
    /// # Errors
    /// When `params/whorl_1.yaml` cannot be read.
    pub fn whorl_1() -> Result<Self> {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../params/whorl_1.yaml");
        let known =
            whorl_recording::read_model(file.as_ref(), Some("whorl_1")).context("params/whorl_1.yaml")?;
        let mut model = known.model;
        model.effects.clear();
        Ok(Self { prior: ModelPrior::typical(&model), model })
    }
}

/// The sealed answer.
#[derive(Debug, Clone, Serialize)]
pub struct Answer {
    pub key: String,
    pub effects: Vec<String>,
    /// Effect -> parameter -> true value; those whose interval must cover it.
    pub comparable: BTreeMap<String, Values>,
    pub values: BTreeMap<String, Values>,
    /// Detectability reached.
    pub lambda: f64,
    /// Detectability left if the most similar effect stood in its place: below 12, they cannot be distinguished.
    pub separation: f64,
    /// The most similar effect.
    pub nearest: Option<String>,
    pub foreign: Option<String>,
    /// Variable and form of a drawn law, as `whorl discover` writes them, and the law itself in words.
    #[serde(skip)]
    pub law: Option<(String, String, String)>,
    pub salt: String,
}

impl Answer {
    /// Printed before the diagnosis runs.
    #[must_use]
    pub fn seal(&self) -> String {
        let text = serde_json::to_string(self).unwrap_or_default();
        Sha256::digest(text.as_bytes()).iter().map(|b| format!("{b:02x}")).collect()
    }
}

/// A case, ready for the tool.
pub struct Built {
    pub spec: Spec,
    pub training: Vec<Recording>,
    pub held_out: Vec<Recording>,
    /// Further runs that could be flown, for confounded cases.
    pub follow_ups: Vec<FollowUp>,
    stand: Arc<Stand>,
    laboratory: Laboratory,
    pub model: PlatformModel,
    pub prior: ModelPrior,
    pub answer: Answer,
}

/// A manoeuvre that may be proposed.
pub struct FollowUp {
    pub style: Style,
    plan: Plan,
    /// What is measured if it is flown.
    pub recording: Recording,
}

impl Built {
    /// A manoeuvre in simulation, beforehand: with the effects that the tool assumes, because the truth is not known
    /// yet. `None` where it would go too far.
    #[must_use]
    pub fn rehearsed(&self, follow_up: &FollowUp, effects: &[(&str, Values)]) -> Option<Recording> {
        let (stand, key) = (&self.stand, format!("{}/rehearsal", self.spec.key()));
        let hidden = stand.hidden(effects);
        record(stand, follow_up.style, &follow_up.plan, &hidden, &self.laboratory, &key, REHEARSAL_STEP_S)
            .ok()
    }
}

/// Runs and platform shared by the cases of a group.
pub struct Stand {
    body: Body,
    plans: Vec<Plan>,
    held_out: Plan,
    /// The first is the one that separates the effects.
    follow_ups: Vec<(Style, Plan)>,
    stage: Stage,
    levels: NoiseLevels,
    lens: Lens,
    follow_lens: Option<Lens>,
    styles: Vec<Style>,
}

/// Which stand a case is run on: cases that share one are built faster.
#[must_use]
pub fn stand_key(spec: &Spec) -> String {
    match spec.cell {
        Cell::Single | Cell::Pair | Cell::Outside => {
            let group = match spec.cell {
                Cell::Single => SINGLES.iter().position(|e| *e == spec.effects[0]).unwrap_or(0) / 8,
                Cell::Pair => 10 + spec.seed as usize % 3,
                _ => 20,
            };
            format!("rich/{group}/{}", spec.seed)
        }
        Cell::Control => format!("control/{}", spec.seed),
        Cell::Confounded => format!("confounded/{}/{}", spec.effects[0], spec.seed),
        Cell::ClosedLoop => format!("closed_loop/{}", spec.seed),
        Cell::Bench => format!("bench/{}", spec.seed),
    }
}

impl Stand {
    /// Draws platform and runs.
    #[must_use]
    pub fn new(laboratory: &Laboratory, key: &str, spec: &Spec) -> Self {
        let body = Body::built(&laboratory.model, &laboratory.prior, &mut rng(&format!("{key}/body")));
        let none = Hidden::none(body.wheels.len(), body.jets.len());
        let (styles, held) = match spec.cell {
            Cell::Confounded => match spec.effects[0].as_str() {
                "spin" => (vec![Style::NarrowSpin; 3], Style::NarrowSpin),
                "jets" => (vec![Style::OnePulse; 3], Style::OnePulse),
                "wheels" => (vec![Style::SteadyWheels; 2], Style::SteadyWheels),
                _ => (vec![Style::FixedHeading; 3], Style::FixedHeading),
            },
            Cell::ClosedLoop => (vec![Style::ClosedLoop; 3], Style::ClosedLoop),
            Cell::Bench => (vec![Style::Bench; 2], Style::Bench),
            _ => (vec![Style::Multisine, Style::YawTurns, Style::Mixed], Style::Mixed),
        };
        let further: &[Style] = match styles[0] {
            Style::NarrowSpin => &[Style::CoastDown, Style::SlowTurn, Style::SingleJets, Style::WheelSweep],
            Style::FixedHeading => &[Style::SlowTurn, Style::CoastDown, Style::SingleJets, Style::WheelSweep],
            Style::OnePulse => &[Style::SingleJets, Style::SlowTurn, Style::CoastDown, Style::WheelSweep],
            Style::SteadyWheels => &[Style::Bench],
            _ => &[],
        };
        let make = |style: Style, name: &str| make_plan(style, name, &body, &none, &format!("{key}/{name}"));
        let plans: Vec<Plan> =
            styles.iter().enumerate().map(|(i, s)| make(*s, &format!("run_{}", i + 1))).collect();
        let held_out = make(held, "held_out");
        let follow_ups: Vec<(Style, Plan)> = further
            .iter()
            .enumerate()
            .map(|(i, style)| {
                let name = if i == 0 { "follow_up".to_owned() } else { format!("follow_up_{}", i + 1) };
                (*style, make(*style, &name))
            })
            .collect();
        let mechanics = Mechanics::new(body.clone(), none.clone());
        let (mut tilt, mut rate) = (0.0_f64, 0.0_f64);
        let mut yaw_sum = 0.0;
        for plan in &plans {
            let mut plan = plan.clone();
            let start = plan.start.clone();
            let span = Span {
                from_slot: 0,
                to_slot: plan.wheel_command_n_m.len(),
                step_s: 0.01,
                mark_every: usize::MAX,
            };
            let trace = simulate(&mechanics, &mut plan, &start, span, None);
            tilt = tilt.max(trace.largest_tilt_rad);
            rate = rate.max(trace.largest_rate_rad_s);
            let x = start.q_world_body * Vector3::x();
            yaw_sum += x.y.atan2(x.x) / plans.len() as f64;
        }
        let count = |j: usize| plans.iter().map(|p| p.pulses[j].len()).sum::<usize>();
        let stage = Stage {
            wheels: laboratory.model.wheels().iter().map(|w| w.name.clone()).collect(),
            jets: laboratory.model.jets().iter().map(|j| j.name.clone()).collect(),
            firing: (0..body.jets.len()).filter(|j| count(*j) >= 4 || spec.cell == Cell::Bench).collect(),
            largest_tilt_rad: tilt,
            largest_rate_rad_s: rate,
            mean_yaw_rad: yaw_sum,
        };
        let levels = NoiseLevels::of(&laboratory.model);
        // Controls need no lens; one empty segment is enough.
        let seen: &[Plan] = if spec.cell == Cell::Control { &[] } else { &plans };
        let lens = Lens::new(&body, seen, &levels, &laboratory.prior);
        let follow_lens = follow_ups.first().map(|(_, follow)| {
            let mut all = plans.clone();
            all.push(follow.clone());
            Lens::new(&body, &all, &levels, &laboratory.prior)
        });
        Self { body, plans, held_out, follow_ups, stage, levels, lens, follow_lens, styles }
    }

    fn hidden(&self, effects: &[(&str, Values)]) -> Hidden {
        let mut hidden = Hidden::none(self.body.wheels.len(), self.body.jets.len());
        for (id, values) in effects {
            install(&mut hidden, id, values, &self.stage, self.body.weight_n);
        }
        hidden
    }

    /// The size at which `see` has this detectability, if there is one.
    fn size_for(&self, lambda: f64, largest: f64, see: impl Fn(f64) -> f64) -> Option<(f64, f64)> {
        let mut size = 1.0_f64.min(largest);
        let (mut best, mut below, mut above) = (None, 0.0_f64, f64::INFINITY);
        for _ in 0..9 {
            let reached = see(size);
            if (0.85..1.2).contains(&(reached / lambda)) {
                return Some((size, reached));
            }
            if reached / lambda > 0.6 && reached / lambda < 1.7 {
                best = Some((size, reached));
            }
            if reached < lambda {
                below = below.max(size)
            } else {
                above = above.min(size)
            }
            let aimed =
                if reached > 0.0 { size * (lambda / reached).sqrt().clamp(0.02, 20.0) } else { 4.0 * size };
            // Where the square law does not hold, halve the bracket.
            size = if aimed > below && aimed < above { aimed } else { (below.max(1e-9) * above).sqrt() };
            if size >= largest {
                if best.is_some() || below >= largest {
                    return best;
                }
                size = largest;
            }
        }
        best
    }

    fn sized(&self, drawn: &Drawn, lambda: f64) -> Option<(Values, f64)> {
        let see = |size: f64| {
            let hidden = self.hidden(&[(drawn.id, drawn.at(size, &self.stage))]);
            self.lens.detectability(&hidden)
        };
        let (size, reached) = self.size_for(lambda, drawn.largest_size, see)?;
        Some((drawn.at(size, &self.stage), reached))
    }

    /// The remaining signal of an effect with these values when a rival takes its place.
    fn beyond_rival(&self, lens: &Lens, seen: &Seen, own: &Values, rival: &str, slopes: &[Seen]) -> f64 {
        let parameters = parameters(rival, &self.stage);
        lens.beyond_fitted(seen, slopes, |multiples| {
            let mut values = shared_shape(rival, own);
            values.extend(parameters.iter().zip(multiples).map(|((n, step), m)| (n.clone(), step * m)));
            self.hidden(&[(rival, values)])
        })
    }

    /// What a rival changes for each step of each parameter: from a small step, since it is fitted further on.
    fn slopes(&self, lens: &Lens, rival: &str, own: &Values) -> Vec<Seen> {
        parameters(rival, &self.stage)
            .into_iter()
            .map(|(name, step)| {
                let mut values = shared_shape(rival, own);
                values.insert(name, step * SMALL_STEP);
                lens.see(&self.hidden(&[(rival, values)])).times(1.0 / SMALL_STEP)
            })
            .collect()
    }

    /// A size at which the data with the follow-up run separate the effect from every rival, and the first data show that
    /// some effect is present; otherwise no manoeuvre would be proposed.
    fn told_apart(&self, lens: &Lens, drawn: &Drawn, lambda: f64) -> Option<(Values, f64)> {
        let own = drawn.at(1.0, &self.stage);
        let rivals: Vec<(&str, Vec<Seen>)> =
            rivals(drawn.id).into_iter().map(|rival| (rival, self.slopes(lens, rival, &own))).collect();
        // Friction and steady torques: their signal is proportional to them, accurately enough for a size.
        let small = drawn.at(SMALL_STEP, &self.stage);
        let one = lens.see(&self.hidden(&[(drawn.id, small)])).times(1.0 / SMALL_STEP);
        let see = |size: f64| {
            let seen = one.clone().times(size);
            rivals.iter().map(|(_, slopes)| lens.beyond(&seen, slopes)).fold(f64::INFINITY, f64::min)
        };
        let (size, _) = self.size_for(lambda, 60.0, see)?;
        let values = drawn.at(size, &self.stage);
        let reached = self.lens.detectability(&self.hidden(&[(drawn.id, values.clone())]));
        if reached < SHOWS { self.sized(drawn, SHOWS) } else { Some((values, reached)) }
    }

    /// What an effect could show, one parameter at a time.
    fn columns(&self, lens: &Lens, id: &str) -> Vec<Seen> {
        parameters(id, &self.stage)
            .into_iter()
            .map(|(name, step)| lens.see(&self.hidden(&[(id, Values::from([(name, step)]))])))
            .collect()
    }
}

/// What stands in for another effect has its frequency and its place: a resonance the frequency and damping, and it hangs
/// where masses hang; a machine the frequency of a draught, and a draught the phase of its strongest axis; a cable the
/// heading at which another is relaxed.
fn shared_shape(rival: &str, own: &Values) -> Values {
    let same = |names: &[&str]| -> Values {
        names.iter().filter_map(|name| Some(((*name).to_owned(), *own.get(*name)?))).collect()
    };
    match rival {
        "slosh" | "flexible_mode" => {
            let mut values = same(&["frequency_hz", "damping_ratio"]);
            values.insert("height_m".to_owned(), 0.2);
            values
        }
        "periodic_torque" => same(&["frequency_hz"]),
        "air_current_periodic" => {
            let mut values = same(&["frequency_hz"]);
            let axis = |a: &str| {
                let part = |wave: &str| own.get(&format!("{wave}_{a}_n_m")).copied().unwrap_or(0.0);
                (part("cosine"), part("sine"))
            };
            let strongest = ["x", "y", "z"]
                .map(axis)
                .into_iter()
                .max_by(|a, b| f64::hypot(a.0, a.1).total_cmp(&f64::hypot(b.0, b.1)));
            let (cosine, sine) = strongest.unwrap_or_default();
            values.insert("phase_rad".to_owned(), cosine.atan2(sine));
            values
        }
        "winding_cable" | "harness_spring" => same(&["yaw0_rad"]),
        _ => Values::new(),
    }
}

/// Simulates and measures one run.
fn record(
    stand: &Stand,
    style: Style,
    plan: &Plan,
    hidden: &Hidden,
    laboratory: &Laboratory,
    key: &str,
    step_s: f64,
) -> Result<Recording> {
    let mut plan = if style == Style::ClosedLoop {
        // The controller feels the effect.
        make_plan(style, &plan.name, &stand.body, hidden, &format!("{key}/closed_loop/{}", plan.name))
    } else {
        plan.clone()
    };
    let mechanics = Mechanics::new(stand.body.clone(), hidden.clone());
    let start = plan.start.clone();
    let span = Span { from_slot: 0, to_slot: plan.wheel_command_n_m.len(), step_s, mark_every: usize::MAX };
    let trace = simulate(&mechanics, &mut plan, &start, span, None);
    if trace.largest_tilt_rad > 0.985 * stand.body.tilt_max_rad {
        bail!("the platform would touch its stop");
    }
    let mut noise = rng(&format!("{key}/noise/{}", plan.name));
    Ok(measure(&trace, &plan, &stand.levels, &laboratory.model, false, &mut noise))
}

/// Builds a case on its stand.
///
/// # Errors
/// When no plausible size of the effect has the required detectability, or the runs are not possible.
pub fn build(laboratory: &Laboratory, stand: &Arc<Stand>, spec: &Spec) -> Result<Built> {
    let key = spec.key();
    let mut random = rng(&format!("{key}/effect"));
    let lambda = f64::from(spec.lambda);
    let mut answer = Answer {
        key: key.clone(),
        effects: Vec::new(),
        comparable: BTreeMap::new(),
        values: BTreeMap::new(),
        lambda: 0.0,
        separation: f64::INFINITY,
        nearest: None,
        foreign: None,
        law: None,
        salt: format!("{:016x}", rand_salt(&key)),
    };
    let mut hidden = stand.hidden(&[]);
    match spec.cell {
        Cell::Outside => {
            let name = spec.effects[0].clone();
            let foreign = foreign::draw(&name, &stand.stage, &stand.plans, &mut random);
            let imitators: Vec<Seen> = foreign::expected(&name)
                .imitators
                .iter()
                .flat_map(|id| stand.columns(&stand.lens, id))
                .collect();
            let at = |size: f64| Hidden { foreign: foreign::scaled(&foreign, size), ..stand.hidden(&[]) };
            let see = |size: f64| stand.lens.beyond(&stand.lens.see(&at(size)), &imitators);
            if name == "swapped_axes" {
                hidden = at(1.0);
                answer.lambda = see(1.0);
            } else {
                let (size, reached) =
                    stand.size_for(lambda, 60.0, see).context("no size of it shows so much and no more")?;
                hidden = at(size);
                answer.lambda = reached;
            }
            answer.law = hidden
                .foreign
                .law
                .as_ref()
                .map(|law| (law.variable_text().to_owned(), law.form(), format!("{law:?}")));
            answer.foreign = Some(name);
        }
        Cell::Pair => {
            let mut names: Vec<&'static str> = Vec::new();
            for _ in 0..40 {
                let id = SINGLES[index(&mut random, PAIRED)];
                let is_rival = names.iter().any(|n| *n == id || rivals(n).contains(&id));
                if !is_rival {
                    let drawn = draw(id, &stand.stage, &mut random);
                    if let Some((values, reached)) = stand.sized(&drawn, lambda) {
                        names.push(id);
                        answer.lambda = reached;
                        note(&mut answer, stand, laboratory, id, values);
                    }
                }
                if names.len() == 2 {
                    break;
                }
            }
            let effects: Vec<(&str, Values)> =
                answer.values.iter().map(|(id, v)| (id.as_str(), v.clone())).collect();
            hidden = stand.hidden(&effects);
            // Each must show beside the other.
            for (id, _) in &effects {
                let alone = stand.lens.see(&stand.hidden(&[(*id, answer.values[*id].clone())]));
                let others: Vec<Seen> = effects
                    .iter()
                    .filter(|(other, _)| other != id)
                    .flat_map(|(other, _)| stand.columns(&stand.lens, other))
                    .collect();
                answer.separation = answer.separation.min(stand.lens.beyond(&alone, &others));
                // Neither may be imitated by another effect, as for one effect alone.
                for rival in rivals(id) {
                    let own = &answer.values[*id];
                    let slopes = stand.slopes(&stand.lens, rival, own);
                    let left = stand.beyond_rival(&stand.lens, &alone, own, rival, &slopes);
                    if left < TOLD_APART && left < answer.separation {
                        answer.separation = left;
                        answer.nearest = Some(rival.to_owned());
                    }
                }
            }
        }
        Cell::Control => {}
        Cell::Single | Cell::Confounded | Cell::ClosedLoop | Cell::Bench => {
            if let Some(id) = spec.effects.last().and_then(|e| SINGLES.iter().find(|s| *s == e)) {
                let drawn = draw(id, &stand.stage, &mut random);
                let (values, reached) = match (&stand.follow_lens, spec.cell) {
                    (Some(lens), Cell::Confounded) => stand.told_apart(lens, &drawn, lambda),
                    _ => stand.sized(&drawn, lambda),
                }
                .context("no plausible size has this detectability")?;
                let seen = stand.lens.see(&stand.hidden(&[(id, values.clone())]));
                for rival in rivals(id) {
                    let slopes = stand.slopes(&stand.lens, rival, &values);
                    let left = stand.beyond_rival(&stand.lens, &seen, &values, rival, &slopes);
                    if left < answer.separation {
                        answer.separation = left;
                        answer.nearest = Some(rival.to_owned());
                    }
                }
                hidden = stand.hidden(&[(id, values.clone())]);
                answer.lambda = reached;
                answer.separation = answer.separation.min(reached);
                note(&mut answer, stand, laboratory, id, values);
            }
        }
    }

    let style = |i: usize| stand.styles.get(i).copied().unwrap_or(Style::Mixed);
    let run = |style: Style, plan: &Plan| record(stand, style, plan, &hidden, laboratory, &key, STEP_S);
    let training =
        stand.plans.iter().enumerate().map(|(i, p)| run(style(i), p)).collect::<Result<Vec<_>>>()?;
    let held_out = vec![run(style(0).held_out(), &stand.held_out)?];
    let mut follow_ups = Vec::new();
    for (style, plan) in &stand.follow_ups {
        // With the effect it may go too far and is then not usable.
        if let Ok(recording) = run(*style, plan) {
            follow_ups.push(FollowUp { style: *style, plan: plan.clone(), recording });
        }
    }
    if follow_ups.is_empty() && !stand.follow_ups.is_empty() {
        bail!("no follow-up run is possible");
    }
    let mut model = laboratory.model.clone();
    Stated::draw(&mut rng(&format!("{key}/stated"))).apply(&mut model);
    Ok(Built {
        spec: spec.clone(),
        training,
        held_out,
        follow_ups,
        stand: Arc::clone(stand),
        laboratory: laboratory.clone(),
        prior: laboratory.prior.clone(),
        model,
        answer,
    })
}

/// How far the follow-up data separate a confounded case, for reports.
#[must_use]
pub fn separation_after_follow_up(stand: &Stand, answer: &Answer) -> Option<f64> {
    let lens = stand.follow_lens.as_ref()?;
    let (id, values) = answer.values.iter().next()?;
    let seen = lens.see(&stand.hidden(&[(id, values.clone())]));
    rivals(id)
        .into_iter()
        .map(|rival| stand.beyond_rival(lens, &seen, values, rival, &stand.slopes(lens, rival, values)))
        .min_by(f64::total_cmp)
}

fn note(answer: &mut Answer, stand: &Stand, laboratory: &Laboratory, id: &str, values: Values) {
    let drawn = Body::as_drawn(&laboratory.model);
    let mut comparable: Values =
        values.iter().filter(|(name, _)| is_comparable(id, name)).map(|(n, v)| (n.clone(), *v)).collect();
    // The tool must find the difference from the drawing, which includes building errors.
    let mut of_part = |name: &str, part: Values| {
        for (suffix, built) in part {
            let name = format!("{name}{suffix}");
            if is_comparable(id, &name) {
                *comparable.entry(name).or_insert(0.0) += built;
            }
        }
    };
    let tilt = |from: &Vector3<f64>, to: &Vector3<f64>| -> Values {
        let turn = from.cross(to);
        let [a, b] = across(from);
        Values::from([("_a_rad".to_owned(), turn.dot(&a)), ("_b_rad".to_owned(), turn.dot(&b))])
    };
    let wheels = stand.stage.wheels.iter().zip(&stand.body.wheels).zip(&drawn.wheels);
    let jets = stand.stage.jets.iter().zip(&stand.body.jets).zip(&drawn.jets);
    match id {
        "wheel_inertia" => wheels.for_each(|((name, is), was)| {
            let ratio = is.spin_inertia_kg_m2 / was.spin_inertia_kg_m2;
            let hidden = values.get(name).copied().unwrap_or(0.0);
            of_part(name, Values::from([(String::new(), (ratio - 1.0) * (1.0 + hidden))]));
        }),
        "wheel_misalignment" => {
            wheels.for_each(|((name, is), was)| of_part(name, tilt(&was.axis_b, &is.axis_b)));
        }
        "thruster_misalignment" => {
            jets.for_each(|((name, is), was)| of_part(name, tilt(&was.direction_b, &is.direction_b)));
        }
        _ => {}
    }
    answer.effects.push(id.to_owned());
    answer.comparable.insert(id.to_owned(), comparable);
    answer.values.insert(id.to_owned(), values);
}

fn rand_salt(key: &str) -> u64 {
    Sha256::digest(format!("salt of {key}").as_bytes())
        .iter()
        .take(8)
        .fold(0, |sum, b| (sum << 8) | u64::from(*b))
}

impl Style {
    /// The style of the held-out run beside training runs of this one.
    fn held_out(self) -> Self {
        if self == Self::ClosedLoop { Self::ClosedLoop } else { Self::Mixed }
    }
}
