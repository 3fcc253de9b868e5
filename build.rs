//! Compiles `shaders/glsl/*.comp`, and the tests' own `tests/glsl/*.comp`, to SPIR-V for Vulkan 1.3. A shader
//! is compiled only if its text or that of a file it includes has changed. Writes `shaders.rs` and
//! `test_shaders.rs` with one `&[u32]` constant for each shader, named as its file in capitals.
//!
//! A debug build of the program runs this executable again, as `build-script-build ROOT OUT_DIR`, to compile
//! the shaders on disk (`src/shaders/reload.rs`). So there is one compiler and one cache.

use std::{
    collections::HashSet,
    env, fs,
    hash::{DefaultHasher, Hash, Hasher},
    path::{Path, PathBuf},
    process::ExitCode,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
};

type Result<T> = std::result::Result<T, String>;

/// The folders of shaders, relative to the source's root. The tests' shaders include the project's.
const FOLDERS: [&str; 2] = ["shaders/glsl", "tests/glsl"];

/// One compiled shader.
struct Shader {
    /// Its path from the root, without `.comp`, and the marks of what else is compiled in: [`RAY_QUERY`], then [`FAULTS`].
    name: String,
    /// The file of its SPIR-V in the cache.
    file: PathBuf,
    spirv: Vec<u32>,
}

/// Marks a shader that has planted faults. Only the feature `faults` has such shaders.
const FAULTS: &str = "+faults";
/// Marks a shader that makes ray queries. Each shader whose own text asks for `RAY_QUERY` is compiled without and with it,
/// because a device without ray queries must not be given a module that has them.
const RAY_QUERY: &str = "+ray_query";

