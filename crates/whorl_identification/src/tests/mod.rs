mod diagnoses;
mod identification;
mod sequential;
mod simulation;
