//! The Vulkan layer: every test ends by destroying its device and demands no validation message; canaries show that
//! a missing barrier and a leak would be one. No device or no layer is a failure, never a skip.

mod declarations;

use crate::{
    common::{close, open},
    shaders,
};
use iprt::{
    Error,
    gpu::{Bind, Format, FrameOptions, Gpu, GpuOptions, PassDeclaration, PushLayout, Threads, struct_layout},
    gpu_struct,
};

gpu_struct! {
    struct AddPush {
        pub count: u32,
        pub amount: f32,
    }
}

gpu_struct! {
    struct Item {
        pub a: [f32; 3],
        pub b: f32,
        pub c: [u32; 2],
    }
}

const ADD: PassDeclaration =
    PassDeclaration { name: "add", spirv: shaders::ADD, push: Some(PushLayout::of::<AddPush>()), structs: &[] };

const ITEMS: PassDeclaration =
    PassDeclaration { name: "items", spirv: shaders::ITEMS, push: None, structs: &[struct_layout::<Item>("Item")] };

const COUNT: PassDeclaration = PassDeclaration { name: "count", spirv: shaders::COUNT, push: None, structs: &[] };

const BLUR: PassDeclaration = PassDeclaration { name: "blur", spirv: shaders::BLUR, push: None, structs: &[] };

const SAMPLE: PassDeclaration = PassDeclaration { name: "sample", spirv: shaders::SAMPLE, push: None, structs: &[] };

#[test]
fn upload_dispatch_read_back() {
    let gpu = open();
    {
        let values: Vec<f32> = (0..1000).map(|i| i as f32).collect();
        let from = gpu.buffer_with("from", &values).unwrap();
        let to = gpu.buffer("to", 4000).unwrap();
        let add = gpu.pass(&ADD, &[]).unwrap();
        assert_eq!(add.local_size(), [64, 1, 1]);
        let mut frame = gpu.frame().unwrap();
        let push = AddPush { count: 999, amount: 0.5 };
        let binds = [("out_values", Bind::from(&to)), ("in_values", Bind::from(&from))];
        frame.dispatch(&add, &binds, &push, Threads::Size([999, 1, 1])).unwrap();
        frame.dispatch(&add, &binds, &push, Threads::Size([0, 1, 1])).unwrap();
        let timings = frame.run().unwrap();
        assert_eq!(timings.entries.len(), 1, "an empty dispatch runs nothing");
        assert_eq!(*timings.entries[0].path, ["add"]);
        assert!(timings.sum() >= 0.0 && timings.gpu_ms >= timings.sum());
        let result: Vec<f32> = gpu.read_buffer(&to).unwrap();
        let expected: Vec<f32> = (0..1000).map(|i| if i < 999 { i as f32 + 0.5 } else { 0.0 }).collect();
        assert_eq!(result, expected);
    }
    close(gpu);
}

#[test]
fn structs_uniforms_and_specialization_arrive() {
    let gpu = open();
    {
        let items = [Item { a: [1.0, 2.0, 3.0], b: 4.0, c: [5, 6] }, Item { a: [0.5; 3], b: 1.0, c: [0, 1] }];
        let items = gpu.buffer_with("items", &items).unwrap();
        let scale = gpu.buffer_with("scale", &[2.0f32]).unwrap();
        let sums = gpu.buffer("sums", 8).unwrap();
        for (specialization, width, extra) in [(&[][..], 32, 0.0), (&[("WIDTH", 16), ("BONUS", 100)][..], 16, 100.0)] {
            let pass = gpu.pass(&ITEMS, specialization).unwrap();
            assert_eq!(pass.local_size(), [width, 1, 1]);
            let mut frame = gpu.frame().unwrap();
            let binds =
                [("in_items", Bind::from(&items)), ("in_scale", Bind::from(&scale)), ("out_sums", Bind::from(&sums))];
            frame.dispatch(&pass, &binds, &(), Threads::Size([2, 1, 1])).unwrap();
            frame.run().unwrap();
            assert_eq!(gpu.read_buffer::<f32>(&sums).unwrap(), [42.0 + extra, 7.0 + extra]);
        }
    }
    close(gpu);
}

