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

use nalgebra::Vector3;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_prediction::{Difference, Window};

use crate::Settings;
use crate::directions::Directions;
use crate::ratio::{Estimate, Suspect, estimate, ln_ratio};
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
/// Usual size of an unmodelled torque, over the background.
const UNMODELLED: f64 = 10.0;

/// The name of a torque that no effect of the catalogue explains.
pub const UNKNOWN_TORQUE: &str = "unknown_torque";

/// A suspect and how much speaks for it since one start.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Evaluated {
    /// The effect.
    pub effect: &'static str,
    /// Share of all evidence against the model.
    pub probability: f64,
    /// Directions of the likeliest way in which it enters; empty for an unmodelled torque.
    pub directions: Vec<usize>,
    /// Estimates along these, and their standard deviations, in units of the directions (of an unmodelled torque: N m).
    pub estimate: Vec<f64>,
    /// Their standard deviations.
    pub stddev: Vec<f64>,
    /// Data put one of them further beyond what a rig can have than chance does.
    pub is_beyond: bool,
    /// Start from which the likeliest way is counted \[ns\].
    pub since_ns: i64,
}

/// The running evidence.
#[derive(Debug, Clone)]
pub(crate) struct Evidence {
    effects: Vec<&'static str>,
    /// Those of breaks, and constants that are wrong from the start on.
    suspects: Vec<Suspect>,
    from_start: Vec<Suspect>,
    parameters: usize,
    unmodelled_n_m: f64,
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
        let mut effects: Vec<&'static str> = Vec::new();
        let mut ways: Vec<(usize, Vec<usize>)> = Vec::new();
        for (id, way) in &all.ways {
            let effect = effects.iter().position(|known| known == id).unwrap_or_else(|| {
                effects.push(*id);
                effects.len() - 1
            });
            ways.push((effect, way.clone()));
        }
        // An unmodelled torque is as likely as any effect.
        let first = all.all.len();
        ways.push((effects.len(), (first..first + 3).collect()));
        effects.push(UNKNOWN_TORQUE);
        let mut pairs: Vec<(usize, usize)> = Vec::new();
        let mut suspect = |(effect, columns): &(usize, Vec<usize>)| {
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
            let of_effect = ways.iter().filter(|(other, _)| other == effect).count();
            Suspect {
                effect: *effect,
                columns: columns.clone(),
                products,
                stddev: columns.iter().map(|k| all.all.get(*k).map_or(1.0, |d| d.stddev)).collect(),
                range: columns.iter().map(|k| all.all.get(*k).map_or(ANY, |d| d.range)).collect(),
                sizes: &SIZES,
                ln_prior: -((effects.len() * of_effect) as f64).ln(),
            }
        };
        let suspects: Vec<Suspect> = ways.iter().map(&mut suspect).collect();
        Self {
            from_start: wrong_from_start(&suspects, all.constants, settings.head_start()),
            parameters: first + 3,
            unmodelled_n_m: UNMODELLED * settings.background_torque_n_m,
            settings: settings.clone(),
            constants: Constants::new(states, all.constants),
            first_ns: None,
            starts: Vec::new(),
            next_start_ns: i64::MIN,
            states,
            found: Vec::new(),
            alone: None,
            windows: 0,
            effects,
            suspects,
            pairs,
        }
    }

    /// Pairs of parameters of which what they do together is needed.
    pub fn pairs(&self) -> &[(usize, usize)] {
        &self.pairs
    }

    /// What an unmodelled torque does, about each axis.
    pub fn unmodelled(&self) -> [Difference; 3] {
        [0, 1, 2].map(|axis| Difference::Torque(Vector3::ith(axis, self.unmodelled_n_m), [0.0; MAX_WHEELS]))
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

    /// All suspects since each start.
    fn terms(&self) -> impl Iterator<Item = (f64, &Suspect, i64, &Marginal)> {
        let breaks = self.found.iter().map(|found| (&self.suspects, found));
        let all = breaks.chain(self.alone.iter().map(|found| (&self.from_start, found)));
        all.flat_map(|(suspects, found)| suspects.iter().map(move |suspect| (suspect, found)))
            .map(|(suspect, found)| (self.ln_term(suspect, &found.sums), suspect, found.at_ns, &found.sums))
    }

    /// ln of the sum over starts of the mean likelihood ratios over suspects \[nats\]; minus infinity without any.
    #[must_use]
    pub fn ln_evidence(&self) -> f64 {
        ln_sum(self.found.iter().chain(&self.alone).map(|found| found.ln))
    }

    /// The effects by how much speaks for them, the likeliest first.
    #[must_use]
    pub fn evaluated(&self) -> Vec<Evaluated> {
        let mut best: Vec<Option<(f64, &Suspect, i64, &Marginal)>> = vec![None; self.effects.len()];
        let (mut share, total) = (vec![0.0; self.effects.len()], self.ln_evidence());
        for term in self.terms() {
            let (ln, Suspect { effect, .. }, ..) = term;
            share[*effect] += (ln - total).exp();
            let slot = &mut best[*effect];
            if slot.is_none_or(|(so_far, ..)| ln > so_far) {
                *slot = Some(term);
            }
        }
        let of = best.iter().zip(&share).zip(&self.effects);
        let evaluated = of.filter_map(|((best, probability), effect)| {
            let (_, suspect, since_ns, sums) = (*best)?;
            let unit = if *effect == UNKNOWN_TORQUE { self.unmodelled_n_m } else { 1.0 };
            let Estimate { values, stddevs, is_beyond } = estimate(suspect, sums, unit)?;
            Some(Evaluated {
                effect,
                probability: *probability,
                directions: suspect.columns.clone(),
                estimate: values,
                stddev: stddevs,
                is_beyond,
                since_ns,
            })
        });
        let mut evaluated: Vec<Evaluated> = evaluated.collect();
        evaluated.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        evaluated
    }
}

/// What no direction is kept from.
const ANY: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
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
