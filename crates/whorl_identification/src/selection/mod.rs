//! Which sets of effects are worth a fit, and what each is worth: best first, by what the samples predict beside the most probable set.

pub(crate) mod beside;
mod hidden;
pub(crate) mod hypothesis;
pub(crate) mod information;
pub(crate) mod unlisted;

use whorl_dynamics::Effect;
use whorl_dynamics::effects::{Clues, catalogue, find};

use crate::signals::lines::Lines;
use crate::signals::seen::Seen;
use crate::signals::{Observed, observed};
use crate::{DiagnosisError, Options, Outcome, Progress, Settings};

pub(crate) use beside::Beside;
pub(crate) use hypothesis::{Evaluated, Hypothesis, Runs};

/// Prior sizes of an effect that are tried, in units of its catalogue prior, each as likely. A ball bearing has a thousand times the
/// friction of an air bearing, and no file states the kind of bearing.
const SIZES: [f64; 6] = [0.01, 0.1, 1.0, 10.0, 100.0, 1000.0];
/// Sets that are fitted at most, that of no effects included.
const MOST_FITS: usize = 18;
/// Sets that are fitted of those proposed beside that of no effects, and beside another one.
const MOST_ASKED: [usize; 2] = [6, 4];
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
    /// What the samples say beside the most probable set, once all were fitted.
    pub beside: Option<Beside<'a>>,
}

