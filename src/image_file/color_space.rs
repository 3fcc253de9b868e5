//! What stored colours mean: a transfer curve and primaries. Both lead to linear Rec. 709.

use super::srgb::srgb_to_linear;
use glam::{DMat3, DVec2, DVec3, Mat3, Vec3};
use moxcms::{ColorProfile, DataColorSpace};

/// How a stored value becomes linear.
#[derive(Clone, Debug, PartialEq)]
pub enum Transfer {
    Srgb,
    Linear,
    /// A power.
    Gamma(f32),
    /// ITU-R BT.709's camera curve, which BT.2020 has, too.
    Bt709,
    /// SMPTE ST 2084, with 203 cd/m² as 1 (ITU-R BT.2408).
    Pq,
    /// ARIB STD-B67, scene light, with the reference white of 0.75 as 1.
    Hlg,
    /// Of red, green and blue, at equally spaced values from 0 to 1.
    Table([Vec<f32>; 3]),
    /// A curve over the narrow range of so many bits: black is 16 and white 235, with 8 bits.
    Narrow {
        bits: u8,
        curve: Box<Transfer>,
    },
}

impl Transfer {
    /// Returns the linear value of a stored one (0..1) of a channel (0 red, 1 green, 2 blue).
    pub fn linear(&self, code: f32, channel: usize) -> f32 {
        match self {
            Self::Srgb => srgb_to_linear(code),
            Self::Linear => code,
            Self::Gamma(power) => code.powf(*power),
            Self::Bt709 if code < 0.081 => code / 4.5,
            Self::Bt709 => ((code + 0.099) / 1.099).powf(1.0 / 0.45),
            Self::Pq => {
                let root = code.powf(1.0 / 78.84375);
                let ratio = (root - 0.835_937_5).max(0.0) / (18.851_563 - 18.6875 * root);
                ratio.powf(1.0 / 0.159_301_76) * (10000.0 / 203.0)
            }
            Self::Hlg => hlg(code) / hlg(0.75),
            Self::Narrow { bits, curve } => {
                let eighths = code * (256.0 - (8.0 - f32::from(*bits)).exp2());
                curve.linear(((eighths - 16.0) / 219.0).max(0.0), channel)
            }
            Self::Table(curves) => {
                let curve = &curves[channel.min(2)];
                let at = code.clamp(0.0, 1.0) * (curve.len() - 1) as f32;
                let (below, above) = (at.floor() as usize, at.ceil() as usize);
                curve[below] + (curve[above] - curve[below]) * at.fract()
            }
        }
    }

    /// Says whether 1 is where a camera saturates, and not just a bright value.
    pub fn saturates_at_one(&self) -> bool {
        match self {
            Self::Pq | Self::Hlg => false,
            Self::Narrow { curve, .. } => curve.saturates_at_one(),
            _ => true,
        }
    }
}

fn hlg(code: f32) -> f32 {
    let high = || (((code - 0.559_910_7) / 0.178_832_77).exp() + 0.284_668_92) / 12.0;
    if code <= 0.5 { code * code / 3.0 } else { high() }
}

/// What the numbers of an image file mean.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorSpace {
    pub transfer: Transfer,
    /// From linear values to Rec. 709; `None` if they are.
    pub to_rec709: Option<Mat3>,
}

impl ColorSpace {
    /// What image files are by default.
    pub const SRGB: Self = Self { transfer: Transfer::Srgb, to_rec709: None };
    pub(super) const LINEAR: Self = Self { transfer: Transfer::Linear, to_rec709: None };

    /// Returns linear Rec. 709. Colours beyond it are cut off.
    pub fn rec709(&self, linear: Vec3) -> Vec3 {
        match self.to_rec709 {
            Some(matrix) if linear.is_finite() => (matrix * linear).max(Vec3::ZERO),
            _ => linear,
        }
    }

