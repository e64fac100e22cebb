//! Campaigns of short runs: the rows do not depend on who computes them, nor on interruptions.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU64;

use crate::work::{Folder, Tasks, run, work};
use crate::{Part, Plan, definition, page, table};
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

fn open(dir: &tempfile::TempDir) -> Folder {
    Folder::open(dir.path(), "campaign", "csv").unwrap()
}

/// The table after so many threads have worked on the whole, and how many runs they computed.
fn table(folder: &Folder, plan: &Plan, threads: usize) -> (String, u64) {
    let computed = AtomicU64::new(0);
    work(folder, plan, Part::WHOLE, threads, &computed).unwrap();
    (table::csv_text(plan, &plan.rows(folder).unwrap()), computed.into_inner())
}

#[test]
fn rows_are_the_same_with_one_thread_with_three_and_after_an_interruption() {
    let plan = plan(SMALL).unwrap();
    assert_eq!(plan.len(), 4);
    let [one, three, broken] = [0; 3].map(|_| tempfile::tempdir().unwrap());
    let (alone, _) = table(&open(&one), &plan, 1);
    assert_eq!(table(&open(&three), &plan, 3), (alone.clone(), 4));
    assert_eq!(alone.lines().count(), 5);
    assert!(three.path().join("runs/00000003/bag").is_dir());

    // What a killed worker leaves: a row that was not moved to its place, and a part of a run that is kept.
    let folder = open(&broken);
    run(&folder, &plan, 1).unwrap();
    std::fs::write(broken.path().join("rows/00000002.elsewhere_17"), "2,leader_fol").unwrap();
    std::fs::create_dir_all(broken.path().join("runs/00000003/bag")).unwrap();
    std::fs::write(broken.path().join("runs/00000003/bag/part.mcap"), "torn").unwrap();
    assert_eq!(folder.done().unwrap(), 1);
    assert_eq!(table(&folder, &plan, 2), (alone.clone(), 3));
    assert!(!broken.path().join("runs/00000003/bag/part.mcap").exists());
    assert_eq!(table(&folder, &plan, 2), (alone, 0));

    // A row that cannot be read is named, and computed again without its file.
    std::fs::write(broken.path().join("rows/00000002.csv"), "").unwrap();
    let error = plan.rows(&folder).unwrap_err().to_string();
    assert!(error.contains("00000002.csv") && error.contains("computed again"), "{error}");

    // Longer delays make larger errors; seeds differ.
    let groups = table::groups(&plan.rows(&open(&one)).unwrap());
    assert_eq!(groups.iter().map(|g| g.runs).collect::<Vec<_>>(), [2, 2]);
    let page = page::html(&plan, &groups);
    assert!(page.contains("relative_error_rms_deg") && page.contains("delay"), "what was swept is named");
}

#[test]
fn a_folder_of_another_campaign_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    Folder::open(folder.path(), "one", "csv").unwrap();
    let error = Folder::open(folder.path(), "two", "csv").unwrap_err().to_string();
    assert!(error.contains("another campaign"), "{error}");
    // Only what belongs to it is there.
    let names: Vec<_> = std::fs::read_dir(folder.path()).unwrap().flatten().map(|e| e.file_name()).collect();
    assert_eq!(names.len(), 2, "{names:?}");
}

#[test]
fn a_folder_has_one_director_until_he_ends() {
    let folder = tempfile::tempdir().unwrap();
    let first = open(&folder).hold().unwrap();
    let error = open(&folder).hold().unwrap_err().to_string();
    assert!(error.contains(&format!("process {} on", std::process::id())), "{error}");
    assert!(error.contains("works on this campaign already"), "{error}");
    drop(first);
    open(&folder).hold().unwrap();
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
