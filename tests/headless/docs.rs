//! Documents that are made from code are what the code says. `IPRT_BLESS=1` (`make docs`) writes them.

use crate::common::*;
use clap::{Arg, ArgAction, Args, Command, CommandFactory};
use glam::{Vec3, vec3};
use iprt::{
    cli::{
        Cli,
        common::{DeviceArgs, PictureArgs},
        sink::VideoArgs,
        target::TargetArgs,
    },
    gpu::{Access, Binding, Kind, bindings},
    panorama::preset::Preset,
    passes::{
        PASSES,
        view::{self, Role, View},
    },
    plan::{Part, Plan},
    scene::{file::parse, material::Material},
    settings::{Method, Settings},
    shaders::current,
};
use std::{
    fmt::Write,
    fs,
    path::{Path, PathBuf},
};

fn file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(name)
}

#[test]
fn the_table_of_settings_is_the_codes_own() {
    generated("docs/methods.md", "settings", "the table in src/settings.rs", &Settings::markdown());
}

// A release build has no key that loads shaders from disk.
#[cfg(debug_assertions)]
#[test]
fn the_table_of_keys_is_the_windows_own() {
    let rows: String =
        iprt::viewer::controls::KEYS.iter().map(|(keys, meaning)| format!("| {keys} | {meaning} |\n")).collect();
    let table = format!("| key | does |\n|---|---|\n{rows}");
    generated("docs/window.md", "keys", "the table in src/viewer/controls.rs", &table);
}

#[test]
fn the_table_of_depth_presets_is_the_codes_own() {
    generated("docs/scene.md", "depth presets", "src/panorama/preset.rs", &Preset::markdown());
}

/// The parser itself says which keys there are, and which types it wants of them.
#[test]
fn every_key_of_a_scene_file_is_described_with_its_type() {
    let text = fs::read_to_string(file("docs/scene.md")).expect("there");
    let problems = |scene: &str| -> Vec<String> {
        let problems = parse(Path::new("s.toml"), scene).expect_err("it is wrong");
        problems.iter().map(ToString::to_string).collect()
    };
    for (heading, head) in [
        ("`[panorama]`", "[panorama]"),
        ("`[camera]`", "[camera]"),
        ("`[[object]]`", "[[object]]"),
        ("`[[object]]`", "[[object]]\nshape = 'box'\n[object.material]"),
        ("`[[object]]`", "[[object]]\nshape = 'box'\n[object.place]"),
        ("`[room]`", "[room]"),
        ("`[render]`", "[render]"),
    ] {
        let section = text.split("\n## ").find(|section| section.starts_with(heading)).expect(heading);
        let answers = problems(&format!("{head}\nzzzzzzzzzzzzzzzzzzzzzzzz = 1\n"));
        let known = answers.iter().find_map(|line| line.split("known here: ").nth(1)).expect("all keys are told");
        for key in known.split(", ") {
            // Key, type, default and meaning, and what is before and after the bars.
            let mut rows = section.lines().map(|line| line.split('|').map(str::trim).collect::<Vec<_>>());
            let cells = rows.find(|cells| cells.len() == 6 && cells[1].contains(&format!("`{key}`")));
            let Some(cells) = cells.filter(|_| !head.contains('.')) else {
                assert!(section.contains(key), "docs/scene.md says nothing of {key} in {head}");
                continue;
            };
            let field = if head == "[[object]]" {
                format!("object[0].{key}")
            } else {
                format!("{}.{key}", &head[1..head.len() - 1])
            };
            let answers = problems(&format!("{head}\n{key} = true\n"));
            let answer =
                answers.iter().find(|line| line.contains(&format!(": {field}: "))).expect("a boolean is never right");
            let right = match answer {
                line if line.contains("a finite number") => "number",
                line if line.contains("a string") => "text",
                line if line.contains("an array of 3 finite") => "3 numbers",
                line if line.contains("an array of finite") => "numbers",
                line if line.contains("an array of whole") => "whole numbers",
                line if line.contains("an array of tables") => "tables",
                line if line.contains("table") => "table",
                _ => "text, number or table",
            };
            assert!(cells[2].starts_with(right), "{field} is {}, but: {answer}", cells[2]);
        }
    }
}

