//! Accessors are typed arrays in buffers. They are checked before anything is read or allocated.

use super::File;
use crate::Result;
use ::gltf::json::{
    accessor::{ComponentType, Type},
    validation::Checked,
};

/// The most elements of an accessor without a buffer (all zero). Others are bounded by their buffer.
const MAX_ZEROS: usize = 1 << 22;

pub(super) struct Elements {
    bytes: Vec<u8>,
    component: ComponentType,
    components: usize,
    normalized: bool,
    pub count: usize,
}

/// Returns the bytes of a buffer view and its stride.
pub(super) fn view<'f>(file: &'f File, index: usize, user: &str) -> Result<(&'f [u8], Option<usize>)> {
    let Some(view) = file.root.buffer_views.get(index) else {
        return Err(file.broken(format!("{user}: buffer view {index} does not exist")));
    };
    let start = view.byte_offset.map_or(0, |offset| offset.0);
    let bytes = file.buffers.get(view.buffer.value()).and_then(|buffer| {
        let end = start.checked_add(view.byte_length.0)?;
        buffer.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?)
    });
    match bytes {
        Some(bytes) => Ok((bytes, view.byte_stride.map(|stride| stride.0))),
        None => Err(file.broken(format!("{user}: buffer view {index} reaches beyond its buffer"))),
    }
}

fn component_size(component: ComponentType) -> usize {
    match component {
        ComponentType::I8 | ComponentType::U8 => 1,
        ComponentType::I16 | ComponentType::U16 => 2,
        ComponentType::U32 | ComponentType::F32 => 4,
    }
}

/// Copies `count` elements of `size` bytes out of a view.
fn gather(file: &File, view_index: usize, offset: u64, count: usize, size: usize, user: &str) -> Result<Vec<u8>> {
    let (bytes, stride) = view(file, view_index, user)?;
    let stride = stride.unwrap_or(size);
    let beyond = || file.broken(format!("{user}: reaches beyond its buffer view"));
    let offset = usize::try_from(offset).map_err(|_| beyond())?;
    if stride < size {
        return Err(file.broken(format!("{user}: its stride is smaller than its elements")));
    }
    if count == 0 {
        return Ok(Vec::new());
    }
    let end = (count - 1).checked_mul(stride).and_then(|end| end.checked_add(offset)?.checked_add(size));
    if end.is_none_or(|end| end > bytes.len()) {
        return Err(beyond());
    }
    let mut out = Vec::with_capacity(count * size);
    for element in 0..count {
        out.extend_from_slice(&bytes[offset + element * stride..][..size]);
    }
    Ok(out)
}

/// Reads accessor `index`. `user` names it in errors.
pub(super) fn elements(file: &File, index: usize, user: &str) -> Result<Elements> {
    let Some(accessor) = file.root.accessors.get(index) else {
        return Err(file.broken(format!("{user}: accessor {index} does not exist")));
    };
    let user = &format!("{user}: accessor {index}");
    let (Checked::Valid(component), Checked::Valid(kind)) = (accessor.component_type, accessor.type_) else {
        return Err(file.broken(format!("{user}: has no valid type")));
    };
    let components = match kind {
        Type::Scalar => 1,
        Type::Vec2 => 2,
        Type::Vec3 => 3,
        Type::Vec4 => 4,
        Type::Mat2 | Type::Mat3 | Type::Mat4 => return Err(file.broken(format!("{user}: is a matrix"))),
    };
    let component = component.0;
    let size = components * component_size(component);
    let too_many = || file.broken(format!("{user}: says it has {} elements", accessor.count.0));
    let count = usize::try_from(accessor.count.0).map_err(|_| too_many())?;
    let mut bytes = match accessor.buffer_view {
        Some(view) => gather(file, view.value(), accessor.byte_offset.unwrap_or_default().0, count, size, user)?,
        None if count > MAX_ZEROS => return Err(too_many()),
        None => vec![0; count * size],
    };
    if let Some(sparse) = &accessor.sparse {
        let Checked::Valid(index_type) = sparse.indices.component_type else {
            return Err(file.broken(format!("{user}: its sparse indices have no valid type")));
        };
        let changed = usize::try_from(sparse.count.0).map_err(|_| too_many())?;
        let (indices, values) = (&sparse.indices, &sparse.values);
        let index_size = component_size(index_type.0);
        let at = gather(file, indices.buffer_view.value(), indices.byte_offset.0, changed, index_size, user)?;
        let values = gather(file, values.buffer_view.value(), values.byte_offset.0, changed, size, user)?;
        for (index, value) in at.chunks_exact(index_size).zip(values.chunks_exact(size)) {
            let index = unsigned(index) as usize;
            match bytes.chunks_exact_mut(size).nth(index) {
                Some(element) => element.copy_from_slice(value),
                None => return Err(file.broken(format!("{user}: sparse index {index} is beyond its count"))),
            }
        }
    }
    Ok(Elements { bytes, component, components, normalized: accessor.normalized, count })
}

fn unsigned(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, byte| (value << 8) | u32::from(*byte))
}

impl Elements {
    fn number(&self, bytes: &[u8]) -> f32 {
        let scale = |largest: f32| if self.normalized { 1.0 / largest } else { 1.0 };
        let least = if self.normalized { -1.0 } else { f32::MIN };
        match self.component {
            ComponentType::F32 => f32::from_bits(unsigned(bytes)),
            ComponentType::U8 => unsigned(bytes) as f32 * scale(255.0),
            ComponentType::U16 => unsigned(bytes) as f32 * scale(65535.0),
            ComponentType::U32 => unsigned(bytes) as f32 * scale(u32::MAX as f32),
            ComponentType::I8 => (f32::from(unsigned(bytes) as u8 as i8) * scale(127.0)).max(least),
            ComponentType::I16 => (f32::from(unsigned(bytes) as u16 as i16) * scale(32767.0)).max(least),
        }
    }

    /// Returns finite vectors of `N` numbers.
    pub(super) fn vectors<const N: usize>(&self, file: &File, user: &str) -> Result<Vec<[f32; N]>> {
        if self.components != N {
            return Err(file.broken(format!("{user}: has {} components, not {N}", self.components)));
        }
        let size = component_size(self.component);
        let numbers: Vec<f32> = self.bytes.chunks_exact(size).map(|bytes| self.number(bytes)).collect();
        if !numbers.iter().all(|number| number.is_finite()) {
            return Err(file.broken(format!("{user}: holds a number that is not finite")));
        }
        let vector = |chunk: &[f32]| std::array::from_fn(|i| chunk[i]);
        Ok(numbers.chunks_exact(N).map(vector).collect())
    }

    pub(super) fn indices(&self, file: &File, user: &str) -> Result<Vec<u32>> {
        let unsigned_type = matches!(self.component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32);
        if self.components != 1 || !unsigned_type {
            return Err(file.broken(format!("{user}: are no unsigned whole numbers")));
        }
        Ok(self.bytes.chunks_exact(component_size(self.component)).map(unsigned).collect())
    }
}
