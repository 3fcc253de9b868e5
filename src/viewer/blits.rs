//! Where finished pictures go in the window.

use super::{
    loupe::Loupe,
    session::Session,
    state::{Compare, RenderedPicture},
};
use crate::gpu::Blit;

impl Session {
    /// The pictures, and where they go in the window.
    pub fn blits(&self) -> Vec<Blit> {
        let rect = self.picture * self.pixels_per_point;
        let [left, top, right, bottom] = [rect.min.x, rect.min.y, rect.max.x, rect.max.y].map(f32::round);
        let part = |picture: &RenderedPicture, from: f32, to: f32| {
            let [width, height] = picture.size.map(|side| side as f32);
            let across = |x: f32| left + (right - left) * x;
            Blit {
                image: picture.image.clone(),
                from: [width * from, 0.0, width * to, height],
                to: [across(from), top, across(to), bottom],
                smooth: !picture.is_full(),
            }
        };
        let [a, b] = &self.shown.pictures;
        let whole = |picture: &Option<RenderedPicture>| picture.iter().map(|p| part(p, 0.0, 1.0)).collect();
        let mut blits: Vec<Blit> = match self.compare {
            Compare::Single => whole(a),
            Compare::Split => {
                let a = a.iter().map(|p| part(p, 0.0, self.divider));
                a.chain(b.iter().map(|p| part(p, self.divider, 1.0))).collect()
            }
            Compare::Difference if self.shown.difference.is_some() => whole(&self.shown.difference),
            Compare::Difference => whole(a),
        };
        blits.extend(Loupe::of(self).map(|loupe| loupe.blit()));
        blits
    }
}
