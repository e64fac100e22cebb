//! The live page: the replay's view, fed by a server.

use maud::{DOCTYPE, PreEscaped, html};

use crate::assets;
use crate::replay::PlatformShape;

/// The page that `whorl live` serves; it reads frames from the WebSocket `/frames` beside it.
#[must_use]
pub fn live_html(shapes: &[PlatformShape]) -> String {
    // Names cannot end the script.
    let shapes = serde_json::to_string(shapes).unwrap_or_default().replace('<', "\\u003c");
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                title { "Whorl live" }
                meta name="viewport" content="width=device-width, initial-scale=1";
                link rel="icon" href="data:,";
                style { (PreEscaped(assets::UPLOT_STYLE)) }
                style { (PreEscaped(assets::STYLE)) }
            }
            body {
                h1 { "Whorl live" }
                div class="bar" role="group" aria-label="Experiment" {
                    b id="connection" role="status" { "connecting" }
                    output id="clock" {}
                    span id="state" class="state" {}
                    button id="start" type="button" title="Starts the experiment, or goes on with one that is held" hidden { "Start" }
                    button id="hold" type="button" title="References come to rest, and the experiment waits for Start" hidden { "Hold" }
                    button id="abort" type="button" hidden { "Abort" }
                    span id="answer" class="state" role="status" {}
                }
                div class="first" {
                    div class="scene" {
                        canvas id="scene" tabindex="0" role="img"
                            aria-label="The platforms in three dimensions, live. Drag or arrow keys turn the view, + and - zoom." {}
                        p id="key" class="key" {}
                        div class="wide" { table id="numbers" {} }
                        ul id="faults" aria-label="Faults" {}
                    }
                    div {
                        @for (id, title, caption) in [
                            ("error", "Relative error", "Angle between attitude and the one that the law demands."),
                            ("innovation", "Whitened innovations",
                                "Mean square over the last 5 s; 1 is what the estimator's model expects, more is unexplained."),
                            ("evidence", "Evidence against the model",
                                "What the model monitors have against their platforms' models, over what is a mismatch: 1 is one."),
                            ("latency", "Delays", "Link: age of the estimate at the coordinator. Command: age of the estimate that control acts on."),
                        ] {
                            div class="figure" {
                                h3 { (title) }
                                p class="caption" { (caption) }
                                div class="plot" id=(format!("plot_{id}")) role="img" aria-label=(format!("{title}. {caption}")) {}
                            }
                        }
                    }
                }
                script id="shapes" type="application/json" { (PreEscaped(shapes)) }
                script { (PreEscaped(format!("/*!\nuPlot: {}*/\n", assets::UPLOT_LICENCE))) (PreEscaped(assets::UPLOT)) }
                @for script in [assets::PLOTS, assets::SCENE, assets::LIVE] {
                    script { (PreEscaped(script)) }
                }
            }
        }
    };
    page.into_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_cannot_end_the_script() {
        let page = live_html(&[PlatformShape::unknown("</script><b>")]);
        assert!(!page.contains("</script><b>") && page.contains("\\u003c/script>"));
    }
}
