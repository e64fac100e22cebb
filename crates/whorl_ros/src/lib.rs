//! The only crate that knows ROS 2's transport: runs a node core on DDS.