/// Replaces what stands between two marks of a document, or demands that it is the same.
fn generated(document: &str, subject: &str, from: &str, table: &str) {
    let path = file(document);
    let text = fs::read_to_string(&path).expect("it is there");
    let (begin, end) =
        (format!("<!-- {subject}: written by `make docs` from {from} -->\n"), format!("<!-- end of {subject} -->"));
    let (before, rest) = text.split_once(&begin).unwrap_or_else(|| panic!("{document} lacks the line {begin}"));
    let (_, after) = rest.split_once(&end).unwrap_or_else(|| panic!("{document} lacks the line {end}"));
    let expected = format!("{before}{begin}\n{table}\n{end}{after}");
    if std::env::var_os("IPRT_BLESS").is_some() {
        fs::write(&path, &expected).expect("it can be written");
    } else {
        assert!(text == expected, "{document} is not what {from} says: run `make docs`");
    }
}

#[test]
fn the_manual_of_commands_is_claps_own() {
    let shared = [
        ("picture", PictureArgs::augment_args(Command::new(""))),
        ("device", DeviceArgs::augment_args(Command::new(""))),
        ("target", TargetArgs::augment_args(Command::new(""))),
        ("video", VideoArgs::augment_args(Command::new(""))),
    ];
    let mut cli = Cli::command();
    cli.build();
    let everywhere: Vec<_> =
        cli.get_arguments().filter(|arg| !matches!(arg.get_action(), ArgAction::Version)).collect();
    let manual = |part: &str, text: &str| generated("docs/cli.md", part, "the arguments in src/cli", text);
    manual("options of every command", &table(&everywhere));
    manual("picture options", &table(&missing(&shared[0].1, &[&shared[1].1])));
    manual("device options", &table(&missing(&shared[1].1, &[])));
    manual("target options", &table(&missing(&shared[2].1, &[])));
    manual("video options", &table(&missing(&shared[3].1, &[])));
    let mut commands = Vec::new();
    collect(&cli, "iprt", &mut commands);
    for (name, mut command) in commands {
        let groups: Vec<_> = shared.iter().filter(|(_, group)| missing(group, &[&command]).is_empty()).collect();
        let mut known: Vec<_> = groups.iter().map(|(_, group)| group).collect();
        known.push(&cli);
        let own = missing(&command, &known);
        let links: Vec<_> = groups.iter().map(|(group, _)| format!("[{group} options](#{group}-options)")).collect();
        let about = command.get_about().expect("a command says what it does").to_string();
        let more = command.get_after_long_help().map(|text| format!("\n```text\n{text}\n```\n")).unwrap_or_default();
        let own = if own.is_empty() { String::new() } else { format!("\n{}", table(&own)) };
        let links = if links.is_empty() { String::new() } else { format!("\nIt also takes {}.\n", links.join(", ")) };
        let usage = command.render_usage().to_string();
        let usage = usage.trim_start_matches("Usage: ");
        manual(&name, &format!("{about}.\n\n```text\n{usage}\n```\n{own}{links}{more}"));
    }
}

/// The commands that do something, with all words of their names.
fn collect(command: &Command, name: &str, found: &mut Vec<(String, Command)>) {
    for sub in command.get_subcommands().filter(|sub| sub.get_name() != "help") {
        let name = format!("{name} {}", sub.get_name());
        if sub.has_subcommands() {
            collect(sub, &name, found);
        } else {
            found.push((name, sub.clone()));
        }
    }
}

/// The arguments of a command that none of the others has, with the same words.
fn missing<'a>(command: &'a Command, others: &[&Command]) -> Vec<&'a Arg> {
    let same = |a: &Arg, b: &Arg| a.get_id() == b.get_id() && a.get_help() == b.get_help();
    let known = |arg: &Arg| others.iter().flat_map(|other| other.get_arguments()).any(|b| same(arg, b));
    command.get_arguments().filter(|arg| !known(arg) && arg.get_id() != "help").collect()
}

