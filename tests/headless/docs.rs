//! Documents that are made from code are what the code says. `IPRT_BLESS=1` (`make docs`) writes them.

use iprt::settings::{Method, Settings};
use std::{fs, path::PathBuf};

const BEGIN: &str = "<!-- settings: written by `make docs` from the table in src/settings.rs -->\n";
const END: &str = "<!-- end of settings -->";

fn document(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("docs").join(name)
}

#[test]
fn the_table_of_settings_is_the_codes_own() {
    let path = document("methods.md");
    let text = fs::read_to_string(&path).expect("docs/methods.md is there");
    let (before, rest) = text.split_once(BEGIN).expect("the table begins");
    let (_, after) = rest.split_once(END).expect("the table ends");
    let expected = format!("{before}{BEGIN}\n{}\n{END}{after}", Settings::markdown());
    if std::env::var_os("IPRT_BLESS").is_some() {
        fs::write(&path, &expected).expect("docs/methods.md can be written");
    } else {
        assert!(text == expected, "docs/methods.md is not what src/settings.rs says: run `make docs`");
    }
}

const KEYS: [&str; 2] =
    ["<!-- keys: written by `make docs` from the table in src/viewer/controls.rs -->\n", "<!-- end of keys -->"];

#[test]
fn the_table_of_keys_is_the_windows_own() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("README.md");
    let text = fs::read_to_string(&path).expect("README.md is there");
    let (before, rest) = text.split_once(KEYS[0]).expect("the table begins");
    let (_, after) = rest.split_once(KEYS[1]).expect("the table ends");
    let rows: String =
        iprt::viewer::controls::KEYS.iter().map(|(keys, meaning)| format!("| {keys} | {meaning} |\n")).collect();
    let expected = format!("{before}{}\n| key | does |\n|---|---|\n{rows}\n{}{after}", KEYS[0], KEYS[1]);
    if std::env::var_os("IPRT_BLESS").is_some() {
        fs::write(&path, &expected).expect("README.md can be written");
    } else {
        assert!(text == expected, "README.md is not what src/viewer/controls.rs says: run `make docs`");
    }
}

#[test]
fn every_setting_and_method_is_described() {
    for row in Settings::TABLE {
        assert!(row.meaning.len() > 10 && !row.meaning.contains('|'), "{}", row.name);
    }
    let text = fs::read_to_string(document("methods.md")).expect("docs/methods.md is there");
    for method in Method::ALL {
        assert!(text.contains(&format!("| `{}` | ", method.name())), "{}", method.name());
    }
}
