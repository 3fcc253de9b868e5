//! A debug build takes up a changed shader without being built again, and says where one is broken.

use crate::common::validated;
use iprt::{
    gpu::{Bind, PassDeclaration, PushLayout, Threads},
    gpu_struct,
    shaders::Sources,
};
use std::{fs, path::Path};
use tempfile::TempDir;

gpu_struct! {
    struct AddPush {
        pub count: u32,
        pub amount: f32,
    }
}

/// A copy of the shaders.
pub fn copy() -> TempDir {
    let (from, to) = (Path::new(env!("CARGO_MANIFEST_DIR")), tempfile::tempdir().expect("a folder"));
    for folder in ["shaders/glsl", "tests/glsl"] {
        copy_folder(&from.join(folder), &to.path().join(folder));
    }
    to
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder");
    for entry in fs::read_dir(from).expect("a folder") {
        let entry = entry.expect("an entry");
        if entry.path().is_dir() {
            copy_folder(&entry.path(), &to.join(entry.file_name()));
        } else {
            fs::copy(entry.path(), to.join(entry.file_name())).expect("copied");
        }
    }
}

/// Replaces a part of a shader.
pub fn change(root: &Path, shader: &str, old: &str, new: &str) {
    let path = root.join(shader);
    let text = fs::read_to_string(&path).expect("a shader");
    assert!(text.contains(old), "{shader} has no \"{old}\"");
    fs::write(&path, text.replace(old, new)).expect("written");
}

#[test]
fn a_changed_shader_runs() {
    let root = copy();
    let before = Sources::at(root.path()).compile().expect("compiles");
    change(root.path(), "tests/glsl/add.comp", "+ push.amount", "- push.amount");
    let after = Sources::at(root.path()).compile().expect("compiles");
    let names = |old: &[(String, Vec<u32>)], new: &[(String, Vec<u32>)]| -> Vec<String> {
        old.iter().zip(new).filter(|(old, new)| old != new).map(|(_, (name, _))| name.clone()).collect()
    };
    assert_eq!(names(&before.shaders, &after.shaders), ["tests/glsl/add"]);
    assert_eq!(before.digest, after.digest, "truths do not depend on shaders of tests");

    let (_, spirv) = after.shaders.into_iter().find(|(name, _)| name == "tests/glsl/add").expect("it is there");
    validated(|gpu| {
        let declaration =
            PassDeclaration { name: "add", spirv: spirv.leak(), push: Some(PushLayout::of::<AddPush>()), structs: &[] };
        let from = gpu.buffer_with("from", &[1.0_f32, 2.0]).expect("a buffer");
        let to = gpu.buffer("to", 8).expect("a buffer");
        let pass = gpu.pass(&declaration, &[]).expect("a pipeline");
        let mut frame = gpu.frame().expect("a frame");
        let binds = [("out_values", Bind::from(&to)), ("in_values", Bind::from(&from))];
        frame.dispatch(&pass, &binds, &AddPush { count: 2, amount: 0.5 }, Threads::Size([2, 1, 1])).expect("recorded");
        frame.run().expect("runs");
        assert_eq!(gpu.read_buffer::<f32>(&to).expect("read"), [0.5, 1.5]);
    });

    change(root.path(), "shaders/glsl/composite.comp", "vec4(radiance, 1.0)", "vec4(radiance, 0.5)");
    let shipped = Sources::at(root.path()).compile().expect("compiles");
    assert_ne!(before.digest, shipped.digest);
}

#[test]
fn a_broken_shader_names_file_and_line() {
    let root = copy();
    let path = root.path().join("shaders/glsl/composite.comp");
    let text = fs::read_to_string(&path).expect("a shader");
    let line = text.lines().take_while(|line| !line.starts_with("void main")).count() + 2;
    change(root.path(), "shaders/glsl/composite.comp", "void main() {\n", "void main() {\n    nonsense = 1;\n");
    let Err(error) = Sources::at(root.path()).compile() else { panic!("it compiles") };
    let said = error.to_string();
    assert!(said.contains(&format!("composite.comp:{line}: ")) && said.contains("nonsense"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
}
