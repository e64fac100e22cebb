//! Computations that are told to stop.

use std::panic::{AssertUnwindSafe, catch_unwind};

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

use crate::{Noise, Prepared, Settings, Stop, fitted_start};

#[test]
fn passes_unwind_on_threads_that_were_told_and_on_no_others() {
    let model = PlatformModel::whorl_1_reference();
    let mut recording = Recording { name: "rest".to_owned(), ..Recording::default() };
    for k in 0..100 {
        recording.gyro_b_rad_s.time_s.push(f64::from(k) * 0.01);
        recording.gyro_b_rad_s.value.push(Vector3::new(1e-3 * f64::from(k % 7), 0.0, 0.0));
    }
    let determined = || {
        let case = Prepared::new(&recording, &model, Settings::default()).unwrap();
        fitted_start(&case, &Noise::stated(&case).unwrap()).determined
    };
    let stop = Stop::default();
    let on_a_thread = |told: bool| {
        let of = || {
            stop.on_this_thread();
            if told {
                stop.now();
            }
            catch_unwind(AssertUnwindSafe(determined))
        };
        std::thread::scope(|scope| scope.spawn(of).join().unwrap())
    };
    let whole = on_a_thread(false).unwrap();
    let cause = on_a_thread(true).unwrap_err();
    assert!(Stop::was_told(cause.as_ref()));
    assert_eq!(determined(), whole, "nobody told this thread");
}