#[test]
fn an_indirect_dispatch_runs_what_the_gpu_counted() {
    let gpu = open();
    {
        let (count, add) = (gpu.pass(&COUNT, &[]).unwrap(), gpu.pass(&ADD, &[]).unwrap());
        let arguments = gpu.buffer_with("arguments", &[99u32, 0, 0, 0]).unwrap();
        let from = gpu.buffer_with("from", &[1.0f32; 256]).unwrap();
        let to = gpu.buffer("to", 1024).unwrap();
        let mut frame = gpu.frame().unwrap();
        frame.fill(&arguments, 0);
        frame.barrier("counting starts at zero");
        frame.dispatch(&count, &[("arguments", Bind::from(&arguments))], &(), Threads::Size([3, 1, 1])).unwrap();
        frame.barrier("the dispatch reads its size");
        let binds = [("in_values", Bind::from(&from)), ("out_values", Bind::from(&to))];
        let push = AddPush { count: 256, amount: 1.0 };
        frame.dispatch(&add, &binds, &push, Threads::Indirect(&arguments, 0)).unwrap();
        let timings = frame.run().unwrap();
        let names: Vec<_> = timings.entries.iter().map(iprt::gpu::Entry::pass).collect();
        assert_eq!(names, ["fill arguments", "count", "add"]);
        let result: Vec<f32> = gpu.read_buffer(&to).unwrap();
        assert_eq!(result.iter().filter(|&&v| v == 2.0).count(), 3 * 64);
        let mut frame = gpu.frame().unwrap();
        let outside = frame.dispatch(&add, &binds, &push, Threads::Indirect(&arguments, 8));
        assert!(outside.unwrap_err().to_string().contains("arguments"));
    }
    close(gpu);
}

#[test]
fn images_have_levels_and_layers() {
    let gpu = open();
    {
        let blur = gpu.pass(&BLUR, &[]).unwrap();
        let image = gpu.image("image", [8, 4], 2, 2, Format::Rgba16f).unwrap();
        let texel = |v: f32| [half::f16::from_f32(v); 4].map(half::f16::to_bits);
        gpu.write_image(&image, 1, 0, &[[texel(1.0), texel(3.0)]; 16]).unwrap();
        assert!(gpu.write_image(&image, 0, 1, &[0u8; 3]).is_err());
        assert!(gpu.read_image(&image, 2).is_err());
        let binds = [("in_level", image.level(0)), ("out_level", image.level(1))];
        let mut frame = gpu.frame().unwrap();
        frame.dispatch(&blur, &binds, &(), Threads::Size([4, 2, 2])).unwrap();
        frame.run().unwrap();
        let expected = |v: f32| [v; 4];
        assert_eq!(gpu.read_image_level(&image, 0, 1).unwrap(), [expected(0.0); 8], "cleared when made");
        let row = [1.0, 2.0, 2.0, 2.0].map(expected);
        assert_eq!(gpu.read_image_level(&image, 1, 1).unwrap(), [row, row].concat());
    }
    close(gpu);
}

#[test]
fn sampling_filters_wraps_across_the_seam_and_stops_at_the_poles() {
    let gpu = open();
    {
        let pass = gpu.pass(&SAMPLE, &[]).unwrap();
        let panorama = gpu.image("panorama", [4, 2], 1, 2, Format::Rgba16f).unwrap();
        let texel = |v: f32| [half::f16::from_f32(v); 4].map(half::f16::to_bits);
        gpu.write_image(&panorama, 0, 0, &[1.0, 2.0, 4.0, 9.0, 0.0, 0.0, 0.0, 0.0].map(texel)).unwrap();
        gpu.write_image(&panorama, 0, 1, &[7.0, 7.0].map(texel)).unwrap();
        let samples = gpu.image("samples", [4, 1], 1, 1, Format::Rgba32f).unwrap();
        let count = gpu.image("count", [1, 1], 1, 1, Format::R32u).unwrap();
        let binds = [
            ("in_panorama", Bind::from(&panorama)),
            ("out_samples", (&samples).into()),
            ("out_count", (&count).into()),
        ];
        let mut frame = gpu.frame().unwrap();
        frame.dispatch(&pass, &binds, &(), Threads::Size([4, 1, 1])).unwrap();
        frame.run().unwrap();
        let values: Vec<f32> = gpu.read_image(&samples, 0).unwrap().iter().map(|v| v[0]).collect();
        for (value, expected) in values.iter().zip([1.5, 5.0, 1.0, 7.0]) {
            assert!((value - expected).abs() < 0.02, "{values:?}"); // filtering has 8 bits of weight
        }
        assert_eq!(gpu.read_image(&count, 0).unwrap(), [[4.0, 0.0, 0.0, 0.0]]);
    }
    close(gpu);
}