    /// Reads an ICC profile. `None` if it is not one of red, green and blue with curves.
    pub(super) fn of_icc(profile: &[u8]) -> Option<Self> {
        const STEPS: usize = 4096;
        let profile = ColorProfile::new_from_slice(profile).ok()?;
        if profile.color_space != DataColorSpace::Rgb {
            return None;
        }
        let curve = |curve: &Option<moxcms::ToneReprCurve>| {
            let evaluator = curve.as_ref()?.make_linear_evaluator().ok()?;
            Some((0..=STEPS).map(|i| evaluator.evaluate_value(i as f32 / STEPS as f32)).collect::<Vec<_>>())
        };
        let curves = [curve(&profile.red_trc)?, curve(&profile.green_trc)?, curve(&profile.blue_trc)?];
        let matrix = profile.transform_matrix(&ColorProfile::new_srgb());
        let matrix = DMat3::from_cols_array_2d(&matrix.v).transpose();
        // Most profiles are sRGB in other words.
        let is_srgb = curves
            .iter()
            .all(|curve| (0..=STEPS).all(|i| (curve[i] - srgb_to_linear(i as f32 / STEPS as f32)).abs() < 2e-3));
        let transfer = if is_srgb { Transfer::Srgb } else { Transfer::Table(curves) };
        Some(Self { transfer, to_rec709: unless_identity(matrix) })
    }

    /// The same colours, with codes of so many bits in the narrow range.
    pub(super) fn narrow(self, bits: u8) -> Self {
        Self { transfer: Transfer::Narrow { bits, curve: Box::new(self.transfer) }, ..self }
    }

    /// Reads the code points of ITU-T H.273.
    pub fn of_code_points(primaries: u8, transfer: u8) -> Option<Self> {
        let to_rec709 = match primaries {
            1 | 2 => None,
            9 => Primaries::REC2020.to_rec709(),
            11 => Primaries { white: [0.314, 0.351], ..Primaries::P3 }.to_rec709(),
            12 => Primaries::P3.to_rec709(),
            _ => return None,
        };
        let transfer = match transfer {
            2 | 13 => Transfer::Srgb,
            1 | 6 | 14 | 15 => Transfer::Bt709,
            4 => Transfer::Gamma(2.2),
            5 => Transfer::Gamma(2.8),
            8 => Transfer::Linear,
            16 => Transfer::Pq,
            18 => Transfer::Hlg,
            _ => return None,
        };
        Some(Self { transfer, to_rec709 })
    }
}

/// CIE xy of red, green, blue and white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Primaries {
    pub red: [f64; 2],
    pub green: [f64; 2],
    pub blue: [f64; 2],
    pub white: [f64; 2],
}

const D65: [f64; 2] = [0.3127, 0.329];

impl Primaries {
    const REC709: Self = Self { red: [0.64, 0.33], green: [0.3, 0.6], blue: [0.15, 0.06], white: D65 };
    const REC2020: Self = Self { red: [0.708, 0.292], green: [0.17, 0.797], blue: [0.131, 0.046], white: D65 };
    const P3: Self = Self { red: [0.68, 0.32], green: [0.265, 0.69], blue: [0.15, 0.06], white: D65 };

    /// Returns the matrix from linear RGB to XYZ, in which white has Y = 1.
    fn to_xyz(self) -> DMat3 {
        let columns = DMat3::from_cols(xyz(self.red), xyz(self.green), xyz(self.blue));
        let weights = columns.inverse() * xyz(self.white);
        columns * DMat3::from_diagonal(weights)
    }

    /// Returns the matrix to Rec. 709, with white adapted by Bradford; `None` if there is nothing to do, or
    /// if these are no primaries.
    pub fn to_rec709(self) -> Option<Mat3> {
        let usable = |at: [f64; 2]| DVec2::from(at).is_finite() && at[1].abs() > 1e-6;
        if ![self.red, self.green, self.blue, self.white].into_iter().all(usable) {
            return None;
        }
        unless_identity(Self::REC709.to_xyz().inverse() * adaptation(self.white) * self.to_xyz())
    }
}