fn main() -> ExitCode {
    let arguments: Vec<_> = env::args_os().skip(1).map(PathBuf::from).collect();
    let done = match &arguments[..] {
        [root, out] => list(root, out),
        _ => build(),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

/// Runs as Cargo's build script.
fn build() -> Result<()> {
    let variable = |name| env::var(name).map_err(|_| format!("cargo sets {name}"));
    let (root, out) = (PathBuf::from(variable("CARGO_MANIFEST_DIR")?), PathBuf::from(variable("OUT_DIR")?));
    let shaders = compile_all(&root, &out)?;
    for folder in FOLDERS {
        let here: Vec<_> = shaders.iter().filter(|shader| shader.name.starts_with(folder)).collect();
        let table = if folder == FOLDERS[0] { "shaders.rs" } else { "test_shaders.rs" };
        let mut text: String = here.iter().map(|shader| constant(shader)).collect();
        if folder == FOLDERS[0] {
            text += &format!("const DIGEST: u64 = {};\n", digest(&shaders));
            let sources = shaders.iter().map(|shader| match shader.name.starts_with(folder) {
                true => format!("({:?}, {}),", shader.name, capitals(&shader.name)),
                false => format!("({:?}, &{:?}),", shader.name, shader.spirv),
            });
            let sources: String = sources.collect();
            text +=
                &format!("#[cfg(debug_assertions)]\npub(crate) static SOURCES: &[(&str, &[u32])] = &[{sources}];\n");
            let pairs: String = here
                .iter()
                .filter_map(|shader| {
                    Some(format!("({}, {}),", capitals(shader.name.strip_suffix(FAULTS)?), capitals(&shader.name)))
                })
                .collect();
            text += &format!("#[cfg(feature = \"faults\")]\nstatic FAULTY: &[(&[u32], &[u32])] = &[{pairs}];\n");
        }
        write(&out.join(table), text.as_bytes())?;
    }
    for entry in read_folder(&cache(&out))? {
        let named = |file: &Path| {
            file.file_stem().and_then(|stem| stem.to_str()?.rsplit_once('-')).map(|(name, _)| name.to_owned())
        };
        let older = |shader: &Shader| named(&shader.file) == named(&entry) && shader.file != entry;
        if shaders.iter().any(older) {
            let _ = fs::remove_file(&entry); // another build may have been faster
        }
    }
    let this = env::current_exe().map_err(|error| error.to_string())?;
    println!("cargo:rustc-env=IPRT_SHADER_COMPILER={}", this.display());
    println!("cargo:rerun-if-changed=build.rs");
    if variable("PROFILE")? == "debug" {
        // The program itself finds a changed shader. If Rust changes, the crate is compiled anyway.
        println!("cargo:rerun-if-changed=src");
    } else {
        FOLDERS.iter().for_each(|folder| println!("cargo:rerun-if-changed={folder}"));
    }
    Ok(())
}

/// Runs as the program's compiler. Prints the name and the SPIR-V file of each shader, then the digest.
fn list(root: &Path, out: &Path) -> Result<()> {
    let shaders = compile_all(root, out)?;
    shaders.iter().for_each(|shader| println!("{}\t{}", shader.name, shader.file.display()));
    println!("digest\t{}", digest(&shaders));
    Ok(())
}

/// Hashes all shipped shaders. Another compiler changes the hash, so truths are computed again.
fn digest(shaders: &[Shader]) -> u64 {
    let mut hasher = DefaultHasher::new();
    for shader in shaders.iter().filter(|shader| shader.name.starts_with(FOLDERS[0]) && !shader.name.ends_with(FAULTS))
    {
        (&shader.name, &shader.spirv).hash(&mut hasher);
    }
    hasher.finish()
}

fn constant(shader: &Shader) -> String {
    let words: Vec<String> = shader.spirv.iter().map(u32::to_string).collect();
    let [name, words] = [capitals(&shader.name), words.join(",")];
    format!("/// SPIR-V of `{}`.\npub const {name}: &[u32] = &[{words}];\n", shader.name)
}

/// The name of a shader's constant.
fn capitals(name: &str) -> String {
    name.rsplit('/').next().unwrap_or_default().replace('+', "_").to_uppercase()
}

/// Compiles the shaders below a root on all cores, as far as they have changed. Returns all, sorted by name.
fn compile_all(root: &Path, out: &Path) -> Result<Vec<Shader>> {
    let faults = cfg!(feature = "faults");
    let mut wanted = Vec::new();
    for folder in FOLDERS {
        for path in read_folder(&root.join(folder))?.into_iter().filter(|p| p.extension().is_some_and(|e| e == "comp"))
        {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy();
            let queries = read(&path)?.contains("#ifdef RAY_QUERY");
            for mark in [Some(""), queries.then_some(RAY_QUERY)].into_iter().flatten() {
                wanted.push((format!("{folder}/{stem}{mark}"), path.clone()));
                if faults && folder == FOLDERS[0] {
                    wanted.push((format!("{folder}/{stem}{mark}{FAULTS}"), path.clone()));
                }
            }
        }
    }
    fs::create_dir_all(cache(out)).map_err(|error| format!("{}: {error}", out.display()))?;
    let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some((name, path)) = wanted.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let shader = up_to_date(name, path, &root.join(FOLDERS[0]), out);
                    done.lock().unwrap_or_else(PoisonError::into_inner).push(shader);
                }
            });
        }
    });
    let shaders: Result<Vec<_>> = done.into_inner().unwrap_or_else(PoisonError::into_inner).into_iter().collect();
    let mut shaders = shaders?;
    shaders.sort_by(|a, b| a.name.cmp(&b.name));
    // most shaders have no planted fault, and are then not needed twice
    let whole: HashSet<Vec<u32>> =
        shaders.iter().filter(|s| !s.name.ends_with(FAULTS)).map(|s| s.spirv.clone()).collect();
    shaders.retain(|shader| !(shader.name.ends_with(FAULTS) && whole.contains(&shader.spirv)));
    Ok(shaders)
}

/// The folder of compiled shaders in Cargo's target folder. All profiles and features share it.
fn cache(out: &Path) -> PathBuf {
    out.ancestors().nth(4).unwrap_or(out).join("spirv") // out is target/PROFILE/build/NAME/out
}

