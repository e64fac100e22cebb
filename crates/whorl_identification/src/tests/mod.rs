mod calibration;
mod regression;
mod simulation;
mod trajectory;
