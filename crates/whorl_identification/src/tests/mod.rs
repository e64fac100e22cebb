mod calibration;
mod regression;
mod sequential;
mod simulation;
mod trajectory;
