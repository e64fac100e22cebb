mod contact;
pub(crate) mod diagnoses;
mod identification;
mod sequential;
mod simulation;
