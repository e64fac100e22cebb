//! Places for those who watch: a bound that silent strangers cannot reach for others.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use tokio::sync::Notify;

/// So many places.
#[derive(Debug)]
pub struct Places {
    most: usize,
    taken: Mutex<Vec<Taken>>,
}

#[derive(Debug)]
struct Taken {
    /// Whether it knows the token.
    operator: bool,
    heard: Instant,
    leave: Arc<Notify>,
}

/// One of them, until it is dropped.
#[derive(Debug)]
pub struct Place {
    places: Arc<Places>,
    leave: Arc<Notify>,
}

impl Places {
    /// All are free.
    #[must_use]
    pub fn new(most: usize) -> Arc<Self> {
        Arc::new(Self { most, taken: Mutex::default() })
    }

    /// Takes a place. Where all are taken whoever was silent longest leaves, but for an operator only another operator. `None`
    /// for a stranger where all others are operators.
    #[must_use]
    pub fn take(self: &Arc<Self>, operator: bool) -> Option<Place> {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        if taken.len() >= self.most {
            let longest_silent = taken
                .iter()
                .enumerate()
                .filter(|(_, other)| operator || !other.operator)
                .min_by_key(|(_, other)| (other.operator, other.heard))
                .map(|(index, _)| index)?;
            taken.swap_remove(longest_silent).leave.notify_one();
        }
        let leave = Arc::new(Notify::new());
        taken.push(Taken { operator, heard: Instant::now(), leave: Arc::clone(&leave) });
        Some(Place { places: Arc::clone(self), leave })
    }
}

impl Place {
    /// Its holder has answered.
    pub fn heard(&self) {
        let mut taken = self.places.taken.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = taken.iter_mut().find(|taken| Arc::ptr_eq(&taken.leave, &self.leave)) {
            own.heard = Instant::now();
        }
    }

    /// Waits until somebody else has it.
    pub async fn is_lost(&self) {
        self.leave.notified().await;
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.places.taken.lock().unwrap_or_else(PoisonError::into_inner);
        taken.retain(|taken| !Arc::ptr_eq(&taken.leave, &self.leave));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_lost(place: &Place) -> bool {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        runtime.block_on(async {
            tokio::select! {
                biased;
                () = place.is_lost() => true,
                () = std::future::ready(()) => false,
            }
        })
    }

    #[test]
    fn who_is_silent_longest_makes_place_and_never_an_operator_for_a_stranger() {
        let places = Places::new(3);
        let operator = places.take(true).unwrap();
        let (silent, answers) = (places.take(false).unwrap(), places.take(false).unwrap());
        answers.heard();
        let next = places.take(false).unwrap();
        assert!(is_lost(&silent) && !is_lost(&answers) && !is_lost(&operator) && !is_lost(&next));
        // What was lost leaves nothing behind when it goes.
        drop(silent);
        let second = places.take(true).unwrap();
        assert!(is_lost(&answers) && !is_lost(&next));
        let third = places.take(true).unwrap();
        assert!(is_lost(&next));
        assert!(places.take(false).is_none(), "three operators watch");
        assert!(!is_lost(&operator) && !is_lost(&second) && !is_lost(&third));
        drop(third);
        assert!(places.take(false).is_some());
    }
}
