//! ROS 2 parameter files to validated types, with errors that name file, line, key and what is allowed.
