//! Metrics of the difference between a picture and the truth. Some compare radiance. Others compare what is
//! displayed: the radiance times the exposure, clipped and sRGB-encoded.

use crate::{Error, Result, image_file::write::display_code};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A picture of linear radiance, row 0 on top.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    /// What error messages call the picture.
    pub subject: &'a str,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// RGBA. Alpha is not compared.
    pub texels: &'a [[f32; 4]],
}

/// All metrics over one region.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Root of the mean squared difference of radiance.
    pub rmse: f64,
    /// Mean of (test − truth)²/(truth² + 0.01).
    pub relmse: f64,
    /// PSNR of the displayed picture for a peak of 1, in decibels. It is 999 if both pictures are the same.
    pub psnr: f64,
    /// SSIM of the displayed picture, as the mean over its channels: Wang et al. 2004 with an 11×11 Gaussian
    /// window of σ 1.5.
    pub ssim: f64,
    /// LDR-FLIP (Andersson et al. 2020) of the displayed 8-bit picture at 67 pixels a degree, by NVIDIA's
    /// implementation.
    pub flip: f64,
    /// Largest difference of radiance.
    pub max_abs: f64,
    /// Mean of the test divided by the mean of the truth. It is 1 if both are black.
    #[serde(deserialize_with = "or_infinite")]
    pub mean_ratio: f64,
    /// Number of pixels in the region.
    pub pixels: u64,
    /// What is left without the truth's own noise, if the truth has two independent halves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_free: Option<NoiseFree>,
}

/// Errors without the truth's own noise. Instead of (x − T)² they average (x − A)·(x − B) over two independent
/// halves A and B of the truth: where x is right, the expected value is 0, however noisy the halves are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NoiseFree {
    /// Root of the mean product; 0 if chance makes the mean negative.
    pub rmse: f64,
    /// Mean of the product over (T² + 0.01), with T the mean of both halves. Chance can make it negative.
    pub relmse: f64,
}

impl NoiseFree {
    /// Compares a picture with both halves, over the pixels where `mask` is true or over all pixels. All have
    /// the same size. The result is `None` for a region without a pixel.
    pub fn of(test: &[[f32; 4]], [a, b]: [&[[f32; 4]]; 2], mask: Option<&[bool]>) -> Option<Self> {
        let (mut square, mut relative, mut samples) = (0.0, 0.0, 0.0);
        for i in (0..test.len()).filter(|i| mask.is_none_or(|mask| mask[*i])) {
            for c in 0..3 {
                let [x, a, b] = [test, a, b].map(|texels| f64::from(texels[i][c]));
                let (product, truth) = ((x - a) * (x - b), 0.5 * (a + b));
                square += product;
                relative += product / (truth * truth + 0.01);
                samples += 1.0;
            }
        }
        (samples > 0.0).then(|| Self { rmse: (square / samples).max(0.0).sqrt(), relmse: relative / samples })
    }
}

impl Metrics {
    /// The means over several frames. `max_abs` is the largest value instead, and `pixels` the sum. The
    /// result is `None` if there are no frames.
    pub fn mean(frames: &[Self]) -> Option<Self> {
        let (first, n) = (frames.first()?, frames.len() as f64);
        let mean = |of: fn(&Self) -> f64| frames.iter().map(of).sum::<f64>() / n;
        Some(Self {
            rmse: mean(|m| m.rmse),
            relmse: mean(|m| m.relmse),
            psnr: mean(|m| m.psnr),
            ssim: mean(|m| m.ssim),
            flip: mean(|m| m.flip),
            max_abs: frames.iter().fold(first.max_abs, |a, b| a.max(b.max_abs)),
            mean_ratio: mean(|m| m.mean_ratio),
            pixels: frames.iter().map(|m| m.pixels).sum(),
            noise_free: None,
        })
    }
}

/// Pixels per degree that FLIP is computed for. A monitor 0.7 m and 3840 pixels wide has as many, seen from
/// 0.7 m.
const PIXELS_PER_DEGREE: f32 = 67.0;

/// The value of [`Metrics::psnr`] for two pictures that are the same.
pub const SAME_PSNR: f64 = 999.0;

/// The FLIP error of each pixel, from 0 to 1.
pub fn flip_map(test: Picture, truth: Picture, exposure: f32) -> Result<Vec<f32>> {
    check(test, truth)?;
    let image = |picture: Picture| {
        let codes: Vec<u8> =
            picture.texels.iter().flat_map(|t| [0, 1, 2].map(|c| display_code(exposure * t[c]))).collect();
        nv_flip::FlipImageRgb8::with_data(picture.size[0], picture.size[1], &codes)
    };
    Ok(nv_flip::flip(image(truth), image(test), PIXELS_PER_DEGREE).to_vec())
}

