//! What a PNG says about its colours (W3C PNG, third edition, 4.3): cICP goes before iCCP, that before sRGB,
//! and that before gAMA and cHRM. Before there was cICP the name of a profile stood for PQ (W3C png-hdr-pq).

use super::color_space::{ColorSpace, Primaries, Transfer};
use std::io::Read;

/// The name of a profile whose curve is none that a profile can hold.
const PQ_PROFILE: &[u8] = b"ITUR_2100_PQ_FULL\0";

/// Reads the chunks before the pixels. `None` leaves it to the ICC profile, or to sRGB.
pub(super) fn color_space(file: &mut impl Read) -> Option<ColorSpace> {
    let word = |bytes: &[u8]| bytes.first_chunk().map(|word| u32::from_be_bytes(*word));
    let (mut gamma, mut primaries, mut profile, mut named, mut bits) = (None, None, false, None, 8);
    let mut head = [0; 8];
    file.read_exact(&mut head).ok()?;
    while file.read_exact(&mut head).is_ok() {
        let [length, kind] = [word(&head)?, word(&head[4..])?];
        let kind = &kind.to_be_bytes();
        if kind == b"IDAT" || kind == b"IEND" {
            break;
        }
        let mut data = Vec::new();
        file.by_ref().take(u64::from(length) + 4).read_to_end(&mut data).ok()?;
        let data = data.get(..length as usize)?;
        match kind {
            // A palette has 8 bits, and what is smaller is stretched.
            b"IHDR" => bits = (*data.get(8)?).max(8),
            b"cICP" => {
                if let Some(space) = ColorSpace::of_code_points(*data.first()?, *data.get(1)?) {
                    return Some(if data.get(3) == Some(&0) { space.narrow(bits) } else { space });
                }
            }
            b"iCCP" => {
                profile = true;
                named = data.starts_with(PQ_PROFILE).then(|| ColorSpace::of_code_points(9, 16)).flatten();
            }
            b"sRGB" if !profile => return Some(ColorSpace::SRGB),
            b"gAMA" => gamma = word(data).filter(|gamma| *gamma > 0).map(|gamma| f64::from(gamma) / 1e5),
            b"cHRM" => {
                let numbers: Vec<f64> =
                    data.as_chunks().0.iter().map(|w| f64::from(u32::from_be_bytes(*w)) / 1e5).collect();
                if let [wx, wy, rx, ry, gx, gy, bx, by] = numbers[..] {
                    primaries = Some(Primaries { white: [wx, wy], red: [rx, ry], green: [gx, gy], blue: [bx, by] });
                }
            }
            _ => {}
        }
    }
    if named.is_some() {
        return named;
    }
    if profile || (gamma.is_none() && primaries.is_none()) {
        return None;
    }
    let transfer = match gamma {
        // What sRGB is nearest to: writers give it beside or in place of the sRGB chunk.
        None => Transfer::Srgb,
        Some(gamma) if (gamma - 0.45455).abs() < 5e-3 => Transfer::Srgb,
        Some(gamma) if (gamma - 1.0).abs() < 1e-3 => Transfer::Linear,
        Some(gamma) => Transfer::Gamma((1.0 / gamma) as f32),
    };
    Some(ColorSpace { transfer, to_rec709: primaries.and_then(Primaries::to_rec709) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
        let mut bytes = vec![0; 8];
        for (kind, data) in chunks {
            bytes.extend((data.len() as u32).to_be_bytes());
            bytes.extend(*kind);
            bytes.extend(*data);
            bytes.extend([0; 4]);
        }
        bytes
    }

    #[test]
    fn chunks_are_heard_in_their_order_of_rank() {
        let gamma = |value: u32| value.to_be_bytes();
        let transfer = |chunks: &[(&[u8; 4], &[u8])]| color_space(&mut &png(chunks)[..]).map(|space| space.transfer);
        assert_eq!(transfer(&[(b"gAMA", &gamma(100_000))]), Some(Transfer::Linear));
        assert_eq!(transfer(&[(b"gAMA", &gamma(45_455))]), Some(Transfer::Srgb));
        assert_eq!(transfer(&[(b"gAMA", &gamma(50_000))]), Some(Transfer::Gamma(2.0)));
        assert_eq!(transfer(&[(b"gAMA", &gamma(100_000)), (b"sRGB", &[0])]), Some(Transfer::Srgb));
        assert_eq!(transfer(&[(b"iCCP", b"x"), (b"gAMA", &gamma(100_000))]), None, "the profile is read elsewhere");
        assert_eq!(transfer(&[(b"cICP", &[9, 16, 0, 1]), (b"sRGB", &[0])]), Some(Transfer::Pq));
        let header: &[u8] = &[0, 0, 0, 1, 0, 0, 0, 1, 16, 2, 0, 0, 0];
        let narrow = Some(Transfer::Narrow { bits: 16, curve: Box::new(Transfer::Pq) });
        assert_eq!(transfer(&[(b"IHDR", header), (b"cICP", &[9, 16, 0, 0])]), narrow);
        let profile: &[u8] = b"ITUR_2100_PQ_FULL\0\0";
        assert_eq!(transfer(&[(b"iCCP", profile)]), Some(Transfer::Pq));
        assert_eq!(transfer(&[(b"iCCP", profile), (b"cICP", &[1, 13, 0, 1])]), Some(Transfer::Srgb));
        assert_eq!(transfer(&[(b"IDAT", b"x"), (b"gAMA", &gamma(100_000))]), None);
        assert!(color_space(&mut &png(&[(b"gAMA", &[1])])[..]).is_none() && color_space(&mut &b"PNG"[..]).is_none());
    }
}
