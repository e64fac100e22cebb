//! Estimates attitude and gyro bias of one platform.
