//! The running evidence that the model has stopped being right, and which effect explains it best.
//!
//! While the model is right, the whitened innovations y are independent with unit variance. If effect E with values phi
//! has begun at a start s, they have the mean X phi, X being the sensitivities passed through the filter from s on. With
//! phi ~ N(0, V) the likelihood ratio is
//!
//! ```text
//! ln B = -1/2 ln |I + V^1/2 A V^1/2| + 1/2 z^T V^1/2 (I + V^1/2 A V^1/2)^-1 V^1/2 z,    A = sum X^T X,  z = sum X^T y
//! ```
//!
//! exact for the linear filter, and with mean one while the model is right. So is any average of such ratios: over the
//! sizes V, over the ways in which an effect enters, over effects. Their sum over starts is what is compared with the limit.
//!
//! No filter is tuned quite rightly: noise and background torque are stated as what they are at most, and where they are smaller
//! innovations follow a little from what was corrected before. Such a fault never grows, but its evidence does, with time
//! alone. So the model counts as right while every whitened reading is off by at most eps standard deviations, however
//! chosen ([`Settings::systematic_sigma`]). A likelihood ratio exp(phi^T z - phi^T A phi / 2) then grows by
//! exp(eps sum |X phi|) at most, and is divided by that: its mean is again at most one. For one column that takes
//! eps sum |X| off |z|. For several the sum is taken as sqrt(n phi^T A phi), n = (sum |X_k|)^2 / A_kk being over how many readings the
//! column that is spread most is spread: what is left of q = z^T V^1/2 (I + V^1/2 A V^1/2)^-1 V^1/2 z is (sqrt q - eps sqrt n)^2.
//!
//! What no rig can have (friction that drives, more than a tank holds) is no explanation: a ratio counts as far as its
//! estimate lies in the ranges of the catalogue's parameters (`ratio.rs`).
//!
//! What is wrong from the first bin on is learned by the filter as far as the priors of the platform's constants allow, and
//! what they do not allow is evidence: against a constant that is several times further off than its prior says. It is
//! evaluated from the first start on, which is never left out, and with a head start ([`Settings::head_start`]).

use nalgebra::DMatrix;
use whorl_dynamics::effects;
use whorl_identification::{Direction, Directions};

use crate::Settings;
use crate::filter::{Whitened, torque_rates};
use crate::lanes::Changes;
use crate::passing::{self, Carried, Columns};
use crate::places::Places;
use crate::ratio::{Estimate, MOST_DIRECTIONS, Suspect, estimate, ln_ratio};

/// Prior sizes of an effect over the catalogue's, each as likely: those of the diagnosis that a run of minutes can tell.
const SIZES: [f64; 4] = [0.3, 1.0, 3.0, 10.0];
/// The same of a constant that was wrong from the start on, over what the model's prior says of it: less is no error.
const SIZES_FROM_START: [f64; 2] = [4.0, 8.0];
/// Starts that are followed at once, beside the first of all.
const STARTS: usize = 5;
/// Usual size of an unmodelled torque, over the background.
const UNMODELLED: f64 = 10.0;

/// The name of a torque that no effect of the catalogue explains.
pub const UNKNOWN_TORQUE: &str = "unknown_torque";

/// What was gathered since one start.
#[derive(Debug, Clone)]
struct Start {
    at_ns: i64,
    /// The first of all, which is never left out while constants that are wrong from the start are looked for.
    keeps: bool,
    carried: Carried,
}

/// A suspect and how much speaks for it since one start.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluated {
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
pub struct Evidence {
    effects: Vec<&'static str>,
    suspects: Vec<Suspect>,
    /// Direction of each column that is followed; the last three are unmodelled torques.
    followed: Vec<usize>,
    unmodelled_n_m: f64,
    systematic_sigma: f64,
    torque_rates: DMatrix<f64>,
    starts: Vec<Start>,
    every_ns: i64,
    memory_ns: i64,
    next_start_ns: Option<i64>,
    length: usize,
    /// Pairs of columns whose products are summed.
    products: Vec<(usize, usize)>,
    columns: Columns,
}

