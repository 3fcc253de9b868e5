//! Closed forms.

use super::*;

const SIZE: [u32; 2] = [24, 16];
const PIXELS: usize = 24 * 16;

type Pictures = Vec<Vec<[f32; 4]>>;

fn frames<'a>(subject: &'a str, frames: &'a Pictures) -> Sequence<'a> {
    Sequence { subject, size: SIZE, frames }
}

/// Frames from displayed values, so that what is measured is what is written here.
fn sequence(count: usize, value: impl Fn(usize, usize, usize) -> f32) -> Pictures {
    let linear = |v: f32| crate::image_file::srgb::srgb_to_linear(v);
    let texel = |t: usize, i: usize| [0, 1, 2, 3].map(|c| linear(value(t, i % 24, i / 24) * [1.0, 0.8, 0.6, 1.0][c]));
    (0..count).map(|t| (0..PIXELS).map(|i| texel(t, i)).collect()).collect()
}

/// The mean of the channels' factors above, and of their squares.
const CHANNELS: f64 = 0.8;

/// White noise of variance 1, the same for the same numbers.
fn noise(t: usize, x: usize, y: usize, seed: usize) -> f32 {
    let uniform = |k: usize| crate::scene::rooms::kit::hash((t * 24 + x) as i32, (y * 7 + k) as i32, seed as u32);
    // twelve uniform numbers less six
    (0..12).map(|k| uniform(k * 131)).sum::<f32>() - 6.0
}

/// A wall on whose left half a shadow falls from frame 4 on.
fn shaded(t: usize, x: usize) -> f32 {
    if t >= 4 && x < 12 { 0.3 } else { 0.7 }
}

fn step() -> Pictures {
    sequence(40, |t, x, _| shaded(t, x))
}

/// As an exponential history shows the step.
fn history(alpha: f32) -> Pictures {
    sequence(40, |t, x, _| {
        let made = if t < 4 { 0.0 } else { 1.0 - (1.0 - alpha).powi(t as i32 - 3) };
        shaded(0, x) + made * (shaded(4, x) - shaded(0, x))
    })
}

fn lag_of(test: &Pictures, truth: &Pictures) -> Lag {
    lag(frames("test", test), frames("truth", truth), None, 1.0).expect("can be measured")
}

fn ghost_of(test: &Pictures, truth: &Pictures) -> f64 {
    ghost_energy(frames("test", test), frames("truth", truth), None, 1.0).expect("can be measured")
}

#[test]
fn flicker_is_the_standard_deviation_of_what_is_displayed() {
    let measure = |sequence: &Pictures, mask| flicker(frames("test", sequence), mask, 1.0).expect("can be measured");
    assert_eq!(measure(&sequence(8, |_, x, y| 0.02 * (x + y) as f32), None), 0.0);
    // ±0.1 by turns: 0.1 √(n/(n − 1))
    let turns = sequence(8, |t, _, _| if t % 2 == 0 { 0.5 } else { 0.3 });
    let expected = CHANNELS * 0.1 * (8.0f64 / 7.0).sqrt();
    assert!((measure(&turns, None) - expected).abs() < 1e-6, "{}", measure(&turns, None));
    // Noise of a known σ, on one half.
    let noisy = sequence(64, |t, x, y| 0.5 + if x < 12 { 0.02 * noise(t, x, y, 3) } else { 0.0 });
    let left: Vec<bool> = (0..PIXELS).map(|i| i % 24 < 12).collect();
    let (whole, half) = (measure(&noisy, None), measure(&noisy, Some(&left)));
    assert!((half / (CHANNELS * 0.02) - 1.0).abs() < 0.02 && (half / whole - 2.0).abs() < 1e-9, "{half} {whole}");
    // Exposure acts before the display: what is clipped does not flicker.
    assert_eq!(flicker(frames("test", &turns), None, 100.0).expect("can be measured"), 0.0);
}

#[test]
fn lag_of_an_exponential_history() {
    let truth = step();
    assert_eq!(lag_of(&truth, &truth), Lag::Frames(1));
    for alpha in [0.95f32, 0.5, 0.3, 0.2, 0.1] {
        let expected = (0.1f64.ln() / (1.0 - f64::from(alpha)).ln()).ceil() as u32;
        assert_eq!(lag_of(&history(alpha), &truth), Lag::Frames(expected), "{alpha}");
    }
    assert_eq!(lag_of(&history(0.05), &truth), Lag::Never);
}