/// Compares two pictures over the pixels where `mask` is true, or over all pixels. FLIP and SSIM depend on
/// neighbours. They are computed on the full picture and then averaged over the region.
///
/// # Errors
/// Fails if the sizes differ, if a radiance is not finite, or if the region is empty.
pub fn compare(test: Picture, truth: Picture, mask: Option<&[bool]>, exposure: f32) -> Result<Metrics> {
    let mut metrics = compare_regions(test, truth, &[mask], exposure)?;
    metrics
        .pop()
        .flatten()
        .ok_or_else(|| Error::input("--mask", "no pixel is in the region", "give a mask with a bright part"))
}

/// Compares like [`compare`], over several regions. The result is `None` for a region without a pixel.
///
/// # Errors
/// Fails if the sizes differ, or if a radiance is not finite.
pub fn compare_regions(
    test: Picture,
    truth: Picture,
    masks: &[Option<&[bool]>],
    exposure: f32,
) -> Result<Vec<Option<Metrics>>> {
    let flip = flip_map(test, truth, exposure)?;
    let ssim = ssim_map(&displayed(test, exposure), &displayed(truth, exposure), test.size);
    Ok(masks.iter().map(|mask| over(test, truth, *mask, exposure, &flip, &ssim)).collect())
}

fn over(
    test: Picture,
    truth: Picture,
    mask: Option<&[bool]>,
    exposure: f32,
    flip: &[f32],
    ssim: &[f32],
) -> Option<Metrics> {
    let inside: Vec<usize> = (0..test.texels.len()).filter(|i| mask.is_none_or(|mask| mask[*i])).collect();
    if inside.is_empty() {
        return None;
    }
    let (mut square, mut relative, mut display, mut largest) = (0.0, 0.0, 0.0, 0.0f64);
    let (mut sum_test, mut sum_truth) = (0.0, 0.0);
    for &i in &inside {
        for c in 0..3 {
            let (a, b) = (f64::from(test.texels[i][c]), f64::from(truth.texels[i][c]));
            let d = a - b;
            square += d * d;
            relative += d * d / (b * b + 0.01);
            largest = largest.max(d.abs());
            sum_test += a;
            sum_truth += b;
            let seen = show(test.texels[i][c] * exposure) - show(truth.texels[i][c] * exposure);
            display += f64::from(seen) * f64::from(seen);
        }
    }
    let samples = 3.0 * inside.len() as f64;
    let mean = |map: &[f32]| inside.iter().map(|i| f64::from(map[*i])).sum::<f64>() / inside.len() as f64;
    Some(Metrics {
        rmse: (square / samples).sqrt(),
        relmse: relative / samples,
        psnr: if display > 0.0 { (-10.0 * (display / samples).log10()).min(SAME_PSNR) } else { SAME_PSNR },
        ssim: mean(ssim),
        flip: mean(flip),
        max_abs: largest,
        mean_ratio: if sum_truth == 0.0 && sum_test == 0.0 { 1.0 } else { sum_test / sum_truth },
        pixels: inside.len() as u64,
        noise_free: None,
    })
}

/// Reads null as infinity. JSON writes null for an infinite ratio, which stands for light over a black truth.
fn or_infinite<'de, D: serde::Deserializer<'de>>(from: D) -> std::result::Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or(f64::INFINITY))
}

/// The sRGB code of a value, clipped to 0..1.
pub(super) fn show(linear: f32) -> f32 {
    crate::image_file::srgb::linear_to_srgb(linear.clamp(0.0, 1.0))
}

fn displayed(picture: Picture, exposure: f32) -> [Vec<f32>; 3] {
    [0, 1, 2].map(|c| picture.texels.iter().map(|t| show(exposure * t[c])).collect())
}

fn check(test: Picture, truth: Picture) -> Result<()> {
    if test.size != truth.size {
        let problem =
            format!("is {}×{}, {} is {}×{}", test.size[0], test.size[1], truth.subject, truth.size[0], truth.size[1]);
        return Err(Error::input(test.subject, problem, "compare pictures of one size"));
    }
    for picture in [test, truth] {
        let bad = picture.texels.iter().filter(|t| !t[..3].iter().all(|v| v.is_finite())).count();
        if bad > 0 {
            return Err(Error::input(
                picture.subject,
                format!("{bad} pixels are not finite"),
                "nothing can be measured on them",
            ));
        }
    }
    Ok(())
}

