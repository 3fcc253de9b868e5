//! Objects that differ in material, clip or light share what is packed of their meshes and textures, and look as they do
//! alone.

use crate::{common::*, folder::Folder, mitsuba::data_file};
use iprt::{
    renderer::Renderer,
    scene::{Object, Scene, model::Model},
    settings::Method,
};
use std::sync::Arc;

/// Loads a scene in a room of paper with these `[[object]]` tables. The folder holds its files.
fn load(objects: &[String]) -> (Folder, Scene) {
    let folder = Folder::empty();
    let white = image::RgbImage::from_pixel(64, 32, image::Rgb([200, 190, 180]));
    white.save(folder.path("white.png")).expect("a picture");
    let head = "[panorama]\ncolor = \"white.png\"\ndepth = 4\n[camera]\nposition = [0, 0, 0]\nlook_at = [0, 0, -1]\n";
    std::fs::write(folder.path("scene.toml"), format!("{head}{}", objects.concat())).expect("a scene file");
    let scene = Scene::load(&folder.path("scene.toml")).expect("a good scene");
    (folder, scene)
}

/// The same scene, in which no object shares anything with another.
fn apart(scene: &Scene) -> Scene {
    let own = |object: &Object| {
        let mut model = Model::clone(&object.model);
        model.meshes.iter_mut().for_each(|mesh| *mesh = Arc::new((**mesh).clone()));
        model.textures.iter_mut().for_each(|texture| *texture = Arc::new((**texture).clone()));
        Object { model: Arc::new(model), ..object.clone() }
    };
    let objects = scene.objects().map(own).collect();
    let (panorama, camera, render) = (scene.panorama.clone(), scene.camera.clone(), scene.render.clone());
    Scene::assemble(&scene.name, panorama, camera, objects, render).expect("fits")
}

fn object(name: usize, more: &str, x: f64) -> String {
    format!("[[object]]\nname = \"{name}\"\n{more}\ntranslation = [{x}, 0, -1]\n")
}

#[test]
fn models_are_packed_once_whatever_their_material() {
    let bottle = format!("gltf = {:?}", data_file("gltf/WaterBottle/WaterBottle.gltf"));
    let of = |more: &[&str]| -> Vec<String> {
        let at = |i: usize| 0.25 * i as f64 - 0.5;
        more.iter().enumerate().map(|(i, more)| object(i, &format!("{bottle}\n{more}"), at(i))).collect()
    };
    let mats = ["", "material = { roughness = 0.1 }", "material = { emissive = [0.2, 1, 0.2] }"];
    let ((_, one), (_files, all)) = (load(&of(&mats[1..2])), load(&of(&mats)));
    assert_eq!(all.packed.triangles.len(), one.packed.triangles.len());
    // The textures of the file, and one copy in which roughness is 1.
    assert_eq!(all.packed.texels.len(), one.packed.texels.len());
    let apart = apart(&all);
    assert_eq!(apart.packed.triangles.len(), 3 * one.packed.triangles.len());
    validated(|gpu| {
        let [shared, own] = [&all, &apart].map(|scene| rendered(gpu, scene, options(Method::Iprt, &[]), 2));
        for name in ["radiance", "albedo_virtual"] {
            assert_eq!(aov(&shared, name), aov(&own, name), "{name}");
        }
    });
}

#[test]
fn a_thousand_spheres_of_a_thousand_colours_are_one_mesh() {
    let of =
        |i: usize| object(i, &format!("shape = \"sphere\"\nmaterial = {{ roughness = {} }}", i as f64 / 1000.0), 0.0);
    let (_, scene) = load(&(0..1000).map(of).collect::<Vec<_>>());
    assert_eq!(scene.packed.triangles.len(), 64 * 62);
    assert_eq!(scene.packed.materials.len(), 1000);
}

#[test]
fn characters_in_step_are_posed_once() {
    let fox = format!("gltf = {:?}\nscale = 0.005", data_file("gltf/Fox/Fox.glb"));
    let (one, (_files, all)) =
        (load(&[object(0, &fox, 0.0)]).1, load(&[0, 1, 2].map(|i| object(i, &fox, 0.3 * i as f64 - 0.3))));
    assert_eq!(all.packed.triangles.len(), one.packed.triangles.len());
    let apart = apart(&all);
    assert_eq!(apart.packed.deforming.len(), 3 * all.packed.deforming.len());
    validated(|gpu| {
        let radiance = |scene: &Scene| {
            let mut renderer = Renderer::new(gpu, scene, options(Method::Iprt, &[])).expect("fits");
            for time in [0.0, 0.1, 0.2] {
                renderer.render(scene, time).expect("renders");
            }
            ["radiance", "motion"].map(|name| aov(&renderer, name))
        };
        assert_eq!(radiance(&all), radiance(&apart));
    });
}

#[test]
fn characters_out_of_step_share_their_keys() {
    let fox = format!("gltf = {:?}", data_file("gltf/Fox/Fox.glb"));
    let of = |i: usize| object(i, &format!("{fox}\nscale = 0.005\noffset = {}", 0.1 * i as f64), i as f64 * 0.3 - 0.3);
    let (_, scene) = load(&[of(0), of(1), of(2)]);
    let clips: Vec<_> = scene.objects().map(|object| object.model.rig.clips[0].clone()).collect();
    assert!(clips.iter().all(|clip| Arc::ptr_eq(&clip.channels, &clips[0].channels)), "keys are copied");
    assert_eq!(clips[2].offset, 0.2);
    let meshes: Vec<_> = scene.objects().map(|object| &object.model.meshes[0]).collect();
    assert!(meshes.iter().all(|mesh| Arc::ptr_eq(mesh, meshes[0])), "the mesh is copied");
}