#[test]
fn lag_despite_noise_offset_and_a_truth_that_takes_its_time() {
    let truth = step();
    let noisy = |of: &Pictures, sigma: f32, seed: usize| -> Pictures {
        let texel = |t: usize, i: usize| {
            let add = 0.08 + sigma * noise(t, i % 24, i / 24, seed);
            of[t][i].map(|v| crate::image_file::srgb::srgb_to_linear(show(v) + add))
        };
        (0..of.len()).map(|t| (0..PIXELS).map(|i| texel(t, i)).collect()).collect()
    };
    assert_eq!(lag_of(&noisy(&history(0.3), 0.05, 1), &noisy(&truth, 0.02, 2)), Lag::Frames(7));
    // A shadow that leaves one half for the other: the mean never changes.
    let moved = |delay: usize| sequence(20, move |t, x, _| if (t >= 6 + delay) == (x < 12) { 0.3 } else { 0.7 });
    assert_eq!(lag_of(&moved(3), &moved(0)), Lag::Frames(4));
    // The truth takes ten frames, the test is two frames behind it.
    let ramp = |late: f32| sequence(20, move |t, _, _| 0.2 + 0.05 * (t as f32 - 4.0 - late).clamp(0.0, 10.0));
    assert_eq!(lag_of(&ramp(2.0), &ramp(0.0)), Lag::Frames(3));
    // Ahead of the truth is not late.
    assert_eq!(lag_of(&ramp(0.0), &ramp(2.0)), Lag::Frames(1));
}

#[test]
fn without_a_change_there_is_no_lag() {
    let still = sequence(20, |_, x, y| 0.02 * (x + y) as f32);
    assert_eq!(lag_of(&step()[..20].to_vec(), &still), Lag::NoChange);
    let noisy = sequence(20, |t, x, y| 0.5 + 0.05 * noise(t, x, y, 9));
    assert_eq!(lag_of(&still, &noisy), Lag::NoChange);
    // a region that the shadow does not touch
    let right: Vec<bool> = (0..PIXELS).map(|i| i % 24 >= 12).collect();
    let found = lag(frames("test", &step()), frames("truth", &step()), Some(&right), 1.0);
    assert_eq!(found.expect("can be measured"), Lag::NoChange);
    // two frames are enough for a step
    let two = step()[3..5].to_vec();
    assert_eq!(lag_of(&two, &two), Lag::Frames(1));
}

#[test]
fn ghost_energy_is_the_share_of_the_past() {
    let truth = step();
    assert_eq!(ghost_of(&truth, &truth), 0.0);
    for k in [-0.2f32, 0.1, 0.4, 1.0] {
        let leftover = sequence(40, |t, x, _| shaded(t, x) + k * (shaded(0, x) - shaded(t, x)));
        assert!((ghost_of(&leftover, &truth) - f64::from(k)).abs() < 1e-5, "{k}: {}", ghost_of(&leftover, &truth));
    }
    // A bar that moves and leaves a trail; one that is noisy; one that is too bright as a whole.
    let bar = |t: usize, x: usize| if x >= t && x < t + 4 { 0.3 } else { 0.6 };
    let moving = sequence(16, |t, x, _| bar(t, x));
    let trail = |k: f32| sequence(16, move |t, x, _| (1.0 - k) * bar(t, x) + k * bar(t.saturating_sub(4), x));
    let (small, large) = (ghost_of(&trail(0.1), &moving), ghost_of(&trail(0.3), &moving));
    assert!(small > 0.05 && (large / small - 3.0).abs() < 1e-4, "{small} {large}");
    let noisy = sequence(16, |t, x, y| bar(t, x) + 0.1 * noise(t, x, y, 4));
    assert!(ghost_of(&noisy, &moving).abs() < 0.01, "{}", ghost_of(&noisy, &moving));
    let still = sequence(16, |_, _, _| 0.5);
    assert_eq!(ghost_of(&moving, &still), 0.0);
}

