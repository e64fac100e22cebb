//! What is kept of long runs.

use whorl_dynamics::{ModelPrior, PlatformModel};

use super::generator::record;
use crate::evidence::nuisance::Nuisance;
use crate::evidence::problem::Problem;
use crate::parameters::Reference;
use crate::search::noise_optimisation::Linears;
use crate::whitening::columns::predict;
use crate::whitening::filter::{Linear, System};
use crate::whitening::mechanics::Mechanics;

/// All transitions, with the columns that they have.
fn transitions(linear: &Linear, intervals: usize) -> Vec<(Vec<usize>, Vec<f64>)> {
    let of = |k| linear.transition_over(k).map(|(columns, row)| (columns.to_vec(), row.to_vec()));
    (0..intervals).flat_map(of).collect()
}

#[test]
fn runs_linearised_for_many_kinds_of_noise_stay_within_their_room_and_are_the_same() {
    let model = PlatformModel::whorl_1_reference();
    let recording = record(&model, 3, 10.0, None);
    let reference = Reference::new(&model, &ModelPrior::typical(&model));
    let problem = Problem::new(std::slice::from_ref(&recording), reference, 10.0, 1).unwrap();
    let mechanics = Mechanics::new(&model).unwrap();
    let (run, motion) = (&problem.runs[0], &problem.motions[0]);
    let (_, prediction) = predict(&mechanics, run, motion);
    let system = |kind| {
        let settings = problem.settings_with(kind, 0);
        System { run, motion, mechanics: &mechanics, prediction: &prediction, settings }
    };
    let quiet = Nuisance::default();
    let torque = |correlation_time| Nuisance { torque: 1, correlation_time, ..quiet };
    let kinds = [quiet, torque(0), torque(1), torque(2)];
    let room = 5 * system(kinds[1]).linear().own_bytes() / 2;
    let mut linears = Linears::within(room);
    for kind in kinds.into_iter().cycle().take(3 * kinds.len()) {
        let fresh = system(kind).linear();
        let kept = &linears.of(kind, &[system(kind)], 1)[0];
        assert_eq!(kept.n, fresh.n);
        assert!(transitions(kept, run.nodes() - 1) == transitions(&fresh, run.nodes() - 1), "{kind:?}");
        assert_eq!(system(kind).innovations(kept), system(kind).innovations(&fresh));
        assert!(linears.bytes() <= room, "{} of {room} bytes", linears.bytes());
    }
}
