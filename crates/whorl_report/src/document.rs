//! Building blocks of every page: head, style, tables, figures.

use std::fmt::Write as _;

use whorl_math::three_digits;

use crate::figure::{Figure, script};

const STYLE: &str = "
body { font: 15px/1.45 system-ui, sans-serif; color: #1a1a1a; max-width: 1080px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: 0.2rem; } h2 { margin-top: 2.2rem; border-bottom: 1px solid #ccc; }
h3 { margin: 1.4rem 0 0; font-size: 1rem; } p.caption { margin: 0; color: #555; font-size: 0.87rem; }
table { border-collapse: collapse; margin: 0.8rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: 0.2rem 0.7rem; border-bottom: 1px solid #e2e2e2; text-align: left; vertical-align: top; }
th { font-weight: 600; } td.n, th.n { text-align: right; } td.code { font-family: ui-monospace, monospace; font-size: 0.85rem; }
tr.fault td { background: #fdf1ea; } .warning { background: #fff4d6; border-left: 4px solid #e69f00; padding: 0.5rem 1rem; }
.wide { overflow-x: auto; } .wide td, .wide th { padding: 0.2rem 0.45rem; font-size: 0.85rem; } td.good { color: #006d4b; } td.bad { color: #a33b00; font-weight: 600; }
p.answer { font-size: 1.15rem; margin: 0.5rem 0; } p.rule { color: #555; font-size: 0.9rem; }
.figure { break-inside: avoid; } .plot { height: 300px; } details summary { cursor: pointer; }
@media print { body { max-width: none; margin: 0; font-size: 11px; } h2 { break-before: auto; } }
";

/// Ends a page.
pub(crate) const END: &str = "</body></html>\n";

/// A page under construction.
#[derive(Debug, Clone)]
pub(crate) struct Document {
    html: String,
    figures: usize,
}

impl Document {
    /// Head, style, the script that draws figures, and the heading.
    pub fn new(title: &str) -> Self {
        let title = escaped(title);
        let html = format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\
             <meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style>\n{}</head><body>\n<h1>{title}</h1>\n",
            script()
        );
        Self { html, figures: 0 }
    }

    /// The HTML so far.
    pub fn into_body(self) -> String {
        self.html
    }

    /// The whole page.
    pub fn finish(self) -> String {
        self.html + END
    }

    /// A subheading.
    pub fn heading(&mut self, text: &str) {
        // Writing to a String cannot fail.
        let _ = writeln!(self.html, "<h2>{}</h2>", escaped(text));
    }

    /// A paragraph of a class (`answer`, `rule`, `warning`; empty for none).
    pub fn paragraph(&mut self, class: &str, text: &str) {
        let _ = writeln!(self.html, "<p class=\"{class}\">{}</p>", escaped(text));
    }

    /// A list of sentences.
    pub fn list(&mut self, items: &[String]) {
        if items.is_empty() {
            return;
        }
        self.html.push_str("<ul>");
        for item in items {
            let _ = writeln!(self.html, "<li>{}</li>", escaped(item));
        }
        self.html.push_str("</ul>\n");
    }

    /// A table of HTML cells ([`text`], [`number`]) with plain-text headings; headings of numeric columns
    /// begin with `#`.
    pub fn table(&mut self, headings: &[&str], rows: &[Vec<String>]) {
        self.html.push_str("<div class=wide><table><tr>");
        for heading in headings {
            let _ = match heading.strip_prefix('#') {
                Some(number) => write!(self.html, "<th class=n>{}</th>", escaped(number)),
                None => write!(self.html, "<th>{}</th>", escaped(heading)),
            };
        }
        self.html.push_str("</tr>\n");
        for row in rows {
            let _ = writeln!(self.html, "<tr>{}</tr>", row.concat());
        }
        self.html.push_str("</table></div>\n");
    }

    /// A figure, unless it is empty.
    pub fn figure(&mut self, figure: &Figure, x_range: Option<(f64, f64)>) {
        if figure.is_empty() {
            return;
        }
        self.figures += 1;
        let _ = writeln!(
            self.html,
            "<div class=figure><h3>{}</h3><p class=caption>{}</p><div class=plot>{}</div></div>",
            escaped(&figure.title),
            escaped(&figure.caption),
            figure.html(&format!("figure_{}", self.figures), &[], x_range)
        );
    }
}

/// A table cell of plain text.
pub(crate) fn text(value: &str) -> String {
    format!("<td>{}</td>", escaped(value))
}

/// A table cell of an identifier.
pub(crate) fn code(value: &str) -> String {
    format!("<td class=code>{}</td>", escaped(value))
}

/// A table cell of a number, marked `good` or `bad`.
pub(crate) fn judged(value: f64, digits: usize, good: bool) -> String {
    let class = if good { "n good" } else { "n bad" };
    number(value, digits).replace("class=n", &format!("class=\"{class}\""))
}

/// A table cell of a number with three significant digits.
pub(crate) fn significant(value: f64) -> String {
    format!("<td class=n>{}</td>", escaped(&three_digits(value)))
}

/// A table cell of a number; a dash for one that is not finite.
pub(crate) fn number(value: f64, digits: usize) -> String {
    if value.is_finite() {
        format!("<td class=n>{value:.digits$}</td>")
    } else {
        "<td class=n>–</td>".to_owned()
    }
}

/// Text for HTML.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_break_the_page() {
        let mut page = Document::new("<b>");
        page.paragraph("answer", "a < b & \"c\"");
        let html = page.finish();
        assert!(html.contains("a &lt; b &amp; &quot;c&quot;") && html.contains("<h1>&lt;b&gt;</h1>"));
        assert!(html.ends_with(END));
    }
}
