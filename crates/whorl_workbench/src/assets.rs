//! What the page is made of; nothing is fetched from elsewhere.

use whorl_report::assets::{PLOTS, STYLE, UPLOT, UPLOT_STYLE};

/// The page.
pub const PAGE: &str = include_str!("../assets/index.html");

const SCRIPT: &str = "text/javascript; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";

/// Name, type and content of each.
const ALL: &[(&str, &str, &str)] = &[
    ("uplot.js", SCRIPT, UPLOT),
    ("uplot.css", CSS, UPLOT_STYLE),
    ("plots.js", SCRIPT, PLOTS),
    ("page.css", CSS, STYLE),
    ("workbench.css", CSS, include_str!("../assets/workbench.css")),
    ("main.js", SCRIPT, include_str!("../assets/main.js")),
    ("interface.js", SCRIPT, include_str!("../assets/interface.js")),
    ("parts.js", SCRIPT, include_str!("../assets/parts.js")),
    ("data.js", SCRIPT, include_str!("../assets/data.js")),
    ("look.js", SCRIPT, include_str!("../assets/look.js")),
    ("path.js", SCRIPT, include_str!("../assets/path.js")),
    ("platform.js", SCRIPT, include_str!("../assets/platform.js")),
    ("scene3d.js", SCRIPT, include_str!("../assets/scene3d.js")),
    ("signals.js", SCRIPT, include_str!("../assets/signals.js")),
    ("tour.js", SCRIPT, include_str!("../assets/tour.js")),
    ("mathml.js", SCRIPT, include_str!("../assets/mathml.js")),
    ("three.js", SCRIPT, include_str!("../assets/three/three.module.min.js")),
];

/// Files with which the workbench can be tried: see their README. The recording comes last, when the others can be read.
pub const EXAMPLE: [(&str, &[u8]); 3] = [
    ("pendulum.yaml", include_bytes!("../assets/example/pendulum.yaml")),
    ("pendulum.channels.yaml", include_bytes!("../assets/example/pendulum.channels.yaml")),
    ("swing.csv.gz", include_bytes!("../assets/example/swing.csv.gz")),
];

/// One of them, by its name.
pub fn find(name: &str) -> Option<(&'static str, &'static str)> {
    ALL.iter().find(|(known, ..)| *known == name).map(|(_, kind, content)| (*kind, *content))
}
