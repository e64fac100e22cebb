mod balance;
mod contact;
pub(crate) mod diagnoses;
mod identification;
mod normal_equations;
mod sequential;
mod simulation;
