//! What commands do between reading their arguments and printing: read runs with their model, ask the libraries, give the
//! answer as data. The `whorl` program prints these answers and the Python package returns them, so both have the same
//! numbers and the same words.
//!
//! | module | what |
//! |---|---|
//! | [`runs`] | runs and their model, from files |
//! | [`new_rig`] | the platform's file and the map of channels of a file that comes with neither |
//! | [`compare`], [`locate`], [`diagnose`], [`adopt`] | answers of [`whorl_explain`] as JSON |
//! | [`next`] | the manoeuvre that a diagnosis recommends, rehearsed in simulation |
//! | [`pointing`] | what a new model is worth in control, in simulation |
//! | [`discover`] | whether a law is to be searched for, with which competitors, and the answer in words |
//! | [`history`], [`calibrate`], [`identify`] | how a model came to be and what changed since; errors of the sensors; mass properties |
//! | [`estimate`], [`attitudes`] | the attitude of a recorded sensor or vehicle |
//! | [`simulate`] | an experiment in one process, recorded |
//! | [`campaign`] | plan, folder and tables of a campaign, over experiments or recordings |
//! | [`report`] | page and numbers of a run |
//! | [`tables`] | recordings and diagnoses as Parquet files |
//! | [`model_file`], [`provenance`] | results written into parameter files, and where they came from |

pub mod adopt;
pub mod attitudes;
pub mod axis_watch;
pub mod calibrate;
pub mod campaign;
pub mod compare;
pub mod diagnose;
pub mod discover;
pub mod estimate;
pub mod history;
pub mod identify;
pub mod locate;
pub mod model_file;
pub mod new_rig;
pub mod next;
pub mod own_times;
pub mod page;
pub mod pointing;
pub mod provenance;
mod rehearsal;
pub mod report;
pub mod runs;
pub mod settings;
pub mod shapes;
pub mod simulate;
pub mod tables;
mod words;

use whorl_identification::Options;
pub use words::{in_words, of_arguments};

/// Default options of the search for effects, on all processors.
#[must_use]
pub fn options() -> Options {
    Options {
        threads: std::thread::available_parallelism().map_or(2, std::num::NonZero::get),
        ..Options::default()
    }
}
