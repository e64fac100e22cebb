//! Which sets of effects are worth a fit, and what each is worth: best first, by what the samples predict beside the most probable set.

pub(crate) mod beside;
mod hidden;
pub(crate) mod hypothesis;
pub(crate) mod information;
pub(crate) mod prior;
pub(crate) mod unlisted;

use whorl_dynamics::Effect;
use whorl_dynamics::effects::Clues;

use crate::signals::lines::Lines;
use crate::signals::seen::Seen;
use crate::signals::{Observed, observed};
use crate::{DiagnosisError, Options, Progress, Settings};

pub(crate) use beside::{Beside, View};
pub(crate) use hypothesis::{Evaluated, Hypothesis, Runs};
use prior::log_prior;

/// Sets that are fitted at most, that of no effects included.
const MOST_FITS: usize = 18;
/// Sets that are fitted of those proposed beside one, and beside that of no effects.
const MOST_ASKED: usize = 4;
const MOST_ASKED_FIRST: usize = 6;

/// Deviations that chance exceeds once in a thousand times, to one side.
const CERTAIN: f64 = 3.09;

/// What turns by more than this within the time of which readings are taken in together is lost by it: a quarter of a turn takes off a tenth.
const FASTEST_CYCLES: f64 = 0.25;

/// Sets of effects that were fitted, and what the runs are without any.
pub(crate) struct Selection<'a> {
    pub runs: Runs<'a>,
    /// The first is that of no effects.
    pub evaluated: Vec<Evaluated>,
    /// The runs as the set of no effects leaves them,
    pub observed: Vec<Observed<'a>>,
    /// with the fast effects that they show,
    pub seen: Seen,
    /// and other periodicities.
    pub lines: Lines,
    /// What the samples say beside sets that were looked at, by their names.
    views: Vec<(Vec<&'static str>, Vec<View>)>,
}

impl<'a> Selection<'a> {
    /// Fits the platform's own parameters, then sets of effects that the samples propose, until nothing more probable is in sight.
    pub fn new(
        runs: Runs<'a>,
        options: &Options,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Self, DiagnosisError> {
        progress(Progress { share: 0.05, doing: "fitting the platform's own parameters to every sample" });
        let mut selection = Self::begun(runs, options)?;
        let mut expanded: Vec<Vec<&'static str>> = Vec::new();
        while let Some(most) = selection.most_probable().cloned() {
            let is_done = expanded.iter().any(|names| names == most.names());
            if is_done || most.names().len() >= options.largest_set || selection.evaluated.len() >= MOST_FITS
            {
                break;
            }
            expanded.push(most.names().to_vec());
            progress(selection.progress("comparing every sample with every effect"));
            let (proposals, views) = {
                let Some(beside) = selection.beside(&most, options)? else { break };
                let with_pairs = most.names().is_empty() && options.largest_set > 1;
                (beside.proposals(with_pairs), beside.views().to_vec())
            };
            selection.views.push((most.names().to_vec(), views));
            let asked = if most.names().is_empty() { MOST_ASKED_FIRST } else { MOST_ASKED };
            let is_new = |p: &beside::Proposal, all: &[Evaluated]| {
                all.iter().all(|e| e.names() != p.hypothesis.effects)
            };
            for proposal in proposals.into_iter().take(asked) {
                if selection.evaluated.len() >= MOST_FITS || !is_new(&proposal, &selection.evaluated) {
                    continue;
                }
                progress(selection.progress("fitting what may be missing"));
                selection.evaluate(proposal.hypothesis, &most)?;
            }
        }
        Ok(selection)
    }

    /// The set of no effects alone, and what the runs are with it.
    pub fn begun(runs: Runs<'a>, options: &Options) -> Result<Self, DiagnosisError> {
        let (mut runs, mut base) = (runs, runs.evaluate(Hypothesis::none(runs.reference), &[])?);
        let observed = observed(&runs, &base)?;
        let (model, settings) = (base.model(runs.reference)?, &runs.reference.settings);
        let is_tested = |effect: &dyn Effect| {
            let id = effect.info().id;
            !is_excluded(options, id) && !runs.reference.model.effects.contains_key(id)
        };
        let seen = Seen::of(&observed, &model, settings, is_tested);
        let lines = Lines::of(&observed, &model, &seen.turning, settings);
        let cell_s = settings.prediction.cell_s;
        let is_fast = || !seen.rows.is_empty() || lines.is_any_faster(FASTEST_CYCLES / cell_s, settings);
        if cell_s > 0.0 && is_fast() {
            runs.each_reading = true;
            base = runs.refitted(&base, &base)?;
        }
        Ok(Self { runs, evaluated: vec![base], observed, seen, lines, views: Vec::new() })
    }

    fn progress(&self, doing: &'static str) -> Progress {
        let share = (self.evaluated.len() as f64 / MOST_FITS as f64).sqrt();
        Progress { share: 0.1 + 0.75 * share, doing }
    }

    /// That of no effects.
    pub fn base(&self) -> &Evaluated {
        &self.evaluated[0]
    }

    /// What effects are told of data to find where they may start.
    fn clues(&self) -> Clues<'_> {
        let motions = || self.observed.iter().filter(|run| !run.clamped).map(|run| &run.motion);
        let rates = motions().flat_map(|motion| &motion.omega).map(nalgebra::Vector3::amax);
        let tilts = motions().flat_map(|motion| &motion.q).map(whorl_math::tilt_rad);
        Clues {
            bin_s: self.runs.available.sample_s,
            largest_rate_rad_s: rates.fold(0.0, f64::max),
            largest_tilt_rad: tilts.fold(0.0, f64::max),
            torque_lines_hz: &self.lines.hz,
            sensor_lines_hz: &self.lines.hz,
            resonances: &self.lines.resonances,
        }
    }

