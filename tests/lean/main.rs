//! What a build is without: the window where that is left out, and planted faults where they were not asked for. It runs in
//! every build: `cargo test --no-default-features --test lean`.

#[test]
fn every_build_renders() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = folder.path().join("scene.toml");
    let color = folder.path().join("grey.png");
    let grey = image::RgbImage::from_pixel(16, 8, image::Rgb([90, 90, 90]));
    grey.save(&color).expect("a picture");
    let text = "[panorama]\ncolor = \"grey.png\"\ndepth = 2.0\n[[object]]\nname = \"ball\"\nshape = \"sphere\"\n\
                size = [0.5, 0.5, 0.5]\ntranslation = [0, 0, -1.2]\n";
    std::fs::write(&scene, text).expect("a scene");
    let picture = folder.path().join("picture.png");
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_iprt"));
    command.args(["render", "--size", "24x16", "--warmup", "2", "--validation", "-q", "-o"]).arg(&picture).arg(&scene);
    let output = command.env("IPRT_CACHE", folder.path()).output().expect("the program runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let picture = image::open(&picture).expect("it was written").into_rgb8();
    let centre = picture.get_pixel(12, 8);
    assert!(picture.dimensions() == (24, 16) && centre != picture.get_pixel(0, 0), "a ball before a wall: {centre:?}");
}

#[cfg(not(feature = "viewer"))]
#[test]
fn a_build_without_the_window_says_so() {
    for arguments in [&["view"][..], &["view", "scene.toml", "--size", "40x30"]] {
        let output =
            std::process::Command::new(env!("CARGO_BIN_EXE_iprt")).args(arguments).output().expect("the program runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        assert!(said.contains("has no window") && said.contains("viewer"), "{said}");
    }
}

/// The shaders' constant is there by its name, as an instruction of the SPIR-V, where faults can be planted.
#[test]
fn faults_are_in_no_program_that_did_not_ask_for_them() {
    let program = std::fs::read(env!("CARGO_BIN_EXE_iprt")).expect("the program is there");
    let holds = |word: &[u8]| program.windows(word.len()).any(|part| part == word);
    assert!(holds(b"\0\0in_view\0"), "names in SPIR-V are found in this way");
    assert_eq!(holds(b"\0\0FAULT\0\0\0"), cfg!(feature = "faults"));
}
