//! `iprt devices` lists the devices to run on.

use super::json::JsonArgs;
use crate::{
    Result,
    gpu::adapter::{self, Adapter},
};

/// Arguments of `devices`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub json: JsonArgs,
}

/// Lists every device.
///
/// # Errors
/// Fails with [`Error::NoDevice`](crate::Error::NoDevice) if there is no loader, no driver or no usable device.
pub fn run(args: &Args) -> Result<()> {
    let adapters = adapter::list()?;
    let default = adapter::choose(&adapters, None);
    args.json.require()?;
    args.json.write(&adapters)?;
    if !args.json.is_printed() && !adapters.is_empty() {
        let lines: Vec<_> = adapters.iter().map(|a| line(a, default.as_ref().ok() == Some(&a.index))).collect();
        super::print_lines(&lines.join("\n"));
    }
    default.map(|_| ())
}

fn line(adapter: &Adapter, default: bool) -> String {
    let Adapter { index, name, driver, api_version, kind, usable, problems } = adapter;
    let verdict = match (usable, default) {
        (true, true) => "usable, the default".to_owned(),
        (true, false) => "usable".to_owned(),
        (false, _) => format!("not usable: {}", problems.join(", ")),
    };
    format!("{index}  {name}\n   {kind}, Vulkan {api_version}, {driver}\n   {verdict}")
}
