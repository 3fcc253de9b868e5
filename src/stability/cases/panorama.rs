//! Cases about the panorama's special places: seam, poles, turning.

use super::*;
use std::f32::consts::{PI, TAU};

pub const CASES: &[Case] = &[
    Case {
        name: "seam",
        asks: "Does the shadow of a ball on the panorama's seam go on over it?",
        metric: "share of the true change of light that is missing or too much, over real pixels within a texel (5.6°) of the seam that it changes by more than 2 %, 32 frames",
        unit: "",
        limit: 0.1,
        reason: CHANGE_WHY,
        must_fail: &[],
        run: seam,
    },
    Case {
        name: "poles",
        asks: "Straight down, where a row of texels is one point: is the shadow of a ball what it should be?",
        metric: "share of the true change of light that is missing or too much, over pixels within a row of texels (5.6°) of straight down, 32 frames",
        unit: "",
        limit: 0.1,
        reason: CHANGE_WHY,
        must_fail: &[],
        run: poles,
    },
    Case {
        name: "rotation",
        asks: "Does turning the panorama's texels, and telling so by yaw, change nothing?",
        metric: "mean FLIP between the picture with yaw 0° and with yaw 130°, pixels that an object makes or changes, 16 frames each",
        unit: "",
        limit: SEEN,
        reason: SEEN_WHY,
        must_fail: &[],
        run: rotation,
    },
];

/// The size of a panorama with texels of 5.6°, so that an error in one of them is seen.
const COARSE: [u32; 2] = [64, 32];

fn seam(run: &Run) -> Result<Outcome> {
    let still = Film::still(run.size(), 32, || World {
        things: vec![Thing::ball(0.3, 0.2, vec3(0.05, FLOOR + 0.35, 0.9))],
        ..room(colourful, vec3(0.0, -1.25, 0.7), 60.0)
    });
    run.worst(&Film { panorama: COARSE, ..still }, [0], |test, truth| {
        let beside = |p: &Vec3| p.x.atan2(p.z).abs() < TAU / COARSE[0] as f32;
        let pixels = truth.position.iter().zip(truth.changed(0.02));
        let mask: Vec<bool> = pixels.map(|(p, changed)| changed && beside(p)).collect();
        Ok(metric::change(test, truth, &mask))
    })
}

fn poles(run: &Run) -> Result<Outcome> {
    let still = Film::still(run.size(), 32, || World {
        things: vec![Thing::ball(0.3, 0.2, vec3(0.36, FLOOR + 0.35, 0.0))],
        ..room(even, vec3(0.0, -1.0, -0.001), 40.0)
    });
    run.worst(&Film { panorama: COARSE, ..still }, [0], |test, truth| {
        let low = |p: &Vec3| p.normalize().dot(Vec3::NEG_Y) > (PI / COARSE[1] as f32).cos();
        let pixels = truth.position.iter().zip(&truth.coverage);
        let mask: Vec<bool> = pixels.map(|(p, m)| *m == 1.0 && low(p)).collect();
        Ok(metric::change(test, truth, &mask))
    })
}

fn rotation(run: &Run) -> Result<Outcome> {
    let film = |yaw| Film {
        yaw,
        ..Film::still(run.size(), 16, || World {
            lamp: Some(Lamp { at: vec2(-0.8, -1.2), half: 0.25, radiance: Vec3::splat(20.0) }),
            things: vec![Thing::ball(0.3, 0.7, vec3(0.3, FLOOR + 0.3, -1.5))],
            ..room(|p, n| 0.4 * colourful(p, n), vec3(0.2, -1.1, -1.5), 55.0)
        })
    };
    let (straight, turned) = (film(0.0), film(130.0));
    let (truth, test) = (run.play(&straight)?.remove(0), run.play(&turned)?.remove(0));
    let mask = run.truth(&straight, 0, 0).concerned();
    let value = metric::flip(run.size(), &test, &truth, &mask, 1.0)?;
    Ok(Outcome { value, size: run.size(), worst: test, truth, exposure: 1.0 })
}
