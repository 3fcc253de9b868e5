//! Cases about surfaces that a depth map does not hold well: edges, thin things, grazing rays, hidden sides.
//! Objects also stand where they cannot be.

use super::*;

pub const CASES: &[Case] = &[
    Case {
        name: "silhouettes",
        asks: "A ball half behind a real cupboard: do rays pass behind the cupboard, which the capture saw from the front alone?",
        metric: "mean FLIP to the true scene over pixels that the ball makes or changes, 16 frames",
        unit: "",
        limit: SEEN,
        reason: SEEN_WHY,
        must_fail: &[],
        run: silhouettes,
    },
    Case {
        name: "thin_posts",
        asks: "A ball behind real posts of 5 cm, two texels wide: do they hide it and its light as posts, not as walls or not at all?",
        metric: "mean FLIP to the true scene over pixels that the ball makes or changes, 16 frames",
        unit: "",
        limit: SEEN,
        reason: SEEN_WHY,
        must_fail: &[],
        run: thin_posts,
    },
    Case {
        name: "grazing_rays",
        asks: "A floor seen and lit at a few degrees: is the shadow on it right?",
        metric: CHANGE,
        unit: "",
        limit: 0.1,
        reason: CHANGE_WHY,
        must_fail: &[],
        run: grazing_rays,
    },
    Case {
        name: "unseen_mirror",
        asks: "A virtual mirror shows the back of a real screen, which the capture never saw: what does it show?",
        metric: "mean FLIP to the true scene over the mirror, 16 frames",
        unit: "",
        limit: SEEN,
        reason: SEEN_WHY,
        must_fail: &[],
        run: unseen_mirror,
    },
    Case {
        name: "shadow_in_mirror",
        asks: "A virtual mirror shows the floor before it, and on it the shadow of a virtual ball: is the shadow there?",
        metric: "share of the true change of what the mirror shows of real surfaces, where they are darkened by more than 5 %, that is missing or too much, 16 frames",
        unit: "",
        limit: 0.2,
        reason: "a reflected shadow a fifth too light or dark passes; one that is missing does not",
        must_fail: &[Method::Ibl, Method::Paper],
        run: shadow_in_mirror,
    },
    Case {
        name: "contact_shadow",
        asks: "A small box on the floor: does its contact shadow survive a filter of 65 × 65 pixels?",
        metric: "mean FLIP to the truth over the floor within 10 cm of the box, 16 frames",
        unit: "",
        limit: SEEN,
        reason: SEEN_WHY,
        must_fail: &[],
        run: contact_shadow,
    },
    Case {
        name: "through_a_wall",
        asks: "A ball stuck in a real wall, most of it beyond: is that hidden, and does the rest cast its shadow?",
        metric: "mean FLIP to the truth over pixels that the ball, seen or hidden, makes or changes, 16 frames",
        unit: "",
        limit: SEEN,
        reason: SEEN_WHY,
        must_fail: &[],
        run: through_a_wall,
    },
    Case {
        name: "camera_inside",
        asks: "The camera inside a shining ball, in a darker room: is it as bright everywhere as its light to and fro makes it?",
        metric: "difference to the equilibrium in steps of 8 bits that 99 % of the pixels stay within, 4 frames",
        unit: "/255",
        limit: 2.0,
        reason: "two steps of 8 bits are not seen",
        must_fail: &[],
        run: camera_inside,
    },
    Case {
        name: "object_at_the_centre",
        asks: "A ball around the capture point itself, seen from beside it: is it lit and does it cast its shadow?",
        metric: "mean FLIP to the truth over pixels that the ball makes or changes, 16 frames",
        unit: "",
        limit: SEEN,
        reason: SEEN_WHY,
        must_fail: &[],
        run: object_at_the_centre,
    },
    Case {
        name: "behind_every_surface",
        asks: "An object beyond the walls: is the picture as if it were not there?",
        metric: "largest difference to the panorama alone, steps of 8 bits, 4 frames",
        unit: "/255",
        limit: 0.5,
        reason: "half a step of 8 bits: nothing changes where nothing happens",
        must_fail: &[],
        run: behind_every_surface,
    },
];

