//! Runs `whorl discover` on laws that were drawn, on controls and on effects of the catalogue, and prints the score.
//!
//! ```text
//! cargo run --release -p whorl_challenge --bin whorl_challenge_laws -- [--laws N] [--others N] [--first SEED] [--stride S] [--lambda L]
//! ```
//!
//! Each case goes the way of a user: the catalogue first, and where it has no answer, the search for a law. The law is then
//! adopted and judged on the held-out run.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use clap::Parser;
use whorl_challenge::cases::build::{Built, Stand, stand_key};
use whorl_challenge::cases::{Cell, Laboratory, Spec, build, foreign};
use whorl_dynamics::effects::written::WrittenEffect;
use whorl_dynamics::effects::{register, withdraw};
use whorl_explain::{Case, adopt};
use whorl_identification::{Diagnosis, Options, Verdict, diagnose};
use whorl_identification::{Discovery, discover};

/// Laws that nobody listed, for the search to find, and the score.
#[derive(Debug, Parser)]
struct Arguments {
    /// Laws to draw.
    #[arg(long, default_value_t = 8)]
    laws: u32,
    /// Controls, and as many effects of the catalogue.
    #[arg(long, default_value_t = 2)]
    others: u32,
    /// Seed of the first case.
    #[arg(long, default_value_t = 0)]
    first: u32,
    /// From one seed to the next: 2 keeps to even seeds, those for work, or to odd ones.
    #[arg(long, default_value_t = 1)]
    stride: usize,
    /// Detectability aimed at.
    #[arg(long, default_value_t = 1000)]
    lambda: u32,
    /// Writes every case as CSV into a folder of its own below this, for other programs.
    #[arg(long, value_name = "DIR")]
    write: Option<PathBuf>,
    /// Only builds and writes the cases.
    #[arg(long)]
    only_build: bool,
}

/// Effects of the catalogue that must not be answered with an invented law.
const KNOWN: [&str; 4] = ["bearing_viscous_friction", "harness_spring", "air_current", "magnetic_torque"];

#[derive(Default)]
struct Score {
    cases: usize,
    asked: usize,
    variable: usize,
    form: usize,
    explained: usize,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let laboratory = Laboratory::whorl_1()?;
    let spec = |cell: Cell, effects: &[&str], lambda: u32, seed: u32| Spec {
        cell,
        effects: effects.iter().map(|e| (*e).to_owned()).collect(),
        lambda,
        seed,
    };
    let mut score = Score::default();
    let seeds = |count: u32| (arguments.first..).step_by(arguments.stride.max(1)).take(count as usize);
    for seed in seeds(arguments.laws) {
        let spec = spec(Cell::Outside, &[foreign::DRAWN_LAW], arguments.lambda, seed);
        let Some(built) = made(&laboratory, &spec) else { continue };
        if let Some(folder) = &arguments.write {
            whorl_challenge::write::case(folder, &built)?;
        }
        if !arguments.only_build {
            judge_law(&built, &mut score)?;
        }
    }
    let (mut others, mut invented) = (0, 0);
    for seed in seeds(arguments.others) {
        let turn = (seed - arguments.first) as usize / arguments.stride.max(1);
        let known = KNOWN.get(turn % KNOWN.len()).copied().unwrap_or(KNOWN[0]);
        for spec in [spec(Cell::Control, &[], 0, seed), spec(Cell::Single, &[known], 1000, seed)] {
            let Some(built) = made(&laboratory, &spec) else { continue };
            if arguments.only_build {
                continue;
            }
            let (diagnosis, found) = asked(&built)?;
            let law = found.as_ref().and_then(Discovery::best);
            others += 1;
            invented += usize::from(law.is_some());
            let answer = law.map_or("none", |law| law.equation.as_str());
            println!("{}: {:?} {:?}; law: {answer}", spec.key(), diagnosis.verdict, diagnosis.effects);
        }
    }
    let of = |count: usize| format!("{count} of {}", score.cases);
    println!("\n| drawn laws | |\n|---|---|");
    println!("| no effect of the catalogue was named | {} |", of(score.asked));
    println!("| a law or curve of the right variable is first | {} |", of(score.variable));
    println!("| a law of the true form is first | {} |", of(score.form));
    println!("| held-out error after adopting it at most 1.1 times the noise | {} |", of(score.explained));
    println!("| controls and effects of the catalogue answered with a law | {invented} of {others} |");
    Ok(())
}

