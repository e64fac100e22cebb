mod balance;
mod contact;
mod diagnoses;
mod identification;
mod normal_equations;
mod sequential;
mod simulation;
