//! Cases about lamps, darkness and clipped light.

use super::*;

pub const CASES: &[Case] = &[
    Case {
        name: "spatial_variation",
        asks: "Are four grey balls lit by where they stand, from under a lamp to across the room?",
        metric: "mean FLIP to the truth over the balls, 16 frames",
        unit: "",
        limit: SEEN,
        reason: SEEN_WHY,
        must_fail: &[Method::Ibl],
        run: spatial_variation,
    },
    Case {
        name: "tiny_lamp",
        asks: "A lamp of 4 cm lights a dark room: is its energy kept?",
        metric: "|Σ picture/Σ truth − 1| of the radiance of a grey ball under it, 32 frames",
        unit: "",
        limit: 0.02,
        reason: "2 % of brightness is what an eye tells apart side by side",
        must_fail: &[],
        run: tiny_lamp,
    },
    Case {
        name: "fireflies",
        asks: "The same lamp, after 8 frames: are there stray bright or dark pixels?",
        metric: "difference to the truth in steps of 8 bits that 99 % of the pixels which the ball makes or changes stay within, 8 frames",
        unit: "/255",
        limit: 16.0,
        reason: "a single pixel that differs by a sixteenth of the range is seen as a speck",
        must_fail: &[],
        run: fireflies,
    },
    Case {
        name: "lamp_beside_object",
        asks: "A dark ball hangs beside a lamp: does the lamp, which sends its own light, stay as bright as it is?",
        metric: "|Σ picture/Σ truth − 1| of the lamp's radiance, 16 frames",
        unit: "",
        limit: 0.02,
        reason: "2 % of brightness is what an eye tells apart side by side",
        must_fail: &[Method::Paper],
        run: lamp_beside_object,
    },
    Case {
        name: "dark_corner",
        asks: "A shining ball in a room with a ten millionth of its light: are the walls, whose E_R is next to nothing, lit by it?",
        metric: "|Σ picture/Σ truth − 1| of the radiance of real surfaces that it changes, 16 frames",
        unit: "",
        limit: 0.1,
        reason: "a tenth of brightness where nothing stands beside it to compare with",
        must_fail: &[],
        run: dark_corner,
    },
    Case {
        name: "saturated_capture",
        asks: "The capture clips the lamp at 1, as 8-bit video does: is a ball under it as bright as it should be?",
        metric: "|Σ picture/Σ truth − 1| of the ball's radiance, 16 frames",
        unit: "",
        limit: 0.1,
        reason: "a tenth of brightness where nothing stands beside it to compare with",
        must_fail: &[],
        run: saturated_capture,
    },
];

fn spatial_variation(run: &Run) -> Result<Outcome> {
    let film = Film::still(run.size(), 16, || World {
        lamp: Some(Lamp { at: vec2(-1.9, -1.6), half: 0.2, radiance: Vec3::splat(40.0) }),
        things: [-1.9, -0.75, 0.75, 1.9].map(|x| Thing::ball(0.3, 0.6, vec3(x, FLOOR + 0.9, -1.7))).to_vec(),
        ..room(|p, n| 0.2 * colourful(p, n), vec3(0.0, -0.5, -1.7), 65.0)
    });
    run.worst(&film, [0], |test, truth| metric::flip(truth.size, test, &truth.texels, &truth.shows_things(), 1.0))
}

fn lit_by_a_speck(size: [u32; 2], frames: usize) -> Film {
    Film::still(size, frames, || World {
        lamp: Some(Lamp { at: vec2(-0.5, -1.2), half: 0.02, radiance: Vec3::splat(3000.0) }),
        things: vec![Thing::ball(0.3, 0.6, vec3(0.1, FLOOR + 0.3, -1.6))],
        ..room(|p, n| 0.15 * colourful(p, n), vec3(0.1, -1.1, -1.5), 50.0)
    })
}

fn tiny_lamp(run: &Run) -> Result<Outcome> {
    run.worst(&lit_by_a_speck(run.size(), 32), [0], |test, truth| {
        Ok(metric::energy(test, &truth.texels, &truth.shows_things()))
    })
}

fn fireflies(run: &Run) -> Result<Outcome> {
    run.worst(&lit_by_a_speck(run.size(), 8), [0], |test, truth| {
        Ok(metric::codes(test, &truth.texels, &truth.concerned(), 0.99, 1.0))
    })
}

fn lamp_beside_object(run: &Run) -> Result<Outcome> {
    let film = Film::still(run.size(), 16, || World {
        lamp: Some(Lamp { at: vec2(-0.1, -1.3), half: 0.2, radiance: Vec3::splat(4.0) }),
        things: vec![Thing::ball(0.25, 0.1, vec3(0.2, 1.1, -1.3))],
        ..room(|p, n| 0.6 * colourful(p, n), vec3(0.05, 1.3, -1.3), 50.0)
    });
    run.worst(&film, [0], |test, truth| {
        let lit = truth.without.iter().zip(&truth.coverage);
        let lamp: Vec<bool> = lit.map(|(before, m)| *m == 1.0 && before[1] > 3.0).collect();
        Ok(metric::energy(test, &truth.without, &lamp))
    })
    .map(|outcome| Outcome { exposure: 0.2, ..outcome })
}

fn pitch_dark(_: Vec3, normal: Vec3) -> Vec3 {
    Vec3::splat(if normal.y > 0.5 { 5e-8 } else { 1e-7 })
}

fn dark_corner(run: &Run) -> Result<Outcome> {
    let film = Film::still(run.size(), 16, || World {
        things: vec![Thing { emission: vec3(1.6, 1.2, 0.6), ..Thing::ball(0.35, 0.0, vec3(1.9, FLOOR + 0.6, -1.6)) }],
        ..room(pitch_dark, vec3(2.4, -0.9, -2.1), 60.0)
    });
    run.worst(&film, [0], |test, truth| Ok(metric::energy(test, &truth.texels, &truth.changed(0.02))))
}

fn saturated_capture(run: &Run) -> Result<Outcome> {
    let film = Film {
        spoil: Some(Box::new(|_, frame| {
            frame.radiance.change(|_, all| all.iter_mut().for_each(|texel| *texel = texel.map(|value| value.min(1.0))));
            frame.white = Some(1.0);
        })),
        ..Film::still(run.size(), 16, || World {
            lamp: Some(Lamp { at: vec2(0.4, -1.4), half: 0.3, radiance: Vec3::splat(12.0) }),
            things: vec![Thing::ball(0.3, 0.6, vec3(0.1, FLOOR + 0.3, -1.5))],
            ..room(|p, n| 0.3 * colourful(p, n), vec3(0.1, -1.1, -1.5), 50.0)
        })
    };
    run.worst(&film, [0], |test, truth| Ok(metric::energy(test, &truth.texels, &truth.shows_things())))
}
