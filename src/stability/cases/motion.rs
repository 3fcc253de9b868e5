//! Cases about what changes: casters, lamps, shots, the camera, the real room.

use super::*;
use crate::measure::{
    motion::{Seen, motion},
    sequence::{Sequence, ghost_energy, warped_difference},
};
use glam::Quat;

const UNSTEADY: &str = "mean |frame − the one before, moved by the motion vectors| beyond the truth's own, pixels that show it, steps of 8 bits";
const LEFT: &str = "share of the change that is still missing in the third frame after it, on the way to what the method shows when it starts anew, pixels that change";
const LEFT_WHY: &str =
    "a tenth of a second is the shortest delay that is noticed; a tenth of the old light is hardly seen then";

pub const CASES: &[Case] = &[
    Case {
        name: "moving_caster",
        asks: "A ball slides over the floor at 1.8 m/s: does its shadow go with it, without a ghost?",
        metric: "ghost energy: the share of the truth's past frames that is left in the picture, last 8 frames, floor that the shadow passes",
        unit: "",
        limit: 0.1,
        reason: "a tenth of a shadow where there is none any more is hardly seen",
        must_fail: &[],
        run: moving_caster,
    },
    Case {
        name: "teleport",
        asks: "A ball is suddenly elsewhere: does its shadow stay where it was?",
        metric: LEFT,
        unit: "",
        limit: 0.1,
        reason: LEFT_WHY,
        must_fail: &[],
        run: teleport,
    },
    Case {
        name: "light_switched_off",
        asks: "The lamp goes out in the video: does a ball still shine in its light?",
        metric: LEFT,
        unit: "",
        limit: 0.1,
        reason: LEFT_WHY,
        must_fail: &[],
        run: light_switched_off,
    },
    Case {
        name: "cut",
        asks: "The video cuts to another room, the ball stays: what is left of the first room's light?",
        metric: LEFT,
        unit: "",
        limit: 0.1,
        reason: LEFT_WHY,
        must_fail: &[],
        run: cut,
    },
    Case {
        name: "fast_pan",
        asks: "The camera pans by 6° a frame past a ball: is what comes into view, and from behind the ball, right at once?",
        metric: "mean FLIP to the truth of the worst of 10 frames, pixels that the ball makes or changes",
        unit: "",
        limit: SEEN,
        reason: SEEN_WHY,
        must_fail: &[],
        run: fast_pan,
    },
    Case {
        name: "moving_camera",
        asks: "The camera dollies past a ball: does the picture change from frame to frame more than it should?",
        metric: "mean |frame − the one before, moved by the motion vectors| beyond the truth's own, pixels that the ball makes or changes, steps of 8 bits",
        unit: "/255",
        limit: 2.0,
        reason: "two steps of 8 bits are not seen",
        must_fail: &[],
        run: moving_camera,
    },
    Case {
        name: "turning_tile",
        asks: "A tile of dark and light squares, as small as pixels, turns: does it shimmer?",
        metric: UNSTEADY,
        unit: "/255",
        limit: 2.0,
        reason: "two steps of 8 bits are not seen",
        must_fail: &[],
        run: turning_tile,
    },
    Case {
        name: "motion_vectors",
        asks: "On the same way, with a lamp: do shadow and shading stay on their surfaces?",
        metric: "mean FLIP to the truth of the worst of the last 6 frames, pixels that the ball makes or changes",
        unit: "",
        limit: SEEN,
        reason: SEEN_WHY,
        must_fail: &[],
        run: motion_vectors,
    },
    Case {
        name: "moving_mirror",
        asks: "The camera dollies past a flat mirror and a mirror ball: do reflections stay where geometry says?",
        metric: "mean FLIP to the truth of the worst of the last 6 frames, pixels that show the mirrors",
        unit: "",
        limit: SEEN,
        reason: SEEN_WHY,
        must_fail: &[],
        run: moving_mirror,
    },
    Case {
        name: "uncovered",
        asks: "A bright post close to the camera uncovers a dark table behind it: is that dark at once?",
        metric: "|Σ picture/Σ truth − 1| of the radiance of what the post uncovered since the last frame, the worst of the last 6 frames",
        unit: "",
        limit: 0.2,
        reason: "a seam a fifth too bright that is gone in the next frames is hardly seen",
        must_fail: &[],
        run: uncovered,
    },
    Case {
        name: "moving_furniture",
        asks: "A real screen slides before a ball, in the video's colour and depth: does it hide the ball, and does its light follow?",
        metric: "mean FLIP to the true scene of the worst of the last 8 frames, the ball's disc, seen or hidden",
        unit: "",
        limit: SEEN,
        reason: SEEN_WHY,
        must_fail: &[],
        run: moving_furniture,
    },
];

