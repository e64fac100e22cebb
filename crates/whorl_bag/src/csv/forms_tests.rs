//! CSV as people write it.

use std::path::PathBuf;

use super::{CsvError, CsvMap, CsvRow, CsvRows};

const MAP: &str = "csv:
  ros__parameters:
    time: {column: t}
    gyro: {columns: [gx, gy, gz]}
    accelerometer: {columns: [ax, ay, az]}
    vector: {columns: [mx, my, mz], reference_world: [0, 1, 0]}
";

struct Read {
    rows: Vec<CsvRow>,
    notes: Vec<String>,
}

fn read(map: &str, csv: impl AsRef<[u8]>) -> Result<Read, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str, content: &[u8]| -> PathBuf {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    };
    let text = |error: CsvError| error.to_string().replace(&format!("{}/", folder.path().display()), "");
    let map = CsvMap::load(&path("map.yaml", map.as_bytes())).map_err(text)?;
    let mut lines = CsvRows::open(&path("a.csv", csv.as_ref()), &map).map_err(text)?;
    let mut rows = Vec::new();
    while let Some(row) = lines.next_row().map_err(text)? {
        rows.push(row);
    }
    Ok(Read { rows, notes: lines.notes() })
}

fn gyro(row: &CsvRow) -> Option<f64> {
    row.axes(crate::Channel::Gyro).map(|v| v.x)
}

const HEADER: &str = "t,gx,gy,gz,ax,ay,az,mx,my,mz\n";

#[test]
fn lines_of_a_fixed_rate_need_no_time_column() {
    let map = MAP.replace("{column: t}", "{rate_hz: 200}");
    let found = read(&map, "gx,gy,gz,ax,ay,az,mx,my,mz\n1,0,0,0,0,1,,,\n# a note\n2,0,0,0,0,1,,,\n").unwrap();
    assert_eq!(found.rows.iter().map(|row| row.time_ns).collect::<Vec<_>>(), [0, 5_000_000]);
    let both = read(&MAP.replace("column: t", "column: t, rate_hz: 200"), HEADER).err().unwrap();
    assert!(both.contains("map.yaml:3: time.rate_hz") && both.contains("one of the two"), "{both}");
}

#[test]
fn dates_and_times_are_read_and_hinted_at() {
    let csv = format!(
        "{HEADER}2026-11-26T23:59:59.5Z,1,0,0,0,0,1,,,\n2026-11-27 01:00:00.25+01:00,2,0,0,0,0,1,,,\n"
    );
    let found = read(&MAP.replace("column: t", "column: t, unit: iso"), &csv).unwrap();
    assert_eq!(found.rows[1].time_ns - found.rows[0].time_ns, 750_000_000);
    let refused = read(MAP, &csv).err().unwrap();
    assert!(refused.contains("a.csv:2") && refused.contains("unit: iso"), "{refused}");
    let number =
        read(&MAP.replace("column: t", "column: t, unit: iso"), format!("{HEADER}1.5,1,0,0,0,0,1,,,\n"));
    assert!(number.err().unwrap().contains("a date and time as 2026-11-26T23:02:51.123Z"));
}

#[test]
fn decimal_commas_are_read_and_hinted_at() {
    let csv = "t;gx;gy;gz;ax;ay;az;mx;my;mz\n0,01;1,5;-2,25;0;0;0;9,81;;;\n0,02;1e-1;0;0;0;0;9,81;;;\n";
    let map = format!("{MAP}    delimiter: \";\"\n");
    let found = read(&format!("{map}    decimal: \",\"\n"), csv).unwrap();
    assert_eq!((found.rows[0].time_ns, gyro(&found.rows[0])), (10_000_000, Some(1.5)));
    assert_eq!((found.rows[1].time_ns, gyro(&found.rows[1])), (20_000_000, Some(0.1)));
    let refused = read(&map, csv).err().unwrap();
    assert!(refused.contains("`0,01` is not a number; is it a decimal comma?"), "{refused}");
    let refused = read(&format!("{MAP}    decimal: \",\"\n"), csv).err().unwrap();
    assert!(refused.contains("decimal") && refused.contains("delimiter"), "{refused}");
}

