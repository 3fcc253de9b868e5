//! The Vulkan layers of the tests (`tests/layer`): compiled once, and put between a command and its driver.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
    sync::OnceLock,
};

/// The folder of the layers.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("layers-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("made");
        let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".into());
        for name in ["fault", "profile"] {
            let status = Command::new(&compiler)
                .args(["-Wall", "-Werror", "-O1", "-fPIC", "-shared", "-o"])
                .arg(folder.join(format!("lib{name}.so")))
                .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/layer/{name}.c")))
                .args(["-lpthread"])
                .status();
            assert!(status.expect("tests of layers need a C compiler").success());
            let manifest = format!(
                r#"{{"file_format_version": "1.1.2", "layer": {{"name": "VK_LAYER_IPRT_{name}", "type": "INSTANCE",
                "library_path": "./lib{name}.so", "api_version": "1.3.0", "implementation_version": "1",
                "description": "for tests"}}}}"#
            );
            fs::write(folder.join(format!("{name}.json")), manifest).expect("writes");
        }
        folder
    })
}

/// Has a command run with these layers, parted by colons. The first is nearest to the command.
pub fn put<'a>(command: &'a mut Command, layers: &str) -> &'a mut Command {
    command.env("VK_ADD_LAYER_PATH", folder()).env("VK_INSTANCE_LAYERS", layers)
}
