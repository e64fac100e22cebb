//! Attitude tracking, reference shaping, relative-attitude laws and momentum management.