impl Evidence {
    /// Before the first bin.
    #[must_use]
    pub fn new(all: &Directions, places: &Places, settings: &Settings) -> Self {
        let mut effects: Vec<&'static str> = Vec::new();
        let mut followed: Vec<usize> = Vec::new();
        let mut suspects = Vec::new();
        for suspect in all.suspects.iter().filter(|s| s.directions.len() <= MOST_DIRECTIONS) {
            let effect = effects.iter().position(|id| *id == suspect.effect).unwrap_or_else(|| {
                effects.push(suspect.effect);
                effects.len() - 1
            });
            let columns: Vec<usize> = suspect
                .directions
                .iter()
                .map(|direction| {
                    followed.iter().position(|f| f == direction).unwrap_or_else(|| {
                        followed.push(*direction);
                        followed.len() - 1
                    })
                })
                .collect();
            let stddev = suspect.directions.iter().map(|d| all.directions[*d].catalogue_stddev).collect();
            suspects.push(Suspect {
                effect,
                columns,
                products: Vec::new(),
                stddev,
                range: suspect.directions.iter().map(|d| range(all, &all.directions[*d])).collect(),
                sizes: &SIZES,
                from_start: false,
                ln_prior: 0.0,
            });
        }
        // An unmodelled torque is as likely as any effect.
        let first = followed.len();
        let columns: Vec<usize> = (first..first + 3).collect();
        suspects.push(Suspect {
            effect: effects.len(),
            columns,
            products: Vec::new(),
            stddev: vec![1.0; 3],
            range: vec![ANY; 3],
            sizes: &SIZES,
            from_start: false,
            ln_prior: 0.0,
        });
        effects.push(UNKNOWN_TORQUE);
        let ways = |effect: usize| suspects.iter().filter(|s| s.effect == effect).count() as f64;
        let priors: Vec<f64> =
            suspects.iter().map(|s| -(effects.len() as f64 * ways(s.effect)).ln()).collect();
        for (suspect, ln_prior) in suspects.iter_mut().zip(priors) {
            suspect.ln_prior = ln_prior;
        }
        suspects.extend(wrong_from_start(all, &suspects, &followed, settings.head_start()));
        // Suspects share columns, so they share products of them.
        let mut products: Vec<(usize, usize)> = Vec::new();
        for suspect in &mut suspects {
            for (k, b) in suspect.columns.iter().enumerate() {
                for a in suspect.columns.iter().take(k + 1) {
                    let place = products.iter().position(|pair| *pair == (*a, *b)).unwrap_or_else(|| {
                        products.push((*a, *b));
                        products.len() - 1
                    });
                    suspect.products.push(place);
                }
            }
        }
        Self {
            unmodelled_n_m: UNMODELLED * settings.background_torque_n_m,
            systematic_sigma: settings.systematic_sigma,
            torque_rates: torque_rates(&all.base, places),
            starts: Vec::new(),
            every_ns: ns(settings.start_every_s),
            memory_ns: ns(settings.memory_s),
            next_start_ns: None,
            length: places.len(),
            products,
            columns: Columns::default(),
            effects,
            suspects,
            followed,
        }
    }

    fn columns(&self) -> usize {
        self.followed.len() + 3
    }

    /// Follows a new start where one is due at the beginning of a bin.
    pub fn begin(&mut self, at_ns: i64) {
        let first = self.next_start_ns.is_none();
        let due = *self.next_start_ns.get_or_insert(at_ns);
        if at_ns < due {
            return;
        }
        self.next_start_ns = Some(due + self.every_ns * ((at_ns - due) / self.every_ns.max(1) + 1));
        self.starts.retain(|start| start.keeps || at_ns - start.at_ns < self.memory_ns);
        let keeps = first && self.suspects.iter().any(|suspect| suspect.from_start);
        let carried = Carried::new(self.length, self.columns(), self.products.len());
        self.starts.push(Start { at_ns, keeps, carried });
        // Old starts grow sparse: what began long ago is not dated to the second. Leaving starts out only lowers the sum.
        let from = usize::from(self.starts.first().is_some_and(|start| start.keeps));
        while self.starts.len() > STARTS + from {
            let age = |k: usize| (at_ns - self.starts[k].at_ns) as f64 + self.every_ns as f64;
            let gap = |k: usize| age(k - 1) / age(k + 1);
            let inner = from + 1..self.starts.len() - 1;
            let Some(k) = inner.min_by(|a, b| gap(*a).total_cmp(&gap(*b))) else { break };
            self.starts.remove(k);
        }
    }

    /// The motion is unknown after a gap: so is what an effect has made of it.
    pub fn forget_motion(&mut self, motion: usize) {
        for start in &mut self.starts {
            start.carried.forget(motion);
        }
    }

    /// Nothing is suspected any more.
    pub fn clear(&mut self) {
        self.starts.clear();
        self.next_start_ns = None;
    }

    /// Takes a bin.
    pub fn add(&mut self, whitened: &Whitened, changes: &Changes, places: &Places) {
        let torque = &self.torque_rates * self.unmodelled_n_m;
        let named = self.followed.len();
        let rate = |row: usize, column: usize| match self.followed.get(column) {
            Some(direction) => changes.rates[(row, *direction)],
            None if column < named + 3 => torque[(row, column - named)],
            None => 0.0,
        };
        let reading = |reading: usize, column: usize| match self.followed.get(column) {
            Some(direction) if reading < 3 => changes.readings[(reading, *direction)],
            _ => 0.0,
        };
        self.columns.load(whitened, places.motion(), named + 3, rate, reading);
        let left = passing::Left {
            torque: (places.torque()..places.first_constant(), whitened.torque_left),
            constants: (places.first_constant()..places.len(), whitened.constants_left),
        };
        let carried = self.starts.iter_mut().map(|start| &mut start.carried);
        passing::pass(carried, &self.columns, &left, &self.products);
    }

