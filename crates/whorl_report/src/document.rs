//! Building blocks of every page: head, style, tables, figures.

use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::DeflateEncoder;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde_json::{Map, Value};
use whorl_math::three_digits;

use crate::assets;
use crate::figure::Figure;
use crate::siblings;
use crate::timeline::Timeline;
use crate::times::Interval;

/// A page under construction.
#[derive(Debug, Clone)]
pub(crate) struct Document {
    title: String,
    body: Vec<Markup>,
    /// Identifier and text of the headings, for the table of contents.
    headings: Vec<(String, String)>,
    /// The figures as the page's script reads them.
    figures: Vec<Value>,
    timeline: Option<Timeline>,
    replay: Option<Value>,
    /// Scripts of the page's own.
    scripts: Vec<&'static str>,
}

impl Document {
    /// An empty page with this heading.
    pub fn new(title: &str) -> Self {
        Self {
            title: title.to_owned(),
            body: Vec::new(),
            headings: Vec::new(),
            figures: Vec::new(),
            timeline: None,
            replay: None,
            scripts: Vec::new(),
        }
    }

    /// A script at the end of the page.
    pub fn script(&mut self, script: &'static str) {
        self.scripts.push(script);
    }

    /// Figures over time that come after this share its time, its marks, one cursor and one zoom.
    pub fn set_timeline(&mut self, timeline: Timeline) {
        self.timeline = Some(timeline);
    }

    /// The bar with the time slider, and the three-dimensional view beside `beside`. Needs a timeline.
    pub fn replay(&mut self, frames: Value, beside: &Figure) {
        self.replay = Some(frames);
        self.add(html! {
            div class="bar" role="group" aria-label="Replay" {
                button id="play" type="button" { "Play" }
                select id="speed" aria-label="Speed" {
                    @for speed in ["0.25", "1", "2", "5", "20", "100"] {
                        option value=(speed) selected[speed == "1"] { (speed) "\u{d7}" }
                    }
                }
                input id="time" type="range" min="0" value="0" aria-label="Time";
                output id="clock" {}
                span id="state" class="state" {}
            }
        });
        let figure =
            (!beside.is_empty()).then(|| self.drawn(beside, self.timeline.as_ref().map(|t| t.span_s)));
        self.add(html! {
            div class="first" {
                div class="scene" {
                    canvas id="scene" tabindex="0" role="img"
                        aria-label="The platforms in three dimensions at the time of the slider. Drag or arrow keys turn the view, + and - zoom." {}
                    p id="key" class="key" {}
                    div class="wide" { table id="numbers" {} }
                }
                @if let Some(figure) = figure { (figure) }
            }
        });
    }

