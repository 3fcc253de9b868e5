//! Cases about objects whose influence the picture's own depth does not hold.

use super::*;

pub const CASES: &[Case] = &[
    Case {
        name: "off_screen_caster",
        asks: "Does a ball beside the picture cast its shadow into it?",
        metric: CHANGE,
        unit: "",
        limit: 0.1,
        reason: CHANGE_WHY,
        must_fail: &[Method::Paper],
        run: off_screen,
    },
    Case {
        name: "caster_from_behind",
        asks: "Does a deep box, of which the camera sees the front alone, cast the shadow of all of it?",
        metric: CHANGE,
        unit: "",
        limit: 0.1,
        reason: CHANGE_WHY,
        must_fail: &[Method::Paper],
        run: from_behind,
    },
];

fn off_screen(run: &Run) -> Result<Outcome> {
    let film = Film::still(run.size(), 16, || World {
        things: vec![Thing::ball(0.45, 0.0, vec3(1.45, FLOOR + 0.6, -1.0))],
        ..room(colourful, vec3(0.1, FLOOR, -1.2), 45.0)
    });
    run.worst(&film, [0], |test, truth| Ok(metric::change(test, truth, &truth.changed(0.02))))
}

fn from_behind(run: &Run) -> Result<Outcome> {
    let film = Film::still(run.size(), 16, || World {
        things: vec![Thing::block(vec3(0.6, 0.6, 1.5), 0.0, vec3(0.0, FLOOR + 0.75, -1.5))],
        ..room(colourful, vec3(0.0, -1.1, -1.6), 60.0)
    });
    run.worst(&film, [0], |test, truth| Ok(metric::change(test, truth, &truth.changed(0.02))))
}
