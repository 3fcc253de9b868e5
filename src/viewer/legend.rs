//! Explains the colours of the picture, over the picture.

use super::{session::Session, state::Compare};
use crate::passes::display::Meaning;
use egui::{Align2, Color32, FontId, Mesh, Pos2, Rect, Shape, pos2, vec2};

/// Width of the text and of the scale, points.
const WIDTH: f32 = 260.0;

/// What the legend says, and whose colours it explains. `None` if the picture shows the scene as it looks, or if the
/// picture is too small. It is about what is shown now, which may not be what was asked for last.
fn words(session: &Session, rect: Rect) -> Option<(String, Option<Meaning>)> {
    if rect.width() < 2.0 * WIDTH {
        return None;
    }
    let mut lines = Vec::new();
    let mut look = None;
    let difference = session.shown.difference.as_ref().filter(|_| session.compare == Compare::Difference);
    let picture = difference.or(session.shown.pictures[0].as_ref())?;
    if difference.is_some() {
        look = Some(Meaning::Difference);
        lines.push(format!("A − B\n{}", Meaning::Difference.legend()));
    } else {
        if picture.aov != "radiance" {
            look = Some(Meaning::of(&picture.aov));
            lines.push(format!("{}\n{}", picture.aov, Meaning::of(&picture.aov).legend()));
        }
        match session.compare {
            Compare::Difference => lines.push("A − B is being prepared".to_owned()),
            _ if picture.aov != session.aov => lines.push(format!("{} is being prepared", session.aov)),
            _ => {}
        }
    }
    if picture.marked {
        lines.push("pink stripes: never seen by the capture".to_owned());
    }
    (!lines.is_empty()).then(|| (lines.join("\n"), look))
}

/// The width of the picture that the legend leaves free on its left, points.
pub fn beside(session: &Session, rect: Rect) -> f32 {
    rect.width() - if words(session, rect).is_some() { WIDTH + 24.0 } else { 16.0 }
}

/// Draws the legend into the lower right corner.
pub fn show(session: &Session, painter: &egui::Painter, rect: Rect) {
    let Some((text, look)) = words(session, rect) else { return };
    let galley = painter.layout(text, FontId::proportional(13.0), Color32::WHITE, WIDTH);
    let scale = look.and_then(Meaning::scale);
    let height = galley.size().y + if scale.is_some() { 34.0 } else { 0.0 };
    let size = vec2(if scale.is_some() { WIDTH } else { galley.size().x }, height);
    let place = Align2::RIGHT_BOTTOM.anchor_size(rect.right_bottom() + vec2(-8.0, -8.0), size);
    painter.rect_filled(place.expand(4.0), 3.0, Color32::from_black_alpha(170));
    painter.galley(place.min, galley, Color32::WHITE);
    if let (Some(ends), Some(look)) = (scale, look) {
        let bar = Rect::from_min_max(pos2(place.min.x, place.max.y - 30.0), pos2(place.max.x, place.max.y - 16.0));
        painter.add(Shape::mesh(bar_of(look, bar)));
        let corners = [(bar.left_bottom(), Align2::LEFT_TOP), (bar.right_bottom(), Align2::RIGHT_TOP)];
        for (text, (at, align)) in ends.into_iter().zip(corners) {
            painter.text(at, align, text, FontId::proportional(12.0), Color32::WHITE);
        }
    }
}

fn bar_of(look: Meaning, bar: Rect) -> Mesh {
    const STEPS: u32 = 32;
    let mut mesh = Mesh::default();
    for k in 0..=STEPS {
        let x = k as f32 / STEPS as f32;
        let [r, g, b] = look.color(x).map(|c| (255.0 * c).round() as u8);
        let at = |y: f32| -> Pos2 { pos2(bar.min.x + x * bar.width(), y) };
        mesh.colored_vertex(at(bar.min.y), Color32::from_rgb(r, g, b));
        mesh.colored_vertex(at(bar.max.y), Color32::from_rgb(r, g, b));
        if k > 0 {
            mesh.add_triangle(2 * k - 2, 2 * k - 1, 2 * k);
            mesh.add_triangle(2 * k - 1, 2 * k, 2 * k + 1);
        }
    }
    mesh
}
