//! The whole path from a recording to an adopted effect on one page, for somebody else: no scripts, figures as SVG, and the commands that
//! do the same.

use maud::{PreEscaped, html};

use super::{Drawn, Facts, facts};
use crate::document::Document;

/// One question with its answer.
#[derive(Debug, Clone, Default)]
pub struct PathPart {
    /// Its heading.
    pub heading: String,
    /// The answer, most important sentence first.
    pub sentences: Vec<String>,
    /// Its figures.
    pub figures: Vec<Drawn>,
    /// Files that were changed: name, text before, text after.
    pub changes: Vec<(String, String, String)>,
    /// The command that asks the same.
    pub command: String,
}

/// The page as one self-contained HTML document.
#[must_use]
pub fn path_html(title: &str, parts: &[PathPart], about: &Facts) -> String {
    let mut page = Document::new(title);
    for part in parts {
        page.heading(&part.heading);
        for (k, sentence) in part.sentences.iter().enumerate() {
            page.paragraph(if k == 0 { "answer" } else { "" }, sentence);
        }
        for drawn in &part.figures {
            page.add(html! {
                div class="figure" {
                    h3 { (drawn.title()) }
                    p class="caption" { (drawn.caption()) }
                    (PreEscaped(drawn.svg()))
                }
            });
        }
        for (file, before, after) in &part.changes {
            page.paragraph("", &format!("{file}: lines that are new"));
            let new: Vec<&str> =
                after.lines().filter(|line| !before.lines().any(|old| old == *line)).collect();
            page.add(html! { pre { (new.join("\n")) } });
        }
    }
    page.heading("The same by commands");
    let commands: Vec<&str> =
        parts.iter().map(|part| part.command.as_str()).filter(|c| !c.is_empty()).collect();
    page.add(html! { pre { (commands.join("\n")) } });
    facts(&mut page, about);
    page.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_says_what_was_answered_changed_and_commanded() {
        let part = PathPart {
            heading: "What is missing?".to_owned(),
            sentences: vec!["The model lacks: <friction>.".to_owned()],
            changes: vec![("rig.yaml".to_owned(), "a: 1\nb: 2\n".to_owned(), "a: 1\nb: 3\n".to_owned())],
            command: "whorl diagnose 'a run'".to_owned(),
            ..PathPart::default()
        };
        let html = path_html("A rig", &[part], &[]);
        assert!(
            html.contains("The model lacks: &lt;friction&gt;.") && html.contains("<pre>b: 3</pre>"),
            "{html}"
        );
        assert!(html.contains("whorl diagnose 'a run'") && !html.contains("<script"), "{html}");
    }
}
