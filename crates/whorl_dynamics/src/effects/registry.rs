//! The effects that this process knows: those compiled in, and those written in files.
//!
//! Files are read before parameters are, so the list only grows; what was handed out stays valid for as long as the
//! process lives.

use std::sync::{PoisonError, RwLock};

use super::written::WrittenEffect;
use super::{Effect, built_in};

/// One that was registered.
#[derive(Clone, Copy)]
struct Entry {
    effect: &'static WrittenEffect,
    standing: Standing,
}

/// Who gets to know an effect that was registered. Of two standings the larger one holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Standing {
    /// Nobody any more.
    Withdrawn,
    /// Who asks for its id: the simulated hardware that has it.
    Secret,
    /// Everybody: it is in the catalogue.
    Listed,
}

struct Registered {
    entries: Vec<Entry>,
    /// Everything that is listed, made anew when it changes.
    all: Option<&'static [&'static dyn Effect]>,
}

static REGISTERED: RwLock<Registered> = RwLock::new(Registered { entries: Vec::new(), all: None });

/// Why an effect was not registered.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RegisterError {
    /// The id is that of an effect that is compiled in.
    #[error("the effect `{0}` is built in; give this one another id")]
    BuiltIn(String),
    /// Another definition has the id.
    #[error("another effect with the id `{0}` but another definition is in use; give one of them another id")]
    Differs(String),
}

/// Every effect: those compiled in, then those registered in the order in which they came.
#[must_use]
pub fn catalogue() -> &'static [&'static dyn Effect] {
    REGISTERED.read().unwrap_or_else(PoisonError::into_inner).all.unwrap_or(built_in())
}

/// The effect with this id: of the catalogue, or a secret one.
#[must_use]
pub fn find(id: &str) -> Option<&'static dyn Effect> {
    let listed = catalogue().iter().copied().find(|effect| effect.info().id == id);
    listed.or_else(|| {
        let registered = REGISTERED.read().unwrap_or_else(PoisonError::into_inner);
        let is_secret = |e: &&Entry| e.standing == Standing::Secret && e.effect.info().id == id;
        registered.entries.iter().find(is_secret).map(|e| e.effect as &'static dyn Effect)
    })
}

/// The effects that were registered, as they were written.
#[must_use]
pub fn registered() -> Vec<&'static WrittenEffect> {
    let registered = REGISTERED.read().unwrap_or_else(PoisonError::into_inner);
    registered.entries.iter().filter(|e| e.standing == Standing::Listed).map(|e| e.effect).collect()
}

/// Adds an effect to the catalogue; the same one a second time changes nothing.
///
/// # Errors
/// When another effect has its id.
pub fn register(effect: WrittenEffect) -> Result<&'static dyn Effect, RegisterError> {
    add(effect, Standing::Listed)
}

/// Makes an effect known to those who ask for its id ([`find`]) and to nobody else, unless it is in the catalogue: simulated
/// hardware may have one that its model lacks, and those who look for what is missing must not see it beside them.
///
/// # Errors
/// When another effect has its id.
pub fn register_secret(effect: WrittenEffect) -> Result<&'static dyn Effect, RegisterError> {
    add(effect, Standing::Secret)
}

fn add(effect: WrittenEffect, standing: Standing) -> Result<&'static dyn Effect, RegisterError> {
    let id = effect.info().id;
    if built_in().iter().any(|known| known.info().id == id) {
        return Err(RegisterError::BuiltIn(id.to_owned()));
    }
    let mut registered = REGISTERED.write().unwrap_or_else(PoisonError::into_inner);
    let known = registered.entries.iter().position(|e| e.effect.definition() == effect.definition());
    let is_other = |(i, e): (usize, &Entry)| {
        e.standing != Standing::Withdrawn && e.effect.info().id == id && Some(i) != known
    };
    if registered.entries.iter().enumerate().any(is_other) {
        return Err(RegisterError::Differs(id.to_owned()));
    }
    let found = match known.and_then(|i| registered.entries.get_mut(i)) {
        Some(entry) => {
            entry.standing = entry.standing.max(standing);
            entry.effect
        }
        None => {
            let effect: &'static WrittenEffect = Box::leak(Box::new(effect));
            registered.entries.push(Entry { effect, standing });
            effect
        }
    };
    registered.relist();
    Ok(found)
}

/// Takes an effect that was registered out of the catalogue, for one that was only tried. Who holds it may go on.
pub fn withdraw(id: &str) {
    let mut registered = REGISTERED.write().unwrap_or_else(PoisonError::into_inner);
    let of_id = registered.entries.iter_mut().filter(|e| e.effect.info().id == id);
    of_id.for_each(|e| e.standing = Standing::Withdrawn);
    registered.relist();
}

impl Registered {
    fn relist(&mut self) {
        let written = self
            .entries
            .iter()
            .filter(|e| e.standing == Standing::Listed)
            .map(|e| e.effect as &'static dyn Effect);
        let all: Vec<&'static dyn Effect> = built_in().iter().copied().chain(written).collect();
        self.all = Some(Box::leak(all.into_boxed_slice()));
    }
}
