//! Shows the pixels under the pointer, each as a square, at the side of the picture.

use super::{
    session::Session,
    state::{Compare, RenderedPicture},
};
use crate::gpu::Blit;
use egui::{Align2, Color32, FontId, Painter, Rect, Stroke, StrokeKind, pos2, vec2};

/// How large a pixel is shown, pixels of the window.
const ZOOM: u32 = 8;
/// The most pixels across.
const ACROSS: u32 = 33;

/// What of a picture is shown, and where.
pub struct Loupe<'a> {
    picture: &'a RenderedPicture,
    /// The pixel under the pointer.
    pixel: [u32; 2],
    /// The first pixel that is shown, and how many.
    first: [u32; 2],
    count: [u32; 2],
    /// Where it is in the window, pixels.
    corner: [f32; 2],
}

impl<'a> Loupe<'a> {
    /// Returns what there is to show: of the picture under the pointer, if the loupe is switched on.
    pub fn of(session: &'a Session) -> Option<Self> {
        let at = session.pointer.filter(|at| session.loupe && session.picture.contains(*at))?;
        let rect = session.picture;
        let place = (at - rect.min) / rect.size();
        let [a, b] = &session.shown.pictures;
        let picture = match session.compare {
            Compare::Split if place.x > session.divider => b,
            Compare::Difference if session.shown.difference.is_some() => &session.shown.difference,
            _ => a,
        };
        let picture = picture.as_ref()?;
        let room = session.pixels_per_point * rect.size().min_elem() * 0.45;
        let most = ((room / ZOOM as f32) as u32).min(ACROSS);
        let count = picture.size.map(|side| side.min(most));
        if most < 5 || count.contains(&0) {
            return None;
        }
        let pixel = [0, 1].map(|axis| ((place[axis] * picture.size[axis] as f32) as u32).min(picture.size[axis] - 1));
        let first =
            [0, 1].map(|axis| pixel[axis].saturating_sub(count[axis] / 2).min(picture.size[axis] - count[axis]));
        // On the side where the pointer is not, between the messages above and the lines below.
        let side = count.map(|count| (count * ZOOM) as f32);
        let [left, right] = [rect.min.x, rect.max.x].map(|x| (x * session.pixels_per_point).round());
        let x = if place.x > 0.5 { left + 8.0 } else { right - 8.0 - side[0] };
        let y = (rect.center().y * session.pixels_per_point - 0.5 * side[1]).round();
        Some(Self { picture, pixel, first, count, corner: [x, y] })
    }

    /// The copy of the pixels.
    pub fn blit(&self) -> Blit {
        let end = |from: f32, count: u32| from + count as f32;
        let [x, y] = self.first.map(|first| first as f32);
        let [left, top] = self.corner;
        let [w, h] = self.count;
        Blit {
            image: self.picture.image.clone(),
            from: [x, y, end(x, w), end(y, h)],
            to: [left, top, end(left, w * ZOOM), end(top, h * ZOOM)],
            smooth: false,
        }
    }

    /// Draws its frame, a mark around the pixel under the pointer, and which one that is.
    pub fn draw(&self, painter: &Painter, pixels_per_point: f32) {
        let rect = |from: [f32; 2], size: [u32; 2]| {
            let points = |value: f32| value / pixels_per_point;
            let [w, h] = size.map(|side| points((side * ZOOM) as f32));
            Rect::from_min_size(pos2(points(from[0]), points(from[1])), vec2(w, h))
        };
        let whole = rect(self.corner, self.count);
        let white = Stroke::new(1.0, Color32::WHITE);
        painter.rect_stroke(whole, 0.0, white, StrokeKind::Outside);
        let mark = [0, 1].map(|i| self.corner[i] + ((self.pixel[i] - self.first[i]) * ZOOM) as f32);
        painter.rect_stroke(
            rect(mark, [1, 1]),
            0.0,
            Stroke::new(1.0, Color32::from_rgb(255, 200, 80)),
            StrokeKind::Outside,
        );
        let ([x, y], [w, h]) = (self.pixel, self.picture.size);
        let galley = painter.layout_no_wrap(
            format!("pixel {x}, {y} of {w}×{h}, ×{ZOOM}"),
            FontId::proportional(13.0),
            Color32::WHITE,
        );
        let align = if whole.min.x - 16.0 < painter.clip_rect().min.x { Align2::LEFT_TOP } else { Align2::RIGHT_TOP };
        let at = if align == Align2::LEFT_TOP { whole.left_bottom() } else { whole.right_bottom() };
        let place = align.anchor_size(at + vec2(0.0, 6.0), galley.size());
        painter.rect_filled(place.expand(4.0), 3.0, Color32::from_black_alpha(170));
        painter.galley(place.min, galley, Color32::WHITE);
    }
}