    /// Everything beside a set.
    pub fn beside<'s>(
        &'s self,
        set: &'s Evaluated,
        options: &Options,
    ) -> Result<Option<Beside<'s>>, DiagnosisError> {
        self.beside_of(set, &|effect| !is_excluded(options, effect.info().id))
    }

    /// Those effects beside a set that `is_asked` chooses.
    pub fn beside_of<'s>(
        &'s self,
        set: &'s Evaluated,
        is_asked: &dyn Fn(&dyn Effect) -> bool,
    ) -> Result<Option<Beside<'s>>, DiagnosisError> {
        let known = self.views.iter().find(|(names, _)| names == set.names());
        Beside::new(&self.runs, set, &self.clues(), is_asked, known.map(|(_, views)| &views[..]))
    }

    /// Fits a set that was proposed beside another one, and where its noise levels and not its effects make it likelier than a smaller set, that one
    /// with these levels.
    fn evaluate(&mut self, hypothesis: Hypothesis, beside: &Evaluated) -> Result<(), DiagnosisError> {
        let base = self.base().clone();
        let others: Vec<&Evaluated> =
            if beside.names().is_empty() { vec![&base] } else { vec![&base, beside] };
        let Some(found) = DiagnosisError::possible(self.runs.evaluate(hypothesis, &others))? else {
            return Ok(());
        };
        let doubt = self.runs.reference.settings.doubt_nats;
        for set in &mut self.evaluated {
            let is_smaller = set.names().len() < found.names().len()
                && set.names().iter().all(|id| found.names().contains(id));
            let gained = found.log_evidence - set.log_evidence;
            if !is_smaller || gained <= found.gain_of_effects_beside(set.names()) + doubt {
                continue;
            }
            // Neither may win by levels that the other was not offered.
            let again = DiagnosisError::possible(self.runs.refitted(set, &found))?;
            if let Some(again) = again.filter(|again| again.log_evidence > set.log_evidence) {
                self.views.retain(|(names, _)| names != again.names());
                *set = again;
            }
        }
        self.evaluated.push(found);
        Ok(())
    }

    /// A set by its names.
    pub fn set(&self, names: &[&str]) -> Option<&Evaluated> {
        self.evaluated.iter().find(|set| set.names() == names)
    }

    pub fn log_posterior(&self, set: &Evaluated) -> f64 {
        set.log_posterior(self.base(), self.runs.reference)
    }

    /// The most probable admissible set.
    pub fn most_probable(&self) -> Option<&Evaluated> {
        let admissible = self.evaluated.iter().filter(|set| self.is_admissible(set));
        admissible.max_by(|a, b| self.log_posterior(a).total_cmp(&self.log_posterior(b)))
    }

    /// Whether a set explains training runs better than that of no effects and held-out ones not worse, more than the shape errors of
    /// each smaller set leave, by the sizes of its effects, and also where no random torque helps: beside one that takes up most of what is missing
    /// an effect may win that lowers no error.
    pub fn is_admissible(&self, set: &Evaluated) -> bool {
        if set.names().is_empty() {
            return true;
        }
        let base = self.base();
        let own = set.log_evidence - base.log_evidence;
        let held = set.held_out_log - base.held_out_log;
        let has_held_out = !self.runs.held_out.is_empty();
        let settings = &self.runs.reference.settings;
        let is_borne_out = !has_held_out || is_borne_out(own, held, set.held_out_expected, settings);
        let explains = set.log_without_random_torques() > base.log_without_random_torques();
        if own <= 0.0 || !is_borne_out || !explains || set.is_at_the_end_of_a_range() {
            return false;
        }
        let without = |left_out: &&'static str| {
            let others = set.names().iter().filter(|id| *id != left_out).copied();
            self.set(&others.collect::<Vec<_>>())
        };
        set.names().iter().filter_map(without).all(|smaller| {
            let gained = set.log_evidence - smaller.log_evidence;
            let of_effects = set.gain_of_effects_beside(smaller.names());
            let of_shape = settings.misspecification * (smaller.log_evidence - base.log_evidence);
            gained > of_shape && gained <= settings.most_over_effects * of_effects + settings.doubt_nats
        })
    }

    /// Log prior of a set.
    pub fn log_prior(&self, set: &Evaluated) -> f64 {
        log_prior(set.names(), &self.runs.reference.settings)
    }
}

