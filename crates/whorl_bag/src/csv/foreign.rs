//! Files of other programs that are no CSV: what they are by their first bytes, and what makes CSV of them.

use std::path::Path;

use whorl_math::words::shell_word;

/// First bytes, what begins so, and what to do; `{file}` is the file, `{stem}` its path without ending.
const KNOWN: &[(&[u8], &str, &str)] = &[
    (
        b"ULog\x01\x12\x35",
        "a flight log of px4 (ULog)",
        "`ulog2csv -m sensor_combined {file}` writes {stem}_sensor_combined_0.csv, which `whorl new` reads (pip install pyulog)",
    ),
    (
        b"PK\x03\x04",
        "an archive (zip) or a spreadsheet",
        "unpack it (`unzip {file} -d {stem}`) and take the CSV files in it; a spreadsheet saves as CSV",
    ),
    (
        b"#ROSBAG V",
        "a bag of ROS 1",
        "`rosbags-convert --src {file} --dst {stem} --dst-storage mcap` writes a folder that Whorl reads (pip install rosbags)",
    ),
    (b"\x89MCAP", "an MCAP file", "name it with the ending .mcap"),
    (b"SQLite format 3\0", "a database of SQLite", "if it is a bag, name it with the ending .db3"),
    (
        b"\x89HDF",
        "an HDF5 file",
        "write its table as CSV (`h5dump` lists it; in Python: h5py and numpy.savetxt)",
    ),
    (
        b"MATLAB 5.0 MAT-file",
        "a file of MATLAB",
        "write its table as CSV (in MATLAB: writetable or writematrix)",
    ),
    (b"PAR1", "a Parquet file", "write it as CSV (in Python: polars.read_parquet(...).write_csv(...))"),
    (
        b"\x93NUMPY",
        "an array of NumPy",
        "write it as CSV (in Python: numpy.savetxt with delimiter=\",\" and a header)",
    ),
    (
        b"\x28\xb5\x2f\xfd",
        "compressed with Zstandard",
        "unpack it (`zstd -d {file}`), or compress it with gzip, which is read as it is",
    ),
    (
        b"BZh",
        "compressed with bzip2",
        "unpack it (`bunzip2 {file}`), or compress it with gzip, which is read as it is",
    ),
    (
        b"\xfd7zXZ\0",
        "compressed with xz",
        "unpack it (`xz -d {file}`), or compress it with gzip, which is read as it is",
    ),
];

/// What a file is that is no CSV, and what makes one of it, by its first bytes.
pub(super) fn told(path: &Path, begins: &[u8]) -> Option<(&'static str, String)> {
    let is = |(magic, ..): &&(&[u8], &str, &str)| begins.starts_with(magic);
    let (_, what, then) = KNOWN.iter().find(is)?;
    let word = |path: &Path| shell_word(&path.display().to_string());
    let then = then.replace("{file}", &word(path)).replace("{stem}", &word(&path.with_extension("")));
    Some((what, then))
}

#[cfg(test)]
mod tests {
    use super::super::look;
    use super::KNOWN;

    #[test]
    fn files_of_other_programs_are_named_with_the_command_that_converts_them() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("flight.ulg");
        for (magic, what, _) in KNOWN {
            std::fs::write(&file, [*magic, b"\n\0\xff\xfe,1,2\n"].concat()).unwrap();
            let error = look(&file, 100).unwrap_err().to_string();
            assert!(error.contains("flight.ulg: this is ") && error.contains(what), "{error}");
        }
        std::fs::write(&file, b"ULog\x01\x12\x35\x01").unwrap();
        let error = look(&file, 100).unwrap_err().to_string();
        let stem = folder.path().join("flight").display().to_string();
        let command = format!("`ulog2csv -m sensor_combined {stem}.ulg` writes {stem}_sensor_combined_0.csv");
        assert!(error.contains(&command), "{error}");
        let spaced = folder.path().join("my flight.ulg");
        std::fs::copy(&file, &spaced).unwrap();
        let error = look(&spaced, 100).unwrap_err().to_string();
        assert!(error.contains(&format!("-m sensor_combined '{}'", spaced.display())), "{error}");
    }
}
