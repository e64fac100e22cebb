//! Which combinations of terms explain the data best, by the linear regression beside the platform's own parameters.

use rayon::prelude::*;

use super::DiscoveryError;
use super::bench::{Bench, Regression};
use super::signals::{Column, Signals};
use crate::grammar::SIZES;
use crate::grammar::terms::{Direction, Term, compound_terms, single_terms};
use crate::grammar::variable::Variable;

/// Columns that pass through the filter together: they share memory.
const TOGETHER: usize = 192;

/// Terms that are combined with each other.
const COMBINED: usize = 140;

/// A further term must bring so much log evidence after its log-prior penalty.
const WORTH_A_TERM: f64 = 3.0;

/// Most terms of a law.
const MOST_TERMS: usize = 3;

/// A law that the regression proposes.
#[derive(Debug, Clone)]
pub(super) struct Proposal {
    pub terms: Vec<Term>,
    /// Coefficient of each term in SI units; for a term on wheels, of the wheel on which it is largest.
    pub coefficients: Vec<f64>,
    /// Log evidence over the model as it is, log-prior penalty included.
    pub score: f64,
}

/// What the search looks at.
pub(super) struct Ground<'a> {
    pub bench: &'a Bench<'a>,
    pub variables: Vec<Variable>,
    pub wheels: usize,
    pub largest_rate_rad_s: f64,
    pub run_s: f64,
}

/// Columns of one term, in one regression.
#[derive(Debug, Clone)]
struct Placed {
    term: usize,
    columns: Vec<usize>,
}

struct Scored {
    coefficients: Vec<f64>,
    score: f64,
}

fn score(regression: &Regression, signals: &[usize], log_prior: f64) -> Option<Scored> {
    let fits = SIZES.iter().filter_map(|size| regression.fit(signals, *size));
    let best = fits.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))?;
    Some(Scored {
        score: best.log_evidence + log_prior - (SIZES.len() as f64).ln(),
        coefficients: best.coefficients,
    })
}

