//! `iprt stability` runs cases in which such methods fail.

use super::{
    common::{DeviceArgs, key_value},
    progress::progress,
    signals,
};
use crate::{
    Error, Result,
    image_file::write::make_folder,
    settings::Method,
    stability::{
        METHODS, Suite, cases,
        report::{self, Row, Setup},
    },
};
use std::{path::PathBuf, sync::atomic::Ordering};

/// Arguments of `iprt stability`.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Names of cases [default: all]
    pub cases: Vec<String>,
    /// Folder for stability.json, stability.html and the pictures; it is made if it does not exist
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Use smaller pictures and fewer frames
    #[arg(long)]
    pub quick: bool,
    /// A method: ibl, paper, iprt or reference (the converged model, which leaves the model's own errors);
    /// may be repeated [default: ibl, paper, iprt]
    #[arg(long)]
    pub method: Vec<String>,
    /// A setting for every method, as key=value; may be repeated (see docs/methods.md)
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Fail with status 1 if a value is beyond its limit
    #[arg(long)]
    pub strict: bool,
    #[command(flatten)]
    pub device: DeviceArgs,
    /// Print less
    #[arg(short, long)]
    pub quiet: bool,
}

/// Runs the cases and writes the report.
pub fn run(args: &Args) -> Result<()> {
    let all = cases::all();
    if let Some(unknown) = args.cases.iter().find(|name| !all.iter().any(|case| case.name == name.as_str())) {
        let names: Vec<_> = all.iter().map(|case| case.name).collect();
        let remedy = format!("choose from {}", names.join(", "));
        return Err(Error::input("CASE", format!("there is no case \"{unknown}\""), remedy));
    }
    let wanted = |name: &str| args.cases.is_empty() || args.cases.iter().any(|case| case == name);
    let chosen: Vec<_> = all.into_iter().filter(|case| wanted(case.name)).collect();
    let methods = match args.method.as_slice() {
        [] => METHODS.to_vec(),
        names => names.iter().map(|name| Method::parse(name, "--method")).collect::<Result<Vec<_>>>()?,
    };
    let set = args.set.iter().map(|pair| key_value(pair)).collect::<Result<Vec<_>>>()?;
    let gpu = args.device.open()?;
    let setup = Setup {
        device: gpu.device_name().to_owned(),
        driver: gpu.driver().to_owned(),
        quick: args.quick,
        set: args.set.clone(),
    };
    let suite = Suite::new(&gpu, args.quick).with(&set)?;
    let bar = progress(args.quiet, (chosen.len() * methods.len()) as u64, "cases");
    make_folder(&args.output)?;
    let (mut rows, mut failed) = (Vec::new(), 0);
    let stop = signals::interrupted();
    let names: Vec<_> = chosen.iter().map(|case| case.name).collect();
    for case in chosen {
        if stop.load(Ordering::Relaxed) {
            return Err(Error::Interrupted {
                subject: args.output.display().to_string(),
                at: format!("after {} of {} cases", rows.len(), names.len()),
                remedy: format!("the report holds them; for the others, name {}", names[rows.len()..].join(" ")),
            });
        }
        let mut results = Vec::new();
        for &method in &methods {
            match suite.run(&case, method) {
                Ok(outcome) => results.push((method, outcome)),
                // The other cases still run.
                Err(error) => {
                    super::say(&format!("{}, {}: {error}", case.name, method.name()));
                    failed += 1;
                }
            }
            bar.inc(1);
        }
        let row = Row { case, results };
        if !args.quiet {
            bar.suspend(|| super::print_lines(&row.line()));
        }
        rows.push(row);
        // What is done is written at once, whatever happens to the rest.
        report::write(&args.output, &rows, &setup)?;
    }
    bar.finish_and_clear();
    drop(suite);
    if !args.quiet {
        super::print(&args.output.join("stability.html").display().to_string());
    }
    args.device.close(gpu)?;
    let beyond: Vec<_> = rows.iter().flat_map(Row::beyond).collect();
    match failed {
        0 if args.strict && !beyond.is_empty() => Err(Error::Beyond {
            subject: "stability".to_owned(),
            problem: format!("{} of its values are beyond their limits: {}", beyond.len(), beyond.join(", ")),
        }),
        0 => Ok(()),
        n => Err(Error::input("stability", format!("{n} could not be measured"), "see the lines above")),
    }
}