/// One row an argument.
fn table(args: &[&Arg]) -> String {
    let rows = args.iter().map(|arg| {
        let mut names: Vec<_> = arg.get_short().map(|c| format!("-{c}")).into_iter().collect();
        names.extend(arg.get_long().map(|long| format!("--{long}")));
        if arg.get_action().takes_values() {
            let value = match arg.get_value_names() {
                Some(names) => names.join(" "),
                None => arg.get_id().as_str().to_uppercase(),
            };
            let optional = arg.get_num_args().is_some_and(|count| count.min_values() == 0);
            match names.last_mut() {
                Some(name) => *name = if optional { format!("{name} [{value}]") } else { format!("{name} {value}") },
                None => names.push(value),
            }
        }
        let names: Vec<_> = names.iter().map(|name| format!("`{name}`")).collect();
        let help = arg.get_long_help().or(arg.get_help()).expect("an argument says what it means").to_string();
        let mut meaning = help.trim_end_matches('.').replace('\n', " ");
        let (mut defaults, mut values) = (Vec::new(), Vec::new());
        if arg.get_action().takes_values() {
            defaults.extend(arg.get_default_values().iter().map(|value| value.to_string_lossy().into_owned()));
            values.extend(arg.get_possible_values().iter().map(|value| value.get_name().to_owned()));
        }
        let mut notes = Vec::new();
        if arg.is_required_set() {
            notes.push("required".to_owned());
        }
        if !values.is_empty() {
            notes.push(format!("one of {}", values.join(", ")));
        }
        if !defaults.is_empty() {
            notes.push(format!("default: {}", defaults.join(",")));
        }
        if let Some(variable) = arg.get_env() {
            notes.push(format!("environment: {}", variable.to_string_lossy()));
        }
        if !notes.is_empty() {
            meaning += &format!(" [{}]", notes.join("; "));
        }
        format!("| {} | {} |\n", names.join(", ").replace('|', "\\|"), meaning.replace('|', "\\|"))
    });
    format!("| argument | meaning |\n|---|---|\n{}", rows.collect::<String>())
}

#[test]
fn the_table_of_parts_is_the_plans_own() {
    generated("docs/plan.md", "parts", "the table in src/plan/part.rs", &Part::markdown());
}

/// A scene that needs all images of the default method, and nothing else of what is stated is taken on the device.
#[test]
fn what_a_picture_takes_is_stated_by_image() {
    validated(|gpu| {
        let glowing = Material { emissive: Vec3::ONE, ..lambert(0.5) };
        let mirror = moving(ball(0.3, metal(0.05), Vec3::ZERO), vec3(0.3, -0.2, -1.4), vec3(0.4, -0.2, -1.4));
        let things = vec![mirror, ball(0.2, glowing, vec3(-0.3, -0.2, -1.4))];
        let scene = scene(floor(), camera(Vec3::ZERO, Vec3::NEG_Z, 60.0), things);
        let plan = Plan::of(&scene, &options(Method::Iprt, &[]), None).expect("a plan");
        let size = [640, 352];
        let taken = |role| {
            let (before, view) = (gpu.device_bytes(), View::new(gpu, "view", size, &plan, role).expect("fits"));
            let taken = gpu.device_bytes() - before;
            drop(view);
            taken as f64 / view::bytes(&plan, role, size) as f64
        };
        for role in [Role::Picture, Role::Relight] {
            let ratio = taken(role);
            assert!((0.999..1.01).contains(&ratio), "{ratio} of what is stated for {role:?}");
        }
        let pixels = f64::from(size[0] * size[1]);
        let of =
            |role| view::memory(&plan, role, size).into_iter().map(move |(name, bytes)| (name, bytes as f64 / pixels));
        let mut table = "| image or list | bytes a pixel | of a relit map |\n|---|---:|---:|\n".to_owned();
        for ((name, picture), (_, map)) in
            of(Role::Picture).zip(of(Role::Relight)).filter(|((_, bytes), _)| *bytes > 0.1)
        {
            let map = if map > 0.1 { format!("{map:.1}") } else { String::new() };
            let _ = writeln!(table, "| {name} | {picture:.1} | {map} |");
        }
        let [picture, map] = [Role::Picture, Role::Relight].map(|role| of(role).map(|(_, bytes)| bytes).sum::<f64>());
        let _ = writeln!(table, "| all | {picture:.1} | {map:.1} |");
        generated("docs/limits.md", "memory", "src/passes/view.rs", &table);
    });
}

/// A name without its direction.
fn plain(binding: &str) -> &str {
    ["in_", "out_", "history_"].iter().find_map(|direction| binding.strip_prefix(direction)).unwrap_or(binding)
}

/// The text of a group of bindings.
fn group(name: &str) -> String {
    fs::read_to_string(file(&format!("shaders/glsl/bind/{name}.glsl"))).expect("the group is there")
}

fn format_of(kind: Kind) -> String {
    match kind {
        Kind::StorageBuffer | Kind::UniformBuffer => "buffer".to_owned(),
        Kind::StorageImage { format, .. } => format!("{format:?}").to_lowercase().replace("32u", "32ui"),
        Kind::Sampled { .. } => "sampled".to_owned(),
        Kind::Acceleration => "acceleration structure".to_owned(),
    }
}