#[test]
fn comments_another_encoding_and_headers_in_the_middle_are_survived() {
    let csv = format!(
        "# made by x\n{HEADER}0,1,0,0,0,0,1,,,\n% pause\n{HEADER}1,2,0,0,0,0,1,,,\n2,3,0,0,oops,0,1,,,\n"
    );
    let wrong = read(MAP, &csv).err().unwrap();
    // Lines keep their numbers.
    assert_eq!(wrong, "a.csv:7: column `ax`: `oops` is not a number");
    let good = csv.replace("oops", "0");
    let found = read(MAP, &good).unwrap();
    assert_eq!(found.rows.iter().filter_map(gyro).collect::<Vec<_>>(), [1.0, 2.0, 3.0]);
    assert!(found.notes[0].contains("header stands in the file again 1 times"), "{:?}", found.notes);
    let wide: Vec<u8> = [0xfeff].into_iter().chain(good.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    assert_eq!(read(MAP, wide).unwrap().rows, found.rows);
}

#[test]
fn a_torn_last_line_is_left_out_and_said() {
    let whole = format!("{HEADER}0,1,0,0,0,0,1,,,\n1,2,0,0,0,0,1,,,\n");
    for torn in ["2,3,0,0,0", "2,3,0,0,-,0,1,,,", "2,3,0,0,0,0,1,,,nul"] {
        let found = read(MAP, format!("{whole}{torn}")).unwrap();
        assert_eq!(found.rows.len(), 2, "{torn}");
        assert!(found.notes[0].contains("Line 4, the last, has no end"), "{:?}", found.notes);
    }
    // Whole but without an end: many writers do that. In the middle it is an error.
    assert_eq!(read(MAP, format!("{whole}2,3,0,0,0,0,1,,,")).unwrap().rows.len(), 3);
    assert!(read(MAP, format!("{whole}2,3,0\n3,3,0,0,0,0,1,,,")).is_err());
    assert!(read(MAP, format!("{whole}2,3,0\n")).is_err());
}

#[test]
fn lines_of_one_time_are_joined_or_the_map_says_what_they_are() {
    let apart = format!("{HEADER}0,1,2,3,,,,,,\n0,,,,0,0,9.8,,,\n0,,,,,,,0,5,0\n1,2,2,3,,,,,,\n");
    let found = read(MAP, apart).unwrap();
    assert_eq!((found.rows.len(), found.rows[0].numbers.len()), (2, 2));
    assert_eq!(found.rows[0].vector_lengths, [Some(5.0)]);
    let same =
        format!("{HEADER}0,1,0,0,0,0,9,,,\n0,3,0,0,0,0,10,1,0,0\n0,8,0,0,0,0,11,3,4,0\n1,5,0,0,0,0,9,,,\n");
    let refused = read(MAP, &same).err().unwrap();
    assert!(refused.contains("a.csv:3") && refused.contains("first, mean, or burst"), "{refused}");
    let kind = |kind: &str| {
        read(&MAP.replace("column: t", &format!("column: t, duplicates: {kind}")), &same).unwrap()
    };
    let (first, mean) = (kind("first"), kind("mean"));
    assert_eq!((first.rows.len(), gyro(&first.rows[0]), gyro(&first.rows[1])), (2, Some(1.0), Some(5.0)));
    assert_eq!((mean.rows.len(), gyro(&mean.rows[0])), (2, Some(4.0)));
    assert_eq!(mean.rows[0].vector_lengths, [Some(8_f64.sqrt())]);
    assert!(mean.notes[0].contains("2 lines have the time of the line before: their mean counts"));
    let burst = kind("burst");
    assert_eq!(burst.rows.iter().filter_map(gyro).collect::<Vec<_>>(), [1.0, 3.0, 8.0, 5.0]);
    // The first burst is as long as the next, three parts of it before its time.
    let times: Vec<i64> = burst.rows.iter().map(|row| row.time_ns).collect();
    assert_eq!(times, [-666_666_666, -333_333_333, 0, 1_000_000_000]);
    let later = format!("{HEADER}0,1,0,0,0,0,9,,,\n1,2,0,0,0,0,9,,,\n1,3,0,0,0,0,9,,,\n");
    let later = read(&MAP.replace("column: t", "column: t, duplicates: burst"), later).unwrap();
    assert_eq!(later.rows.iter().map(|row| row.time_ns).collect::<Vec<_>>(), [0, 500_000_000, 1_000_000_000]);
    assert!(later.notes[0].contains("spread over the time since"), "{:?}", later.notes);
}

#[test]
fn clocks_that_end_or_were_set_are_bridged_and_said() {
    let lines = |times: [&str; 3]| {
        let lines = times.iter().enumerate().map(|(i, t)| format!("{t},{i},0,0,0,0,9,,,\n"));
        format!("{HEADER}{}", lines.collect::<String>())
    };
    let micros = MAP.replace("column: t", "column: t, unit: us");
    let found = read(&micros, lines(["2147473647", "2147483647", "-2147473649"])).unwrap();
    assert_eq!(found.rows[2].time_ns - found.rows[1].time_ns, 10_000_000);
    assert!(found.notes[0].contains("32 bits and begins anew in line 4"), "{:?}", found.notes);
    let found = read(MAP, lines(["1451606400.00", "1451606400.01", "1655000000.02"])).unwrap();
    assert_eq!(found.rows[2].time_ns - found.rows[1].time_ns, 10_000_000);
    assert!(found.notes[0].contains("set ahead by 2354 days before line 4"), "{:?}", found.notes);
    // A second back is an error as before.
    let refused = read(MAP, lines(["10.0", "10.01", "9.0"])).err().unwrap();
    assert!(refused.contains("a.csv:4") && refused.contains("does not come after"), "{refused}");
}

#[test]
fn held_values_are_counted_once_without_a_key() {
    let mut csv = HEADER.to_owned();
    for i in 0..1000 {
        // A log of 1 kHz: gyro of 200 Hz, accelerometer of 100 Hz, field of 20 Hz; then a rest of exact constants.
        let step = |lines: i32| f64::from((i / lines).min(800 / lines)).sin();
        csv += &format!("{},{},0,0,{},0,9,{},1,0\n", f64::from(i) * 1e-3, step(5), step(10), step(50));
    }
    let found = read(MAP, &csv).unwrap();
    let count = |channel| found.rows.iter().filter(|row| row.numbers.contains_key(&channel)).count();
    // 161 values, of which the last stands for 200 lines: a reading each 15 lines.
    assert_eq!(count(crate::Channel::Gyro), 161 + 13);
    assert_eq!(count(crate::Channel::Accelerometer), 81 + 6);
    assert_eq!(found.rows.iter().filter(|row| row.vectors_b[0].is_some()).count(), 17);
    assert!(
        found.notes[0].starts_with("Each value of the gyro stands in 5 samples in a row"),
        "{:?}",
        found.notes
    );
    // Exact constants of a resting sensor: its direction is measured again each second and is not forgotten.
    let mut csv = HEADER.to_owned();
    (0..1000).for_each(|i| csv += &format!("{},0,0,0,0,0,9,0,1,0\n", f64::from(i) * 0.01));
    let found = read(MAP, &csv).unwrap();
    assert_eq!(found.rows.iter().filter_map(gyro).count(), 1000);
    assert_eq!(found.rows.iter().filter(|row| row.vectors_b[0].is_some()).count(), 10);
    let kept = read(&MAP.replace("[0, 1, 0]", "[0, 1, 0], repeats: true"), &csv).unwrap();
    assert!(kept.rows.iter().all(|row| row.vectors_b[0].is_some()));
    let once = read(&MAP.replace("[0, 1, 0]", "[0, 1, 0], repeats: false"), &csv).unwrap();
    assert_eq!(once.rows.iter().filter(|row| row.vectors_b[0].is_some()).count(), 1);
}

/// Bounds of what is kept, reached: in plain text, compressed and of 16 bits.
#[test]
fn lines_and_records_without_end_are_refused() {
    use std::io::Write as _;
    let endless = "1,".repeat(6 << 20);
    let refused = |csv: &[u8]| read(MAP, csv).err().unwrap();
    for text in [format!("{HEADER}{endless}"), endless.clone(), format!("# {endless}")] {
        let mut compressed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        compressed.write_all(text.as_bytes()).unwrap();
        let compressed = compressed.finish().unwrap();
        let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(text.bytes().flat_map(|b| [b, 0])).collect();
        for csv in [text.as_bytes(), &compressed, &wide] {
            let why = refused(csv);
            assert!(why.contains("a line is longer than 1 MB") && why.len() < 300, "{why}");
        }
    }
    // A quote that is never closed, behind which every line is in order.
    let open = format!("{HEADER}\"{}", "0,1,0,0,0,0,1,,,\n".repeat(400_000));
    let why = refused(open.as_bytes());
    assert!(why.contains("is a quote not closed?") && why.len() < 300, "{why}");
    // Comments without end, of lines that are in order.
    let comments = "# note\n".repeat(1_000_000);
    assert!(refused(comments.as_bytes()).len() < 300);
}

#[test]
fn messages_show_the_beginning_of_what_is_wrong() {
    let cell = format!("{HEADER}0,{},0,0,0,0,1,,,\n", "x".repeat(900_000));
    let why = read(MAP, cell).err().unwrap();
    assert!(why.contains("(900000 characters)") && why.len() < 300, "{why}");
    let header =
        |count| format!("{}\n0,1\n", (0..count).map(|k| format!("column_{k}")).collect::<Vec<_>>().join(","));
    let why = read(MAP, header(4_000)).err().unwrap();
    assert!(why.contains("column_0") && why.len() < 2500, "{}", why.len());
    let why = read(MAP, header(4_001)).err().unwrap();
    assert!(why.contains("4001 columns; allowed: up to 4000"), "{why}");
}