/// Takes a shader from the cache, or compiles it.
fn up_to_date(name: &str, path: &Path, includes: &Path, out: &Path) -> Result<Shader> {
    let mut hasher = DefaultHasher::new();
    hash_text(path, includes, &mut HashSet::new(), &mut hasher)?;
    // another compiler or other options need another file
    (name, include_str!("build.rs"), shaderc::get_spirv_version()).hash(&mut hasher);
    let file = cache(out).join(format!("{}-{:016x}.spv", name.replace('/', "_"), hasher.finish()));
    let spirv = match fs::read(&file) {
        Ok(bytes) => bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect(),
        Err(_) => {
            let spirv = compile(path, includes, name)?;
            let bytes: Vec<u8> = spirv.iter().flat_map(|word| word.to_le_bytes()).collect();
            write(&file, &bytes)?;
            spirv
        }
    };
    Ok(Shader { name: name.to_owned(), file, spirv })
}

/// Hashes the text of a shader and of all that it includes.
fn hash_text(path: &Path, includes: &Path, seen: &mut HashSet<PathBuf>, hasher: &mut DefaultHasher) -> Result<()> {
    if !seen.insert(path.to_owned()) {
        return Ok(());
    }
    let text = read(path)?;
    text.hash(hasher);
    for line in text.lines() {
        if let Some(name) = line.trim().strip_prefix("#include").and_then(|rest| rest.trim().strip_prefix('"'))
            && let Some((name, _)) = name.split_once('"')
        {
            hash_text(&includes.join(name), includes, seen, hasher)?;
        }
    }
    Ok(())
}

fn compile(path: &Path, includes: &Path, name: &str) -> Result<Vec<u32>> {
    let compiler = shaderc::Compiler::new().map_err(|error| error.to_string())?;
    let mut options = shaderc::CompileOptions::new().map_err(|error| error.to_string())?;
    options.set_target_env(shaderc::TargetEnv::Vulkan, shaderc::EnvVersion::Vulkan1_3 as u32);
    options.set_optimization_level(shaderc::OptimizationLevel::Performance);
    options.set_generate_debug_info(); // keeps the names of bindings and members, by which bindings are matched
    options.set_warnings_as_errors();
    for mark in [FAULTS, RAY_QUERY].into_iter().filter(|mark| name.contains(mark)) {
        options.add_macro_definition(&capitals(mark)[1..], None); // without the +, which capitals makes _
    }
    options.set_include_callback(|name, _, _, _| {
        let path = includes.join(name);
        Ok(shaderc::ResolvedInclude { resolved_name: path.display().to_string(), content: read(&path)? })
    });
    let (text, shown) = (read(path)?, path.display().to_string());
    let spirv = compiler.compile_into_spirv(&text, shaderc::ShaderKind::Compute, &shown, "main", Some(&options));
    spirv.map(|spirv| without_source(spirv.as_binary())).map_err(|error| error.to_string())
}

/// Drops the source text and line numbers of debug information. Names of bindings and members stay.
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

fn read(path: &Path) -> Result<String> {
    fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
}

/// Lists the files in a folder, sorted by name.
fn read_folder(folder: &Path) -> Result<Vec<PathBuf>> {
    let files = fs::read_dir(folder).and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect());
    let mut files: Vec<_> = files.map_err(|error| format!("{}: {error}", folder.display()))?;
    files.sort();
    Ok(files)
}

/// Writes a file that others may be reading, unless it already has this content.
fn write(path: &Path, content: &[u8]) -> Result<()> {
    if fs::read(path).is_ok_and(|old| old == content) {
        return Ok(());
    }
    let new = path.with_extension(format!("{}.new", std::process::id()));
    fs::write(&new, content)
        .and_then(|()| fs::rename(&new, path))
        .map_err(|error| format!("{}: {error}", path.display()))
}
