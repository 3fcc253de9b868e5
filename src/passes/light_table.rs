//! `light_table`, once per video frame: a table of lamps and windows from which directions are drawn.

use super::{
    panorama::Panorama,
    resources::{Kernel, Resources},
};
use crate::{
    Result,
    gpu::{Constant, Frame, Gpu, Threads},
    panorama::light::CELLS,
    plan::Part,
    settings::Settings,
    shaders,
};

/// The table's size in bytes: header, row sums, and four arrays of cells.
pub const BYTES: u64 = 4 * (3 + CELLS[1] as u64 + 4 * CELLS[0] as u64 * CELLS[1] as u64);

pub struct LightTable {
    cells: Kernel,
    sums: Kernel,
}

impl LightTable {
    /// `free_lamps` says whether lamps may hang free, which the table leaves out, and `halves` whether the panorama is of
    /// 16-bit floats.
    pub fn new(gpu: &Gpu, settings: &Settings, free_lamps: bool, halves: Constant) -> Result<Self> {
        let lamps = Part::FreeLamps.constant(u32::from(free_lamps));
        Ok(Self {
            cells: Kernel::new::<()>(gpu, "light_cells", shaders::LIGHT_CELLS, &[lamps, halves])?,
            sums: Kernel::new::<()>(
                gpu,
                "light_table",
                shaders::LIGHT_TABLE,
                &[Part::LightTable.constant(settings.directions as u32), lamps],
            )?,
        })
    }

    pub fn record(&self, frame: &mut Frame, panorama: &Panorama, view: &Resources) -> Result<()> {
        let pools = [&panorama.resources, view];
        frame.scope("light_table", |frame| {
            self.cells.dispatch(frame, &[], &pools, &(), Threads::Size([CELLS[0], CELLS[1], 1]))?;
            frame.barrier("light_table sums its cells");
            self.sums.dispatch(frame, &[], &pools, &(), Threads::Size([CELLS[1], 1, 1]))
        })
    }
}
