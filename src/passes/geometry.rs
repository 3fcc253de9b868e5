//! `geometry`: position, normal, motion and object of surfaces, which the images of a view hold packed. Outside of the
//! frame.

use super::{
    display::Values,
    resources::{Kernel, Resources},
    view::{Role, View},
};
use crate::{
    Result,
    gpu::{Bind, Format, Gpu, Image, Threads},
    plan::Plan,
    shaders,
};

/// Unpacks what one layer of a view holds after a frame: an image of its size. `values` is one of those that
/// `Values::is_geometry` names.
///
/// # Errors
/// Fails if the device is lost or out of memory.
pub fn unpack(gpu: &Gpu, plan: &Plan, view: &View, scene: &Resources, layer: u32, values: Values) -> Result<Image> {
    let constants = [("LAYER", layer), ("WANTED", values as u32), Role::Picture.projection(plan)];
    let kernel = Kernel::new::<()>(gpu, "geometry", shaders::GEOMETRY, &constants)?;
    let image = gpu.image("geometry", view.size, 1, 1, Format::Rgba32f)?;
    let mut frame = gpu.frame()?;
    let [width, height] = view.size;
    let (special, threads) = ([("out_geometry", Bind::from(&image))], Threads::Size([width, height, 1]));
    kernel.dispatch(&mut frame, &special, &[&view.resources, scene], &(), threads)?;
    frame.run()?;
    Ok(image)
}
