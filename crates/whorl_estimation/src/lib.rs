//! Attitude and gyro-bias filters with consistency statistics.
