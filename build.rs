//! Compiles every `shaders/glsl/*.comp` to SPIR-V for Vulkan 1.3 and writes `shaders.rs`: one `&[u32]` constant a
//! pass, named as the file's stem in capitals. The tests' own shaders, `tests/glsl/*.comp`, go to `test_shaders.rs`.

use std::{
    env, fs,
    hash::{DefaultHasher, Hash, Hasher},
    path::PathBuf,
};

fn main() {
    compile("shaders/glsl", "shaders.rs");
    compile("tests/glsl", "test_shaders.rs");
}

fn compile(sources: &str, table_name: &str) {
    let folder = PathBuf::from(env::var("CARGO_MANIFEST_DIR").expect("cargo sets it")).join(sources);
    let out = PathBuf::from(env::var("OUT_DIR").expect("cargo sets it"));
    println!("cargo:rerun-if-changed={}", folder.display());
    let compiler = shaderc::Compiler::new().expect("shaderc could not be initialised");
    let mut options = shaderc::CompileOptions::new().expect("shaderc could not be initialised");
    options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_3 as u32);
    options.set_optimization_level(shaderc::OptimizationLevel::Performance);
    options.set_generate_debug_info(); // keeps binding and member names, by which bindings are matched
    options.set_warnings_as_errors();
    // the tests' shaders include the project's
    let includes = PathBuf::from(env::var("CARGO_MANIFEST_DIR").expect("cargo sets it")).join("shaders/glsl");
    options.set_include_callback(move |name, _, _, _| {
        let path = includes.join(name);
        let content = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok(shaderc::ResolvedInclude { resolved_name: path.display().to_string(), content })
    });

    let mut stems: Vec<_> = fs::read_dir(&folder)
        .expect("the shader folders are part of the source")
        .map(|entry| entry.expect("a readable folder").path())
        .filter(|path| path.extension().is_some_and(|e| e == "comp"))
        .collect();
    stems.sort();
    let mut table = String::new();
    for path in &stems {
        let stem = path.file_stem().expect("a file name").to_string_lossy().into_owned();
        let source = fs::read_to_string(path).expect("a readable shader");
        let spirv = compiler
            .compile_into_spirv(
                &source,
                shaderc::ShaderKind::Compute,
                &path.display().to_string(),
                "main",
                Some(&options),
            )
            .unwrap_or_else(|error| panic!("{error}"));
        let words: Vec<String> = without_source(spirv.as_binary()).iter().map(|word| format!("{word:#x}")).collect();
        table += &format!(
            "/// SPIR-V of `{sources}/{stem}.comp`.\npub const {}: &[u32] = &[{}];\n",
            stem.to_uppercase(),
            words.join(",")
        );
    }
    // stable for one compiler: another one's truths are merely computed again
    let mut hasher = DefaultHasher::new();
    table.hash(&mut hasher);
    table += &format!(
        "/// Changes with any of them.\n#[allow(dead_code)]\npub const DIGEST: u64 = {:#x};\n",
        hasher.finish()
    );
    fs::write(out.join(table_name), table).expect("OUT_DIR is writable");
}

/// Leaves out the source text and line numbers that come with debug information; names of bindings and members stay.
fn without_source(spirv: &[u32]) -> Vec<u32> {
    const HEADER: usize = 5;
    // OpSourceContinued, OpSource, OpSourceExtension, OpString, OpLine, OpNoLine, OpModuleProcessed
    const DROPPED: [u32; 7] = [2, 3, 4, 7, 8, 317, 330];
    let mut kept = spirv[..HEADER].to_vec();
    let mut at = HEADER;
    while at < spirv.len() {
        let (length, opcode) = ((spirv[at] >> 16) as usize, spirv[at] & 0xffff);
        if !DROPPED.contains(&opcode) {
            kept.extend_from_slice(&spirv[at..at + length]);
        }
        at += length;
    }
    kept
}