/// Returns the matrix from CIE XYZ with a white to linear Rec. 709.
pub(super) fn xyz_to_rec709(white: [f64; 2]) -> Mat3 {
    (Primaries::REC709.to_xyz().inverse() * adaptation(white)).as_mat3()
}

fn xyz([x, y]: [f64; 2]) -> DVec3 {
    DVec3::new(x / y, 1.0, (1.0 - x - y) / y)
}

/// Bradford's adaptation of a white to D65.
fn adaptation(white: [f64; 2]) -> DMat3 {
    let cones = DMat3::from_cols_array(&[0.8951, -0.7502, 0.0389, 0.2664, 1.7135, -0.0685, -0.1614, 0.0367, 1.0296]);
    let gains = (cones * xyz(D65)) / (cones * xyz(white));
    cones.inverse() * DMat3::from_diagonal(gains) * cones
}

fn unless_identity(matrix: DMat3) -> Option<Mat3> {
    let known = matrix.is_finite() && !matrix.abs_diff_eq(DMat3::IDENTITY, 2e-3);
    known.then(|| matrix.as_mat3())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn primaries_lead_to_rec709() {
        assert_eq!(Primaries::REC709.to_rec709(), None);
        // Rec. 2020 to Rec. 709 as ITU-R BT.2087 has it.
        let matrix = Primaries::REC2020.to_rec709().expect("another space");
        let right =
            Mat3::from_cols_array(&[1.6605, -0.1246, -0.0182, -0.5876, 1.1329, -0.1006, -0.0728, -0.0083, 1.1187]);
        assert!(matrix.abs_diff_eq(right, 1e-3), "{matrix}");
        // White stays white, whatever it is.
        let ap0 =
            Primaries { red: [0.7347, 0.2653], green: [0.0, 1.0], blue: [0.0001, -0.077], white: [0.32168, 0.33767] };
        assert!((ap0.to_rec709().expect("another space") * Vec3::ONE).abs_diff_eq(Vec3::ONE, 1e-4));
        assert_eq!(Primaries { white: [0.3, 0.0], ..ap0 }.to_rec709(), None);
    }

    #[test]
    fn curves_meet_their_reference_points() {
        let at = |transfer: Transfer, code| transfer.linear(code, 0);
        assert!((at(Transfer::Pq, 0.580_69) - 1.0).abs() < 0.01, "203 cd/m²");
        assert!((at(Transfer::Hlg, 0.75) - 1.0).abs() < 1e-5);
        assert!((at(Transfer::Bt709, 1.0) - 1.0).abs() < 1e-5);
        let narrow = |bits| Transfer::Narrow { bits, curve: Box::new(Transfer::Linear) };
        assert!((at(narrow(8), 126.0 / 255.0) - 110.0 / 219.0).abs() < 1e-5);
        assert!((at(narrow(16), 126.0 * 256.0 / 65535.0) - 110.0 / 219.0).abs() < 1e-5);
        assert_eq!(at(narrow(8), 0.0), 0.0);
        assert_eq!(at(Transfer::Table([vec![0.0, 0.5, 2.0], vec![0.0], vec![0.0]]), 0.75), 1.25);
        let p3 = ColorProfile::new_display_p3().encode().expect("a profile");
        let space = ColorSpace::of_icc(&p3).expect("read");
        assert_eq!(space.transfer, Transfer::Srgb);
        assert!(space.to_rec709.expect("P3").abs_diff_eq(Primaries::P3.to_rec709().expect("P3"), 5e-3));
        let srgb = ColorProfile::new_srgb().encode().expect("a profile");
        assert_eq!(ColorSpace::of_icc(&srgb), Some(ColorSpace::SRGB));
        assert_eq!(ColorSpace::of_icc(b"none"), None);
    }
}
