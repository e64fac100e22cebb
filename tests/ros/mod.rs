//! The node set as real processes over DDS, on the loopback interface.