#[test]
fn scopes_name_timings_and_query_pools_grow() {
    let gpu = open();
    {
        let add = gpu.pass(&ADD, &[]).unwrap();
        let (a, b) = (gpu.buffer("a", 4096).unwrap(), gpu.buffer("b", 4096).unwrap());
        for rounds in [3, 150, 2] {
            let mut frame = gpu.frame().unwrap();
            frame.scope("relight", |frame| {
                for round in 0..rounds {
                    let (from, to) = if round % 2 == 0 { (&a, &b) } else { (&b, &a) };
                    let binds = [("in_values", Bind::from(from)), ("out_values", Bind::from(to))];
                    let push = AddPush { count: 1024, amount: 1.0 };
                    frame.dispatch(&add, &binds, &push, Threads::Size([1024, 1, 1])).unwrap();
                    frame.barrier("each round reads the last");
                }
            });
            frame.copy_buffer(&a, &b).unwrap();
            let timings = frame.run().unwrap();
            assert_eq!(timings.barriers, rounds);
            let (last, relit) = timings.entries.split_last().unwrap();
            assert!(relit.len() == rounds && relit.iter().all(|entry| *entry.path == ["relight", "add"]));
            assert_eq!(*last.path, ["copy a to b"]);
            let tree = timings.tree();
            assert_eq!(tree.iter().map(|node| node.name.as_str()).collect::<Vec<_>>(), ["relight", "copy a to b"]);
            assert!(timings.gpu_ms >= timings.sum() && timings.sum() > 0.0);
        }
        assert_eq!(gpu.read_buffer::<f32>(&b).unwrap()[0], 2.0 + 150.0 + 2.0);
    }
    close(gpu);
}

/// Three dispatches with two barriers; the second makes both a read after a write and a write after a read.
fn chain(gpu: &Gpu, skip: Option<usize>, ignore_hazards: bool) -> iprt::Result<()> {
    let add = gpu.pass(&ADD, &[])?;
    let (a, b) = (gpu.buffer("a", 4096)?, gpu.buffer("b", 4096)?);
    let mut frame = gpu.frame_with(FrameOptions { skip_barrier: skip, ignore_hazards, ..Default::default() })?;
    for (i, (from, to)) in [(&a, &b), (&b, &a), (&a, &b)].into_iter().enumerate() {
        if i > 0 {
            frame.barrier("each round reads the last");
        }
        let binds = [("in_values", Bind::from(from)), ("out_values", Bind::from(to))];
        frame.dispatch(&add, &binds, &AddPush { count: 1024, amount: 1.0 }, Threads::Size([1024, 1, 1]))?;
    }
    frame.run().map(|_| ())
}

#[test]
fn frames_in_flight_run_in_order_and_need_no_waiting() {
    let gpu = open();
    {
        let add = gpu.pass(&ADD, &[]).unwrap();
        let (a, b) = (gpu.buffer("a", 4096).unwrap(), gpu.buffer("b", 4096).unwrap());
        let mut tickets = Vec::new();
        for round in 0..8 {
            // what is written overwrites what the frame before reads
            let mut frame = gpu.frame().unwrap();
            frame.write_buffer(&a, 0, &[round as f32; 1024]).unwrap();
            frame.barrier("add reads what was written");
            let binds = [("in_values", Bind::from(&a)), ("out_values", Bind::from(&b))];
            let push = AddPush { count: 1024, amount: 0.5 };
            frame.dispatch(&add, &binds, &push, Threads::Size([1024, 1, 1])).unwrap();
            let copy = gpu.buffer("copy", 4096).unwrap();
            frame.barrier("the sum is kept");
            frame.copy_buffer(&b, &copy).unwrap();
            tickets.push((frame.submit().unwrap(), copy));
        }
        // what a frame uses lives until it has run, whoever drops it
        drop((add, a, b));
        for (round, (ticket, copy)) in tickets.into_iter().enumerate() {
            if round % 3 == 0 {
                drop(ticket);
            } else {
                assert_eq!(*ticket.wait().unwrap().entries[0].path, ["write a"]);
            }
            assert_eq!(gpu.read_buffer::<f32>(&copy).unwrap()[1023], round as f32 + 0.5);
        }
    }
    close(gpu);
}

