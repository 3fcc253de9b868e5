//! Cases with nothing, very little, very much, very many frames, and a repeat.

use super::*;
use crate::{
    Error,
    panorama::{
        depth::box_depth,
        source::{PanoramaFrame, PanoramaSource},
    },
    scene::Scene,
};

pub const CASES: &[Case] = &[
    Case {
        name: "empty_scene",
        asks: "Without an object, looking at the seam: is the picture the panorama?",
        metric: "largest difference to the panorama, steps of 8 bits, 2 frames",
        unit: "/255",
        limit: 0.5,
        reason: "half a step of 8 bits: nothing changes where nothing happens",
        must_fail: &[],
        run: empty_scene,
    },
    Case {
        name: "odd_sizes",
        asks: "Pictures of 1×1, 7×5, 33×17 and 65×9 pixels: are they right to the last pixel?",
        metric: "mean difference to the truth of the worst row or column of the worst size, steps of 8 bits, 16 frames each",
        unit: "/255",
        limit: 8.0,
        reason: "the noise of so few pixels is not what is asked; a pixel that is missing is far above",
        must_fail: &[],
        run: odd_sizes,
    },
    Case {
        name: "large_panorama",
        asks: "A panorama of 8192×4096 texels, seen from beside the capture point: are the walls where they are?",
        metric: "error of the distance that 99 % of the pixels stay within, of the distance (quick: 8192×128)",
        unit: "",
        limit: 0.005,
        reason: "half a percent is what depth cameras reach",
        must_fail: &[],
        run: large_panorama,
    },
    Case {
        name: "many_frames",
        asks: "10,000 frames of 32×24 pixels: no drift, no NaN, no growth of memory?",
        metric: "mean FLIP to the truth of the mean of the last 32 frames; not finite also where device memory grew (quick: 160 frames)",
        unit: "",
        limit: SEEN,
        reason: "FLIP 0.05: a drift that is seen when the two pictures are flipped",
        must_fail: &[],
        run: many_frames,
    },
    Case {
        name: "determinism",
        asks: "The same seed again: are the bits the same?",
        metric: "values that differ between two runs of 4 frames",
        unit: "",
        limit: 0.0,
        reason: "same seed, device and driver: same bits",
        must_fail: &[],
        run: determinism,
    },
];

fn empty_scene(run: &Run) -> Result<Outcome> {
    let film = Film { panorama: [128, 64], ..Film::still(run.size(), 2, || room(colourful, Vec3::Z, 60.0)) };
    run.worst(&film, [0], |test, truth| Ok(metric::codes(test, &truth.without, &vec![true; test.len()], 1.0, 1.0)))
}

fn ball() -> World {
    World {
        things: vec![Thing::ball(0.35, 0.5, vec3(0.15, FLOOR + 0.35, -1.5))],
        ..room(even, vec3(0.1, -1.1, -1.5), 50.0)
    }
}

fn odd_sizes(run: &Run) -> Result<Outcome> {
    let mut worst: Option<Outcome> = None;
    for (which, size) in [[1, 1], [7, 5], [33, 17], [65, 9]].into_iter().enumerate() {
        // A single pixel has no neighbours by which an edge in it could be found, so it looks at the ball
        // alone.
        let fov_y = if size == [1, 1] { 12.0 } else { 50.0 };
        let film = Film::still(size, 16, move || {
            let world = ball();
            World { eye: super::Eye { target: world.things[0].at, fov_y, ..world.eye }, ..world }
        });
        let test = run.play(&film)?.remove(0);
        let truth = run.truth(&film, which, 0).texels.clone();
        let difference = |(a, b): (&[f32; 4], &[f32; 4])| {
            (0..3).map(|c| f64::from((metric::shown(a[c], 1.0) - metric::shown(b[c], 1.0)).abs())).sum::<f64>() / 3.0
        };
        let value = match metric::is_finite(&test) {
            true => {
                let apart: Vec<f64> = test.iter().zip(&truth).map(difference).collect();
                let [width, height] = size.map(|side| side as usize);
                let row = |y: usize| apart[y * width..(y + 1) * width].iter().sum::<f64>() / width as f64;
                let column = |x: usize| (0..height).map(|y| apart[y * width + x]).sum::<f64>() / height as f64;
                255.0 * (0..height).map(row).chain((0..width).map(column)).fold(0.0, f64::max)
            }
            false => metric::NOT_FINITE,
        };
        if worst.as_ref().is_none_or(|w| value > w.value) {
            worst = Some(Outcome { value, size, worst: test, truth, exposure: 1.0 });
        }
    }
    worst.ok_or_else(|| Error::Internal("odd_sizes: no size".into()))
}

