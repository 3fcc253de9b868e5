//! Accessors are typed arrays in buffers. They are checked before anything is read or allocated.

use super::{Fault, File, MAX_CORNERS, Read, fault, json::Json, meshopt};
use crate::budget;

/// The most elements of all accessors without a buffer: of those that are all zero, and of sparse ones, which are few
/// numbers for many elements. Others are bounded by their buffer.
const MAX_ZEROS: usize = 1 << 20;
const MAX_SPARSE: usize = 2 * MAX_CORNERS;

pub(super) struct Elements {
    bytes: Vec<u8>,
    component: Component,
    components: usize,
    normalized: bool,
    pub count: usize,
}

#[derive(Clone, Copy, PartialEq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(object: Json) -> Option<Self> {
        Some(match object.index("componentType")? {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

/// Returns the bytes of a buffer view and its stride.
pub(super) fn view<'f>(file: &'f File, index: usize, user: &str) -> Read<(&'f [u8], Option<usize>)> {
    let view = file.root.entry("bufferViews", index);
    let Some(how) = meshopt::of(view) else { return part(file, view, &format!("{user}: buffer view {index}")) };
    let name_user = |fault: Fault| Fault { problem: format!("{user}: {}", fault.problem), ..fault };
    let decoded = file.views[index].get_or_init(|| meshopt::decode(file, index, how));
    Ok((decoded.as_deref().map_err(|fault| name_user(fault.clone()))?, view.index("byteStride")))
}

/// Returns the part of a buffer that a buffer view names, or its compressed form, and the stride in it.
pub(super) fn part<'f>(file: &'f File, view: Json, user: &str) -> Read<(&'f [u8], Option<usize>)> {
    let Some(buffer) = view.index("buffer") else {
        return Err(fault(format!("{user} does not exist, or has no buffer")));
    };
    let bytes = file.buffer(buffer)?;
    let start = view.index("byteOffset").unwrap_or(0);
    let end = view.index("byteLength").and_then(|length| start.checked_add(length));
    let (Some(end), true) = (end, start <= bytes.len()) else {
        return Err(fault(format!("{user} reaches beyond its buffer")));
    };
    if end > bytes.len() {
        file.warn(user, "reaches beyond its buffer: what lies in it is read");
    }
    Ok((&bytes[start..end.min(bytes.len())], view.index("byteStride")))
}

/// Copies `count` elements of `size` bytes out of the view that `place` names.
fn gather(file: &File, place: Json, count: usize, size: usize, user: &str) -> Read<Vec<u8>> {
    let (bytes, stride) = view(file, place.index("bufferView").unwrap_or(usize::MAX), user)?;
    if stride == Some(0) {
        file.warn(user, "has a byteStride of 0: its elements are taken to follow each other");
    }
    let stride = stride.filter(|stride| *stride > 0).unwrap_or(size);
    let offset = place.index("byteOffset").unwrap_or(0);
    if stride < size {
        return Err(fault(format!("{user}: its stride is smaller than its elements")));
    }
    if count == 0 {
        return Ok(Vec::new());
    }
    let end = (count - 1).checked_mul(stride).and_then(|end| end.checked_add(offset)?.checked_add(size));
    if end.is_none_or(|end| end > bytes.len()) {
        return Err(fault(format!("{user}: reaches beyond its buffer view")));
    }
    let mut out = Vec::with_capacity(count * size);
    for element in 0..count {
        out.extend_from_slice(&bytes[offset + element * stride..][..size]);
    }
    Ok(out)
}

/// Whether an accessor says that it is zero everywhere.
pub(super) fn is_zero(accessor: Json) -> bool {
    accessor.exists() && !accessor.get("bufferView").exists() && !accessor.get("sparse").exists()
}

