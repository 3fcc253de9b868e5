//! What a shader says of itself is what the Rust side must declare and bind; whatever does not fit is named.

use super::{ADD, AddPush, BLUR, ITEMS, Item, SAMPLE};
use crate::{
    common::{close, open},
    shaders,
};
use iprt::{
    Error,
    gpu::{
        Access, Bind, Binding, Format, Kind, PassDeclaration, PushLayout, StructLayout, Threads, bindings,
        struct_layout,
    },
    gpu_struct,
};

#[test]
fn bindings_are_those_that_the_shader_uses() {
    let all = |spirv| {
        let mut all = bindings(spirv).unwrap();
        all.sort_by_key(|binding| binding.number);
        all
    };
    let binding = |name: &str, number, access, kind| Binding { name: name.to_owned(), number, access, kind };
    let image = |format, array| Kind::StorageImage { format, array };
    assert_eq!(
        all(shaders::ITEMS), // in_never is declared and not used
        [
            binding("in_items", 2, Access::Read, Kind::StorageBuffer),
            binding("in_scale", 5, Access::Read, Kind::UniformBuffer),
            binding("out_sums", 7, Access::Write, Kind::StorageBuffer),
        ]
    );
    assert_eq!(
        all(shaders::BLUR),
        [
            binding("in_level", 0, Access::Read, image(Format::Rgba16f, true)),
            binding("out_level", 1, Access::Write, image(Format::Rgba16f, true)),
        ]
    );
    assert_eq!(
        all(shaders::SAMPLE),
        [
            binding("in_panorama", 0, Access::Read, Kind::Sampled { array: false, integer: false }),
            binding("out_samples", 1, Access::Write, image(Format::Rgba32f, false)),
            binding("out_count", 2, Access::ReadWrite, image(Format::R32u, false)),
        ]
    );
    assert!(bindings(&[1, 2, 3]).unwrap_err().to_string().contains("cannot be read"));
}

#[test]
fn declarations_that_disagree_with_the_shader_are_named() {
    gpu_struct! {
        struct Swapped {
            pub amount: f32,
            pub count: u32,
        }
    }
    gpu_struct! {
        struct Shifted {
            pub pad: f32,
            pub count: u32,
            pub amount: f32,
        }
    }
    gpu_struct! {
        struct Padded {
            pub a: [f32; 4],
            pub b: f32,
            pub c: [u32; 2],
        }
    }
    gpu_struct! {
        struct Longer {
            pub a: [f32; 3],
            pub b: f32,
            pub c: [u32; 3],
        }
    }
    const PADDED: &[StructLayout] = &[struct_layout::<Padded>("Item")];
    const LONGER: &[StructLayout] = &[struct_layout::<Longer>("Item")];
    const UNKNOWN: &[StructLayout] = &[struct_layout::<Item>("Thing")];
    let with_push = |push| PassDeclaration { push, ..ADD };
    let with_structs = |structs| PassDeclaration { structs, ..ITEMS };
    let cases = [
        (with_push(None), "push constants are not declared"),
        (with_push(Some(PushLayout::of::<Swapped>())), "field 0 is count in GLSL and amount in Rust"),
        (with_push(Some(PushLayout::of::<Shifted>())), "GLSL has 2 fields and Rust 3"),
        (with_push(Some(PushLayout { size: 132, fields: &[] })), "132 bytes"),
        (PassDeclaration { push: Some(PushLayout::of::<AddPush>()), ..ITEMS }, "the shader does not use them"),
        (with_structs(PADDED), "struct Item: its array stride is 24 in GLSL and 28 in Rust"),
        (with_structs(LONGER), "struct Item: its array stride is 24 in GLSL and 28 in Rust"),
        (with_structs(UNKNOWN), "Rust knows no struct Item that is in a buffer"),
    ];
    let gpu = open();
    for (declaration, says) in cases {
        let error = gpu.pass(&declaration, &[]).unwrap_err();
        assert!(matches!(&error, Error::Internal(_)), "{error}");
        let text = error.to_string();
        assert!(text.contains(says) && text.contains(declaration.name), "{text}, not: {says}");
    }
    assert!(gpu.pass(&ADD, &[("BONUS", 1)]).unwrap_err().to_string().contains("no specialization constant BONUS"));
    close(gpu);
}

#[test]
fn dispatches_that_do_not_fit_their_pass_are_named() {
    let gpu = open();
    {
        let (add, blur) = (gpu.pass(&ADD, &[]).unwrap(), gpu.pass(&BLUR, &[]).unwrap());
        let sample = gpu.pass(&SAMPLE, &[]).unwrap();
        let buffer = gpu.buffer("buffer", 16).unwrap();
        let wrong_format = gpu.image("wrong", [4, 4], 1, 1, Format::Rgba32f).unwrap();
        let layered = gpu.image("layered", [4, 4], 2, 1, Format::Rgba16f).unwrap();
        let mut frame = gpu.frame().unwrap();
        let push = AddPush::default();
        let says = |result: iprt::Result<()>, text: &str| {
            let error = result.unwrap_err().to_string();
            assert!(error.contains(text), "{error}, not: {text}");
        };
        let one = Threads::Size([1, 1, 1]);
        let (b, w, l) = (|| Bind::from(&buffer), || Bind::from(&wrong_format), || Bind::from(&layered));
        says(frame.dispatch(&add, &[("in_values", b())], &push, one), "out_values is not given");
        says(frame.dispatch(&add, &[("x", b())], &push, one), "no binding x");
        says(frame.dispatch(&add, &[("in_values", b()), ("in_values", b())], &push, one), "given twice");
        says(frame.dispatch(&add, &[("in_values", b()), ("out_values", w())], &push, one), "out_values takes a buffer");
        let good = [("in_values", b()), ("out_values", b())];
        says(frame.dispatch(&add, &good, &(), one), "not its push constants");
        says(frame.dispatch(&add, &good, &push, Threads::Size([u32::MAX, 1, 1])), "workgroups");
        says(frame.dispatch(&blur, &[("in_level", w()), ("out_level", l())], &(), one), "in_level is Rgba16f in GLSL");
        says(frame.dispatch(&blur, &[("in_level", layered.level(1)), ("out_level", l())], &(), one), "no such level");
        let binds = [("in_panorama", l()), ("out_samples", w()), ("out_count", w())];
        says(frame.dispatch(&sample, &binds, &(), one), "in_panorama has no layers in GLSL");
        frame.dispatch(&add, &good, &push, one).unwrap();
        assert!(frame.run().unwrap_err().to_string().contains("add binds buffer twice"));
    }
    close(gpu);
}