/// Each term alone, best first: score and position.
fn alone(
    ground: &Ground<'_>,
    terms: &[Term],
    say: &mut dyn FnMut(f64),
) -> Result<Vec<(f64, usize)>, DiscoveryError> {
    let mut found = Vec::new();
    let chunks: Vec<&[Term]> = terms.chunks(TOGETHER).collect();
    for (i, chunk) in chunks.iter().enumerate() {
        let signals = Signals::of(ground.bench, chunk, ground.wheels, ground.largest_rate_rad_s)?;
        // Each term alone: only columns of one term take part together.
        let regression = regression(ground, &signals, ground.wheels.max(1))?;
        let placed = placed(&signals.columns);
        let scored: Vec<(f64, usize)> = placed
            .par_iter()
            .filter_map(|p| {
                let term = chunk.get(p.term)?;
                Some((score(&regression, &p.columns, term.log_prior)?.score, i * TOGETHER + p.term))
            })
            .collect();
        found.extend(scored);
        say((i + 1) as f64 / chunks.len() as f64);
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    Ok(found)
}

fn regression(ground: &Ground<'_>, signals: &Signals, apart: usize) -> Result<Regression, DiscoveryError> {
    Ok(ground.bench.regression(signals.columns.len(), apart, || signals.pushing())?)
}

fn placed(columns: &[Column]) -> Vec<Placed> {
    let mut list: Vec<Placed> = Vec::new();
    for (i, column) in columns.iter().enumerate() {
        match list.iter_mut().find(|p| p.term == column.term) {
            Some(placed) => placed.columns.push(i),
            None => list.push(Placed { term: column.term, columns: vec![i] }),
        }
    }
    list
}

/// The best terms of a list, at most `count`, best first; of terms that are alike to the data only the cheapest few.
fn best_of(scored: &[(f64, usize)], terms: &[Term], count: usize) -> Vec<Term> {
    scored.iter().take(count).filter_map(|(_, i)| terms.get(*i).cloned()).collect()
}

/// Laws of up to three terms, best first, and how many were tried.
pub(super) fn proposals(
    ground: &Ground<'_>,
    say: &mut dyn FnMut(f64, &str),
) -> Result<(Vec<Proposal>, usize), DiscoveryError> {
    let singles = single_terms(&ground.variables);
    let first = alone(ground, &singles, &mut |share| say(0.5 * share, "terms of one variable"))?;
    // Products and lags of what shows alone, about the axes about which it shows.
    let hints: Vec<(String, Direction)> = first
        .iter()
        .take(24)
        .filter_map(|(_, i)| singles.get(*i))
        .flat_map(|t| t.variables.iter().map(|v| (v.clone(), t.direction)))
        .fold(Vec::new(), |mut list, hint| {
            if !list.contains(&hint) {
                list.push(hint);
            }
            list
        });
    let compounds = compound_terms(&ground.variables, &hints, ground.run_s);
    let second = alone(ground, &compounds, &mut |share| say(0.5 + 0.3 * share, "products and lags"))?;
    let mut pool: Vec<(f64, Term)> = Vec::new();
    for (scored, terms) in [(&first, &singles), (&second, &compounds)] {
        pool.extend(scored.iter().filter_map(|(s, i)| Some((*s, terms.get(*i)?.clone()))));
    }
    pool.sort_by(|a, b| b.0.total_cmp(&a.0));
    // A term that shows only beside another may be weak alone: simple ones take part in any case.
    let is_simple = |t: &Term| t.shape.is_none() && t.variables.len() == 1 && !t.is_lag;
    let (mut chosen, rest): (Vec<_>, Vec<_>) = {
        let split = pool.len().min(COMBINED / 2);
        let rest = pool.split_off(split);
        (pool, rest)
    };
    chosen.extend(rest.into_iter().filter(|(_, t)| is_simple(t)).take(COMBINED / 2));
    let scored: Vec<(f64, usize)> = chosen.iter().enumerate().map(|(i, (s, _))| (*s, i)).collect();
    let list: Vec<Term> = chosen.into_iter().map(|(_, t)| t).collect();
    let terms = best_of(&scored, &list, COMBINED);
    say(0.85, "combining terms");
    let (found, tried) = combined(ground, &terms)?;
    Ok((found, tried + singles.len() + compounds.len()))
}

/// Laws of the given terms, alone and together.
fn combined(ground: &Ground<'_>, terms: &[Term]) -> Result<(Vec<Proposal>, usize), DiscoveryError> {
    let signals = Signals::of(ground.bench, terms, ground.wheels, ground.largest_rate_rad_s)?;
    let regression = regression(ground, &signals, signals.columns.len())?;
    let (own, list) = (&signals.columns, placed(&signals.columns));
    let make = |set: &[usize]| -> Option<Proposal> {
        let members: Vec<&Placed> = set.iter().filter_map(|i| list.get(*i)).collect();
        let of: Vec<Term> = members.iter().filter_map(|p| terms.get(p.term).cloned()).collect();
        // The terms of a law are a set.
        let order: f64 = (1..=set.len()).map(|k| (k as f64).ln()).sum();
        let log_prior = of.iter().map(|t| t.log_prior).sum::<f64>() + order;
        let signals: Vec<usize> = members.iter().flat_map(|p| p.columns.iter().copied()).collect();
        let scored = score(&regression, &signals, log_prior)?;
        let (mut coefficients, mut at) = (Vec::new(), 0);
        for p in &members {
            let of_term = at..at + p.columns.len();
            at = of_term.end;
            let size = |i: &usize| scored.coefficients.get(*i).map_or(0.0, |c| c.abs());
            let largest = of_term.max_by(|a, b| size(a).total_cmp(&size(b)))?;
            let scale = own.get(*p.columns.get(largest - (at - p.columns.len()))?)?.scale;
            coefficients.push(scored.coefficients.get(largest)? * scale);
        }
        let pushes =
            of.iter().zip(&coefficients).any(|(t, c)| t.can_be_passive(&ground.variables) && *c > 0.0);
        // Friction that drives is possible (a turbine), and rare.
        let rare = if pushes { 20f64.ln() } else { 0.0 };
        Some(Proposal { terms: of, coefficients, score: scored.score - rare })
    };
    let score_of = |set: &Vec<usize>| make(set).map(|p| (p.score, set.clone()));
    let sets: Vec<Vec<usize>> = (0..list.len()).map(|i| vec![i]).collect();
    let mut level: Vec<(f64, Vec<usize>)> = sets.par_iter().filter_map(score_of).collect();
    let mut all = level.clone();
    let mut tried = 0;
    for _ in 1..MOST_TERMS {
        level.sort_by(|a, b| b.0.total_cmp(&a.0));
        level.truncate(30);
        let is_torque = |i: usize| {
            list.get(i).and_then(|p| terms.get(p.term)).is_some_and(|t| t.direction != Direction::Wheels)
        };
        let grown: Vec<(f64, Vec<usize>)> = level
            .iter()
            .flat_map(|(score, set)| {
                (0..list.len())
                    .filter(|i| !set.contains(i) && set.iter().all(|j| is_torque(*i) == is_torque(*j)))
                    .map(|i| {
                        let mut more: Vec<usize> = set.iter().copied().chain([i]).collect();
                        more.sort_unstable();
                        (*score, more)
                    })
                    .collect::<Vec<_>>()
            })
            .collect();
        tried += grown.len();
        let next: Vec<(f64, Vec<usize>)> = grown
            .par_iter()
            .filter_map(|(before, set)| score_of(set).filter(|(after, _)| *after > before + WORTH_A_TERM))
            .collect();
        level = next;
        level.sort_by(|a, b| b.0.total_cmp(&a.0));
        level.dedup_by(|a, b| a.1 == b.1);
        all.extend(level.iter().cloned());
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    all.truncate(60);
    Ok((all.iter().filter_map(|(_, set)| make(set)).collect(), tried))
}