#[test]
fn a_pattern_that_moves_as_told_is_steady() {
    let pattern = |x: f32, y: usize| 0.5 + 0.3 * (0.7 * x).sin() * (0.5 * y as f32).cos();
    let right = |speed: f32| sequence(6, move |t, x, y| pattern(x as f32 - speed * t as f32, y));
    let still = sequence(6, |_, _, _| 0.5);
    let told = |x: f32| vec![vec![[x, 0.0]; PIXELS]; 6];
    let measure = |test: &Pictures, truth: &Pictures, motion: Option<&[Vec<[f32; 2]>]>| {
        warped_difference(frames("test", test), frames("truth", truth), motion, None, 1.0).expect("can be measured")
    };
    let moving = right(2.0);
    assert!(measure(&moving, &still, Some(&told(-2.0))).abs() < 1e-6);
    assert!(measure(&moving, &still, Some(&told(2.0))) > 0.15, "the other way");
    assert!(measure(&moving, &still, None) > 0.1, "no motion");
    assert_eq!(measure(&moving, &moving, None), 0.0, "no more than the truth's own");
    assert!(measure(&still, &moving, None) < -0.1, "less than the truth's own");
    // half a pixel: bilinear, to the second derivative of the pattern
    assert!(measure(&right(0.5), &still, Some(&told(-0.5))) < 0.02);
    // Steps of 0.1 up and down on each pixel.
    let steps = sequence(6, |t, _, _| if t % 2 == 0 { 0.5 } else { 0.6 });
    assert!((measure(&steps, &still, None) - CHANNELS * 0.1).abs() < 1e-6);
    // What was hidden is left out: here all that changes.
    let opened = sequence(6, |t, x, _| if x == t { 0.9 } else { 0.4 });
    let gap = |t: usize, i: usize| if i % 24 == t || i % 24 + 1 == t { [f32::NAN; 2] } else { [0.0; 2] };
    let motion: Vec<Vec<[f32; 2]>> = (0..6).map(|t| (0..PIXELS).map(|i| gap(t, i)).collect()).collect();
    assert_eq!(measure(&opened, &still, Some(&motion)), 0.0);
    assert!(measure(&opened, &still, None) > 0.01);
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let good = step();
    let refused = |test: &Pictures, mask: Option<&[bool]>, word: &str| {
        let error = compare_sequence(frames("the test", test), frames("truth", &good), None, mask, 1.0);
        let text = error.expect_err(word).to_string();
        assert!(text.contains(word), "{text}");
    };
    refused(&good[..7].to_vec(), None, "the test: has 7 frames, truth has 40");
    let mut bad = good.clone();
    bad[5][9][1] = f32::NAN;
    refused(&bad, None, "the test: its frame 5 has pixels that are not finite");
    bad[5].pop();
    refused(&bad, None, "frame 5 has 383 pixels instead of 384");
    refused(&good, Some(&[false; PIXELS]), "no pixel is in the region");
    refused(&good, Some(&[true; 9]), "--mask: is of another size");
    let one = good[..1].to_vec();
    let error = flicker(frames("the test", &one), None, 1.0).expect_err("one frame").to_string();
    assert!(error.contains("the test: has 1 frames"), "{error}");
    let small = Sequence { subject: "small", size: [24, 8], frames: &good };
    let error = lag(small, frames("truth", &good), None, 1.0).expect_err("sizes").to_string();
    assert!(error.contains("small: is 24×8, truth is 24×16"), "{error}");
    let unseen = vec![vec![[f32::NAN; 2]; PIXELS]; 40];
    for motion in [&unseen[..], &unseen[..7]] {
        let found = compare_sequence(frames("the test", &good), frames("truth", &good), Some(motion), None, 1.0);
        let error = found.expect_err("no motion").to_string();
        assert!(error.contains("motion has another length") || error.contains("seen in two"), "{error}");
    }
}

#[test]
fn all_at_once_is_each_alone() {
    let (test, truth) = (history(0.3), step());
    let (a, b) = (frames("test", &test), frames("truth", &truth));
    let all = compare_sequence(a, b, None, None, 1.0).expect("can be measured");
    assert_eq!(all.flicker, flicker(a, None, 1.0).expect("can be measured"));
    assert_eq!(all.flicker_truth, flicker(b, None, 1.0).expect("can be measured"));
    assert_eq!(all.lag, Lag::Frames(7));
    assert_eq!(all.ghost_energy, ghost_energy(a, b, None, 1.0).expect("can be measured"));
    assert_eq!(all.warped_difference, warped_difference(a, b, None, None, 1.0).expect("can be measured"));
    let json = |lag: Lag| serde_json::to_value(TemporalMetrics { lag, ..all }).expect("JSON")["lag"].clone();
    assert_eq!(json(Lag::Frames(7)), serde_json::json!(7));
    assert_eq!((json(Lag::Never), json(Lag::NoChange)), (serde_json::json!("never"), serde_json::Value::Null));
}
