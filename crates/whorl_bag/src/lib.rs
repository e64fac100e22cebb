//! Recordings: rosbag2 MCAP, CSV, and the run directory with its manifest.
