//! The text of a CSV file as people write it: comment lines, another encoding, the last line torn.

use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use super::error::CsvError;

/// Longest line: a longer one is no line of numbers.
const LONGEST_LINE: usize = 1 << 20;
/// Longest record: a quote that is never closed makes one of all lines behind it.
const LONGEST_RECORD: usize = 4 << 20;
/// Most lines, comments and empty ones with them: five hours at 1 kHz.
const MOST_LINES: u64 = 20_000_000;
/// Most text, decompressed \[bytes\].
const MOST_TEXT: u64 = 8 << 30;
/// Lines before the header, of comments, that are kept to find it in.
const LONGEST_PREAMBLE: usize = 10_000;

/// Reads a text line by line as UTF-8. A comment line becomes an empty one, so that lines keep their numbers.
pub(super) struct Source {
    input: BufReader<Box<dyn Read + Send>>,
    encoding: Encoding,
    /// What is ready to be read.
    ready: Vec<u8>,
    read: usize,
    /// Whether the last line has no end.
    torn: bool,
    ended: bool,
    /// Bytes that were given out for the present record.
    given: usize,
    /// Lines and bytes so far.
    lines: u64,
    text: u64,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Utf8,
    Utf16 { little_endian: bool },
}

impl Source {
    /// Opens a file, compressed with gzip or not: by its content, because names lie.
    pub fn open(path: &Path, delimiter: u8) -> Result<Self, CsvError> {
        let mut file = BufReader::new(whorl_files::open_file(path).map_err(CsvError::io("open", path))?);
        let begins = file.fill_buf().map_err(CsvError::io("read", path))?;
        if let Some((what, then)) = super::foreign::told(path, begins) {
            return Err(CsvError::Foreign { path: path.to_owned(), what, then });
        }
        let compressed = begins.starts_with(&[0x1f, 0x8b]);
        let input: Box<dyn Read + Send> =
            if compressed { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) };
        Self::new(input, delimiter).map_err(CsvError::io("read", path))
    }

    /// Finds the encoding and the header: the last comment line where the first other line begins with a number, as NumPy's
    /// `savetxt` writes it.
    fn new(input: Box<dyn Read + Send>, delimiter: u8) -> io::Result<Self> {
        let mut input = BufReader::with_capacity(1 << 16, input);
        let start = input.fill_buf()?;
        // A byte order mark, or ASCII of which every second byte is zero.
        let (encoding, mark) = match start {
            [0xff, 0xfe, ..] => (Encoding::Utf16 { little_endian: true }, 2),
            [0xfe, 0xff, ..] => (Encoding::Utf16 { little_endian: false }, 2),
            [_, 0, _, 0, ..] => (Encoding::Utf16 { little_endian: true }, 0),
            [0, _, 0, _, ..] => (Encoding::Utf16 { little_endian: false }, 0),
            [0xef, 0xbb, 0xbf, ..] => (Encoding::Utf8, 3),
            _ => (Encoding::Utf8, 0),
        };
        input.consume(mark);
        let mut source = Self {
            input,
            encoding,
            ready: Vec::new(),
            read: 0,
            torn: false,
            ended: false,
            given: 0,
            lines: 0,
            text: 0,
        };
        source.find_header(delimiter)?;
        Ok(source)
    }

    /// Whether the last line has no end: the writer may have been stopped within it.
    pub fn is_torn(&self) -> bool {
        self.torn
    }

    /// What is read from here on is another record.
    pub fn begin_record(&mut self) {
        self.given = 0;
    }

    fn find_header(&mut self, delimiter: u8) -> io::Result<()> {
        let mut text = Vec::new();
        let mut comment: Option<std::ops::Range<usize>> = None;
        for _ in 0..LONGEST_PREAMBLE {
            if text.len() > LONGEST_RECORD {
                break;
            }
            let Some(line) = self.line()? else { break };
            if is_blank(&line) {
                text.extend(line);
            } else if is_comment(&line) {
                comment = Some(text.len()..text.len() + line.len());
                text.extend(line);
            } else {
                if let Some(found) = comment.filter(|_| begins_with_a_number(&line, delimiter)) {
                    let signs = comment_signs(text.get(found.clone()).unwrap_or_default());
                    text.drain(found.start..found.start + signs);
                }
                text.extend(line);
                break;
            }
        }
        self.ready = without_comments(text);
        Ok(())
    }

    /// The next line with its end; `None` behind the last.
    fn line(&mut self) -> io::Result<Option<Vec<u8>>> {
        if self.ended {
            return Ok(None);
        }
        let mut line = Vec::new();
        let ended = match self.encoding {
            Encoding::Utf8 => {
                let limit = LONGEST_LINE as u64;
                let length = (&mut self.input).take(limit).read_until(b'\n', &mut line)?;
                length == 0 || line.last() != Some(&b'\n') && length < LONGEST_LINE
            }
            Encoding::Utf16 { little_endian } => self.line_of_units(little_endian, &mut line)?,
        };
        // A line of 16-bit units has as many bytes, or up to three times as many.
        if line.len() >= LONGEST_LINE && line.last() != Some(&b'\n') {
            let why = format!("a line is longer than {} MB: this is no file of numbers", LONGEST_LINE >> 20);
            return Err(io::Error::new(io::ErrorKind::InvalidData, why));
        }
        self.lines += 1;
        self.text += line.len() as u64;
        if self.lines > MOST_LINES || self.text > MOST_TEXT {
            let why = format!(
                "more than {} million lines or {} GB; allowed: less. Split the recording into several files",
                MOST_LINES / 1_000_000,
                MOST_TEXT >> 30
            );
            return Err(io::Error::new(io::ErrorKind::InvalidData, why));
        }
        if ended {
            self.ended = true;
            self.torn = !is_blank(&line);
        }
        Ok((!line.is_empty()).then_some(line))
    }

    /// A line of 16-bit units as UTF-8; whether the text ends with it.
    fn line_of_units(&mut self, little_endian: bool, line: &mut Vec<u8>) -> io::Result<bool> {
        let mut units = Vec::new();
        loop {
            let mut pair = [0; 2];
            match self.input.read_exact(&mut pair) {
                Ok(()) => {}
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
                    line.extend(String::from_utf16_lossy(&units).bytes());
                    return Ok(true);
                }
                Err(error) => return Err(error),
            }
            let unit = if little_endian { u16::from_le_bytes(pair) } else { u16::from_be_bytes(pair) };
            units.push(unit);
            if unit == u16::from(b'\n') || units.len() >= LONGEST_LINE {
                line.extend(String::from_utf16_lossy(&units).bytes());
                return Ok(false);
            }
        }
    }
}