fn made(laboratory: &Laboratory, spec: &Spec) -> Option<Built> {
    let stand = Arc::new(Stand::new(laboratory, &stand_key(spec), spec));
    match build(laboratory, &stand, spec) {
        Ok(built) => {
            println!("sealed {} {}", built.answer.seal(), spec.key());
            Some(built)
        }
        Err(error) => {
            println!("{}: not built: {error}", spec.key());
            None
        }
    }
}

/// The catalogue's answer, and where it has none, the search's.
fn asked(built: &Built) -> Result<(Diagnosis, Option<Discovery>)> {
    let options = Options::default();
    let held_out = &built.held_out;
    let diagnosis = diagnose(&built.training, held_out, &built.model, &built.prior, &options, &mut |_| {})?;
    let is_settled =
        matches!(diagnosis.verdict, Verdict::Named | Verdict::Confounded | Verdict::NothingMissing);
    if is_settled {
        return Ok((diagnosis, None));
    }
    let named: Vec<Vec<String>> =
        diagnosis.candidates.iter().take(3).map(|c| vec![c.effect.clone()]).collect();
    let (model, prior) = (&built.model, &built.prior);
    let found =
        discover(&built.training, held_out, model, prior, &named, "found_law", &options, &mut |_, _| {})?;
    Ok((diagnosis, Some(found)))
}

fn judge_law(built: &Built, score: &mut Score) -> Result<()> {
    let Some((variable, form, truth)) = built.answer.law.clone() else { return Ok(()) };
    let begun = Instant::now();
    score.cases += 1;
    let (diagnosis, found) = asked(built)?;
    let key = built.spec.key();
    let Some(found) = found else {
        println!("{key}: {truth}: {:?} {:?}", diagnosis.verdict, diagnosis.effects);
        return Ok(());
    };
    score.asked += 1;
    let Some(best) = found.best() else {
        let first = found.laws.first().map_or("", |law| law.kind);
        println!("{key}: {truth}: no law; {first} is first");
        return Ok(());
    };
    // Rates about body z and about the vertical are the same to a platform that is nearly level.
    let right_variable = best.variables.contains(&variable);
    let right_form = best.kind == "law" && best.equation.contains(&form);
    let error = adopted(built, best.definition.clone())?;
    score.variable += usize::from(right_variable);
    score.form += usize::from(right_form);
    score.explained += usize::from(error.is_some_and(|e| e <= 1.1));
    println!(
        "{key}: {truth}: {} {} ({:.0} %): variable {}, form {}, held-out error {}; {:.0} s",
        best.kind,
        best.equation,
        100.0 * best.probability,
        if right_variable { "right" } else { "WRONG" },
        if right_form { "right" } else { "wrong" },
        error.map_or_else(|| "-".to_owned(), |e| format!("{e:.3}")),
        begun.elapsed().as_secs_f64()
    );
    Ok(())
}

/// Held-out prediction error with the law adopted, over that of noise.
fn adopted(
    built: &Built,
    definition: Option<whorl_dynamics::effects::written::Definition>,
) -> Result<Option<f64>> {
    let Some(definition) = definition else { return Ok(None) };
    let id = definition.id.clone();
    register(WrittenEffect::new(definition)?)?;
    let case = Case {
        training: &built.training,
        held_out: &built.held_out,
        model: &built.model,
        prior: &built.prior,
    };
    let adoption = adopt(&case, &[vec![id.clone()]], &Options::default(), &mut |_, _| {});
    withdraw(&id);
    let with = adoption?.versions.into_iter().find(|v| v.effects.contains(&id));
    Ok(with.and_then(|v| v.prediction_error(true)))
}
