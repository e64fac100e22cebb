//! Reading files that somebody else wrote: only files, and only so much.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path;

/// Largest text that is read whole \[bytes\]: the parameter files of a formation have some 50 kB, and an effect with measured
/// curves of thousands of knots has less than one megabyte.
pub const LARGEST_TEXT: u64 = 16 << 20;

/// Opens a file to read it.
///
/// # Errors
/// Those of the operating system; what is no file, such as a named pipe, which would be waited for without end.
pub fn open_file(path: &Path) -> io::Result<File> {
    let kind = std::fs::metadata(path)?.file_type();
    if kind.is_file() {
        return File::open(path);
    }
    let what = if kind.is_dir() { "a folder" } else { "a pipe or a device" };
    Err(io::Error::new(ErrorKind::InvalidInput, format!("it is {what}; allowed: a file")))
}

/// The text of a file.
///
/// # Errors
/// As [`open_file`]; more than [`LARGEST_TEXT`]; what is no UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    open_file(path)?.take(LARGEST_TEXT + 1).read_to_string(&mut text)?;
    if text.len() as u64 > LARGEST_TEXT {
        let why = format!("it is larger than {} MB; allowed: less", LARGEST_TEXT >> 20);
        return Err(io::Error::new(ErrorKind::InvalidData, why));
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pipes_folders_devices_and_huge_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let refused = |path: &Path| read_text(path).unwrap_err().to_string();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        assert!(refused(&pipe).contains("a pipe or a device"), "{}", refused(&pipe));
        assert!(refused(Path::new("/dev/zero")).contains("a pipe or a device"));
        assert!(refused(folder.path()).contains("a folder"));
        let huge = folder.path().join("huge.yaml");
        File::create(&huge).unwrap().set_len(LARGEST_TEXT + 1).unwrap();
        assert!(refused(&huge).contains("larger than 16 MB"), "{}", refused(&huge));
        File::create(&huge).unwrap().set_len(LARGEST_TEXT).unwrap();
        assert_eq!(read_text(&huge).unwrap().len() as u64, LARGEST_TEXT);
        assert_eq!(read_text(&folder.path().join("none")).unwrap_err().kind(), ErrorKind::NotFound);
    }
}
