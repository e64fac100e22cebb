//! ROS 2 messages of Whorl as Rust types, their .msg definitions, CDR encoding and the table of topics.
