//! Links between the pages of a run, and to the list of runs.
//!
//! A page is written when its command is asked, so that earlier pages do not know of later ones: every page has a marked place for
//! links, which is filled anew in all of them whenever one is written.

use std::fmt::Write as _;
use std::io;
use std::path::Path;

/// Pages that commands write into a run's directory, and what their links are called.
const PAGES: [(&str, &str); 8] = [
    ("report.html", "Run"),
    ("compare.html", "How far off"),
    ("where.html", "Where it fails"),
    ("diagnose.html", "What is missing"),
    ("discover.html", "Laws"),
    ("next.html", "Next run"),
    ("adopt.html", "Adopted"),
    ("history.html", "From run to run"),
];
/// Pages of many runs that may stand in the folder above.
const LISTS: [(&str, &str); 2] = [("runs.html", "All runs"), ("index.html", "All runs")];
/// Around the links.
pub(crate) const MARKS: [&str; 2] = ["<!--pages-->", "<!--/pages-->"];
/// Larger files are left as they are.
const LARGEST_BYTES: u64 = 256 << 20;

/// Fills the links of a page, and of those beside it of the same run: in a run's directory all, else those that are named by the
/// same file (`swing.compare.html`, `swing.where.html`).
///
/// # Errors
/// When a page cannot be read or written.
pub fn link_pages(page: &Path) -> io::Result<()> {
    let folder = page.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let own = page.file_name().unwrap_or_default().to_string_lossy();
    let of_file = own.strip_suffix(".html").and_then(|stem| stem.rsplit_once('.')).map_or("", |(of, _)| of);
    let name = |file: &str| if of_file.is_empty() { file.to_owned() } else { format!("{of_file}.{file}") };
    // Of a page that was written again beside a file it is the newest.
    let newest = |file: &str| if same_page(&own, &name(file)) { own.to_string() } else { name(file) };
    let there: Vec<(String, &str)> = PAGES.into_iter().map(|(file, called)| (newest(file), called)).collect();
    let there: Vec<(&str, &str)> = there
        .iter()
        .map(|(file, called)| (file.as_str(), *called))
        .filter(|(file, _)| folder.join(file).is_file())
        .collect();
    let list = LISTS.into_iter().find(|(file, _)| folder.join("..").join(file).is_file());
    for (file, _) in &there {
        let path = folder.join(file);
        if std::fs::metadata(&path)?.len() > LARGEST_BYTES {
            continue;
        }
        let page = std::fs::read_to_string(&path)?;
        let Some(linked) = with_links(&page, file, &there, list) else { continue };
        if linked != page {
            whorl_files::write_file(&path, linked)?;
        }
    }
    Ok(())
}

/// Whether a page is this one with a number: `swing.compare_2.html` of `swing.compare.html`.
fn same_page(page: &str, first: &str) -> bool {
    let rest = first.strip_suffix(".html").and_then(|stem| page.strip_prefix(stem)?.strip_suffix(".html"));
    rest.and_then(|rest| rest.strip_prefix('_')).is_some_and(|number| number.parse::<u32>().is_ok())
}

/// A page with its links; `None` of one that has no place for them.
fn with_links(page: &str, own: &str, there: &[(&str, &str)], list: Option<(&str, &str)>) -> Option<String> {
    let [open, close] = MARKS;
    let (before, rest) = page.split_once(open)?;
    let (_, after) = rest.split_once(close)?;
    let mut links = String::new();
    if there.len() > 1 || list.is_some() {
        links.push_str("<nav class=\"pages\" aria-label=\"Pages of this run\">");
        for (file, name) in there {
            let _ = if *file == own {
                write!(links, "<span aria-current=\"page\">{name}</span> ")
            } else {
                write!(links, "<a href=\"{file}\">{name}</a> ")
            };
        }
        if let Some((file, name)) = list {
            let _ = write!(links, "<a href=\"../{file}\">{name}</a>");
        }
        links.push_str("</nav>");
    }
    Some([before, open, &links, close, after].concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_of_a_run_link_each_other_and_the_list() {
        let runs = tempfile::tempdir().unwrap();
        let run = runs.path().join("run");
        std::fs::create_dir(&run).unwrap();
        let page = |name: &str| std::fs::read_to_string(run.join(name)).unwrap();
        let blank = format!("<h1>x</h1>{}{}<p>rest</p>", MARKS[0], MARKS[1]);
        std::fs::write(run.join("report.html"), &blank).unwrap();
        link_pages(&run.join("report.html")).unwrap();
        assert_eq!(page("report.html"), blank);
        std::fs::write(run.join("compare.html"), &blank).unwrap();
        std::fs::write(run.join("notes.html"), &blank).unwrap();
        std::fs::write(runs.path().join("runs.html"), "").unwrap();
        for _ in 0..2 {
            link_pages(&run.join("compare.html")).unwrap();
        }
        assert!(page("report.html").contains("<a href=\"compare.html\">How far off</a>"));
        assert!(page("compare.html").contains("<a href=\"report.html\">Run</a>"));
        assert!(
            page("compare.html")
                .contains("<a href=\"../runs.html\">All runs</a></nav><!--/pages--><p>rest</p>")
        );
        assert_eq!(page("compare.html").matches("<nav").count(), 1);
        assert_eq!(page("notes.html"), blank);
    }

    #[test]
    fn pages_of_files_in_one_folder_link_those_of_their_own_file() {
        let folder = tempfile::tempdir().unwrap();
        let blank = format!("<h1>x</h1>{}{}", MARKS[0], MARKS[1]);
        for name in ["a.compare.html", "a.where.html", "b.compare.html", "a.compare_2.html"] {
            std::fs::write(folder.path().join(name), &blank).unwrap();
            link_pages(&folder.path().join(name)).unwrap();
        }
        let page = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        assert!(page("a.where.html").contains("<a href=\"a.compare_2.html\">How far off</a>"));
        assert!(page("a.compare_2.html").contains("<a href=\"a.where.html\">"));
        assert_eq!(page("b.compare.html"), blank, "nothing else is of this file");
        assert!(!page("a.where.html").contains("b.compare"));
    }
}
