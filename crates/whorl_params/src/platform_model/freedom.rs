//! Which motion the rig leaves the body.

use whorl_dynamics::Freedom;

use crate::reader::Reader;

const KINDS: [&str; 4] = ["on_bearing", "hinge", "clamped", "free"];

/// A platform without the group is on a spherical bearing.
pub(super) fn read(r: &mut Reader<'_>) -> Freedom {
    r.group("freedom", |r| {
        let kind = r.choice_or(
            "kind",
            "on_bearing",
            &KINDS,
            "motion that the rig leaves the body; on_bearing: about three axes, with weight; hinge: about one axis that \
             is fixed in the body and in the world; clamped: none, only the wheels turn; free: a spacecraft, about three \
             axes, without weight",
        );
        match kind {
            "hinge" => Freedom::Hinge {
                axis_b: r.direction(
                    "axis",
                    "the hinge's axis, body axes; where it points in the world follows from the attitude at the start",
                ),
            },
            "clamped" => Freedom::Clamped,
            "free" => Freedom::Free,
            _ => Freedom::OnBearing,
        }
    })
}