#[test]
fn what_passes_read_and_write_is_what_their_shaders_say() {
    let scene = group("scene");
    let mut table = "| pass | shader | reads | writes |\n|---|---|---|---|\n".to_owned();
    for (pass, (stem, spirv)) in PASSES.iter().flat_map(|pass| pass.shaders.iter().map(move |shader| (pass, shader))) {
        let (mut reads, mut writes) = (Vec::new(), Vec::new());
        let mut all = bindings(current(spirv).expect("it compiles")).expect("a good shader");
        all.sort_by_key(|binding| binding.number);
        for Binding { name, access, kind, .. } in all {
            let text = match (name.as_str(), scene.contains(&format!(" {name};"))) {
                (_, true) => "scene".to_owned(),
                ("in_view", _) => continue, // every one
                (name, _) if name.starts_with("history_") => format!("last `{}` {}", plain(name), format_of(kind)),
                (name, _) => format!("`{}` {}", plain(name), format_of(kind)),
            };
            let lists = match access {
                Access::Read => vec![&mut reads],
                Access::Write => vec![&mut writes],
                Access::ReadWrite => vec![&mut reads, &mut writes],
            };
            for list in lists {
                if !list.contains(&text) {
                    list.push(text.clone());
                }
            }
        }
        let _ = writeln!(table, "| {} | `{stem}.comp` | {} | {} |", pass.name, reads.join(", "), writes.join(", "));
    }
    generated("docs/pipeline.md", "passes", "the shaders", &table);
}

#[test]
fn what_images_hold_is_what_their_groups_say() {
    let written = |name: &str| {
        let writes = |spirv| {
            bindings(current(spirv).expect("it compiles"))
                .expect("a good shader")
                .iter()
                .any(|b| b.access != Access::Read && plain(&b.name) == name)
        };
        let passes = PASSES.iter().filter(|pass| pass.shaders.iter().any(|(_, spirv)| writes(spirv)));
        passes.map(|pass| pass.name).collect::<Vec<_>>().join(", ")
    };
    let mut table = "| name | format | holds | written by |\n|---|---|---|---|\n".to_owned();
    for name in ["images", "panorama", "relit"] {
        let text = group(name);
        // Comments, each with the lines that it is about.
        let mut blocks: Vec<(String, Vec<&str>)> = vec![];
        for line in text.lines() {
            match (line.strip_prefix("//"), blocks.last_mut()) {
                (Some(more), Some((comment, about))) if about.is_empty() => comment.push_str(more),
                (Some(comment), _) => blocks.push((comment.to_owned(), vec![])),
                (None, Some((_, about))) => about.push(line),
                (None, None) => {}
            }
        }
        for (comment, about) in blocks {
            let mut rows: Vec<(String, String, bool)> = Vec::new();
            for line in about.into_iter().filter(|line| line.starts_with("layout(")) {
                let variable = line.trim_end_matches(';').rsplit(' ').next().expect("a name").to_owned();
                let format = line.split(')').next().and_then(|layout| layout.rsplit(", ").next()).expect("a layout");
                let format = match format {
                    "scalar" => "buffer".to_owned(),
                    format if format.starts_with("binding") => "sampled".to_owned(),
                    format => format!("{format}{}", if line.contains("Array") { " 2" } else { "" }),
                };
                let (name, history) = (plain(&variable).to_owned(), variable.starts_with("history_"));
                match rows.iter_mut().find(|(known, ..)| *known == name) {
                    Some((.., kept)) => *kept |= history,
                    None => rows.push((name, format, history)),
                }
            }
            let comment = comment.trim().trim_end_matches('.').replace('|', "\\|");
            for (name, format, history) in rows {
                let history = if history { " h" } else { "" };
                let _ = writeln!(table, "| `{name}` | {format}{history} | {comment} | {} |", written(&name));
            }
        }
    }
    generated("docs/pipeline.md", "images", "shaders/glsl/bind", &table);
}

#[test]
fn every_setting_and_method_is_described() {
    for row in Settings::TABLE {
        assert!(row.meaning.len() > 10 && !row.meaning.contains('|'), "{}", row.name);
    }
    let text = fs::read_to_string(file("docs/methods.md")).expect("docs/methods.md is there");
    for method in Method::ALL {
        assert!(text.contains(&format!("| `{}` | ", method.name())), "{}", method.name());
    }
}
