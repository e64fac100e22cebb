//! The running evidence that the model has stopped being right, and which effect explains it best.
//!
//! While the model is right, innovations e over their deviations are independent with unit variance. If effect E with values phi
//! has begun at a start s, they have the mean -(de/dphi) phi. With phi ~ N(0, V) and what windows say of phi, G and g, with the platform's
//! constants integrated out (`sums.rs`), the likelihood ratio is
//!
//! ```text
//! ln B = -1/2 ln |I + V^1/2 G V^1/2| + 1/2 q,    q = g^T V^1/2 (I + V^1/2 G V^1/2)^-1 V^1/2 g
//! ```
//!
//! exact for the linear filter, and with mean one while the model is right. So is any average of such ratios: over the
//! sizes V, over the ways in which an effect enters, over effects. Their sum over starts is what is compared with the limit.
//!
//! No filter is tuned quite rightly: noise and background torque are stated as what they are at most, and where they are smaller
//! innovations follow a little from what was corrected before. Such a fault never grows, but its evidence does, with time
//! alone. So the model counts as right while every innovation is off by at most eps deviations, however
//! chosen ([`Settings::systematic_sigma`]). A likelihood ratio exp(phi^T g - phi^T G phi / 2) then grows by
//! exp(eps sum |d phi|) at most, and is divided by that: its mean is again at most one. For one column d that takes
//! eps sum |d| off |g|. For several the sum is taken as sqrt(n phi^T G phi), n = (sum |d_k|)^2 / G_kk being over how many readings the
//! column that is spread most is spread: what is left of q is (sqrt q - eps sqrt n)^2.
//!
//! What no rig can have (friction that drives, more than a tank holds) is no explanation: a ratio counts as far as its
//! estimate lies in the ranges of the catalogue's parameters (`ratio.rs`).
//!
//! What is wrong from the first cell on is learned as far as the priors of the platform's constants allow, and what they do not allow is
//! evidence: against a constant that is several times further off than its prior says. It is evaluated as long as the monitor runs,
//! and with a head start ([`Settings::head_start`]).

use std::collections::{BTreeMap, BTreeSet};

use whorl_prediction::Window;

use crate::Settings;
use crate::directions::{Direction, Directions, UNKNOWN_TORQUE};
use crate::fit::{Likeliest, Parameter};
use crate::ratio::{Suspect, estimate, ln_ratio};
use crate::sums::{Constants, Marginal, Sums};

/// Prior sizes of an effect over the catalogue's, each as likely: those of the diagnosis that a run of minutes can tell.
const SIZES: [f64; 4] = [0.3, 1.0, 3.0, 10.0];
/// The same of a constant that was wrong from the start on, over what the model's prior says of it: less is no error.
const SIZES_FROM_START: [f64; 2] = [4.0, 8.0];
/// Starts that are followed at once; of which only the newest are evaluated at the end of every window, and all at every so many: what
/// began long ago has waited already. Leaving off looking, by a rule that no reading changes, keeps the mean of a ratio.
const STARTS: usize = 5;
const NEWEST: usize = 2;
const OLD_EVERY: usize = 4;
/// The running evidence.
#[derive(Debug, Clone)]
pub(crate) struct Evidence {
    /// Those of breaks, and constants that are wrong from the start on.
    suspects: Vec<Suspect>,
    from_start: Vec<Suspect>,
    parameters: usize,
    settings: Settings,
    constants: Constants,
    first_ns: Option<i64>,
    starts: Vec<(i64, Sums)>,
    next_start_ns: i64,
    states: usize,
    /// Pairs of columns whose products are summed.
    pairs: Vec<(usize, usize)>,
    /// What was found of each start, and of the constants alone.
    found: Vec<Found>,
    alone: Option<Found>,
    windows: usize,
}

/// What was found of a start at the end of a window, and ln of how much speaks for a break there.
#[derive(Debug, Clone)]
struct Found {
    at_ns: i64,
    sums: Marginal,
    ln: f64,
}

