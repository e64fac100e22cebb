//! Fits of a set that had not come to its end.

use whorl_dynamics::PlatformModel;

use super::generator::{record, wrong_model};
use crate::search::Search;
use crate::{Options, prepare};

/// A base model that ended far from its minimum, and a larger set that did not and whose effect is nothing: what is better is
/// the base model.
#[test]
fn a_smaller_set_is_fitted_from_where_a_larger_one_ended() {
    let truth = PlatformModel::whorl_1_reference();
    let runs = [record(&truth, 31, 30.0, None), record(&truth, 32, 30.0, None)];
    let (model, prior) = wrong_model(&truth, 3);
    let options = Options { threads: 1, ..Options::default() };
    let (mut problem, _) = prepare(&runs, &[], &model, &prior, &options, None, &mut |_| {}).unwrap();
    let mut search = Search::start(&mut problem, None, &options, &mut |_| {}).unwrap();
    let base = search.base.clone();
    let good = search.converge(&base).unwrap().unwrap();
    let addition = search.additions(&base).swap_remove(0);
    let larger = search.converge(&addition).unwrap().unwrap();
    let mut poor = good.clone();
    poor.score.log_evidence -= 40.0;
    poor.point = search.problem.reference.point();
    search.remember(poor);
    search.remember(larger.clone());
    assert_eq!(search.most_probable().map(|set| set.names.clone()), Some(larger.names.clone()));
    search.fit_smaller_sets(&larger).unwrap();
    let found = search.score(&base).unwrap();
    assert!((found.log_evidence - good.score.log_evidence).abs() < 2.0, "{found:?} {:?}", good.score);
    assert!(search.most_probable().is_some_and(|set| set.names.is_empty()));
}
