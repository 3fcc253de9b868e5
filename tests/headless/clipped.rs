//! Lamps that an 8-bit capture clips get their light back, by the light that they cast: in the built-in rooms, captured with exposures that clip
//! 0.1 to 5 % of the texels. HDR captures are left alone, and so is what the picture shows.

use crate::common::*;
use iprt::{
    image_file::{srgb::srgb_to_linear, write::display_code},
    panorama::{
        clipped::{self, Clipped},
        mapping::texel_direction,
        source::PanoramaFrame,
    },
    reference::capture::{CaptureSettings, room_frames},
    scene::rooms::{NAMES, Video, by_name},
};

/// The exposure at which a share of the texels clips.
fn exposure(frame: &PanoramaFrame, share: f32) -> f32 {
    let mut largest: Vec<f32> = frame.radiance.iter().map(|t| t[0].max(t[1]).max(t[2])).collect();
    largest.sort_by(|a, b| b.total_cmp(a));
    1.0 / largest[(share * largest.len() as f32) as usize]
}

/// What an 8-bit camera keeps of it, sRGB, in the units of the scene.
fn coded(frame: &PanoramaFrame, exposure: f32) -> PanoramaFrame {
    let value = |v: f32| srgb_to_linear(f32::from(display_code(v * exposure)) / 255.0) / exposure;
    let radiance = frame.radiance.iter().map(|t| [value(t[0]), value(t[1]), value(t[2]), 1.0]).collect();
    PanoramaFrame { radiance, white: Some(1.0 / exposure), ..frame.clone() }
}

/// The light of the texels that clip: as it is, as captured, and as estimated.
fn light(frame: &PanoramaFrame, coded: &PanoramaFrame, white: f32) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for (at, (is, seen)) in frame.radiance.iter().zip(coded.radiance.iter()).enumerate() {
        if seen[0].max(seen[1]).max(seen[2]) < 0.955 * white {
            continue;
        }
        let size = frame.color_size;
        let d = texel_direction(at as u32 % size[0], at as u32 / size[0], size);
        let weight = (1.0 - d.y * d.y).sqrt();
        let luminance = |t: &[f32; 4]| f64::from(0.2126 * t[0] + 0.7152 * t[1] + 0.0722 * t[2]);
        sums[0] += weight * luminance(&is);
        sums[1] += weight * luminance(&seen);
        sums[2] += weight * luminance(&seen) * f64::from(seen[3]);
    }
    sums
}

#[test]
fn clipped_lamps_get_back_the_light_that_they_cast() {
    validated(|gpu| {
        let mut wrong = Vec::new();
        for name in NAMES {
            let mut room = by_name(name).expect("a built-in room");
            let size = [256, 128];
            room.video = room.video.map(|video| Video { frames: 1, size, ..video });
            let settings = CaptureSettings { size, samples: 24, progress: false, ..Default::default() };
            let frame = room_frames(gpu, &room, &settings, None).expect("captures").swap_remove(0);
            for share in [0.001, 0.05] {
                let exposure = exposure(&frame, share);
                let mut coded = coded(&frame, exposure);
                let white = 1.0 / exposure;
                let found = clipped::estimate(&coded, white);
                found.raise(&mut coded, white);
                let [is, captured, estimated] = light(&frame, &coded, white);
                println!(
                    "{name}, {share}: captured {:.3}, estimated {:.3}; {:.2?}",
                    captured / is,
                    estimated / is,
                    found.lamps
                );
                if !(0.5..2.0).contains(&(estimated / is)) {
                    wrong.push(format!("{name} {share}: {}", estimated / is));
                }
            }
        }
        assert!(wrong.is_empty(), "{wrong:?}");
    });
}

#[test]
fn what_is_not_clipped_is_left_alone() {
    let frame = room([128, 64], glam::vec3(4.0, 3.0, 5.0), glam::Vec3::ZERO, |d| glam::Vec3::splat(0.5 + 0.3 * d.y));
    let found = clipped::estimate(&frame, 1.0);
    assert_eq!(found, Clipped::default());
    let mut same = frame.clone();
    found.raise(&mut same, 1.0);
    assert_eq!(same.radiance, frame.radiance);
}
