//! Building blocks of every page: head, style, tables, figures.

use maud::{DOCTYPE, Markup, PreEscaped, html};
use whorl_math::three_digits;

use crate::figure::{Figure, script};
use crate::metrics::Interval;

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

/// A page under construction.
#[derive(Debug, Clone)]
pub(crate) struct Document {
    title: String,
    body: Vec<Markup>,
    figures: usize,
}

impl Document {
    /// An empty page with this heading.
    pub fn new(title: &str) -> Self {
        Self { title: title.to_owned(), body: Vec::new(), figures: 0 }
    }

    /// The whole page: head, style, the script that draws figures, the heading and what was added.
    pub fn finish(self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    title { (self.title) }
                    meta name="viewport" content="width=device-width";
                    style { (PreEscaped(STYLE)) }
                    (PreEscaped(script()))
                }
                body {
                    h1 { (self.title) }
                    @for part in &self.body {
                        (part) "\n"
                    }
                }
            }
        };
        page.into_string()
    }

    /// Anything else.
    pub fn add(&mut self, part: Markup) {
        self.body.push(part);
    }

    /// A subheading.
    pub fn heading(&mut self, text: &str) {
        self.add(html! { h2 { (text) } });
    }

    /// A paragraph of a class (`answer`, `rule`, `warning`; empty for none).
    pub fn paragraph(&mut self, class: &str, text: &str) {
        self.add(html! { p class=[(!class.is_empty()).then_some(class)] { (text) } });
    }

    /// A list of sentences.
    pub fn list(&mut self, items: &[String]) {
        if !items.is_empty() {
            self.add(html! { ul { @for item in items { li { (item) } } } });
        }
    }

    /// A table of cells ([`text`], [`number`]) with plain-text headings; headings of numeric columns begin with `#`.
    pub fn table(&mut self, headings: &[&str], rows: &[Vec<Markup>]) {
        self.add(html! { div class="wide" { (table(headings, rows)) } });
    }

    /// A figure, unless it is empty.
    pub fn figure(&mut self, figure: &Figure, x_range: Option<(f64, f64)>) {
        self.figure_with_bands(figure, &[], x_range);
    }

    /// The same with shaded stretches of time.
    pub fn figure_with_bands(&mut self, figure: &Figure, shaded: &[Interval], x_range: Option<(f64, f64)>) {
        if figure.is_empty() {
            return;
        }
        self.figures += 1;
        let drawn = figure.html(&format!("figure_{}", self.figures), shaded, x_range);
        self.add(html! {
            div class="figure" {
                h3 { (figure.title) }
                p class="caption" { (figure.caption) }
                div class="plot" { (PreEscaped(drawn)) }
            }
        });
    }
}

/// A table, as in [`Document::table`], that does not scroll.
pub(crate) fn table(headings: &[&str], rows: &[Vec<Markup>]) -> Markup {
    html! {
        table {
            (heading_row(headings))
            @for row in rows {
                tr { @for cell in row { (cell) } }
            }
        }
    }
}

/// The row of headings; those of numeric columns begin with `#`.
pub(crate) fn heading_row(headings: &[&str]) -> Markup {
    html! {
        tr {
            @for heading in headings {
                @if let Some(number) = heading.strip_prefix('#') {
                    th class="n" { (number) }
                } @else {
                    th { (heading) }
                }
            }
        }
    }
}

/// A table cell of plain text.
pub(crate) fn text(value: &str) -> Markup {
    html! { td { (value) } }
}

/// A table cell of text below a heading: to the right where the heading begins with `#`.
pub(crate) fn text_below(heading: &str, value: &str) -> Markup {
    if heading.starts_with('#') { right(value) } else { text(value) }
}

/// A table cell of an identifier.
pub(crate) fn code(value: &str) -> Markup {
    html! { td class="code" { (value) } }
}

/// The same, emphasised.
pub(crate) fn bold_code(value: &str) -> Markup {
    html! { td class="code" { b { (value) } } }
}

/// A table cell of a number, marked `good` or `bad`.
pub(crate) fn judged(value: f64, digits: usize, good: bool) -> Markup {
    html! { td class=(if good { "n good" } else { "n bad" }) { (written(value, digits)) } }
}

/// A table cell of a number with three significant digits.
pub(crate) fn significant(value: f64) -> Markup {
    right(&three_digits(value))
}

/// A table cell of a number; a dash for one that is not finite.
pub(crate) fn number(value: f64, digits: usize) -> Markup {
    right(&written(value, digits))
}

/// A table cell of a number that is written already.
pub(crate) fn right(value: &str) -> Markup {
    html! { td class="n" { (value) } }
}

fn written(value: f64, digits: usize) -> String {
    if value.is_finite() { format!("{value:.digits$}") } else { "–".to_owned() }
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
        assert!(html.ends_with("</body></html>"));
    }
}