/// The structural similarity around each pixel, as the mean over the channels. The picture is reflected at
/// its borders.
fn ssim_map(test: &[Vec<f32>; 3], truth: &[Vec<f32>; 3], size: [u32; 2]) -> Vec<f32> {
    const C1: f32 = 0.01 * 0.01;
    const C2: f32 = 0.03 * 0.03;
    let product = |a: &[f32], b: &[f32]| -> Vec<f32> { a.iter().zip(b).map(|(a, b)| a * b).collect() };
    let channels: Vec<Vec<f32>> = (0..3)
        .into_par_iter()
        .map(|c| {
            let (x, y) = (&test[c], &truth[c]);
            let (mx, my) = (blur(x, size), blur(y, size));
            let (xx, yy, xy) = (blur(&product(x, x), size), blur(&product(y, y), size), blur(&product(x, y), size));
            let at = |i: usize| {
                let (vx, vy, cov) = (xx[i] - mx[i] * mx[i], yy[i] - my[i] * my[i], xy[i] - mx[i] * my[i]);
                (2.0 * mx[i] * my[i] + C1) * (2.0 * cov + C2) / ((mx[i] * mx[i] + my[i] * my[i] + C1) * (vx + vy + C2))
            };
            (0..x.len()).map(at).collect()
        })
        .collect();
    (0..channels[0].len()).map(|i| (channels[0][i] + channels[1][i] + channels[2][i]) / 3.0).collect()
}