/// Reads accessor `index`. `user` names it in errors.
pub(super) fn elements(file: &File, index: usize, user: &str) -> Read<Elements> {
    let accessor = file.root.entry("accessors", index);
    if !accessor.exists() {
        return Err(fault(format!("{user}: accessor {index} does not exist")));
    }
    let user = &format!("{user}: accessor {index}");
    let components = match accessor.text("type") {
        Some("SCALAR") => Some(1),
        Some("VEC2") => Some(2),
        Some("VEC3") => Some(3),
        Some("VEC4") => Some(4),
        Some("MAT4") => Some(16),
        _ => None,
    };
    let (Some(component), Some(components)) = (Component::of(accessor), components) else {
        return Err(fault(format!("{user}: has no type that can be read")));
    };
    let size = components * component.size();
    // As they are stored, and as numbers.
    let most = accessor.index("count").unwrap_or(0) as u64;
    let numbers = most.saturating_mul(4 * components as u64);
    let bytes = most.saturating_mul(size as u64).saturating_add(numbers).saturating_add(file.read.get());
    if let Some(problem) = budget::refusal(bytes) {
        let fault = Fault { problem: format!("{user}: {problem}"), remedy: budget::REMEDY.into() };
        return Err(file.fill(fault));
    }
    file.read.set(file.read.get() + numbers);
    let Some(count) = accessor.index("count") else { return Err(fault(format!("{user}: has no count"))) };
    let mut bytes = match accessor.index("bufferView") {
        Some(_) => gather(file, accessor, count, size, user)?,
        None => {
            let (sum, most, kind) = match is_zero(accessor) {
                true => (&file.zeros, MAX_ZEROS, "all zero"),
                false => (&file.sparse, MAX_SPARSE, "sparse"),
            };
            sum.set(sum.get().saturating_add(count));
            if sum.get() > most {
                let problem = format!("{user}: has {count} elements, {kind}; all such may have {most}");
                return Err(Fault { problem, remedy: "simplify the model".into() });
            }
            vec![0; count * size]
        }
    };
    let sparse = accessor.get("sparse");
    if sparse.exists() {
        let (indices, values) = (sparse.get("indices"), sparse.get("values"));
        let (Some(changed), Some(index_type)) = (sparse.index("count"), Component::of(indices)) else {
            return Err(fault(format!("{user}: its sparse part has no count or type")));
        };
        let at = gather(file, indices, changed, index_type.size(), user)?;
        let values = gather(file, values, changed, size, user)?;
        for (index, value) in at.chunks_exact(index_type.size()).zip(values.chunks_exact(size)) {
            let index = unsigned(index) as usize;
            match bytes.chunks_exact_mut(size).nth(index) {
                Some(element) => element.copy_from_slice(value),
                None => return Err(fault(format!("{user}: sparse index {index} is beyond its count"))),
            }
        }
    }
    Ok(Elements { bytes, component, components, normalized: accessor.flag("normalized"), count })
}

fn unsigned(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, byte| (value << 8) | u32::from(*byte))
}

impl Elements {
    fn number(&self, bytes: &[u8]) -> f32 {
        let scale = |largest: f32| if self.normalized { 1.0 / largest } else { 1.0 };
        let least = if self.normalized { -1.0 } else { f32::MIN };
        match self.component {
            Component::F32 => f32::from_bits(unsigned(bytes)),
            Component::U8 => unsigned(bytes) as f32 * scale(255.0),
            Component::U16 => unsigned(bytes) as f32 * scale(65535.0),
            Component::U32 => unsigned(bytes) as f32 * scale(u32::MAX as f32),
            Component::I8 => (f32::from(unsigned(bytes) as u8 as i8) * scale(127.0)).max(least),
            Component::I16 => (f32::from(unsigned(bytes) as u16 as i16) * scale(32767.0)).max(least),
        }
    }

    /// Returns the first `N` numbers of each element. They need not be finite.
    pub(super) fn vectors<const N: usize>(&self, user: &str) -> Read<Vec<[f32; N]>> {
        if self.components < N {
            return Err(fault(format!("{user}: has {} components, not {N}", self.components)));
        }
        let size = self.component.size();
        let vector = |bytes: &[u8]| std::array::from_fn(|i| self.number(&bytes[i * size..(i + 1) * size]));
        Ok(self.bytes.chunks_exact(size * self.components).map(vector).collect())
    }

    pub(super) fn indices(&self, user: &str) -> Read<Vec<u32>> {
        let unsigned_type = matches!(self.component, Component::U8 | Component::U16 | Component::U32);
        if self.components != 1 || !unsigned_type {
            return Err(fault(format!("{user}: are no unsigned whole numbers")));
        }
        Ok(self.bytes.chunks_exact(self.component.size()).map(unsigned).collect())
    }
}