/// Whether held-out data bear out what training data gained by effects. A log likelihood ratio has a variance of twice its mean, which is what is `expected` if
/// the effects are there as they were fitted, and at most what the training data gained. Formulas are never quite those of a rig: where half of an effect's
/// size is true, data gain nothing by it, and that is enough; where it is not known what is expected, nothing is missed.
fn is_borne_out(own: f64, held: f64, expected: Option<f64>, settings: &Settings) -> bool {
    let is_missed = expected.is_some_and(|expected| {
        let by_chance = CERTAIN * (2.0 * expected).sqrt() + settings.prediction.fit_round_nats;
        held < 0.0 && expected - held > by_chance
    });
    held >= -(2.0 * own).sqrt() && !is_missed
}

pub(crate) fn is_excluded(options: &Options, id: &str) -> bool {
    options.exclude.iter().any(|excluded| excluded == id)
}

#[cfg(test)]
mod tests {
    use crate::Settings;

    fn is_borne_out(own: f64, held: f64, expected: impl Into<Option<f64>>) -> bool {
        super::is_borne_out(own, held, expected.into(), &Settings::default())
    }

    #[test]
    fn held_out_data_must_gain_what_they_would_if_the_effect_were_there() {
        // Twenty nats are expected, with a deviation of the root of forty.
        assert!(is_borne_out(100.0, 20.0, 20.0) && is_borne_out(100.0, 1.0, 20.0));
        assert!(!is_borne_out(100.0, -1.0, 20.0));
        // Of a strong effect whose formula is another it is enough that half of its size is there.
        assert!(is_borne_out(1000.0, 10.0, 250.0) && !is_borne_out(1000.0, -10.0, 250.0));
        // Runs that do not excite it say nothing,
        assert!(is_borne_out(100.0, -1.0, 0.5) && is_borne_out(100.0, -0.4, 0.0));
        // unless they are much less likely with it.
        assert!(!is_borne_out(100.0, -15.0, 0.5));
        // Where nobody knows what to expect, only that counts.
        assert!(is_borne_out(100.0, -10.0, None) && !is_borne_out(100.0, -15.0, None));
    }
}
