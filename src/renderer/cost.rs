//! What a plan costs: dispatches and device memory.

use crate::{
    Result,
    passes::{
        PASSES, PassRow, panorama,
        view::{self, Role},
    },
    plan::{By, Decision, Part, Plan},
};
use std::fmt::Write;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cost {
    /// Dispatches of a frame that shows a new video frame.
    pub dispatches: u32,
    /// Bytes of images and lists before drivers round them up, without objects' triangles and textures.
    pub bytes: u64,
}

/// What a part adds to a plan. Values are negative if the part saves something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Dispatches of a frame that shows a new video frame.
    pub dispatches: i64,
    /// Bytes.
    pub bytes: i64,
}

/// A pass, as a plan runs it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PassPlan {
    /// The pass's name.
    pub name: &'static str,
    /// How often it is dispatched in a frame that shows a new video frame.
    pub dispatches: u32,
    /// Why it does not run, if it does not.
    pub off: Option<String>,
}

impl Plan {
    /// All passes in the order of the frame.
    pub fn passes(&self) -> Vec<PassPlan> {
        let pass = |row: &PassRow| {
            let dispatches = (row.dispatches)(self);
            let missing = row.without.iter().filter(|part| !self.on(**part));
            let why = || match missing.map(|part| self.reason(*part)).collect::<Vec<_>>() {
                parts if parts.is_empty() => "no setting asks for it".to_owned(),
                parts => parts.join("; "),
            };
            PassPlan { name: row.name, dispatches, off: (dispatches == 0).then(why) }
        };
        PASSES.iter().map(pass).collect()
    }

    /// The dispatches and the memory of the plan.
    pub fn cost(&self) -> Cost {
        let width = self.settings.relight_width;
        let relight = view::bytes(self, Role::Relight, [width, width.div_ceil(2)]);
        let relight = relight * u64::from(self.settings.relight_levels) * u64::from(self.on(Part::Relight));
        Cost {
            dispatches: self.passes().iter().map(|pass| pass.dispatches).sum(),
            bytes: view::bytes(self, Role::Picture, self.size) + relight + panorama::bytes(self),
        }
    }

    /// The plan in one line: the number of parts that are on, and the names of those left out.
    pub fn summary(&self) -> String {
        let off: Vec<_> =
            self.parts.iter().filter(|d| !d.on && !matches!(d.by, By::Need(_))).map(|d| d.part.name()).collect();
        let on = self.parts.iter().filter(|d| d.on).count();
        let off = if off.is_empty() { "none left out".to_owned() } else { format!("without {}", off.join(", ")) };
        let Cost { dispatches, bytes } = self.cost();
        format!(
            "plan: {on} of {} parts ({off}); {dispatches} dispatches, {}",
            self.parts.len(),
            mebibytes(bytes as f64)
        )
    }

    /// What each part costs, compared with the same plan without it. A part that is off is forced on for
    /// this.
    ///
    /// # Errors
    /// Fails only if the table of parts has an error.
    pub fn costs(&self) -> Result<Vec<Difference>> {
        let own = self.cost();
        let difference = |decision| {
            let other = self.flipped(decision)?.cost();
            let (with, without) = if decision.on { (own, other) } else { (other, own) };
            Ok(Difference {
                dispatches: i64::from(with.dispatches) - i64::from(without.dispatches),
                bytes: with.bytes as i64 - without.bytes as i64,
            })
        };
        self.parts.iter().map(difference).collect()
    }

    /// A table for people to read: each part, whether it is on, what it costs, and why.
    ///
    /// # Errors
    /// Fails as [`Plan::costs`] does.
    pub fn table(&self) -> Result<String> {
        let mut out = format!("{:<18}{:<5}{:>12}{:>12}  {}\n", "part", "", "memory", "dispatches", "why");
        for (decision, cost) in self.parts.iter().zip(self.costs()?) {
            let (name, on) = (decision.part.name(), if decision.on { "on" } else { "off" });
            let memory = mebibytes(cost.bytes as f64);
            let _ = writeln!(out, "{name:<18}{on:<5}{memory:>12}{:>12}  {}", cost.dispatches, decision.why);
        }
        let _ = write!(out, "{}", self.summary());
        Ok(out)
    }

    /// The same as JSON.
    ///
    /// # Errors
    /// Fails as [`Plan::costs`] does.
    pub fn json(&self) -> Result<serde_json::Value> {
        let part = |(decision, cost): (&Decision, Difference)| {
            serde_json::json!({
                "name": decision.part.name(),
                "on": decision.on,
                "by": match decision.by {
                    By::Scene => "scene",
                    By::Method => "method",
                    By::Need(_) => "need",
                    By::Set => "set",
                },
                "why": decision.why,
                "setting": decision.part.row().setting,
                "bytes": cost.bytes,
                "dispatches": cost.dispatches,
            })
        };
        let Cost { dispatches, bytes } = self.cost();
        let passes: Vec<_> = self
            .passes()
            .iter()
            .map(|pass| serde_json::json!({ "name": pass.name, "dispatches": pass.dispatches, "off": pass.off }))
            .collect();
        Ok(serde_json::json!({
            "method": self.method.name(),
            "size": self.size,
            "parts": self.parts.iter().zip(self.costs()?).map(part).collect::<Vec<_>>(),
            "passes": passes,
            "dispatches": dispatches,
            "bytes": bytes,
        }))
    }
}

fn mebibytes(bytes: f64) -> String {
    format!("{:.1} MiB", bytes / f64::from(1 << 20))
}