/// Returns the share of a film's step between `before` and `before + 1` that is missing in the third frame
/// after it. The whole step leads from what the method shows before it to what it shows when it starts anew.
/// It is taken in displayed values, over pixels that change and wholly show one kind of surface before and
/// after: with `things` a thing.
fn left(run: &Run, film: &Film, fresh: &Film, before: usize, things: bool) -> Result<Outcome> {
    let pictures = run.play(film)?;
    let (start, test, end) = (&pictures[before], pictures[before + 3].clone(), run.play(fresh)?.remove(0));
    let (old, new) = (run.truth(film, 0, before), run.truth(film, 0, before + 1));
    let value = if [start, &test, &end].into_iter().all(|picture| metric::is_finite(picture)) {
        let (mut made, mut whole) = (0.0, 0.0);
        for i in 0..test.len() {
            let (a, b) = (old.coverage[i], new.coverage[i]);
            if a != b || !(a == 0.0 || (a == 1.0 && !things)) {
                continue;
            }
            for c in 0..3 {
                let shown = |texels: &[[f32; 4]]| f64::from(metric::shown(texels[i][c], 1.0));
                if (shown(&old.texels) - shown(&new.texels)).abs() < 4.0 / 255.0 {
                    continue;
                }
                let step = shown(&end) - shown(start);
                (made, whole) = (made + step * (shown(&test) - shown(start)), whole + step * step);
            }
        }
        if whole > 0.0 { (1.0 - made / whole).abs() } else { metric::NOT_FINITE }
    } else {
        metric::NOT_FINITE
    };
    Ok(Outcome { value, size: film.size, worst: test, truth: end, exposure: 1.0 })
}

/// Makes a ball on a floor under a bright ceiling panel, which is so wide that its light is found at once.
fn lit(at: Vec3) -> World {
    World {
        lamp: Some(Lamp { at: vec2(0.6, -1.0), half: 0.9, radiance: Vec3::splat(1.6) }),
        things: vec![Thing::ball(0.25, 0.5, at)],
        ..room(|p, n| 0.4 * colourful(p, n), vec3(0.0, -1.2, -1.6), 60.0)
    }
}

fn moving_caster(run: &Run) -> Result<Outcome> {
    let frames = run.count(28, 20);
    let film =
        Film::moving(run.size(), frames, move |n| lit(vec3(0.65 - 0.06 * (frames - 1 - n) as f32, FLOOR + 0.25, -1.6)));
    let film = Film { warmup: 8, ..film };
    let pictures = run.play(&film)?;
    let truths: Vec<_> = (frames - 8..frames).map(|n| run.truth(&film, 0, n)).collect();
    let texels: Vec<Texels> = truths.iter().map(|truth| truth.texels.clone()).collect();
    // The region is the floor that the shadow passes. The ball is left out, because its own shading moves
    // with it.
    let floor = |i: &usize| truths.iter().all(|truth| truth.coverage[*i] == 1.0 && truth.position[*i].y < FLOOR + 1e-3);
    let passed = |i: &usize| truths.iter().any(|truth| truth.changed(0.02)[*i]);
    let mask: Vec<bool> = (0..texels[0].len()).map(|i| floor(&i) && passed(&i)).collect();
    let value = if pictures.iter().all(|picture| metric::is_finite(picture)) {
        let test = Sequence { subject: "picture", size: film.size, frames: &pictures[frames - 8..] };
        let truth = Sequence { subject: "truth", size: film.size, frames: &texels };
        ghost_energy(test, truth, Some(&mask), 1.0)?.max(0.0)
    } else {
        metric::NOT_FINITE
    };
    let (worst, truth) = (pictures[frames - 1].clone(), texels[7].clone());
    Ok(Outcome { value, size: film.size, worst, truth, exposure: 1.0 })
}

fn teleport(run: &Run) -> Result<Outcome> {
    let (before, frames) = (3, 8);
    let at = |x: f32| lit(vec3(x, FLOOR + 0.25, -1.6));
    let film = Film::moving(run.size(), frames, move |n| at(if n <= before { -0.55 } else { 0.55 }));
    let fresh = Film::still(run.size(), 32, move || at(0.55));
    left(run, &Film { warmup: 24, ..film }, &fresh, before, false)
}

fn light_switched_off(run: &Run) -> Result<Outcome> {
    let (before, frames) = (3, 8);
    let on = || lit(vec3(0.1, FLOOR + 0.25, -1.6));
    let film = Film::moving(run.size(), frames, move |n| World { lamp: on().lamp.filter(|_| n <= before), ..on() });
    let fresh = Film::still(run.size(), 32, move || World { lamp: None, ..on() });
    left(run, &Film { warmup: 24, video: true, ..film }, &fresh, before, false)
}

