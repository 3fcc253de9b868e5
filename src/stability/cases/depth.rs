//! Cases about depth as estimators give it: wrong, torn, unsteady.

use super::*;
use crate::{
    measure::sequence::{Sequence, flicker},
    panorama::{mapping::texel_direction, source::PanoramaFrame},
};

pub const CASES: &[Case] = &[
    Case {
        name: "noisy_depth",
        asks: "Depth that is off by 18 % (root mean square), smoothly and from texel to texel, with 12 % of holes: is the ball still whole and rightly lit?",
        metric: "mean FLIP to the truth over the ball, 16 frames",
        unit: "",
        limit: SEEN,
        reason: SEEN_WHY,
        must_fail: &[],
        run: noisy_depth,
    },
    Case {
        name: "scale_flicker",
        asks: "Depth whose scale changes by up to 10 % from frame to frame, of a scene that stands still: does the picture?",
        metric: "mean standard deviation over 12 frames of each pixel's displayed value, pixels that the ball makes or changes, after 8 frames, steps of 8 bits",
        unit: "/255",
        limit: 2.0,
        reason: "two steps of 8 bits are not seen",
        must_fail: &[],
        run: scale_flicker,
    },
];

fn ball_on_the_floor() -> World {
    World {
        things: vec![Thing::ball(0.3, 0.12, vec3(0.1, FLOOR + 0.3, -1.5))],
        ..room(colourful, vec3(0.1, -1.1, -1.5), 50.0)
    }
}

fn noise(i: usize, salt: u32) -> f32 {
    let x = (i as u32).wrapping_mul(747_796_405).wrapping_add(salt.wrapping_mul(0x9e37_79b9));
    let x = ((x >> ((x >> 28) + 4)) ^ x).wrapping_mul(277_803_737);
    (((x >> 22) ^ x) & 0xffff) as f32 / 32767.5 - 1.0
}

/// Adds waves of 13 and 8 % of the distance and 9 % from texel to texel (together 18 %), and makes every
/// eighth block of 2×2 texels a hole.
fn spoil(frame: &mut PanoramaFrame) {
    let size = frame.depth_size;
    for (i, depth) in frame.depth.iter_mut().enumerate() {
        let (x, y) = (i as u32 % size[0], i as u32 / size[0]);
        let d = texel_direction(x, y, size).as_vec3();
        let wave =
            0.19 * (3.0 * d.x + 5.0 * d.y + 4.0 * d.z).sin() + 0.11 * (17.0 * d.x - 13.0 * d.z + 9.0 * d.y).sin();
        *depth *= 1.0 + wave + 0.155 * noise(i, 1);
        let block = (x / 2 + y / 2 * size[0]) as usize;
        if noise(block, 2) < -1.0 + 2.0 / 8.0 {
            *depth = 0.0;
        }
    }
}

fn noisy_depth(run: &Run) -> Result<Outcome> {
    let film =
        Film { spoil: Some(Box::new(|_, frame| spoil(frame))), ..Film::still(run.size(), 16, ball_on_the_floor) };
    run.worst(&film, [0], |test, truth| metric::flip(truth.size, test, &truth.texels, &truth.shows_things(), 1.0))
}

fn scale_flicker(run: &Run) -> Result<Outcome> {
    let film = Film {
        video: true,
        spoil: Some(Box::new(|n, frame| {
            let scale = 1.0 + 0.1 * noise(n, 3);
            frame.depth.iter_mut().for_each(|depth| *depth *= scale);
        })),
        ..Film::moving(run.size(), 20, |_| ball_on_the_floor())
    };
    let pictures = run.play(&film)?;
    let truth = run.truth(&film, 0, 0);
    let mask = truth.concerned();
    let value = if pictures.iter().all(|picture| metric::is_finite(picture)) {
        let frames = Sequence { subject: "scale_flicker", size: film.size, frames: &pictures[8..] };
        255.0 * flicker(frames, Some(&mask), 1.0)?
    } else {
        metric::NOT_FINITE
    };
    let off = |picture: &metric::Texels| metric::flip(film.size, picture, &truth.texels, &mask, 1.0);
    let errors = pictures[8..].iter().map(off).collect::<Result<Vec<_>>>()?;
    let worst = 8 + (0..errors.len()).fold(0, |worst, n| if errors[n] > errors[worst] { n } else { worst });
    Ok(Outcome { value, size: film.size, worst: pictures[worst].clone(), truth: truth.texels.clone(), exposure: 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_as_wrong_as_the_case_says() {
        let mut frame = ball_on_the_floor().capture([256, 128], 0.0);
        let clean = frame.depth.clone();
        spoil(&mut frame);
        let holes = frame.depth.iter().filter(|depth| **depth == 0.0).count() as f32 / clean.len() as f32;
        let errors: Vec<f32> =
            frame.depth.iter().zip(&clean).filter(|(a, _)| **a > 0.0).map(|(a, b)| a / b - 1.0).collect();
        let rms = (errors.iter().map(|e| e * e).sum::<f32>() / errors.len() as f32).sqrt();
        assert!((0.1..0.15).contains(&holes) && (0.15..0.2).contains(&rms), "{holes} holes, {rms}");
        assert!(frame.depth.iter().all(|depth| *depth >= 0.0 && depth.is_finite()));
    }
}