/// Blurs with a Gaussian of σ 1.5 over 11×11 pixels.
fn blur(values: &[f32], [width, height]: [u32; 2]) -> Vec<f32> {
    let kernel: Vec<f32> = (-5i32..=5).map(|k| (-(k * k) as f32 / 4.5).exp()).collect();
    let total: f32 = kernel.iter().sum();
    let (width, height) = (width as i32, height as i32);
    // … 1 0 | 0 1 2 … n−1 | n−1 n−2 …
    let reflect = |i: i32, n: i32| {
        let m = i.rem_euclid(2 * n);
        if m < n { m } else { 2 * n - 1 - m }
    };
    let pass = |from: &[f32], across: bool| -> Vec<f32> {
        let at = |i: i32| {
            let (x, y) = (i % width, i / width);
            let tap = |(k, w): (i32, &f32)| {
                let (x, y) = if across { (reflect(x + k, width), y) } else { (x, reflect(y + k, height)) };
                w * from[(y * width + x) as usize]
            };
            (-5..=5).zip(&kernel).map(tap).sum::<f32>() / total
        };
        (0..width * height).map(at).collect()
    };
    pass(&pass(values, true), false)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [48, 40];

    /// A picture with edges and gradients.
    fn scene() -> Vec<[f32; 4]> {
        let texel = |i: u32| {
            let (x, y) = (i % SIZE[0], i / SIZE[0]);
            let v = if (x / 8 + y / 8) % 2 == 0 { 0.2 } else { 0.6 };
            [v + 0.005 * x as f32, v, 0.9 - v + 0.004 * y as f32, 1.0]
        };
        (0..SIZE[0] * SIZE[1]).map(texel).collect()
    }

    fn picture<'a>(subject: &'a str, texels: &'a [[f32; 4]]) -> Picture<'a> {
        Picture { subject, size: SIZE, texels }
    }

    fn metrics(test: &[[f32; 4]], truth: &[[f32; 4]]) -> Metrics {
        compare(picture("test", test), picture("truth", truth), None, 1.0).expect("can be compared")
    }

    #[test]
    fn the_same_picture_is_perfect() {
        let m = metrics(&scene(), &scene());
        assert_eq!((m.rmse, m.relmse, m.psnr, m.flip, m.max_abs, m.mean_ratio), (0.0, 0.0, SAME_PSNR, 0.0, 0.0, 1.0));
        assert!((m.ssim - 1.0).abs() < 1e-6 && m.pixels == 48 * 40);
    }

    #[test]
    fn known_differences_have_known_values() {
        let truth = vec![[0.25, 0.25, 0.25, 1.0]; 48 * 40];
        let test = vec![[0.5, 0.25, 0.25, 1.0]; 48 * 40];
        let m = metrics(&test, &truth);
        let third = 1.0f64 / 3.0;
        assert!((m.rmse - 0.25 * third.sqrt()).abs() < 1e-9);
        assert!((m.relmse - third * 0.0625 / (0.0625 + 0.01)).abs() < 1e-9);
        // sRGB(0.5) − sRGB(0.25) = 0.735357 − 0.537099
        assert!((m.psnr - -10.0 * (third * 0.198258f64.powi(2)).log10()).abs() < 1e-3, "{}", m.psnr);
        assert!((m.max_abs - 0.25).abs() < 1e-9 && (m.mean_ratio - 4.0 * third).abs() < 1e-6);
        // Flat pictures have no structure, so the luminance term of one channel of three is left.
        let (x, y) = (0.735_357_f64, 0.537_099_f64);
        let expected = (2.0 + (2.0 * x * y + 1e-4) / (x * x + y * y + 1e-4)) / 3.0;
        assert!((m.ssim - expected).abs() < 1e-4, "{} instead of {expected}", m.ssim);
    }

    #[test]
    fn noise_of_the_truth_is_no_error() {
        // Both halves are noisy, with noise of 0.1 that differs. The second picture is 0.02 too bright.
        let truth = scene();
        let noise = |seed: u32| {
            let value = |i: usize| (i as u32 ^ seed.wrapping_mul(0x9E37_79B9)).wrapping_mul(0x85EB_CA6B);
            let wave = move |i: usize| if (value(i) ^ (value(i) >> 15)).count_ones() % 2 == 0 { 0.1 } else { -0.1 };
            truth.iter().enumerate().map(move |(i, t)| t.map(|v| v + wave(i))).collect::<Vec<_>>()
        };
        let (a, b) = (noise(1), noise(2));
        let brighter: Vec<_> = truth.iter().map(|t| t.map(|v| v + 0.02)).collect();
        let free = |test: &[[f32; 4]]| NoiseFree::of(test, [&a, &b], None).expect("pixels");
        assert!(metrics(&truth, &a).rmse > 0.099);
        assert!(free(&truth).rmse < 0.03 && free(&truth).relmse.abs() < 0.01, "{:?}", free(&truth));
        let gained = free(&brighter).rmse.powi(2) - free(&truth).rmse.powi(2);
        assert!(gained > 0.0 && free(&brighter).rmse < 0.045, "{gained}, {:?}", free(&brighter));
        // Without noise it is the plain error.
        let exact = NoiseFree::of(&brighter, [&truth, &truth], None).expect("pixels");
        let plain = metrics(&brighter, &truth);
        assert!((exact.rmse - plain.rmse).abs() < 1e-9 && (exact.relmse - plain.relmse).abs() < 1e-9);
        assert_eq!(NoiseFree::of(&truth, [&a, &b], Some(&vec![false; truth.len()])), None);
    }

    #[test]
    fn shifted_and_black_pictures_are_bad() {
        let truth = scene();
        let mut shifted = truth.clone();
        shifted.rotate_right(3);
        let black = vec![[0.0, 0.0, 0.0, 1.0]; truth.len()];
        let (shift, dark) = (metrics(&shifted, &truth), metrics(&black, &truth));
        assert!(shift.flip > 0.1 && shift.ssim < 0.7 && shift.psnr < 20.0, "{shift:?}");
        assert!(dark.flip > 0.3 && dark.ssim < 0.2 && dark.mean_ratio == 0.0, "{dark:?}");
    }

    #[test]
    fn a_region_counts_its_own_pixels() {
        let truth = scene();
        let mut test = truth.clone();
        test.iter_mut().take(10).for_each(|t| t[0] += 1.0);
        let mask: Vec<bool> = (0..truth.len()).map(|i| i >= 48 * 30).collect();
        let m = compare(picture("test", &test), picture("truth", &truth), Some(&mask), 1.0).expect("can be compared");
        assert_eq!((m.rmse, m.pixels), (0.0, 480));
        let nothing = vec![false; truth.len()];
        compare(picture("test", &test), picture("truth", &truth), Some(&nothing), 1.0).expect_err("an empty region");
    }

    #[test]
    fn what_is_not_finite_or_has_another_size_is_refused() {
        let truth = scene();
        let mut test = truth.clone();
        test[7][1] = f32::NAN;
        let error = compare(picture("test", &test), picture("truth", &truth), None, 1.0).expect_err("NaN");
        assert!(error.to_string().contains("1 pixels are not finite"), "{error}");
        let small = Picture { subject: "small", size: [40, 40], texels: &truth[..1600] };
        let error = compare(small, picture("truth", &truth), None, 1.0).expect_err("sizes differ");
        assert!(error.to_string().contains("40×40") && error.to_string().contains("48×40"), "{error}");
    }
}
