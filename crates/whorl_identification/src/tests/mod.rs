mod regression;
mod simulation;
mod trajectory;