impl<'a> Selection<'a> {
    /// Fits the platform's own parameters, then sets of effects that the samples propose, until nothing more probable is in sight.
    pub fn new(runs: Runs<'a>, options: &Options, progress: &mut dyn FnMut(Progress)) -> Outcome<Self> {
        progress(Progress { share: 0.05, doing: "fitting the platform's own parameters to every sample" });
        let mut selection = Self::begun(runs, options)?;
        let mut expanded: Vec<Vec<&'static str>> = Vec::new();
        loop {
            let most = selection.most_probable().clone();
            let is_known = |beside: &Beside<'_>| {
                (beside.set.names(), beside.set.log_evidence) == (most.names(), most.log_evidence)
            };
            if !selection.beside.as_ref().is_some_and(is_known) {
                progress(selection.progress("comparing every sample with every effect"));
                selection.beside = selection.beside_of(&most, looked_for(options))?;
            }
            let is_new = !expanded.iter().any(|names| names == most.names());
            let Some(beside) = selection.beside.as_ref().filter(|_| is_new) else { break };
            expanded.push(most.names().to_vec());
            let is_first = most.names().is_empty();
            let mut proposals = beside.proposals(is_first && options.largest_set > 1, &selection.evaluated);
            proposals.retain(|proposal| proposal.hypothesis.effects.len() <= options.largest_set);
            for proposal in proposals.into_iter().take(MOST_ASKED[usize::from(!is_first)]) {
                let effects = &proposal.hypothesis.effects;
                // One that was given up beside random torques may be there without them.
                let is_quiet = proposal.hypothesis.quiet;
                let is_known = selection.set(effects).is_some_and(|set| set.fitted.stands || !is_quiet);
                // What there is beside a set that is more probable by now is asked beside it.
                let best = selection.most_probable().names();
                let is_beside = best != most.names() && best.iter().all(|id| effects.contains(id));
                if !is_known && !is_beside && selection.evaluated.len() < MOST_FITS {
                    progress(selection.progress("fitting what may be missing"));
                    selection.evaluate(proposal.hypothesis, &most)?;
                }
            }
        }
        Ok(selection)
    }

    /// The set of no effects alone, and what the runs are with it.
    pub fn begun(runs: Runs<'a>, options: &Options) -> Outcome<Self> {
        let (mut runs, mut base) = (runs, runs.evaluate(Hypothesis::default(), &[])?);
        let observed = observed(&runs, &base)?;
        let (model, settings) = (base.model(runs.reference)?, &runs.reference.settings);
        let seen = Seen::of(&observed, &model, settings, |of| !is_given(&runs, options, of.info().id));
        let lines = Lines::of(&observed, &model, &seen.turning, settings);
        let cell_s = settings.prediction.cell_s;
        let is_fast = || !seen.rows.is_empty() || lines.is_any_faster(FASTEST_CYCLES / cell_s, settings);
        if cell_s > 0.0 && is_fast() {
            runs.each_reading = true;
            base = runs.refitted(&base, &base, &base.loudest_torques())?;
        }
        Ok(Self { runs, evaluated: vec![base], observed, seen, lines, beside: None })
    }

    fn progress(&self, doing: &'static str) -> Progress {
        let share = (self.evaluated.len() as f64 / MOST_FITS as f64).sqrt();
        Progress { share: 0.1 + 0.75 * share, doing }
    }

    pub fn base(&self) -> &Evaluated {
        &self.evaluated[0]
    }

    /// What the samples say beside a set of these effects.
    pub fn beside_of(&self, set: &Evaluated, asked: Vec<&'static dyn Effect>) -> Outcome<Option<Beside<'a>>> {
        let states = || self.observed.iter().filter(|run| !run.clamped).flat_map(|run| &run.motion.states);
        let rates = states().map(|state| state.omega_wb_b_rad_s.amax());
        let tilts = states().map(|state| whorl_math::tilt_rad(&state.q_world_body));
        let clues = Clues {
            bin_s: self.runs.available.sample_s,
            largest_rate_rad_s: rates.fold(0.0, f64::max),
            largest_tilt_rad: tilts.fold(0.0, f64::max),
            torque_lines_hz: &self.lines.hz,
            sensor_lines_hz: &self.lines.hz,
            resonances: &self.lines.resonances,
        };
        Beside::new(&self.runs, set, &clues, asked)
    }

    /// The set of these effects, fitted from where the samples have them enter beside none; `None` where they do not.
    pub fn with(&self, ids: &[&'static str]) -> Outcome<Option<Evaluated>> {
        let base = self.base();
        let beside = self.beside_of(base, ids.iter().filter_map(|id| find(id)).collect())?;
        let Some(hypothesis) = beside.and_then(|beside| beside.with(ids)) else { return Ok(None) };
        DiagnosisError::possible(self.runs.evaluate(hypothesis, &[base]))
    }

    /// Fits a set proposed beside another, and where its noise levels, not its effects, make it likelier than a smaller set, that one with them.
    fn evaluate(&mut self, hypothesis: Hypothesis, beside: &Evaluated) -> Outcome<()> {
        let base = self.base();
        let others = if beside.names().is_empty() { vec![base] } else { vec![base, beside] };
        let Some(mut found) = DiagnosisError::possible(self.runs.evaluate(hypothesis, &others))? else {
            return Ok(());
        };
        let doubt_nats = self.runs.reference.settings.doubt_nats;
        let torques = self.base().loudest_torques();
        for set in &mut self.evaluated {
            let is_smaller = set.names().len() < found.names().len()
                && set.names().iter().all(|id| found.names().contains(id));
            let gained = found.log_evidence - set.log_evidence;
            // Neither may win by levels that the other was not offered.
            if is_smaller && gained > found.gain_of_effects_beside(set.names()) + doubt_nats {
                let again = DiagnosisError::possible(self.runs.refitted(set, &found, &torques))?;
                if let Some(again) = again.filter(|again| again.log_evidence > set.log_evidence) {
                    *set = again;
                }
                // With states of their own they have other starts.
                if !found.names().iter().any(|id| self.runs.reference.is_hidden(id)) {
                    let log = self.runs.log_posterior_with(set, &found.fitted.followed);
                    let gained = DiagnosisError::possible(log)?.map(|log| found.fitted.log_posterior - log);
                    found.gains_at_levels.extend(gained.map(|gained| (set.names().to_vec(), gained)));
                }
            }
        }
        match self.evaluated.iter_mut().find(|set| set.names() == found.names()) {
            Some(known) if known.log_evidence >= found.log_evidence => {}
            Some(known) => *known = found,
            None => self.evaluated.push(found),
        }
        Ok(())
    }

    pub fn set(&self, names: &[&str]) -> Option<&Evaluated> {
        self.evaluated.iter().find(|set| set.names() == names)
    }

    /// Log posterior, up to a constant that all sets share.
    pub fn log_posterior(&self, set: &Evaluated) -> f64 {
        set.log_evidence + self.held_out_nats(set) + log_prior(set.names(), &self.runs.reference.settings)
    }

    /// What held-out runs say for a set, with values that were fitted to the others: they are evidence as these are. What they gain beyond what its effects
    /// bring, if they are there, comes from other levels of noise.
    pub fn held_out_nats(&self, set: &Evaluated) -> f64 {
        self.held_out_gain(set).min(set.held_out_expected.unwrap_or(0.0))
    }

    /// By how much a set makes held-out runs likelier than that of no effects does.
    pub fn held_out_gain(&self, set: &Evaluated) -> f64 {
        set.held_out_log - self.base().held_out_log
    }

    pub fn most_probable(&self) -> &Evaluated {
        let admissible = self.evaluated.iter().filter(|set| self.is_admissible(set));
        let most = admissible.max_by(|a, b| self.log_posterior(a).total_cmp(&self.log_posterior(b)));
        most.unwrap_or_else(|| self.base())
    }

    /// Whether a set explains training runs better than that of no effects and held-out ones not worse, more than the shape errors of each smaller set
    /// leave, by the sizes of its effects, and where no random torque helps: beside one that takes up most an effect may win that lowers no error.
    pub fn is_admissible(&self, set: &Evaluated) -> bool {
        let (base, settings) = (self.base(), &self.runs.reference.settings);
        if set.names().is_empty() {
            return true;
        }
        let (own, held) = (set.log_evidence - base.log_evidence, self.held_out_gain(set));
        let quiet = base.quiet_log_posterior;
        let explains = set.quiet_log_posterior > quiet || !quiet.is_finite();
        let is_borne_out =
            self.runs.held_out.is_empty() || is_borne_out(own, held, set.held_out_expected, settings);
        let without = |left_out: &&'static str| {
            let others = set.names().iter().filter(|id| *id != left_out).copied();
            self.set(&others.collect::<Vec<_>>())
        };
        let is_more_than = |smaller: &Evaluated| {
            let gained = set.log_evidence - smaller.log_evidence;
            let of_effects = set.gain_of_effects_beside(smaller.names());
            let of_shape = smaller.shape_error(settings) * (smaller.log_evidence - base.log_evidence);
            gained > of_shape && gained <= settings.most_over_effects * of_effects + settings.doubt_nats
        };
        own > 0.0
            && is_borne_out
            && explains
            && !set.is_at_the_end_of_a_range()
            && set.names().iter().filter_map(without).all(is_more_than)
    }
}