fn silhouettes(run: &Run) -> Result<Outcome> {
    let film = Film::still(run.size(), 16, || World {
        furniture: vec![Block::around(vec3(-0.25, FLOOR + 0.5, -1.1), vec3(0.9, 1.0, 0.3))],
        things: vec![Thing::ball(0.35, 0.7, vec3(0.35, FLOOR + 0.45, -1.75))],
        ..room(colourful, vec3(0.1, -1.0, -1.5), 55.0)
    });
    worst_flip(run, &film, [0])
}

fn thin_posts(run: &Run) -> Result<Outcome> {
    let film = Film::still(run.size(), 16, || World {
        furniture: [-0.6, -0.3, 0.0, 0.3, 0.6]
            .map(|x| Block::around(vec3(x, 0.0, -1.2), vec3(0.05, 2.8, 0.05)))
            .to_vec(),
        things: vec![Thing::ball(0.4, 0.7, vec3(0.1, FLOOR + 0.6, -1.9))],
        ..room(colourful, vec3(0.05, -0.8, -1.6), 60.0)
    });
    worst_flip(run, &film, [0])
}

fn grazing_rays(run: &Run) -> Result<Outcome> {
    let long = Block { low: vec3(-2.5, -0.35, -10.0), high: vec3(2.5, 2.0, 2.0) };
    let paint = |_: Vec3, normal: Vec3| Vec3::splat(if normal.y > 0.5 { 0.25 } else { 0.7 });
    let still = Film::still(run.size(), 16, move || World {
        room: long,
        things: vec![Thing::ball(0.25, 0.5, vec3(0.15, -0.09, -1.7))],
        ..room(paint, vec3(0.0, -0.25, -1.6), 30.0)
    });
    // Rows span 0.7°. A coarser depth map has no such floor (docs/limits.md).
    let film = Film { panorama: [512, 256], ..still };
    run.worst(&film, [0], |test, truth| Ok(metric::change(test, truth, &truth.changed(0.02))))
}

fn red_back(p: Vec3, normal: Vec3) -> Vec3 {
    if normal.z < -0.5 && p.z > -1.3 && p.z < 0.0 { vec3(0.75, 0.1, 0.1) } else { colourful(p, normal) }
}

fn unseen_mirror(run: &Run) -> Result<Outcome> {
    let film = Film::still(run.size(), 16, || World {
        furniture: vec![Block::around(vec3(0.8, -0.5, -1.1), vec3(0.6, 1.8, 0.06))],
        things: vec![Thing { mirror: true, ..Thing::block(vec3(1.2, 1.4, 0.04), 0.0, vec3(0.35, -0.3, -2.2)) }],
        ..room(red_back, vec3(0.3, -0.25, -1.5), 55.0)
    });
    run.worst(&film, [0], |test, truth| metric::flip(truth.size, test, &truth.texels, &truth.shows_things(), 1.0))
}

fn bright_ceiling(_: Vec3, normal: Vec3) -> Vec3 {
    Vec3::splat(if normal.y < -0.5 { 1.5 } else { 0.3 })
}

fn shadow_in_mirror(run: &Run) -> Result<Outcome> {
    let world = |relit| {
        move || World {
            relit,
            things: vec![
                Thing { mirror: true, ..Thing::block(vec3(1.8, 1.2, 0.04), 0.0, vec3(0.0, FLOOR + 0.61, -2.0)) },
                Thing::ball(0.3, 0.4, vec3(0.1, FLOOR + 0.5, -0.9)),
            ],
            ..room(bright_ceiling, vec3(0.0, FLOOR + 0.4, -2.0), 50.0)
        }
    };
    // Each method relights what its rays meet, or not, as it does by itself.
    let film = Film { set: Vec::new(), ..Film::still(run.size(), run.count(16, 64), world(true)) };
    let as_captured = run.truth(&Film::still(run.size(), 1, world(false)), 1, 0);
    run.worst(&film, [0], |test, truth| {
        // The region is where the mirror shows something darker than before. Beside the shadow the ball's own
        // light makes the floor brighter.
        let sum = |texel: &[f32; 4]| texel[0] + texel[1] + texel[2];
        let darker = truth.texels.iter().zip(&as_captured.texels).map(|(new, old)| sum(new) < 0.95 * sum(old));
        let mask: Vec<bool> = darker.zip(truth.shows_things()).map(|(a, b)| a && b).collect();
        let change = WorldTruth { without: as_captured.texels.clone(), ..truth.clone() };
        Ok(metric::change(test, &change, &mask))
    })
}