impl Read for Source {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.read >= self.ready.len() {
            let Some(line) = self.line()? else { return Ok(0) };
            self.ready = if is_comment(&line) { without_comments(line) } else { line };
            self.read = 0;
        }
        if self.given > LONGEST_RECORD {
            let why = format!(
                "a record, with comments and empty lines before it, is longer than {} MB: is a quote not closed?",
                LONGEST_RECORD >> 20
            );
            return Err(io::Error::new(io::ErrorKind::InvalidData, why));
        }
        let rest = self.ready.get(self.read..).unwrap_or_default();
        let count = rest.len().min(buffer.len());
        if let (Some(to), Some(from)) = (buffer.get_mut(..count), rest.get(..count)) {
            to.copy_from_slice(from);
        }
        self.read += count;
        self.given += count;
        Ok(count)
    }
}

fn is_blank(line: &[u8]) -> bool {
    line.iter().all(u8::is_ascii_whitespace)
}

/// `#`, `%` and `//` begin comments in files of measurements.
fn is_comment(line: &[u8]) -> bool {
    let text = line.trim_ascii_start();
    text.starts_with(b"#") || text.starts_with(b"%") || text.starts_with(b"//")
}

fn begins_with_a_number(line: &[u8], delimiter: u8) -> bool {
    let cell = line.trim_ascii().split(|byte| *byte == delimiter).next().unwrap_or_default();
    std::str::from_utf8(cell).is_ok_and(|cell| cell.trim().parse::<f64>().is_ok())
}

/// How many signs of a comment, and spaces, a line begins with: where spaces separate cells, none may stay before the first.
fn comment_signs(line: &[u8]) -> usize {
    line.iter().take_while(|byte| matches!(byte, b'#' | b'%' | b'/' | b' ' | b'\t')).count()
}

/// Comment lines without their text: their ends stay.
fn without_comments(text: Vec<u8>) -> Vec<u8> {
    let mut kept = Vec::with_capacity(text.len());
    for line in text.split_inclusive(|byte| *byte == b'\n') {
        match (is_comment(line), line.last()) {
            (true, Some(b'\n')) => kept.push(b'\n'),
            (true, _) => {}
            (false, _) => kept.extend(line),
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> (String, bool) {
        let mut source = Source::new(Box::new(io::Cursor::new(bytes.to_vec())), b',').unwrap();
        let mut text = String::new();
        source.read_to_string(&mut text).unwrap();
        (text, source.is_torn())
    }

    #[test]
    fn comments_become_empty_lines_and_a_header_among_them_is_found() {
        assert_eq!(read(b"# made by x\nt,a\n1,2\n% pause\n2,3\n"), ("\nt,a\n1,2\n\n2,3\n".into(), false));
        assert_eq!(read(b"# made by x\n# t,a\n1,2\n"), ("\nt,a\n1,2\n".into(), false));
        assert_eq!(read(b"t,a\n1,2\n2"), ("t,a\n1,2\n2".into(), true));
        assert_eq!(read(b"t,#a\n1,2\n# end"), ("t,#a\n1,2\n".into(), true));
        assert_eq!(read(b""), (String::new(), false));
    }

    #[test]
    fn utf_16_with_and_without_a_mark_is_utf_8_here() {
        let text = "t,\u{b5}T\r\n1,2\r\n";
        for (mark, little) in [(true, true), (true, false), (false, true), (false, false)] {
            let bytes = |unit: u16| if little { unit.to_le_bytes() } else { unit.to_be_bytes() };
            let units = mark.then_some(0xfeff).into_iter().chain(text.encode_utf16());
            let bytes: Vec<u8> = units.flat_map(bytes).collect();
            assert_eq!(read(&bytes), (text.to_owned(), false), "{mark} {little}");
        }
    }

    #[test]
    fn lines_without_end_are_not_read_for_ever() {
        let refused = |input: Box<dyn Read + Send>| {
            let read = Source::new(input, b',').and_then(|mut source| {
                let mut buffer = vec![0; 1 << 16];
                while source.read(&mut buffer)? > 0 {
                    source.begin_record();
                }
                Ok(())
            });
            read.unwrap_err().to_string()
        };
        assert!(refused(Box::new(io::repeat(b'\n'))).contains("more than 20 million lines"));
        assert!(refused(Box::new(io::repeat(b'1'))).contains("longer than 1 MB"));
    }
}
