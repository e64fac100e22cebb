//! Tracks the attitude reference of one platform with wheels and jets.