/// Whether held-out data bear out what training data gained by effects. A log likelihood ratio has a variance of twice its mean: `expected` if effects
/// are as fitted, at most what training data gained. No formula is quite a rig's: where half an effect's size is true, nothing is gained, and it stands.
fn is_borne_out(own: f64, held: f64, expected: Option<f64>, settings: &Settings) -> bool {
    let is_missed = expected.is_some_and(|expected| {
        let by_chance = CERTAIN * (2.0 * expected).sqrt() + settings.prediction.fit_round_nats;
        held < 0.0 && expected - held > by_chance
    });
    held >= -(2.0 * own).sqrt() && !is_missed
}

/// Log prior odds of a set of effects against none.
pub(crate) fn log_prior<S: AsRef<str>>(set: &[S], settings: &Settings) -> f64 {
    let penalty = |id: &S| find(id.as_ref()).map_or(0.0, |effect| effect.prior_penalty_nats());
    set.iter().map(|id| (settings.present / (1.0 - settings.present)).ln() - penalty(id)).sum()
}

/// Minus the logarithm of a size's prior probability.
fn size_penalty_nats(size: f64, settings: &Settings) -> f64 {
    let rare = if size >= settings.unusual_size { settings.unusual_odds.ln() } else { 0.0 };
    (SIZES.len() as f64).ln() + rare
}

/// The effects of the catalogue that are not excluded.
pub(crate) fn looked_for(options: &Options) -> Vec<&'static dyn Effect> {
    catalogue().iter().copied().filter(|effect| !is_excluded(options, effect.info().id)).collect()
}

fn is_excluded(options: &Options, id: &str) -> bool {
    options.exclude.iter().any(|excluded| excluded == id)
}

/// Whether an effect is not looked for: it is excluded, or in the model.
pub(crate) fn is_given(runs: &Runs<'_>, options: &Options, id: &str) -> bool {
    is_excluded(options, id) || runs.reference.model.effects.contains_key(id)
}

#[cfg(test)]
mod tests;