impl Evidence {
    /// Before the first window, of a filter with so many states.
    #[must_use]
    pub fn new(all: &Directions, states: usize, settings: &Settings) -> Self {
        // A torque that nothing explains is as likely as any effect.
        let effects: BTreeSet<&str> = all.ways.iter().map(|(effect, _)| *effect).collect();
        let mut pairs: Vec<(usize, usize)> = Vec::new();
        let mut suspect = |(effect, columns): &(&'static str, Vec<usize>)| {
            let mut products = Vec::new();
            for (k, b) in columns.iter().enumerate() {
                for a in columns.iter().take(k + 1) {
                    let place = pairs.iter().position(|pair| pair == &(*a, *b)).unwrap_or_else(|| {
                        pairs.push((*a, *b));
                        pairs.len() - 1
                    });
                    products.push(place);
                }
            }
            let of_effect = all.ways.iter().filter(|(other, _)| other == effect).count();
            Suspect {
                effect,
                columns: columns.clone(),
                products,
                stddev: columns.iter().map(|k| all.all[*k].stddev).collect(),
                range: columns.iter().map(|k| all.all[*k].range).collect(),
                sizes: &SIZES,
                ln_prior: -((effects.len() * of_effect) as f64).ln(),
            }
        };
        let suspects: Vec<Suspect> = all.ways.iter().map(&mut suspect).collect();
        Self {
            from_start: wrong_from_start(&suspects, all.constants, settings.head_start()),
            parameters: all.all.len(),
            settings: settings.clone(),
            constants: Constants::new(states, all.constants),
            first_ns: None,
            starts: Vec::new(),
            next_start_ns: i64::MIN,
            states,
            found: Vec::new(),
            alone: None,
            windows: 0,
            suspects,
            pairs,
        }
    }

    /// Pairs of parameters of which what they do together is needed.
    pub fn pairs(&self) -> &[(usize, usize)] {
        &self.pairs
    }

    /// What is known of the platform's constants.
    pub fn constants(&self) -> &Constants {
        &self.constants
    }

    /// Follows a new start where one is due at the beginning of a window.
    pub fn begin(&mut self, at_ns: i64) {
        self.first_ns.get_or_insert(at_ns);
        if at_ns < self.next_start_ns {
            return;
        }
        let (every_ns, memory_ns) = (ns(self.settings.start_every_s), ns(self.settings.memory_s));
        self.next_start_ns = at_ns + every_ns;
        self.starts.retain(|(start_ns, _)| at_ns - start_ns < memory_ns);
        let constants = self.constants.of_state().ncols();
        self.starts.push((at_ns, Sums::none(self.states, constants, self.parameters, self.pairs.len())));
        // Old starts grow sparse: what began long ago is not dated to the second. Leaving starts out only lowers the sum.
        while self.starts.len() > STARTS {
            let age = |k: usize| (at_ns - self.starts[k].0 + every_ns) as f64;
            let gap = |k: usize| age(k - 1) / age(k + 1);
            let inner = 1..self.starts.len() - 1;
            let Some(k) = inner.min_by(|a, b| gap(*a).total_cmp(&gap(*b))) else { break };
            self.starts.remove(k);
        }
    }

    /// Takes a window of this length \[s\].
    pub fn add(&mut self, window: &Window, length_s: f64) {
        let share = (-length_s / self.settings.constants_time_s).exp();
        for (_, sums) in &mut self.starts {
            sums.add(window, self.constants.of_state(), &self.pairs, share);
        }
        self.constants.add(window, share);
        let whole = self.windows.is_multiple_of(OLD_EVERY);
        self.windows += 1;
        let old = self.starts.len().saturating_sub(NEWEST);
        let mut found = Vec::with_capacity(self.starts.len());
        for (i, (at_ns, sums)) in self.starts.iter().enumerate() {
            let before = self.found.iter().find(|found| found.at_ns == *at_ns).filter(|_| i < old && !whole);
            found.push(before.cloned().unwrap_or_else(|| {
                self.found(&self.suspects, *at_ns, sums.without(&self.constants, &self.pairs))
            }));
        }
        self.found = found;
        if let Some(at_ns) = self.first_ns.filter(|_| whole && !self.from_start.is_empty()) {
            self.alone = Some(self.found(&self.from_start, at_ns, self.constants.alone()));
        }
    }

    fn found(&self, suspects: &[Suspect], at_ns: i64, sums: Marginal) -> Found {
        let terms: Vec<f64> = suspects.iter().map(|suspect| self.ln_term(suspect, &sums)).collect();
        Found { at_ns, sums, ln: ln_sum(terms.into_iter()) }
    }

    /// The motion is unknown after a gap: so is what an effect has made of it.
    pub fn forget_motion(&mut self, motion: usize) {
        self.starts.iter_mut().for_each(|(_, sums)| sums.forget_motion(motion));
        self.constants.forget_motion(motion);
    }

