//! Platform model: gyrostat, mass properties, actuators, sensors and the catalogue of physical effects.
