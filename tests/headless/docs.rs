//! Documents that are made from code are what the code says. `IPRT_BLESS=1` (`make docs`) writes them.

use clap::{Arg, ArgAction, Args, Command, CommandFactory};
use iprt::{
    cli::{
        Cli,
        common::{DeviceArgs, PictureArgs},
        target::TargetArgs,
    },
    settings::{Method, Settings},
};
use std::{fs, path::PathBuf};

fn file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(name)
}

#[test]
fn the_table_of_settings_is_the_codes_own() {
    generated("docs/methods.md", "settings", "the table in src/settings.rs", &Settings::markdown());
}

#[test]
fn the_table_of_keys_is_the_windows_own() {
    let rows: String =
        iprt::viewer::controls::KEYS.iter().map(|(keys, meaning)| format!("| {keys} | {meaning} |\n")).collect();
    let table = format!("| key | does |\n|---|---|\n{rows}");
    generated("docs/window.md", "keys", "the table in src/viewer/controls.rs", &table);
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
fn every_setting_and_method_is_described() {
    for row in Settings::TABLE {
        assert!(row.meaning.len() > 10 && !row.meaning.contains('|'), "{}", row.name);
    }
    let text = fs::read_to_string(file("docs/methods.md")).expect("docs/methods.md is there");
    for method in Method::ALL {
        assert!(text.contains(&format!("| `{}` | ", method.name())), "{}", method.name());
    }
}
