//! How much memory a file may take. Whoever reads one asks before anything is allocated, by what the file's
//! header says, so that no small file fills the machine.

use crate::{Error, Result};
use std::sync::{
    Mutex, OnceLock, PoisonError,
    atomic::{AtomicU64, Ordering},
};

/// What the user allows, bytes; 0 if nothing was said.
static GIVEN: AtomicU64 = AtomicU64::new(0);
/// The share of the machine's memory that one file may take while it is read.
const SHARE: f64 = 0.5;
/// What is taken where the machine does not say what it has.
const UNKNOWN: u64 = 8 << 30;

/// Sets what one file may take while it is read, bytes.
pub fn set(bytes: u64) {
    GIVEN.store(bytes, Ordering::Relaxed);
}

/// What one file may take while it is read, bytes: what was [`set`], or half of the machine's memory.
pub fn limit() -> u64 {
    static HALF: OnceLock<u64> = OnceLock::new();
    match GIVEN.load(Ordering::Relaxed) {
        0 => *HALF.get_or_init(|| (machine().unwrap_or(UNKNOWN) as f64 * SHARE) as u64),
        given => given,
    }
}

/// Refuses what takes more than the [`limit`].
///
/// # Errors
/// Fails with both numbers, and `subject` in front.
pub fn ask(subject: &str, bytes: u64) -> Result<()> {
    refusal(bytes).map_or(Ok(()), |problem| Err(Error::input(subject, problem, REMEDY)))
}

/// What can be done about a [`refusal`].
pub const REMEDY: &str = "give a smaller one, or allow more by --memory";

/// Says what is wrong with taking so much, if it is too much.
pub fn refusal(bytes: u64) -> Option<String> {
    let limit = limit();
    (bytes > limit).then(|| format!("would take {} of memory, and {} may be taken", words(bytes), words(limit)))
}

fn words(bytes: u64) -> String {
    match bytes {
        0..0x4000_0000 => format!("{:.0} MiB", bytes as f64 / f64::from(1 << 20)),
        _ => format!("{:.1} GiB", bytes as f64 / f64::from(1 << 30)),
    }
}

/// What a device can hold.
#[derive(Clone, Debug)]
pub struct Device {
    pub name: String,
    /// The most texels that an image has along a side.
    pub side: u32,
    /// The most bytes of an image, and of all.
    pub image: u64,
    pub all: u64,
}

/// The device that was opened last.
static DEVICE: Mutex<Option<Device>> = Mutex::new(None);

/// Sets the device that panoramas are meant for.
pub fn set_device(device: Device) {
    *DEVICE.lock().unwrap_or_else(PoisonError::into_inner) = Some(device);
}

/// Refuses a panorama of this size, if the device cannot hold it. `bytes` says of a number of texels how many the largest
/// image of them takes, and how many all.
///
/// # Errors
/// Fails with both numbers, and the `--panorama-size` that can be held.
pub fn ask_device(subject: &str, [width, height]: [u32; 2], bytes: &dyn Fn(u64) -> [u64; 2]) -> Result<()> {
    let device = DEVICE.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(Device { name, side, image, all }) = device.as_ref() else { return Ok(()) };
    let takes = |by: u32| bytes(u64::from(width.div_ceil(by)) * u64::from(height.div_ceil(by)));
    let fits = |by: u32| {
        let [largest, sum] = takes(by);
        width.max(height).div_ceil(by) <= *side && largest <= *image && sum <= *all
    };
    if fits(1) {
        return Ok(());
    }
    let problem = if width.max(height) > *side {
        format!("has {width}x{height} texels, and {name} holds images of at most {side} a side")
    } else {
        let [largest, sum] = takes(1);
        let (takes, most) = if largest > *image { (largest, *image) } else { (sum, *all) };
        format!("has {width}x{height} texels, which take {}, and {name} holds {}", words(takes), words(most))
    };
    let smaller = (1..=16).map(|power| 1 << power).find(|by| fits(*by)).map_or(8, |by| (width / by).max(8));
    Err(Error::input(subject, problem, format!("give --panorama-size {smaller}, which reduces it as it is read")))
}

/// The memory of the machine, or of the part of it that this process may use.
fn machine() -> Option<u64> {
    let group = ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"]
        .iter()
        .find_map(|file| std::fs::read_to_string(file).ok()?.trim().parse::<u64>().ok());
    let physical = physical();
    [group, physical].into_iter().flatten().min()
}

#[cfg(unix)]
fn physical() -> Option<u64> {
    // SAFETY: these calls only ask.
    let [pages, size] = unsafe { [libc::sysconf(libc::_SC_PHYS_PAGES), libc::sysconf(libc::_SC_PAGESIZE)] };
    Some(u64::try_from(pages).ok()? * u64::try_from(size).ok()?).filter(|bytes| *bytes > 0)
}

#[cfg(not(unix))]
fn physical() -> Option<u64> {
    None
}

/// Reads a size like `512M` or `4G`: bytes in powers of 1024.
///
/// # Errors
/// Fails with what can be given.
pub fn parse(text: &str) -> std::result::Result<u64, String> {
    let text = text.trim().trim_end_matches("iB").trim_end_matches('B');
    let digits = text.trim_end_matches(['K', 'M', 'G', 'T', 'k', 'm', 'g', 't']);
    let shift = match text[digits.len()..].to_ascii_uppercase().as_str() {
        "" => 0,
        "K" => 10,
        "M" => 20,
        "G" => 30,
        "T" => 40,
        _ => return Err("write for example 512M or 4G".to_owned()),
    };
    let number: Option<f64> = digits.trim().parse().ok();
    match number.map(|number| number * (1_u64 << shift) as f64) {
        Some(bytes) if (f64::from(1 << 20)..1e18).contains(&bytes) => Ok(bytes as u64),
        _ => Err("write for example 512M or 4G; 1M is the least".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read() {
        assert_eq!(parse("512M"), Ok(512 << 20));
        assert_eq!(parse("1.5GiB"), Ok(3 << 29));
        assert_eq!(parse("2097152"), Ok(2 << 20));
        for bad in ["", "G", "1", "4X", "-4G", "inf", "NaNG", "1e30"] {
            assert!(parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn half_of_the_machine_is_allowed() {
        let half = limit();
        assert!(half >= 64 << 20, "{half}");
        assert!(ask("a.png", half).is_ok());
        let line = ask("a.png", u64::MAX).expect_err("too much").to_string();
        assert!(line.starts_with("a.png: would take") && line.contains("--memory"), "{line}");
    }
}
