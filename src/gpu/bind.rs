//! What bindings are given, and whether it fits them.

use super::{
    acceleration::Acceleration,
    device::Gpu,
    memory::{Buffer, Image},
    pass::Pass,
    reflect::{Binding, Kind},
};

/// What a shader's binding is bound to.
#[derive(Clone, Debug)]
pub enum Bind {
    Buffer(Buffer),
    /// An image and the level to bind. `None` binds level 0 for stores and all levels for sampling.
    Image(Image, Option<u32>),
    /// What ray queries search.
    Acceleration(Acceleration),
}

impl From<&Buffer> for Bind {
    fn from(buffer: &Buffer) -> Self {
        Self::Buffer(buffer.clone())
    }
}

impl From<&Image> for Bind {
    fn from(image: &Image) -> Self {
        Self::Image(image.clone(), None)
    }
}

impl From<&Acceleration> for Bind {
    fn from(acceleration: &Acceleration) -> Self {
        Self::Acceleration(acceleration.clone())
    }
}

impl Image {
    /// Binds one mip level.
    pub fn level(&self, level: u32) -> Bind {
        Bind::Image(self.clone(), Some(level))
    }
}

/// Sorts the bindings into the order of the pass's slots, and checks each.
pub(super) fn order(pass: &Pass, binds: &[(&str, Bind)], gpu: &Gpu) -> std::result::Result<Vec<Bind>, String> {
    let slots = &pass.0.slots;
    for (i, (name, _)) in binds.iter().enumerate() {
        if !slots.iter().any(|slot| slot.name == *name) {
            return Err(format!("it has no binding {name}"));
        }
        if binds[..i].iter().any(|(earlier, _)| earlier == name) {
            return Err(format!("binding {name} is given twice"));
        }
    }
    slots
        .iter()
        .map(|slot| {
            let (_, bind) = binds
                .iter()
                .find(|(name, _)| *name == slot.name)
                .ok_or_else(|| format!("binding {} is not given", slot.name))?;
            fits(slot, bind, gpu)?;
            Ok(bind.clone())
        })
        .collect()
}

fn fits(slot: &Binding, bind: &Bind, gpu: &Gpu) -> std::result::Result<(), String> {
    let name = &slot.name;
    match (slot.kind, bind) {
        (Kind::StorageBuffer, Bind::Buffer(_)) | (Kind::Acceleration, Bind::Acceleration(_)) => Ok(()),
        (Kind::UniformBuffer, Bind::Buffer(buffer)) => {
            let most = u64::from(gpu.0.limits.max_uniform_buffer_range);
            if buffer.bytes() > most {
                return Err(format!("{name} is a uniform block of at most {most} bytes, but {buffer:?} is larger"));
            }
            Ok(())
        }
        (Kind::StorageImage { array, .. } | Kind::Sampled { array, .. }, Bind::Image(image, level)) => {
            if !array && image.layers() > 1 {
                return Err(format!("{name} has no layers in GLSL, but {image:?} has some"));
            }
            if level.is_some_and(|level| level >= image.levels()) {
                return Err(format!("{name}: {image:?} has no such level"));
            }
            match slot.kind {
                Kind::StorageImage { format, .. } if format != image.format() => {
                    Err(format!("{name} is {format:?} in GLSL, but {image:?} is not"))
                }
                Kind::Sampled { integer, .. } if integer != image.format().is_integer() => {
                    Err(format!("one of {name} and {image:?} holds integers, the other floats"))
                }
                _ => Ok(()),
            }
        }
        (Kind::StorageBuffer | Kind::UniformBuffer, _) => Err(format!("{name} takes a buffer")),
        (Kind::StorageImage { .. } | Kind::Sampled { .. }, _) => Err(format!("{name} takes an image")),
        (Kind::Acceleration, _) => Err(format!("{name} takes an acceleration structure")),
    }
}