#[test]
fn writes_of_a_frame_are_checked_and_tracked() {
    let gpu = open();
    {
        let buffer = gpu.buffer("numbers", 16).unwrap();
        let image = gpu.image("picture", [2, 2], 1, 1, Format::R32f).unwrap();
        let mut frame = gpu.frame().unwrap();
        assert!(frame.write_buffer(&buffer, 8, &[0u32; 3]).unwrap_err().to_string().contains("do not fit numbers"));
        assert!(
            frame.write_image(&image, 0, 0, &[0f32; 3]).unwrap_err().to_string().contains("takes 16 bytes, not 12")
        );
        assert!(frame.write_image(&image, 1, 0, &[0f32; 4]).unwrap_err().to_string().contains("no layer 1"));
        frame.write_buffer(&buffer, 4, &[7u32, 8]).unwrap();
        frame.write_image(&image, 0, 0, &[1.0f32, 2.0, 3.0, 4.0]).unwrap();
        frame.write_buffer(&buffer, 0, &[1u32]).unwrap();
        let error = frame.run().unwrap_err().to_string();
        assert!(error.contains("write after write on numbers"), "{error}");
        let mut frame = gpu.frame().unwrap();
        frame.barrier("nothing came before");
        frame.write_buffer(&buffer, 4, &[7u32, 8]).unwrap();
        frame.write_image(&image, 0, 0, &[1.0f32, 2.0, 3.0, 4.0]).unwrap();
        frame.barrier("the first is written again");
        frame.write_buffer(&buffer, 0, &[1u32]).unwrap();
        frame.barrier("nothing comes after");
        assert_eq!(frame.run().unwrap().barriers, 1);
        assert_eq!(gpu.read_buffer::<u32>(&buffer).unwrap(), [1, 7, 8, 0]);
        assert_eq!(
            gpu.read_image(&image, 0).unwrap().iter().map(|texel| texel[0]).collect::<Vec<_>>(),
            [1.0, 2.0, 3.0, 4.0]
        );
    }
    close(gpu);
}

#[test]
fn pipelines_are_kept_and_a_broken_cache_is_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let run = || {
        let device = std::env::var("IPRT_DEVICE").ok();
        let pipeline_cache = Some(folder.path().to_owned());
        let gpu = Gpu::new(&GpuOptions { device, validation: true, pipeline_cache }).unwrap();
        gpu.pass(&ADD, &[]).unwrap();
        close(gpu);
        let files: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
        assert_eq!(files.len(), 1, "{files:?}");
        (files[0].clone(), std::fs::read(&files[0]).unwrap())
    };
    let (file, good) = run();
    assert!(good.len() >= 64, "a check sum and a header at least");
    std::fs::write(&file, [&good[..40], &[0xff; 100]].concat()).unwrap();
    assert_eq!(run(), (file, good), "made again");
}

#[test]
fn every_missing_barrier_is_an_error_before_anything_runs() {
    let gpu = open();
    chain(&gpu, None, false).unwrap();
    for n in 0..2 {
        let error = chain(&gpu, Some(n), false).unwrap_err();
        assert!(error.to_string().contains("read after write on "), "{error}");
    }
    close(gpu);
}

#[test]
fn canary_the_layer_sees_every_missing_barrier() {
    for n in 0..2 {
        let gpu = open();
        chain(&gpu, Some(n), true).unwrap();
        let messages = gpu.destroy().unwrap();
        assert!(messages.iter().any(|m| m.contains("SYNC-HAZARD-READ-AFTER-WRITE")), "{n}: {messages:?}");
    }
}

#[test]
fn canary_the_layer_sees_a_leak() {
    let gpu = open();
    gpu.leak_for_test().unwrap();
    let messages = gpu.destroy().unwrap();
    // ...-00378 in older layers, ...-05137 in newer ones
    assert!(messages.iter().any(|m| m.contains("VUID-vkDestroyDevice-device-")), "{messages:?}");
}

#[test]
fn a_device_still_in_use_is_not_destroyed() {
    let gpu = open();
    let buffer = gpu.buffer("held", 16).unwrap();
    assert!(matches!(gpu.destroy(), Err(Error::Internal(_))));
    drop(buffer);
}

#[test]
fn memory_is_counted_and_given_back() {
    let gpu = open();
    assert_eq!(gpu.device_bytes(), 0);
    let image = gpu.image("image", [256, 256], 1, 1, Format::Rgba32f).unwrap();
    let with_image = gpu.device_bytes();
    assert!(with_image >= 256 * 256 * 16);
    let empty = gpu.buffer("empty", 0).unwrap();
    assert!(empty.bytes() == 16 && gpu.device_bytes() > with_image);
    drop((image, empty));
    assert_eq!(gpu.device_bytes(), 0);
    close(gpu);
}

#[test]
fn sizes_beyond_the_device_are_input_errors() {
    let gpu = open();
    for result in [
        gpu.image("wide", [1 << 30, 1], 1, 1, Format::R32f).map(|_| ()),
        gpu.image("none", [0, 1], 1, 1, Format::R32f).map(|_| ()),
        gpu.buffer("vast", u64::MAX / 2).map(|_| ()),
    ] {
        assert_eq!(result.unwrap_err().exit_code(), 2);
    }
    close(gpu);
}

#[test]
fn a_device_that_does_not_exist_is_no_device() {
    for device in ["no such device", "4711"] {
        let options = GpuOptions { device: Some(device.into()), ..Default::default() };
        let error = Gpu::new(&options).err().unwrap();
        assert!(matches!(error, Error::NoDevice { .. }), "{error}");
        assert_eq!(error.exit_code(), 3);
        assert!(error.to_string().contains(device), "{error}");
    }
}
