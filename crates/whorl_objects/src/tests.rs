//! Truth: the paths of local folders, and `object_store`'s own store in memory. Servers: `python/tests/test_objects.py`.

use std::path::Path;

use super::*;

#[test]
fn addresses_have_a_bucket_and_perhaps_a_prefix() {
    assert!(is_remote(Path::new("s3://runs/a")) && !is_remote(Path::new("runs/s3://a")));
    assert_eq!(parts("s3://runs").unwrap(), ("runs", ""));
    assert_eq!(parts("s3://runs/2026/a b/").unwrap(), ("runs", "2026/a b"));
    for wrong in ["s3://", "s3:///a", "s3://runs/a/../b", "s3://runs/a//b", "gs://runs/a", "runs"] {
        let said = parts(wrong).unwrap_err().to_string();
        assert!(said.contains(wrong) && said.contains("allowed: s3://BUCKET"), "{said}");
    }
}

#[test]
fn paths_are_seen_from_a_base_of_either_kind() {
    for (base, path, whole) in [
        ("campaigns", "../runs/a", "campaigns/../runs/a"),
        ("campaigns", "s3://runs/a", "s3://runs/a"),
        ("s3://runs/old", "a", "s3://runs/old/a"),
        ("s3://runs/old", "/here/a", "/here/a"),
    ] {
        assert_eq!(join(Path::new(base), path), Path::new(whole));
    }
}

#[test]
fn local_files_stay_where_they_are() {
    let here = local(Path::new("a/b.csv")).unwrap();
    assert_eq!((here.path(), here.told("a/b.csv: torn").as_str()), (Path::new("a/b.csv"), "a/b.csv: torn"));
}

#[cfg(not(feature = "s3"))]
#[test]
fn without_the_feature_it_is_refused_with_what_helps() {
    let said = Place::open(Path::new("s3://runs/a")).unwrap_err().to_string();
    assert!(said.contains("s3://runs/a") && said.contains("--features object_storage"), "{said}");
}

#[cfg(feature = "s3")]
mod stored {
    use std::fs;
    use std::sync::Arc;

    use object_store::memory::InMemory;

    use super::*;

    fn place(prefix: &str) -> Place {
        Place::of(Arc::new(InMemory::new()), "runs", prefix)
    }

    #[test]
    fn of_several_writers_of_a_new_object_the_first_one_wins() {
        let place = place("campaign");
        assert_eq!(place.get("a").unwrap(), None);
        assert!(place.put_new("a", b"1".to_vec()).unwrap());
        assert!(!place.put_new("a", b"2".to_vec()).unwrap());
        assert_eq!(place.get("a").unwrap().unwrap(), b"1");
        place.put("a", b"3".to_vec()).unwrap();
        let all = place.get_all(&["none".to_owned(), "a".to_owned()]).unwrap();
        assert_eq!(all, [None, Some(b"3".to_vec())]);
    }

    #[test]
    fn a_folder_comes_back_as_it_was() {
        let dir = tempfile::tempdir().unwrap();
        // Names of hive partitions, of which some are encoded; more than one part; an empty file.
        let files = [
            ("summary.csv", vec![b'x'; 10]),
            ("table/run=a%2Fb/platform=w 1/rows.parquet", vec![7; 3]),
            ("bag/large.mcap", (0..40_000_000_u32).map(|k| (k % 251) as u8).collect()),
            ("empty", Vec::new()),
        ];
        for (name, content) in &files {
            let path = dir.path().join("from").join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, content).unwrap();
        }
        let place = place("a");
        // Another campaign, whose name begins with ours.
        place.put("../ab/x", Vec::new()).unwrap_err();
        assert_eq!(place.below("b").address(), "s3://runs/a/b");
        assert_eq!(place.below("b").publish(&dir.path().join("from")).unwrap(), 4);
        let mut expected: Vec<String> = files.iter().map(|(name, _)| format!("b/{name}")).collect();
        expected.sort();
        assert_eq!(place.names().unwrap(), expected);
        assert_eq!(place.below("b").fetch(&dir.path().join("to")).unwrap(), 4);
        for (name, content) in &files {
            assert!(&fs::read(dir.path().join("to").join(name)).unwrap() == content, "{name}");
        }
        // One object, by its own name, to a file.
        assert_eq!(place.below("b/summary.csv").fetch(&dir.path().join("one.csv")).unwrap(), 1);
        assert_eq!(fs::read(dir.path().join("one.csv")).unwrap(), b"xxxxxxxxxx");
        let said = place.below("none").fetch(&dir.path().join("none")).unwrap_err().to_string();
        assert_eq!(said, "s3://runs/a/none: there is nothing with this name or below it");
    }
}
