mod calibration;
mod sequential;
mod simulation;
mod trajectory;
