//! Drives one platform: simulated hardware, replay of a recording, or real hardware, behind one safety gate.
