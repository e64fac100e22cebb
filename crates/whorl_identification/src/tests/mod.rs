mod simulation;
mod trajectory;
