//! Where the pixels of a file are in the whole picture. Some files hold a part of a panorama and say where it
//! is: OpenEXR by its windows, photographs by Google's GPano.

use super::read::{MAX_PIXELS, Raster, Samples};

/// A part of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Placement {
    /// Width and height of the whole.
    pub whole: [u32; 2],
    /// The left upper corner of the part in the whole.
    pub at: [i64; 2],
    /// Width and height of the part.
    pub part: [u32; 2],
}

impl Placement {
    /// Says whether it is the whole picture.
    pub fn is_whole(&self) -> bool {
        self.at == [0, 0] && self.whole == self.part
    }

    /// Says whether any of the part is in the whole, and whether that can be held.
    pub fn is_usable(&self) -> bool {
        let [w, h] = self.whole.map(u64::from);
        let meets = |i: usize| self.at[i] < i64::from(self.whole[i]) && self.at[i] + i64::from(self.part[i]) > 0;
        w > 0 && h > 0 && w * h <= MAX_PIXELS && meets(0) && meets(1)
    }

    /// Puts the part's values into the whole, with `empty` around them.
    pub fn spread<T: Copy>(&self, values: &[T], channels: usize, empty: T) -> Vec<T> {
        let [width, height] = self.whole.map(|side| side as usize);
        let mut out = vec![empty; width * height * channels];
        for (y, row) in values.chunks_exact(self.part[0] as usize * channels).enumerate() {
            let (row_at, from) = (self.at[1] + y as i64, self.at[0]);
            if !(0..height as i64).contains(&row_at) {
                continue;
            }
            let (skip, start) = ((-from).max(0) as usize, from.max(0) as usize);
            let count = (self.part[0] as usize).saturating_sub(skip).min(width.saturating_sub(start));
            let target = (row_at as usize * width + start) * channels;
            out[target..target + count * channels].copy_from_slice(&row[skip * channels..(skip + count) * channels]);
        }
        out
    }

    /// Where a line of the part begins in the whole, how many of its pixels lie before that, and how many are in it;
    /// `None` if there are none.
    pub fn line(&self, [x, y]: [usize; 2], count: usize) -> Option<(usize, usize, usize)> {
        let [left, top] = [self.at[0] + x as i64, self.at[1] + y as i64];
        let [width, height] = self.whole.map(i64::from);
        let (first, end) = (left.max(0), (left + count as i64).min(width));
        ((0..height).contains(&top) && first < end)
            .then(|| ((top * width + first) as usize, (first - left) as usize, (end - first) as usize))
    }

    pub fn note(&self) -> String {
        let ([w, h], [x, y], [pw, ph]) = (self.whole, self.at, self.part);
        let covers = |at: i64, part: u32, whole: u32| at <= 0 && at + i64::from(part) >= i64::from(whole);
        let rest = match covers(x, pw, w) && covers(y, ph, h) {
            true => "what lies beyond is left out",
            false => "what lies around them is not known",
        };
        format!("holds {pw}x{ph} pixels at ({x}, {y}) of {w}x{h}: {rest}")
    }
}

/// Reads GPano's crop from XMP, for a file of this size, which may have been scaled since.
pub(super) fn gpano(xmp: &str, size: [u32; 2]) -> Option<Placement> {
    let number = |name: &str| -> Option<f64> {
        let at = xmp.find(&format!("GPano:{name}"))?;
        // Written as an attribute, or as an element.
        let value = xmp[at + 6 + name.len()..].trim_start_matches(['=', '>', '"', '\'', ' ']);
        let end = value.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(value.len());
        value[..end].parse().ok()
    };
    let full = [number("FullPanoWidthPixels")?, number("FullPanoHeightPixels")?];
    let part = [number("CroppedAreaImageWidthPixels")?, number("CroppedAreaImageHeightPixels")?];
    let at = [number("CroppedAreaLeftPixels").unwrap_or(0.0), number("CroppedAreaTopPixels").unwrap_or(0.0)];
    if part[0] < 1.0 || part[1] < 1.0 {
        return None;
    }
    let scale: [f64; 2] = std::array::from_fn(|i| f64::from(size[i]) / part[i]);
    let scaled = |values: [f64; 2]| -> [f64; 2] { std::array::from_fn(|i| (values[i] * scale[i]).round()) };
    let placement = Placement { whole: scaled(full).map(|x| x as u32), at: scaled(at).map(|x| x as i64), part: size };
    (!placement.is_whole() && placement.is_usable()).then_some(placement)
}

/// Puts a raster into the whole picture. Alpha is 0 where nothing is known.
pub(super) fn place(raster: Raster, placement: Placement) -> Raster {
    let with_alpha = raster.channels + usize::from(raster.channels % 2 == 1);
    fn spread<T: Copy>(values: &[T], from: usize, to: usize, opaque: T, empty: T, placement: &Placement) -> Vec<T> {
        let alpha = |pixel: &[T]| pixel.iter().copied().chain((from < to).then_some(opaque)).collect::<Vec<_>>();
        let values: Vec<T> = values.chunks_exact(from).flat_map(alpha).collect();
        placement.spread(&values, to, empty)
    }
    let (from, to) = (raster.channels, with_alpha);
    let samples = match &raster.samples {
        Samples::U8(values) => Samples::U8(spread(values, from, to, u8::MAX, 0, &placement)),
        Samples::U16(values) => Samples::U16(spread(values, from, to, u16::MAX, 0, &placement)),
        Samples::F32(values) => Samples::F32(spread(values, from, to, 1.0, 0.0, &placement)),
    };
    let mut notes = raster.notes;
    notes.push(placement.note());
    Raster { size: placement.whole, channels: to, samples, notes, ..raster }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crops_are_read_as_attributes_and_as_elements() {
        let attributes = r#"<rdf:Description GPano:FullPanoWidthPixels="128" GPano:FullPanoHeightPixels="64"
            GPano:CroppedAreaImageWidthPixels="128" GPano:CroppedAreaImageHeightPixels="40"
            GPano:CroppedAreaLeftPixels="0" GPano:CroppedAreaTopPixels="12"/>"#;
        let right = Placement { whole: [128, 64], at: [0, 12], part: [128, 40] };
        assert_eq!(gpano(attributes, [128, 40]), Some(right));
        let elements = attributes.replace("=\"", ">").replace("\" ", "</x> <").replace("\"\n", "</x>\n<");
        assert_eq!(gpano(&elements, [128, 40]), Some(right));
        assert_eq!(gpano(attributes, [64, 20]).map(|p| (p.whole, p.at)), Some(([64, 32], [0, 6])));
        assert_eq!(gpano("GPano:FullPanoWidthPixels", [4, 2]), None);
    }

    #[test]
    fn parts_are_put_in_place_and_cut_off() {
        let part = Placement { whole: [3, 2], at: [-1, 1], part: [2, 2] };
        assert_eq!(part.spread(&[1, 2, 3, 4], 1, 0), [0, 0, 0, 2, 0, 0]);
        assert!(part.is_usable() && !Placement { at: [3, 0], ..part }.is_usable());
    }
}
