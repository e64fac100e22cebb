//! Work shared between threads; results keep their order, so they do not depend on the number of threads.

use rayon::prelude::*;

/// `work` of every item, in the order of the items: on this thread alone, or on those of rayon's pool.
pub fn map<I: Sync, O: Send>(threads: usize, items: &[I], work: impl Fn(&I) -> O + Sync) -> Vec<O> {
    if threads.min(items.len()) <= 1 {
        return items.iter().map(work).collect();
    }
    items.par_iter().map(&work).collect()
}
