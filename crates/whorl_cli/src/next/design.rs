//! Which manoeuvre of the family tells most.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, bail};
use whorl_diagnosis::{Diagnosis, Options, Prospect, Verdict, fit, prospects};
use whorl_dynamics::PlatformModel;
use whorl_recording::{KnownPlatform, Recording};

use super::experiment;
use super::family::{Envelope, Manoeuvre, family};
use super::rehearsal::{Demand, Stage};
use crate::progress;

/// How often a manoeuvre that goes too far is made smaller, and by how much each time.
const ATTEMPTS: usize = 4;
const SMALLER: f64 = 0.75;
/// Steps in the probability of telling explanations apart that are worth more than a shorter run.
const STEPS: f64 = 20.0;

/// A manoeuvre with what it would bring.
#[derive(Debug, Clone)]
pub struct Judged {
    pub manoeuvre: Manoeuvre,
    pub envelope: Envelope,
    pub demand: Demand,
    pub prospect: Prospect,
    /// Its motion in simulation.
    pub motion: Recording,
}

/// What is proposed, and what else was looked at.
#[derive(Debug, Clone)]
pub struct Design {
    /// The sets of effects that are to be told apart; an empty set is the model as it is.
    pub explanations: Vec<Vec<String>>,
    /// What the data at hand say.
    pub now: Prospect,
    /// All manoeuvres within the limits, best first.
    pub judged: Vec<Judged>,
    /// Manoeuvres beyond the limits, with the reason.
    pub left_out: Vec<(String, String)>,
    /// Whether explanations are to be separated; else more effects are to be shown.
    pub separates: bool,
}

impl Design {
    /// The best manoeuvre.
    pub fn best(&self) -> Option<&Judged> {
        self.judged.first()
    }
}

/// Judges every manoeuvre of the family.
pub fn design(
    known: &KnownPlatform,
    common: &Path,
    training: &[Recording],
    diagnosis: &Diagnosis,
    options: &Options,
) -> anyhow::Result<Design> {
    if training.iter().all(|r| r.mounting == whorl_recording::Mounting::Clamped) {
        bail!(
            "all runs are of a clamped platform, and manoeuvres are designed for a free one: for a bench test let every wheel coast down from full speed to both sides, then brake it through zero"
        );
    }
    let explanations = diagnosis.explanations();
    let truth = simulated_truth(known, training, &diagnosis.effects, options);
    let stage = Stage::new(known, common, &truth)?;
    let (tried, left_out) = progress::during("rehearsing manoeuvres in simulation", || {
        rehearse_all(&stage, known, options.threads)
    })?;
    if tried.is_empty() {
        let reasons: Vec<String> = left_out.iter().map(|(name, reason)| format!("{name} {reason}")).collect();
        bail!("no manoeuvre stays within the platform's limits: {}", reasons.join("; "));
    }
    let further: Vec<Recording> = tried.iter().map(|(_, _, motion, _)| motion.clone()).collect();
    let found = progress::during("judging what each would tell", || {
        prospects(training, &further, &known.model, &known.prior, &explanations, options)
    })
    .context("cannot judge the manoeuvres")?;
    let mut judged: Vec<Judged> = tried
        .into_iter()
        .zip(found.with)
        .map(|((manoeuvre, envelope, motion, demand), prospect)| Judged {
            manoeuvre,
            envelope,
            demand,
            prospect,
            motion,
        })
        .collect();
    let separates =
        matches!(diagnosis.verdict, Verdict::Confounded | Verdict::Named) && found.now.log_odds.is_some();
    let worth = |j: &Judged| {
        let odds = (STEPS * j.prospect.told_apart.unwrap_or(0.0)).round();
        let shown = j.prospect.shown.len() as f64;
        let short = -j.demand.duration_s;
        if separates { [odds, short, shown] } else { [shown, odds, short] }
    };
    judged.sort_by(|a, b| {
        let pairs = worth(b).into_iter().zip(worth(a));
        pairs.map(|(b, a)| b.total_cmp(&a)).find(|o| o.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
    });
    Ok(Design { explanations, now: found.now, judged, left_out, separates })
}

/// The platform as the data say: the best explanation fitted; the model as given where no fit is possible.
fn simulated_truth(
    known: &KnownPlatform,
    training: &[Recording],
    effects: &[String],
    options: &Options,
) -> PlatformModel {
    let ids: Vec<&str> = effects.iter().map(String::as_str).collect();
    let fitted = progress::during("fitting the leading explanation", || {
        fit(training, &[], &known.model, &known.prior, &ids, options)
    });
    fitted.map_or_else(|_| known.model.clone(), |fitted| fitted.model)
}

type Tried = (Manoeuvre, Envelope, Recording, Demand);

/// A manoeuvre within the limits, or why it is not.
enum Rehearsed {
    Fits(Box<Tried>),
    GoesTooFar(String),
}

/// Manoeuvres that fit, and the names of those that do not, with the reason.
type Sorted = (Vec<Tried>, Vec<(String, String)>);

/// Simulates each manoeuvre, smaller if need be.
fn rehearse_all(stage: &Stage, known: &KnownPlatform, threads: usize) -> anyhow::Result<Sorted> {
    let names: Vec<&'static str> = family(&Envelope::of(&known.model, 1.0)).iter().map(|m| m.name).collect();
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::<(usize, anyhow::Result<Rehearsed>)>::new());
    std::thread::scope(|scope| {
        for _ in 0..threads.clamp(1, names.len().max(1)) {
            scope.spawn(|| {
                loop {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    let Some(name) = names.get(k) else { break };
                    let result = rehearse(stage, known, name);
                    if let Ok(mut all) = results.lock() {
                        all.push((k, result));
                    }
                }
            });
        }
    });
    let mut all = results.into_inner().unwrap_or_default();
    all.sort_by_key(|(k, _)| *k);
    let (mut tried, mut left_out) = (Vec::new(), Vec::new());
    for (k, result) in all {
        match result? {
            Rehearsed::Fits(found) => tried.push(*found),
            Rehearsed::GoesTooFar(reason) => {
                left_out.push((names.get(k).copied().unwrap_or("").to_owned(), reason))
            }
        }
    }
    Ok((tried, left_out))
}

fn rehearse(stage: &Stage, known: &KnownPlatform, name: &str) -> anyhow::Result<Rehearsed> {
    let mut scale = 1.0;
    let mut reason = String::new();
    for _ in 0..ATTEMPTS {
        let envelope = Envelope::of(&known.model, scale);
        let Some(manoeuvre) = family(&envelope).into_iter().find(|m| m.name == name) else { break };
        let text = experiment::yaml(name, &known.platform, &envelope, &manoeuvre, &[]);
        let (motion, demand) = stage
            .rehearse(name, &text, &known.model)
            .with_context(|| format!("cannot simulate the manoeuvre {name}"))?;
        match demand.objection() {
            None => return Ok(Rehearsed::Fits(Box::new((manoeuvre, envelope, motion, demand)))),
            Some(objection) => reason = objection,
        }
        scale *= SMALLER;
    }
    Ok(Rehearsed::GoesTooFar(reason))
}

/// The parameters that all nodes share: beside the model, in `folder`, or in the working directory's `params`.
pub fn common_file(known: &KnownPlatform, folder: Option<&Path>) -> Option<PathBuf> {
    let beside = known.files.iter().find(|f| f.file_name().is_some_and(|n| n == "common.yaml")).cloned();
    let there = [folder, Some(Path::new("params"))];
    beside.or_else(|| there.into_iter().flatten().map(|f| f.join("common.yaml")).find(|f| f.is_file()))
}
