//! What a PNG says about its colours (W3C PNG, third edition, 4.3): cICP goes before iCCP, that before sRGB,
//! and that before gAMA and cHRM.

use super::color_space::{ColorSpace, Primaries, Transfer};

/// Reads the chunks before the pixels. `None` leaves it to the ICC profile, or to sRGB.
pub(super) fn color_space(bytes: &[u8]) -> Option<ColorSpace> {
    let word = |bytes: &[u8]| bytes.first_chunk().map(|word| u32::from_be_bytes(*word));
    let (mut gamma, mut primaries, mut profile) = (None, None, false);
    let mut rest = bytes.get(8..)?;
    while let Some(length) = word(rest) {
        let kind = rest.get(4..8)?;
        let data = rest.get(8..8_usize.checked_add(length as usize)?)?;
        match kind {
            b"cICP" => {
                if let Some(space) = ColorSpace::of_code_points(*data.first()?, *data.get(1)?) {
                    return Some(space);
                }
            }
            b"iCCP" => profile = true,
            b"sRGB" if !profile => return Some(ColorSpace::SRGB),
            b"gAMA" => gamma = word(data).filter(|gamma| *gamma > 0).map(|gamma| f64::from(gamma) / 1e5),
            b"cHRM" => {
                let numbers: Vec<f64> =
                    data.as_chunks().0.iter().map(|w| f64::from(u32::from_be_bytes(*w)) / 1e5).collect();
                if let [wx, wy, rx, ry, gx, gy, bx, by] = numbers[..] {
                    primaries = Some(Primaries { white: [wx, wy], red: [rx, ry], green: [gx, gy], blue: [bx, by] });
                }
            }
            b"IDAT" | b"IEND" => break,
            _ => {}
        }
        rest = rest.get(12 + length as usize..)?;
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
        let transfer = |chunks: &[(&[u8; 4], &[u8])]| color_space(&png(chunks)).map(|space| space.transfer);
        assert_eq!(transfer(&[(b"gAMA", &gamma(100_000))]), Some(Transfer::Linear));
        assert_eq!(transfer(&[(b"gAMA", &gamma(45_455))]), Some(Transfer::Srgb));
        assert_eq!(transfer(&[(b"gAMA", &gamma(50_000))]), Some(Transfer::Gamma(2.0)));
        assert_eq!(transfer(&[(b"gAMA", &gamma(100_000)), (b"sRGB", &[0])]), Some(Transfer::Srgb));
        assert_eq!(transfer(&[(b"iCCP", b"x"), (b"gAMA", &gamma(100_000))]), None, "the profile is read elsewhere");
        assert_eq!(transfer(&[(b"cICP", &[9, 16, 0, 1]), (b"sRGB", &[0])]), Some(Transfer::Pq));
        assert_eq!(transfer(&[(b"IDAT", b"x"), (b"gAMA", &gamma(100_000))]), None);
        assert!(color_space(&png(&[(b"gAMA", &[1])])).is_none() && color_space(b"PNG").is_none());
    }
}
