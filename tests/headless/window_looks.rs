//! What stands over the window's picture: the pixels under the pointer, and what the picture does not show yet.

use crate::view::{Display, picture, room, start, until};

#[test]
fn the_pixels_under_the_pointer_are_shown_large() {
    let (folder, display) = (room(), Display::start());
    let script = "
        key P
        settle 4
        move 66,70
        key M
        settle 32
        screenshot shot.png
        await seen
        key M
        wait 3
        await gone
    ";
    let session = start(&folder, &display, script, "scene.toml");
    // Not half of the height of 120: six squares of eight pixels. They are on the side that is far from the pointer.
    let count = 6;
    let corner = [160 - 8 - 8 * count, 60 - 4 * count];
    let squares = |screen: &image::RgbImage, shot: &image::RgbImage| {
        let [first_x, first_y] = [66 - count / 2, 70 - count / 2];
        let apart = |x: u32, y: u32| {
            let middle = screen.get_pixel(corner[0] + 8 * x + 4, corner[1] + 8 * y + 4);
            let pixel = shot.get_pixel(first_x + x, first_y + y);
            middle.0.iter().zip(pixel.0).map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0)
        };
        // The line below covers the last row in so small a window.
        (0..count - 1).flat_map(|y| (0..count).map(move |x| (x, y))).map(|(x, y)| apart(x, y)).max().unwrap_or(255)
    };
    let mut last = 255;
    until("the pixels", || {
        let shot = folder.path("shot.png");
        shot.exists() && {
            last = squares(&display.screen([160, 120]), &picture(&shot));
            last < 16
        }
    });
    folder.write("seen", "");
    let shot = picture(&folder.path("shot.png"));
    until("the picture alone", || squares(&display.screen([160, 120]), &shot) > 20);
    folder.write("gone", "");
    let report = session.finish();
    assert_eq!(report.0["errors"], serde_json::json!([]));
}