    /// ln of the prior times the likelihood ratio of each suspect since each start, over all sizes.
    fn terms(&self) -> impl Iterator<Item = (f64, &Suspect, &Start)> + Clone {
        let of = |start| self.suspects.iter().map(move |suspect: &Suspect| (suspect, start));
        let told = |(suspect, start): (&'_ Suspect, &'_ Start)| !suspect.from_start || start.keeps;
        self.starts.iter().flat_map(of).filter(move |both| told(*both)).map(|(suspect, start)| {
            let ratio = |size: &f64| ln_ratio(suspect, &start.carried, *size, self.systematic_sigma);
            let ratios = suspect.sizes.iter().map(ratio);
            (suspect.ln_prior + ln_sum(ratios) - (suspect.sizes.len() as f64).ln(), suspect, start)
        })
    }

    /// ln of the sum over starts of the mean likelihood ratios over suspects \[nats\]; minus infinity without any.
    #[must_use]
    pub fn ln_evidence(&self) -> f64 {
        ln_sum(self.terms().map(|(ln, ..)| ln).collect::<Vec<_>>().into_iter())
    }

    /// The effects by how much speaks for them, the likeliest first.
    #[must_use]
    pub fn evaluated(&self) -> Vec<Evaluated> {
        let total = self.ln_evidence();
        let mut best: Vec<Option<(f64, &Suspect, &Start)>> = vec![None; self.effects.len()];
        let mut share = vec![0.0; self.effects.len()];
        for (ln, suspect, start) in self.terms() {
            share[suspect.effect] += (ln - total).exp();
            let slot = &mut best[suspect.effect];
            if slot.as_ref().is_none_or(|(so_far, ..)| ln > *so_far) {
                *slot = Some((ln, suspect, start));
            }
        }
        let mut evaluated: Vec<Evaluated> = best
            .iter()
            .zip(&share)
            .zip(&self.effects)
            .filter_map(|((best, probability), effect)| {
                let (_, suspect, start) = best.as_ref()?;
                let unmodelled = *effect == UNKNOWN_TORQUE;
                let unit = if unmodelled { self.unmodelled_n_m } else { 1.0 };
                let Estimate { values, stddevs, is_beyond } = estimate(suspect, &start.carried, unit)?;
                let direction = |column: &usize| self.followed.get(*column).copied();
                Some(Evaluated {
                    effect,
                    probability: *probability,
                    directions: suspect.columns.iter().filter_map(direction).collect(),
                    estimate: values,
                    stddev: stddevs,
                    is_beyond,
                    since_ns: start.at_ns,
                })
            })
            .collect();
        evaluated.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        evaluated
    }
}

/// What no direction is kept from.
const ANY: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
/// A moment of inertia is at least this share of the model's, and at most so many times it: as for the diagnosis.
const MOMENTS: (f64, f64) = (0.2, 11.0);

/// Units of a direction that a rig can have.
fn range(all: &Directions, direction: &Direction) -> (f64, f64) {
    let units = |value: f64| (value - direction.origin) / direction.scale;
    let (min, max) = match effects::find(direction.effect) {
        // Directions in which an effect begins may move several parameters: these have names of their own.
        Some(effect) => {
            let specs = effect.parameters(all.base.model());
            let Some(spec) = specs.into_iter().find(|spec| spec.name == direction.parameter) else {
                return ANY;
            };
            if spec.period.is_some() {
                return ANY;
            }
            (spec.min, spec.max)
        }
        None if direction.origin > 0.0 => (MOMENTS.0 * direction.origin, MOMENTS.1 * direction.origin),
        None => return ANY,
    };
    let (a, b) = (units(min), units(max));
    if a.is_nan() || b.is_nan() { ANY } else { (a.min(b), a.max(b)) }
}

/// The platform's own constants, each alone, further off than their priors say: together as likely as breaks from so many
/// starts on.
fn wrong_from_start(all: &Directions, ways: &[Suspect], followed: &[usize], head_start: f64) -> Vec<Suspect> {
    let single = |way: &&Suspect| {
        let [column] = way.columns.as_slice() else { return None };
        let stddev = all.directions.get(*followed.get(*column)?)?.base_stddev;
        (stddev > 0.0).then_some((way.effect, *column, stddev, *way.range.first()?))
    };
    let mut found: Vec<_> = ways.iter().filter_map(|way| single(&way)).collect();
    found.sort_by_key(|(_, column, ..)| *column);
    found.dedup_by_key(|(_, column, ..)| *column);
    if head_start <= 0.0 {
        found.clear();
    }
    let ln_prior = (head_start / found.len() as f64).ln();
    found
        .into_iter()
        .map(|(effect, column, stddev, range)| Suspect {
            effect,
            columns: vec![column],
            products: Vec::new(),
            stddev: vec![stddev],
            range: vec![range],
            sizes: &SIZES_FROM_START,
            from_start: true,
            ln_prior,
        })
        .collect()
}

fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

/// ln sum exp.
fn ln_sum(terms: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = terms.clone().fold(f64::NEG_INFINITY, f64::max);
    if most == f64::NEG_INFINITY { most } else { most + terms.map(|x| (x - most).exp()).sum::<f64>().ln() }
}