    /// Nothing is suspected any more, and of the platform's constants nothing is known but their priors.
    pub fn clear(&mut self) {
        let constants = self.constants.of_state().ncols();
        self.constants = Constants::new(self.states, constants);
        (self.starts, self.found, self.alone) = (Vec::new(), Vec::new(), None);
        (self.next_start_ns, self.first_ns, self.windows) = (i64::MIN, None, 0);
    }

    /// ln of the prior times the likelihood ratio of a suspect, over all sizes.
    fn ln_term(&self, suspect: &Suspect, sums: &Marginal) -> f64 {
        let ratio = |size: &f64| ln_ratio(suspect, sums, *size, self.settings.systematic_sigma);
        suspect.ln_prior + ln_sum(suspect.sizes.iter().map(ratio)) - (suspect.sizes.len() as f64).ln()
    }

    /// ln of the sum over starts of the mean likelihood ratios over suspects \[nats\]; minus infinity without any.
    #[must_use]
    pub fn ln_evidence(&self) -> f64 {
        ln_sum(self.found.iter().chain(&self.alone).map(|found| found.ln))
    }

    /// The effect for which most speaks, of those that are directions of this list.
    #[must_use]
    pub fn likeliest(&self, directions: &[Direction]) -> Option<Likeliest> {
        let total = self.ln_evidence();
        let breaks = self.found.iter().map(|found| (&self.suspects, found));
        let all = breaks.chain(self.alone.iter().map(|found| (&self.from_start, found)));
        // Of each effect its share of all evidence, and its likeliest way.
        let mut effects: BTreeMap<&str, (f64, f64, &Suspect, &Found)> = BTreeMap::new();
        for (suspect, found) in all.flat_map(|(list, found)| list.iter().map(move |one| (one, found))) {
            let ln = self.ln_term(suspect, &found.sums);
            let best = effects.entry(suspect.effect).or_insert((0.0, ln, suspect, found));
            let share = best.0 + (ln - total).exp();
            *best = if ln > best.1 { (share, ln, suspect, found) } else { (share, best.1, best.2, best.3) };
        }
        let estimated = effects.into_values().filter_map(|(share, _, suspect, found)| {
            let (numbers, is_beyond) = estimate(suspect, &found.sums)?;
            Some((share, suspect, found.at_ns, numbers, is_beyond))
        });
        let mut all: Vec<_> = estimated.collect();
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut first = all.first()?;
        let mut probability = first.0;
        // A value beyond what a rig can have is no effect's own: it follows something that has no name here.
        if first.4
            && let Some(unmodelled) = all.iter().find(|one| one.1.effect == UNKNOWN_TORQUE)
        {
            first = unmodelled;
            let without_name = all.iter().filter(|one| one.4 || one.1.effect == UNKNOWN_TORQUE);
            probability = without_name.map(|one| one.0).sum();
        }
        let (_, suspect, since_ns, numbers, _) = first;
        let own = suspect.columns.iter().filter_map(|k| directions.get(*k)).zip(numbers);
        let parameters = own.map(|(direction, (estimate, stddev))| Parameter {
            name: direction.parameter.clone(),
            estimate: direction.origin + estimate * direction.scale,
            stddev: stddev * direction.scale,
            unit: direction.unit.to_owned(),
        });
        Some(Likeliest {
            effect: suspect.effect.to_owned(),
            probability: probability.min(1.0),
            parameters: parameters.collect(),
            since_ns: *since_ns,
        })
    }
}

/// The platform's own constants, each alone, further off than their priors say: together as likely as breaks from so many
/// starts on.
fn wrong_from_start(ways: &[Suspect], constants: usize, head_start: f64) -> Vec<Suspect> {
    let alone = |way: &&Suspect| matches!(way.columns.as_slice(), [column] if *column < constants);
    let mut found: Vec<Suspect> = ways.iter().filter(alone).cloned().collect();
    found.retain(|_| head_start > 0.0);
    let ln_prior = (head_start / found.len() as f64).ln();
    for suspect in &mut found {
        suspect.products.clone_from(&suspect.columns);
        (suspect.stddev, suspect.sizes, suspect.ln_prior) = (vec![1.0], &SIZES_FROM_START, ln_prior);
    }
    found
}

fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

/// ln sum exp.
fn ln_sum(terms: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = terms.clone().fold(f64::NEG_INFINITY, f64::max);
    if most == f64::NEG_INFINITY { most } else { most + terms.map(|x| (x - most).exp()).sum::<f64>().ln() }
}