fn cut(run: &Run) -> Result<Outcome> {
    fn after() -> World {
        let green = |p: Vec3, normal: Vec3| {
            if p.x < -1.9 { vec3(1.0, 0.9, 0.5) } else { vec3(0.15, 0.35, 0.2) * colourful(p, normal) }
        };
        let room = Block { low: vec3(-2.0, FLOOR, -3.5), high: vec3(4.0, 1.6, 2.0) };
        World { room, lamp: None, paint: green, ..lit(vec3(0.1, FLOOR + 0.25, -1.6)) }
    }
    let film = Film::moving(run.size(), 8, |n| if n <= 3 { lit(vec3(0.1, FLOOR + 0.25, -1.6)) } else { after() });
    left(run, &Film { warmup: 24, video: true, ..film }, &Film::still(run.size(), 32, after), 3, true)
}

fn fast_pan(run: &Run) -> Result<Outcome> {
    let film = Film::moving(run.size(), 14, |n| {
        let world = lit(vec3(0.1, FLOOR + 0.45, -1.4));
        let turn = Quat::from_rotation_y((6.0 * (n.max(2) as f32 - 8.0)).to_radians());
        World { eye: Eye { target: turn * vec3(0.0, -1.0, -1.5), ..world.eye }, ..world }
    });
    worst_flip(run, &Film { warmup: 8, ..film }, 4..14)
}

/// Makes a camera that goes past a ball, 3 cm a frame.
fn dolly(size: [u32; 2], frames: usize) -> Film {
    let film = Film::moving(size, frames, |n| {
        let world = lit(vec3(0.1, FLOOR + 0.3, -1.6));
        let aside = 0.03 * n as f32 - 0.3;
        World { eye: Eye { at: vec3(aside, 0.1, 0.2), target: vec3(0.5 * aside, -1.1, -1.6), fov_y: 50.0 }, ..world }
    });
    Film { warmup: 8, ..film }
}

fn moving_camera(run: &Run) -> Result<Outcome> {
    steadiness(run, &dolly(run.size(), run.count(20, 14)), WorldTruth::concerned)
}

/// Makes a turntable. It is the camera that goes round, by 2° a frame.
fn turntable(run: &Run, things: impl Fn() -> Vec<Thing> + Sync + 'static) -> Result<Outcome> {
    let film = Film::moving(run.size(), run.count(20, 14), move |n| {
        let middle = vec3(0.0, FLOOR + 0.2, -0.6);
        let turn = Quat::from_rotation_y((2.0 * n as f32 + 7.0).to_radians());
        let eye = Eye { at: middle + turn * vec3(0.0, 0.6, 1.6), target: middle, fov_y: 45.0 };
        World { things: things(), eye, ..lit(Vec3::ZERO) }
    });
    steadiness(run, &Film { warmup: 8, ..film }, WorldTruth::shows_things)
}

fn turning_tile(run: &Run) -> Result<Outcome> {
    let pattern = Pattern::Checker(61);
    turntable(run, move || {
        vec![Thing { pattern, ..Thing::block(vec3(1.4, 0.02, 1.4), 0.8, vec3(0.0, FLOOR + 0.01, -0.6)) }]
    })
}

/// Measures how much more than the truth a film changes from frame to frame, along motion, in a region.
fn steadiness(run: &Run, film: &Film, region: fn(&WorldTruth) -> Vec<bool>) -> Result<Outcome> {
    let frames = film.frames;
    let (mut pictures, mut seen) = (Vec::new(), Vec::new());
    run.watch(film, |renderer| {
        pictures.push(renderer.picture()?);
        seen.push([renderer.aov("motion")?, renderer.aov("position")?]);
        Ok(())
    })?;
    let measured = frames - 8..frames;
    let layers = |n: usize| Seen { motion: &seen[n][0], position: Some(&seen[n][1]) };
    let ways: Vec<_> = measured.clone().map(|n| motion(film.size, layers(n), layers(n - 1))).collect();
    let truths: Vec<_> = measured.clone().map(|n| run.truth(film, 0, n)).collect();
    let texels: Vec<Texels> = truths.iter().map(|truth| truth.texels.clone()).collect();
    let masks: Vec<Vec<bool>> = truths.iter().map(|truth| region(truth)).collect();
    let mask: Vec<bool> = (0..texels[0].len()).map(|i| masks.iter().any(|mask| mask[i])).collect();
    let last = &pictures[frames - 1];
    let value = if pictures.iter().all(|picture| metric::is_finite(picture)) {
        let test = Sequence { subject: "picture", size: film.size, frames: &pictures[measured] };
        let truth = Sequence { subject: "truth", size: film.size, frames: &texels };
        (255.0 * warped_difference(test, truth, Some(&ways), Some(&mask), 1.0)?).max(0.0)
    } else {
        metric::NOT_FINITE
    };
    Ok(Outcome { value, size: film.size, worst: last.clone(), truth: texels[7].clone(), exposure: 1.0 })
}

