//! Campaigns of short runs: the rows do not depend on who computes them, nor on interruptions.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU64;

use crate::work::{Folder, work};
use crate::{Plan, Row, definition, page, table};
use whorl_params::{ParameterTree, try_read};

const SMALL: &str = r#"
/campaign:
  ros__parameters:
    experiments: [leader_follower_short]
    seeds: 2
    longest_s: 12.0
    keep_every: 3
    sweep:
      delay_s: {key: "/simulation:link.delay_s", values: [0.001, 0.1]}
"#;

fn parameters() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params")
}

fn plan(text: &str) -> Result<Plan, String> {
    let tree = ParameterTree::from_texts(&[("test.yaml", text)], &[]).map_err(|e| e.to_string())?;
    let (definition, _) =
        try_read(&tree.for_node("/campaign"), |r| Some(definition::read(r))).map_err(|e| e.to_string())?;
    Plan::new(definition, &parameters()).map_err(|e| e.to_string())
}

fn rows(folder: &Folder, plan: &Plan, threads: usize) -> Vec<Row> {
    work(folder, plan, threads, &AtomicU64::new(0)).unwrap();
    folder.rows(plan).unwrap()
}

#[test]
fn rows_are_the_same_with_one_thread_with_three_and_after_an_interruption() {
    let plan = plan(SMALL).unwrap();
    assert_eq!(plan.len(), 4);
    let [one, three, broken] = [0; 3].map(|_| tempfile::tempdir().unwrap());
    let open = |dir: &tempfile::TempDir| Folder::open(dir.path(), "campaign").unwrap();
    let alone = table::csv_text(&plan, &rows(&open(&one), &plan, 1));
    let many = table::csv_text(&plan, &rows(&open(&three), &plan, 3));
    assert_eq!(alone, many);
    assert_eq!(alone.lines().count(), 5);
    assert!(three.path().join("runs/00000003/bag").is_dir());

    // A dead worker left a claim without a row. A recent claim of another machine is respected.
    let folder = open(&broken);
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap();
    std::fs::write(broken.path().join("claims/00000001"), format!("{} 4194305\n", host.trim())).unwrap();
    std::fs::write(broken.path().join("claims/00000002"), "another_machine 17\n").unwrap();
    let some = rows(&folder, &plan, 2);
    assert_eq!(some.iter().map(|r| r.index).collect::<Vec<_>>(), [0, 1, 3]);
    std::fs::remove_file(broken.path().join("claims/00000002")).unwrap();
    assert_eq!(table::csv_text(&plan, &rows(&folder, &plan, 2)), alone);

    // Longer delays make larger errors; seeds differ.
    let groups = table::groups(&folder.rows(&plan).unwrap());
    assert_eq!(groups.iter().map(|g| g.runs).collect::<Vec<_>>(), [2, 2]);
    let page = page::html(&plan, &groups);
    assert!(page.contains("relative_error_rms_deg") && page.contains("delay"), "what was swept is named");
}

#[test]
fn a_folder_of_another_campaign_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    Folder::open(folder.path(), "one").unwrap();
    let error = Folder::open(folder.path(), "two").unwrap_err().to_string();
    assert!(error.contains("another campaign"), "{error}");
}

#[test]
fn a_run_that_is_refused_says_why_in_its_row() {
    let text = SMALL.replace("/simulation:link.delay_s", "/coordinator:law.kindd");
    let spec = plan(&text).unwrap().run(0).unwrap();
    let row = crate::single::simulate(&spec, 5.0, None);
    assert_eq!(row.outcome, "refused");
    assert!(row.reason.contains("law.kindd"), "{}", row.reason);
}

#[test]
fn a_campaign_whose_runs_cannot_begin_is_refused_before_the_first() {
    plan(SMALL).unwrap().check().unwrap();
    let text = SMALL.replace("[0.001, 0.1]", "[0.001, -1.0]");
    let error = plan(&text).unwrap().check().unwrap_err().to_string();
    assert!(error.contains("leader_follower_short -1.0") && error.contains("link.delay_s"), "{error}");
}

#[test]
fn definitions_that_are_wrong_are_refused_in_words() {
    for (from, to, said) in [
        ("leader_follower_short", "no_such", "no_such.yaml does not exist"),
        ("seeds: 2", "seeds: 0", "allowed"),
        ("seeds: 2", "seedz: 2", "did you mean"),
        ("\"/simulation:link.delay_s\"", "\"/simulation:link delay\"", "sweep.delay_s"),
        ("values: [0.001, 0.1]", "values: []", "nothing to sweep"),
        ("keep_every: 3", "plots: [gas]", "there is no metric `gas`"),
    ] {
        let error = plan(&SMALL.replace(from, to)).unwrap_err();
        assert!(error.contains(said), "{to}: {error}");
    }
}