fn large_panorama(run: &Run) -> Result<Outcome> {
    let large = [8192, run.count(4096, 128) as u32];
    let frame = PanoramaFrame {
        color_size: [64, 32],
        radiance: vec![[0.5, 0.5, 0.5, 1.0]; 64 * 32].into(),
        depth_size: large,
        depth: box_depth(large, super::ROOM.high - super::ROOM.low, Vec3::ZERO, 0.0),
        ..PanoramaFrame::default()
    };
    // These are directions towards columns beyond 4096, that is to the right and behind.
    let (at, target, fov_y) = (vec3(0.3, 0.2, -0.4), vec3(2.0, 0.1, 0.8), 60.0);
    // Surfaces are found only if there is something to light them, so a ball stands behind the camera.
    let world = World {
        eye: super::Eye { at, target, fov_y },
        things: vec![Thing::ball(0.2, 0.5, vec3(-2.0, 0.0, -1.0))],
        ..room(even, target, fov_y)
    };
    let film = Film { panorama: [64, 32], ..Film::still(run.size(), 1, move || world.clone()) };
    let truth = run.truth(&film, 0, 0);
    let mut scene = film.scene()?;
    scene.panorama = PanoramaSource::from_frames(vec![frame], FPS, Vec3::ZERO, 0.0)?;
    let mut renderer = self::renderer(run, &scene, &film)?;
    renderer.render(&scene, 0.0)?;
    let found = renderer.aov("position_real")?;
    let distance = |p: Vec3| p.distance(at);
    let pairs = found.iter().zip(&truth.position);
    let mut errors: Vec<f64> = pairs
        .map(|(p, expected)| match p[3] > 0.0 {
            true => f64::from((distance(Vec3::from_slice(p)) / distance(*expected) - 1.0).abs()),
            false => 1.0,
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    let value = errors[(0.99 * (errors.len() - 1) as f64) as usize];
    // The picture shows distances.
    let grey = |d: f32| [0.15 * d, 0.15 * d, 0.15 * d, 1.0];
    let worst = found.iter().map(|p| grey(p[3])).collect();
    let truth = truth.position.iter().map(|p| grey(distance(*p))).collect();
    Ok(Outcome { value, size: film.size, worst, truth, exposure: 1.0 })
}

fn renderer(run: &Run, scene: &Scene, film: &Film) -> Result<crate::renderer::Renderer> {
    run.renderer(scene, run.options(film.size, &film.set)?)
}

fn many_frames(run: &Run) -> Result<Outcome> {
    let (frames, size) = (run.count(10_000, 160), [32, 24]);
    let film = Film::moving(size, 128, |n| {
        let mut world = ball();
        // The ball moves to and fro, and rests for the second half.
        world.things[0].at.x += if n < 64 { 0.4 * (n as f32 * std::f32::consts::TAU / 64.0).sin() } else { 0.0 };
        world
    });
    let scene = film.scene()?;
    let mut renderer = renderer(run, &scene, &film)?;
    let (mut memory, mut sum, mut finite) = (0, vec![[0.0; 4]; (size[0] * size[1]) as usize], true);
    for n in 0..frames {
        // The last frames are at rest.
        let phase = (128 - frames % 128 + n) % 128;
        renderer.render(&scene, film.time(phase))?;
        if n == 10 {
            memory = run.gpu().device_bytes();
        }
        if n % 1000 == 999 || n + 32 >= frames {
            let picture = renderer.picture()?;
            finite &= metric::is_finite(&picture);
            if n + 32 >= frames {
                sum.iter_mut().zip(&picture).for_each(|(s, p)| (0..4).for_each(|c| s[c] += p[c] / 32.0));
            }
        }
    }
    let truth = run.truth(&film, 0, 127);
    let grew = run.gpu().device_bytes() > memory;
    let everywhere = vec![true; sum.len()];
    let value = match finite && !grew {
        true => metric::flip(size, &sum, &truth.texels, &everywhere, 1.0)?,
        false => metric::NOT_FINITE,
    };
    Ok(Outcome { value, size, worst: sum, truth: truth.texels.clone(), exposure: 1.0 })
}

fn determinism(run: &Run) -> Result<Outcome> {
    let film = || {
        Film::moving(run.size(), 4, |n| {
            let mut world = ball();
            world.things[0].at.x += 0.05 * n as f32;
            world
        })
    };
    let (first, again) = (run.play(&film())?, run.play(&film())?);
    let differ = |(a, b): (&metric::Texels, &metric::Texels)| {
        a.iter().flatten().zip(b.iter().flatten()).filter(|(x, y)| x.to_bits() != y.to_bits()).count()
    };
    let value = first.iter().zip(&again).map(differ).sum::<usize>() as f64;
    let last = film().frames - 1;
    Ok(Outcome { value, size: run.size(), worst: again[last].clone(), truth: first[last].clone(), exposure: 1.0 })
}
