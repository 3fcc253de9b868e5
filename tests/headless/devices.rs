//! `iprt devices`, and the exit statuses of the command line.

use std::process::{Command, Output};

fn iprt(args: &[&str], environment: &[(&str, &str)]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_iprt"));
    command.args(args).env_remove("IPRT_DEVICE").env_remove("IPRT_VALIDATION");
    command.envs(environment.iter().copied()).output().unwrap()
}

fn one_line(output: &Output) -> String {
    let text = String::from_utf8(output.stderr.clone()).unwrap();
    assert!(text.starts_with("iprt: ") && text.ends_with('\n') && text.lines().count() == 1, "{text}");
    text
}

#[test]
fn every_device_is_listed_with_driver_version_and_verdict() {
    let output = iprt(&["devices", "--json"], &[]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let list: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let list = list.as_array().unwrap();
    assert!(list.iter().any(|device| device["usable"] == true));
    for (index, device) in list.iter().enumerate() {
        assert_eq!(device["index"], index);
        assert!(device["api_version"].as_str().unwrap().starts_with("1."));
        assert!(!device["name"].as_str().unwrap().is_empty() && !device["driver"].as_str().unwrap().is_empty());
        assert_eq!(device["usable"] == true, device["problems"].as_array().unwrap().is_empty());
    }
    let text = iprt(&["devices"], &[]);
    let text = String::from_utf8(text.stdout).unwrap();
    assert!(text.contains(list[0]["name"].as_str().unwrap()) && text.contains("usable, the default"), "{text}");
}

#[test]
fn no_driver_is_exit_3_and_one_line() {
    let output =
        iprt(&["devices"], &[("VK_DRIVER_FILES", "/nonexistent.json"), ("VK_ICD_FILENAMES", "/nonexistent.json")]);
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    assert!(one_line(&output).contains("install"));
}

#[test]
fn no_loader_is_exit_3_and_one_line() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("libvulkan.so.1"), "not a library").unwrap();
    let output = iprt(&["devices"], &[("LD_LIBRARY_PATH", folder.path().to_str().unwrap())]);
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    assert!(one_line(&output).contains("libvulkan1"));
}

#[test]
fn wrong_usage_is_exit_2() {
    for args in [&["devices", "--frobnicate"][..], &["fly"], &[]] {
        let output = iprt(args, &[]);
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        assert!(output.stdout.is_empty());
    }
    assert_eq!(iprt(&["--help"], &[]).status.code(), Some(0));
}