fn motion_vectors(run: &Run) -> Result<Outcome> {
    let frames = run.count(20, 14);
    worst_flip(run, &dolly(run.size(), frames), frames - 6..frames)
}

fn moving_mirror(run: &Run) -> Result<Outcome> {
    let frames = run.count(20, 14);
    let dolly = dolly(run.size(), frames);
    let film = Film::moving(run.size(), frames, move |n| {
        let mirror = |thing| Thing { mirror: true, ..thing };
        let things = vec![
            mirror(Thing::block(vec3(0.9, 1.1, 0.04), 0.0, vec3(-0.4, FLOOR + 0.6, -1.7))),
            mirror(Thing::ball(0.35, 0.0, vec3(0.55, FLOOR + 0.35, -1.4))),
        ];
        World { things, lamp: None, paint: colourful, ..(dolly.world)(n) }
    });
    let film = Film { warmup: 8, ..film };
    run.worst(&film, frames - 6..frames, |test, truth| {
        metric::flip(truth.size, test, &truth.texels, &truth.shows_things(), 1.0)
    })
}

/// Makes a room that is bright behind the camera and dark before it.
fn half_dark(p: Vec3, _: Vec3) -> Vec3 {
    Vec3::splat(if p.z > -0.4 { 1.5 } else { 0.05 })
}

fn uncovered(run: &Run) -> Result<Outcome> {
    let frames = run.count(16, 12);
    let world = |n: usize, post: bool| {
        let aside = 0.03 * n as f32 - 0.2;
        let table = Thing::block(vec3(3.0, 0.05, 1.2), 0.8, vec3(0.0, -0.7, -1.9));
        let post = post.then(|| Thing::block(vec3(0.12, 2.0, 0.04), 0.8, vec3(0.05, -0.4, -0.7)));
        let eye = Eye { at: vec3(aside, 0.1, 0.2), target: vec3(aside, -0.6, -1.8), fov_y: 40.0 };
        World { things: std::iter::once(table).chain(post).collect(), eye, ..room(half_dark, Vec3::ZERO, 40.0) }
    };
    let film = Film::moving(run.size(), frames, move |n| world(n, true));
    let film = Film { warmup: 8, ..film };
    // Where the post is, the picture differs from the one of the table alone.
    let alone = Film::moving(run.size(), frames, move |n| world(n, false));
    let post = |n| -> Vec<bool> {
        let (whole, table) = (run.truth(&film, 0, n), run.truth(&alone, 1, n));
        let brighter = whole.texels.iter().zip(&table.texels).map(|(a, b)| a[1] > 1.5 * b[1]);
        brighter.zip(table.shows_things()).map(|(a, b)| a && b).collect()
    };
    let at = std::cell::Cell::new(frames - 6);
    run.worst(&film, frames - 6..frames, |test, truth| {
        let n = at.replace(at.get() + 1);
        let (before, now) = (post(n - 1), post(n));
        let mask: Vec<bool> =
            before.iter().zip(now).zip(truth.shows_things()).map(|((a, b), c)| *a && !b && c).collect();
        Ok(metric::energy(test, &truth.texels, &mask))
    })
}

fn orange() -> World {
    let mut world = lit(vec3(0.1, FLOOR + 0.3, -1.7));
    world.things[0].albedo = vec3(0.9, 0.3, 0.05);
    world
}

fn moving_furniture(run: &Run) -> Result<Outcome> {
    let frames = run.count(24, 16);
    let film = Film::moving(run.size(), frames, move |n| {
        let at = 0.35 + 0.05 * (frames - 1 - n) as f32;
        World { furniture: vec![Block::around(vec3(at, -0.6, -1.1), vec3(0.6, 1.0, 0.06))], ..orange() }
    });
    let film = Film { warmup: 8, video: true, ..film };
    // The region is where the ball is, hidden or not.
    let bare = Film::still(run.size(), 1, orange);
    let disc = run.truth(&bare, 1, 0).shows_things();
    run.worst(&film, frames - 8..frames, |test, truth| metric::flip(truth.size, test, &truth.texels, &disc, 1.0))
}
