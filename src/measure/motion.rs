//! Finds where the surface in each pixel was one frame before, from a renderer's images `motion` and
//! `position`.

/// The images of one frame, as [`Renderer::aov`](crate::renderer::Renderer::aov) returns them.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// Each texel holds the way to the previous frame in pixels, the distance from the previous camera in
    /// metres (0 where there is no surface), and the object id.
    pub motion: &'a [[f32; 4]],
    /// The fourth channel is the distance from the camera in metres.
    pub position: Option<&'a [[f32; 4]]>,
}

/// Two distances of the same surface differ by at most this share.
const SAME_DISTANCE: f32 = 0.03;

/// Returns each pixel's way to where its surface was one frame before, in pixels to the right and down. The
/// way is NaN if the surface was not seen then, because it was outside the picture or behind another object.
/// Where `before` has positions, it may also have been behind another part of the same object.
pub fn motion(size: [u32; 2], now: Seen, before: Seen) -> Vec<[f32; 2]> {
    let way = |(index, [x, y, distance, id]): (usize, &[f32; 4])| {
        let own = [index as u32 % size[0], index as u32 / size[0]];
        let at = [own[0] as f32 + x, own[1] as f32 + y].map(f32::round);
        let within = *distance > 0.0 && (0..2).all(|k| at[k] >= 0.0 && at[k] < size[k] as f32);
        let then = if within { at[1] as usize * size[0] as usize + at[0] as usize } else { return [f32::NAN; 2] };
        let nearby = |p: &[[f32; 4]]| (p[then][3] - distance).abs() <= SAME_DISTANCE * distance;
        let same = before.motion[then][2] > 0.0 && before.motion[then][3] == *id && before.position.is_none_or(nearby);
        if same { [*x, *y] } else { [f32::NAN; 2] }
    };
    now.motion.iter().enumerate().map(way).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_hidden_has_no_past() {
        // This is a row of five pixels. Object 7 moves one pixel to the right, before a wall 3 m away.
        let wall = [0.0, 0.0, 3.0, 0.0];
        let object = [-1.0, 0.0, 2.0, 7.0];
        let before = [wall, object, wall, wall, wall];
        let now = [wall, wall, object, wall, [9.0, 0.0, 3.0, 0.0]];
        let found = motion([5, 1], Seen { motion: &now, position: None }, Seen { motion: &before, position: None });
        assert_eq!([found[0], found[2], found[3]], [[0.0, 0.0], [-1.0, 0.0], [0.0, 0.0]]);
        assert!(found[1][0].is_nan() && found[4][0].is_nan(), "uncovered; from outside: {found:?}");
        // Real surfaces hide each other. The surface of the fourth pixel was 1 m away one frame ago.
        let positions = [3.0, 2.0, 3.0, 1.0, 3.0].map(|d| [0.0, 0.0, 0.0, d]);
        let seen = Seen { motion: &before, position: Some(&positions) };
        let found = motion([5, 1], Seen { motion: &now, position: None }, seen);
        assert!(found[0] == [0.0, 0.0] && found[2] == [-1.0, 0.0] && found[3][0].is_nan(), "{found:?}");
        // No pixel shows a surface.
        let nothing = [[0.0; 4]; 5];
        let found = motion([5, 1], Seen { motion: &nothing, position: None }, seen);
        assert!(found.iter().all(|way| way[0].is_nan()));
    }
}
