//! What the page is made of; nothing is fetched from elsewhere.

use whorl_report::assets::{PLOTS, STYLE, UPLOT, UPLOT_STYLE};

use crate::api::Choice;

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

/// Files with which the workbench can be tried: see their README.
pub const EXAMPLE: [(&str, &[u8]); 5] = [
    (EXAMPLE_MODEL, include_bytes!("../assets/example/dfki_pendulum.yaml")),
    (EXAMPLE_MAP, include_bytes!("../assets/example/dfki_pendulum.channels.yaml")),
    (EXAMPLE_TRAINING, include_bytes!("../assets/example/swing_up_ddp.csv.gz")),
    (EXAMPLE_HELD_OUT, include_bytes!("../assets/example/swing_up_collocation.csv.gz")),
    ("dfki_pendulum_LICENSE.txt", include_bytes!("../assets/example/LICENSE")),
];
const EXAMPLE_MODEL: &str = "dfki_pendulum.yaml";
const EXAMPLE_MAP: &str = "dfki_pendulum.channels.yaml";
const EXAMPLE_TRAINING: &str = "swing_up_ddp.csv.gz";
const EXAMPLE_HELD_OUT: &str = "swing_up_collocation.csv.gz";

/// What of them is for what.
pub fn example_choice() -> Choice {
    Choice {
        runs: vec![EXAMPLE_TRAINING.to_owned()],
        held_out: vec![EXAMPLE_HELD_OUT.to_owned()],
        model: Some(EXAMPLE_MODEL.to_owned()),
        channels: Some(EXAMPLE_MAP.to_owned()),
        ..Choice::default()
    }
}

/// One of them, by its name.
pub fn find(name: &str) -> Option<(&'static str, &'static str)> {
    ALL.iter().find(|(known, ..)| *known == name).map(|(_, kind, content)| (*kind, *content))
}