    /// The whole page: head, style, the heading, what was added, and the scripts and numbers that draw the figures.
    pub fn finish(self) -> String {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    title { (self.title) }
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    @if !self.figures.is_empty() {
                        style { (PreEscaped(assets::UPLOT_STYLE)) }
                    }
                    style { (PreEscaped(assets::STYLE)) }
                }
                body {
                    h1 { (self.title) }
                    (PreEscaped(siblings::MARKS[0])) (PreEscaped(siblings::MARKS[1]))
                    @if self.headings.len() > 2 {
                        nav class="contents" aria-label="Contents" {
                            @for (id, text) in &self.headings { a href=(format!("#{id}")) { (text) } " " }
                        }
                    }
                    @for part in &self.body {
                        (part) "\n"
                    }
                    @if !self.figures.is_empty() {
                        noscript { p class="warning" { "The figures are drawn by a script; this browser runs none." } }
                        (self.drawing())
                    }
                    @for script in &self.scripts { script { (PreEscaped(script)) } }
                }
            }
        };
        page.into_string()
    }

    /// The numbers of the figures, compressed, and what draws them.
    fn drawing(&self) -> Markup {
        let mut data = Map::new();
        data.insert("figures".to_owned(), Value::Array(self.figures.clone()));
        data.extend(
            self.timeline.iter().flat_map(Timeline::stored).map(|(key, value)| (key.to_owned(), value)),
        );
        data.extend(self.replay.iter().map(|frames| ("scene".to_owned(), frames.clone())));
        html! {
            script id="data" type="text/plain" { (PreEscaped(packed(&Value::Object(data)))) }
            script { (PreEscaped(format!("/*!\nuPlot: {}*/\n", assets::UPLOT_LICENCE))) (PreEscaped(assets::UPLOT)) }
            @for script in [assets::PLOTS, assets::SCENE, assets::REPLAY, assets::PAGE] {
                script { (PreEscaped(script)) }
            }
        }
    }

    /// Anything else.
    pub fn add(&mut self, part: Markup) {
        self.body.push(part);
    }

    /// A subheading.
    pub fn heading(&mut self, text: &str) {
        let id = format!("section_{}", self.headings.len() + 1);
        self.add(html! { h2 id=(id) { (text) } });
        self.headings.push((id, text.to_owned()));
    }

    /// A paragraph of a class (`answer`, `rule`, `warning`; empty for none).
    pub fn paragraph(&mut self, class: &str, text: &str) {
        self.add(html! { p class=[(!class.is_empty()).then_some(class)] { (signs(text)) } });
    }

    /// A list of sentences.
    pub fn list(&mut self, items: &[String]) {
        if !items.is_empty() {
            self.add(html! { ul { @for item in items { li { (signs(item)) } } } });
        }
    }

    /// A table of cells ([`text`], [`number`]) with plain-text headings; headings of numeric columns begin with `#`.
    pub fn table(&mut self, headings: &[&str], rows: &[Vec<Markup>]) {
        self.add(html! { div class="wide" { (table(headings, rows)) } });
    }

    /// A figure, unless it is empty; without a range its horizontal axis is fitted to the curves.
    pub fn figure(&mut self, figure: &Figure, x_range: Option<Interval>) {
        if !figure.is_empty() {
            let drawn = self.drawn(figure, x_range);
            self.add(drawn);
        }
    }

    fn drawn(&mut self, figure: &Figure, x_range: Option<Interval>) -> Markup {
        let id = format!("figure_{}", self.figures.len() + 1);
        self.figures.push(figure.stored(&id, x_range, self.timeline.is_some()));
        html! {
            div class="figure" {
                h3 { (figure.title) }
                p class="caption" { (figure.caption) }
                div class="plot" id=(id) role="img" tabindex="0" aria-label=(figure.spoken()) {}
            }
        }
    }
}

/// As text that a page can hold: compressed (raw DEFLATE), then in base 64.
fn packed(value: &Value) -> String {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
    // Writing to memory does not fail.
    let _ = encoder.write_all(value.to_string().as_bytes());
    STANDARD.encode(encoder.finish().unwrap_or_default())
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
                    th class="n" { (signs(number)) }
                } @else {
                    th { (signs(heading)) }
                }
            }
        }
    }
}

/// A table cell of plain text.
pub(crate) fn text(value: &str) -> Markup {
    html! { td { (signs(value)) } }
}

/// Signs as pages have them, where words are also for terminals and files that may not.
fn signs(text: &str) -> String {
    text.replace("+-", "\u{b1}")
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
        assert!(!html.contains("<script"), "no figures, no scripts");
    }

    #[test]
    fn pages_have_signs_that_terminals_may_not_have() {
        let mut page = Document::new("t");
        page.paragraph("", "1 +- 2");
        page.list(&["3 +- 4".to_owned()]);
        page.table(&["#+-"], &[vec![text("5 +- 6")]]);
        let html = page.finish();
        let found = ["1 \u{b1} 2", "3 \u{b1} 4", "<th class=\"n\">\u{b1}</th>", "5 \u{b1} 6"];
        assert!(found.iter().all(|words| html.contains(words)) && !html.contains("+-"), "{html}");
    }

    #[test]
    fn the_numbers_of_the_figures_are_in_the_page() {
        let mut page = Document::new("t");
        let curve = crate::series::Curve::new("a", [(0.0, 1.0), (0.5, 2.5)]);
        page.figure(&Figure { title: "F".to_owned(), curves: vec![curve], ..Figure::default() }, None);
        let html = page.finish();
        let packed = html.split_once("type=\"text/plain\">").unwrap().1.split_once('<').unwrap().0;
        let mut text = String::new();
        let bytes = STANDARD.decode(packed).unwrap();
        std::io::Read::read_to_string(&mut flate2::read::DeflateDecoder::new(bytes.as_slice()), &mut text)
            .unwrap();
        let data: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(data["figures"][0]["curves"][0]["y"], serde_json::json!([1.0, 2.5]));
        assert!(html.contains("F, ; a: 1.00 to 2.50"), "an alternative text");
    }

    #[test]
    fn scripts_cannot_end_themselves() {
        let all = [
            assets::UPLOT,
            assets::PLOTS,
            assets::SCENE,
            assets::REPLAY,
            assets::PAGE,
            assets::UPLOT_LICENCE,
        ];
        assert!(all.iter().all(|script| !script.contains("</script")));
    }
}
