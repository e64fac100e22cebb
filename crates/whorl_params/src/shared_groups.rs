//! Keys that belong to no single node.

/// The group that holds a platform's model.
pub(crate) const MODEL_GROUP: &str = "model";
/// The group that says how the model came to be.
pub(crate) const HISTORY_GROUP: &str = "model_history";
/// The group that says how well the model is known.
pub(crate) const PRIOR_GROUP: &str = "model_prior";

/// Groups of keys that belong to no single node. Only they may stand in a section that ends in a
/// wildcard, and a node that does not read such a group ignores it.
pub const SHARED_GROUPS: [&str; 6] =
    ["formation", MODEL_GROUP, HISTORY_GROUP, PRIOR_GROUP, "truth", "use_sim_time"];

/// True for a key of one of [`SHARED_GROUPS`].
#[must_use]
pub fn is_shared(key: &str) -> bool {
    let group = key.split_once('.').map_or(key, |(group, _)| group);
    SHARED_GROUPS.contains(&group)
}
