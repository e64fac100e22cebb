mod calibration;
mod identification;
mod sequential;
mod simulation;
