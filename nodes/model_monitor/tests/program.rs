//! The program, as a shell starts it. Cargo builds it because of this test: `tests/support/binaries.rs` relies on that.

#[test]
fn it_says_what_it_is_and_refuses_a_wrong_parameter() {
    whorl_tests::node_answers_the_shell(
        env!("CARGO_BIN_EXE_model_monitor"),
        "model_monitor",
        Some("whorl_1"),
    );
}