fn contact_shadow(run: &Run) -> Result<Outcome> {
    let (at, size) = (vec3(0.1, FLOOR + 0.1, -1.3), Vec3::splat(0.2));
    let film = Film::still(run.size(), 16, move || World {
        lamp: Some(Lamp { at: vec2(0.8, -1.6), half: 0.3, radiance: Vec3::splat(12.0) }),
        things: vec![Thing::block(size, 0.4, at)],
        ..room(|p, n| 0.5 * colourful(p, n), at, 35.0)
    });
    run.worst(&film, [0], |test, truth| {
        let near = |p: &Vec3| (*p - at).abs().with_y(0.0).max_element() < 0.2 && p.y < FLOOR + 1e-3;
        let pixels = truth.position.iter().zip(&truth.coverage);
        let mask: Vec<bool> = pixels.map(|(p, m)| *m == 1.0 && near(p)).collect();
        metric::flip(truth.size, test, &truth.texels, &mask, 1.0)
    })
}

fn through_a_wall(run: &Run) -> Result<Outcome> {
    let ball = Thing::ball(0.4, 0.6, vec3(0.2, -0.5, ROOM.low.z - 0.3));
    let film = Film::still(run.size(), 16, move || World {
        furniture: vec![Block::around(vec3(0.55, -0.4, -1.5), vec3(0.5, 0.8, 0.1))],
        things: vec![ball],
        ..room(colourful, ball.at, 45.0)
    });
    // The region is the ball's whole disc, including where it must not be seen.
    let bare = Film::still(run.size(), 1, move || World { things: vec![ball], ..room(colourful, ball.at, 45.0) });
    let disc = run.truth(&bare, 1, 0).shows_things();
    run.worst(&film, [0], |test, truth| {
        let mask: Vec<bool> = truth.concerned().iter().zip(&disc).map(|(a, b)| *a || *b).collect();
        metric::flip(truth.size, test, &truth.texels, &mask, 1.0)
    })
}

fn camera_inside(run: &Run) -> Result<Outcome> {
    let film = Film::still(run.size(), 4, || World {
        things: vec![Thing { emission: Vec3::splat(0.3), ..Thing::ball(0.5, 0.5, vec3(0.1, 0.0, -0.1)) }],
        ..room(|_, _| Vec3::splat(0.2), vec3(0.3, -0.2, -1.0), 70.0)
    })
    // Beyond the last bounce a path sees the dark room.
    .with("bounces", "12");
    let test = run.play(&film)?.remove(0);
    let truth = vec![[0.6, 0.6, 0.6, 1.0]; test.len()];
    let value = metric::codes(&test, &truth, &vec![true; test.len()], 0.99, 1.0);
    Ok(Outcome { value, size: film.size, worst: test, truth, exposure: 1.0 })
}

fn object_at_the_centre(run: &Run) -> Result<Outcome> {
    let film = Film::still(run.size(), 16, || World {
        lamp: Some(Lamp { at: vec2(0.6, -0.4), half: 0.3, radiance: Vec3::splat(10.0) }),
        things: vec![Thing { form: Form::Ball(0.3), ..Thing::ball(0.3, 0.7, Vec3::ZERO) }],
        eye: Eye { at: vec3(0.9, 0.5, 1.5), target: vec3(-0.1, -0.5, -0.2), fov_y: 70.0 },
        ..room(|p, n| 0.6 * colourful(p, n), Vec3::ZERO, 70.0)
    });
    worst_flip(run, &film, [0])
}

fn behind_every_surface(run: &Run) -> Result<Outcome> {
    let film = Film {
        panorama: [128, 64],
        ..Film::still(run.size(), 4, || World {
            things: vec![Thing::ball(0.6, 0.2, vec3(0.4, 0.0, ROOM.low.z - 1.0))],
            ..room(colourful, Vec3::NEG_Z, 60.0)
        })
    };
    run.worst(&film, [0], |test, truth| {
        let everywhere = vec![true; test.len()];
        Ok(metric::codes(test, &truth.without, &everywhere, 1.0, 1.0))
    })
}
