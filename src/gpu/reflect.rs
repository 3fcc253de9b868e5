//! Compares a pass's declaration with its SPIR-V, so that Rust and GLSL cannot drift apart.

use std::collections::{HashMap, HashSet};

use ash::vk;
use spirq::{
    ReflectConfig,
    constant::ConstantValue,
    entry_point::EntryPoint,
    spirv::ExecutionMode,
    ty::{AccessType, DescriptorType, ImageFormat, StructType, Type},
    var::Variable,
};

use super::{hazard::Access, layout::Fields, memory::Format, pass::PassDeclaration};
use crate::{Error, Result};

/// What the shader takes at one binding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    StorageBuffer,
    UniformBuffer,
    StorageImage { format: Format, array: bool },
    Sampled { array: bool, integer: bool },
}

impl Kind {
    pub(super) fn descriptor(self) -> vk::DescriptorType {
        match self {
            Self::StorageBuffer => vk::DescriptorType::STORAGE_BUFFER,
            Self::UniformBuffer => vk::DescriptorType::UNIFORM_BUFFER,
            Self::StorageImage { .. } => vk::DescriptorType::STORAGE_IMAGE,
            Self::Sampled { .. } => vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
        }
    }
}

/// One binding, checked.
#[derive(Clone, Debug)]
pub(super) struct Slot {
    pub name: &'static str,
    pub binding: u32,
    pub access: Access,
    pub kind: Kind,
}

/// What a pipeline needs to know of its shader.
#[derive(Debug)]
pub(super) struct Reflected {
    pub local_size: [u32; 3],
    pub slots: Vec<Slot>,
}

/// Reads the SPIR-V of `declaration` and checks the one against the other.
///
/// # Errors
/// [`Error::Internal`] that names shader and field where they disagree.
pub(super) fn check(declaration: &PassDeclaration, specialization: &[(u32, u32)]) -> Result<Reflected> {
    let PassDeclaration { name, spirv, .. } = *declaration;
    let fault = |problem: String| Error::Internal(format!("shader {name}: {problem}"));
    let entry_points = ReflectConfig::new().spv(spirv).ref_all_rscs(true).reflect();
    let entry = match entry_points.as_deref() {
        Ok([entry]) if entry.name == "main" => entry,
        Ok(_) => return Err(fault("it has not exactly one entry point, main".into())),
        Err(error) => return Err(fault(format!("its SPIR-V cannot be read: {error}"))),
    };
    let used = statically_used(spirv);
    let slots = check_bindings(declaration, entry, &used).map_err(fault)?;
    check_push(declaration, entry, used.push_constants).map_err(fault)?;
    check_structs(declaration, entry, &used).map_err(fault)?;
    for &(id, _) in specialization {
        let known = |v: &Variable| matches!(v, Variable::SpecConstant { spec_id, .. } if *spec_id == id);
        if !entry.vars.iter().any(known) {
            return Err(fault(format!("it has no specialization constant {id}")));
        }
    }
    let local_size = local_size(entry, specialization).ok_or_else(|| fault("its local size is unknown".into()))?;
    Ok(Reflected { local_size, slots })
}

fn check_bindings(
    declaration: &PassDeclaration,
    entry: &EntryPoint,
    used: &Used,
) -> std::result::Result<Vec<Slot>, String> {
    let mut slots = Vec::new();
    for variable in &entry.vars {
        let Variable::Descriptor { name, desc_bind, desc_ty, ty, nbind } = variable else { continue };
        let binding = desc_bind.bind();
        if !used.bindings.contains(&(desc_bind.set(), binding)) {
            continue; // from an include; this shader never touches it
        }
        let name = name.as_deref().ok_or_else(|| format!("binding {binding} has no instance name"))?;
        if desc_bind.set() != 0 {
            return Err(format!("binding {name} is in set {}, not 0", desc_bind.set()));
        }
        if *nbind != 1 {
            return Err(format!("binding {name} is an array of descriptors"));
        }
        let Some(&(name, access)) = declaration.bindings.iter().find(|(declared, _)| *declared == name) else {
            return Err(format!("binding {name} is used and not declared"));
        };
        let (kind, shader_access) = kind(name, desc_ty, ty)?;
        if access != shader_access {
            return Err(format!("binding {name} is declared as {access:?} and GLSL says {shader_access:?}"));
        }
        if let Some(Slot { name: other, .. }) = slots.iter().find(|slot: &&Slot| slot.binding == binding) {
            return Err(format!("{name} and {other} share binding {binding}"));
        }
        slots.push(Slot { name, binding, access, kind });
    }
    for (i, (name, _)) in declaration.bindings.iter().enumerate() {
        if !slots.iter().any(|slot| slot.name == *name) {
            return Err(format!("binding {name} is declared and the shader does not use it"));
        }
        if declaration.bindings[..i].iter().any(|(earlier, _)| earlier == name) {
            return Err(format!("binding {name} is declared twice"));
        }
    }
    Ok(slots)
}

fn kind(name: &str, descriptor: &DescriptorType, ty: &Type) -> std::result::Result<(Kind, Access), String> {
    let access = |access: &AccessType| match access {
        AccessType::ReadOnly => Access::Read,
        AccessType::WriteOnly => Access::Write,
        AccessType::ReadWrite => Access::ReadWrite,
    };
    match (descriptor, ty) {
        (DescriptorType::StorageBuffer(a), _) => Ok((Kind::StorageBuffer, access(a))),
        (DescriptorType::UniformBuffer(), _) => Ok((Kind::UniformBuffer, Access::Read)),
        (DescriptorType::StorageImage(a), Type::StorageImage(image)) => {
            let format = match image.fmt {
                ImageFormat::R32f => Format::R32f,
                ImageFormat::Rg32f => Format::Rg32f,
                ImageFormat::Rgba16f => Format::Rgba16f,
                ImageFormat::Rgba32f => Format::Rgba32f,
                ImageFormat::R32ui => Format::R32u,
                ImageFormat::Rgba32ui => Format::Rgba32u,
                other => return Err(format!("image {name} has the format {other:?}, which nothing here uses")),
            };
            Ok((Kind::StorageImage { format, array: image.is_array }, access(a)))
        }
        (DescriptorType::CombinedImageSampler(), Type::CombinedImageSampler(sampler)) => {
            let image = &sampler.sampled_image_ty;
            let integer = matches!(image.scalar_ty, spirq::ty::ScalarType::Integer { .. });
            Ok((Kind::Sampled { array: image.is_array, integer }, Access::Read))
        }
        (other, _) => Err(format!("binding {name} is a {other:?}, which nothing here uses")),
    }
}

fn check_push(declaration: &PassDeclaration, entry: &EntryPoint, used: bool) -> std::result::Result<(), String> {
    let block = entry.vars.iter().find_map(|v| match v {
        Variable::PushConstant { ty: Type::Struct(block), .. } if used => Some(block),
        _ => None,
    });
    match (block, &declaration.push) {
        (None, None) => Ok(()),
        (Some(_), None) => Err("its push constants are not declared".into()),
        (None, Some(_)) => Err("push constants are declared and the shader does not use them".into()),
        (Some(block), Some(push)) => {
            if push.size > 128 {
                return Err(format!("push constants take {} bytes and Vulkan promises 128", push.size));
            }
            check_fields("push constants", block, push.size, push.fields)
        }
    }
}

/// Compares a GLSL struct with a Rust one: names, offsets and sizes of its members, and its size.
fn check_fields(what: &str, block: &StructType, size: usize, fields: Fields) -> std::result::Result<(), String> {
    if block.members.len() != fields.len() {
        return Err(format!("{what}: GLSL has {} fields and Rust {}", block.members.len(), fields.len()));
    }
    for (i, (member, &(name, offset))) in block.members.iter().zip(fields).enumerate() {
        let glsl = member.name.as_deref().unwrap_or("without a name");
        if glsl != name {
            return Err(format!("{what}: field {i} is {glsl} in GLSL and {name} in Rust"));
        }
        if member.offset != Some(offset) {
            let there = member.offset.map_or("unknown".to_owned(), |o| o.to_string());
            return Err(format!("{what}: offset of {name} is {there} in GLSL and {offset} in Rust"));
        }
        // Plain-data structs have no padding: a field ends where the next begins.
        let rust = fields.get(i + 1).map_or(size, |next| next.1).checked_sub(offset);
        let glsl = match &member.ty {
            Type::Struct(_) => None, // its own entry in `structs` is checked
            ty => ty.nbyte(),
        };
        if let (Some(glsl), Some(rust)) = (glsl, rust)
            && glsl != rust
        {
            return Err(format!("{what}: {name} takes {glsl} bytes in GLSL and {rust} in Rust"));
        }
    }
    Ok(())
}

fn check_structs(declaration: &PassDeclaration, entry: &EntryPoint, used: &Used) -> std::result::Result<(), String> {
    for &(name, size, fields) in declaration.structs {
        let mut found = false;
        for variable in &entry.vars {
            let Variable::Descriptor { desc_bind, ty, .. } = variable else { continue };
            if !used.bindings.contains(&(desc_bind.set(), desc_bind.bind())) {
                continue;
            }
            visit_structs(ty, None, &mut |block, stride| {
                if block.name() != Some(name) {
                    return Ok(());
                }
                found = true;
                if let Some(stride) = stride
                    && stride != size
                {
                    return Err(format!("struct {name}: its array stride is {stride} in GLSL and {size} in Rust"));
                }
                check_fields(&format!("struct {name}"), block, size, fields)
            })?;
        }
        if !found {
            return Err(format!("struct {name} is declared and no used buffer holds it"));
        }
    }
    Ok(())
}

/// Calls `visit` for every struct within `ty`, with the stride of the array it is an element of.
fn visit_structs(
    ty: &Type,
    stride: Option<usize>,
    visit: &mut dyn FnMut(&StructType, Option<usize>) -> std::result::Result<(), String>,
) -> std::result::Result<(), String> {
    match ty {
        Type::Array(array) => visit_structs(&array.element_ty, array.stride, visit),
        Type::Struct(block) => {
            visit(block, stride)?;
            block.members.iter().try_for_each(|member| visit_structs(&member.ty, None, visit))
        }
        _ => Ok(()),
    }
}

fn local_size(entry: &EntryPoint, specialization: &[(u32, u32)]) -> Option<[u32; 3]> {
    let mode = entry
        .exec_modes
        .iter()
        .find(|mode| matches!(mode.exec_mode, ExecutionMode::LocalSize | ExecutionMode::LocalSizeId))?;
    let mut size = [0; 3];
    for (size, constant) in size.iter_mut().zip(&mode.operands) {
        let chosen = specialization.iter().find(|(id, _)| constant.spec_id == Some(*id));
        *size = match (chosen, &constant.value) {
            (Some((_, value)), _) => *value,
            (None, ConstantValue::U32(value)) => *value,
            (None, ConstantValue::S32(value)) => u32::try_from(*value).ok()?,
            (None, ConstantValue::Typeless(bytes)) => u32::from_le_bytes(bytes.as_ref().try_into().ok()?),
            _ => return None,
        };
    }
    size.iter().all(|&n| n > 0).then_some(size)
}

/// What the functions of a module touch.
struct Used {
    bindings: HashSet<(u32, u32)>, // set, binding
    push_constants: bool,
}

/// Descriptor bindings and push constants that some instruction refers to. Reflection libraries follow loads and
/// stores only, and so overlook `.length()` and image atomics.
fn statically_used(spirv: &[u32]) -> Used {
    let mut placed: HashMap<u32, [u32; 2]> = HashMap::new(); // variable → set, binding
    let mut push = HashSet::new();
    let mut used = Used { bindings: HashSet::new(), push_constants: false };
    let mut rest = spirv.get(5..).unwrap_or(&[]);
    while let Some(&head) = rest.first() {
        let (length, opcode) = ((head >> 16) as usize, head & 0xffff);
        let Some(operands) = rest.get(1..length.max(1)) else { break };
        rest = &rest[length.max(1)..];
        // Where an instruction names the pointers it goes through.
        let pointers = match opcode {
            71 => {
                if let [target, decoration @ (33 | 34), value] = *operands {
                    placed.entry(target).or_default()[usize::from(decoration == 33)] = value;
                }
                continue;
            }
            59 => {
                if let [_, id, 9, ..] = *operands {
                    push.insert(id); // OpVariable in the class PushConstant
                }
                continue;
            }
            57 => operands.get(3..),                      // OpFunctionCall: arguments
            60 | 61 | 65..=68 | 83 => operands.get(2..3), // texel pointer, load, access chains, array length, copy object
            62 | 228 => operands.get(..1),                // store, atomic store
            63 => operands.get(..2),                      // copy memory
            227 | 229..=242 => operands.get(2..3),        // other atomics
            _ => continue,
        };
        for id in pointers.unwrap_or(&[]) {
            if let Some(&[set, binding]) = placed.get(id) {
                used.bindings.insert((set, binding));
            }
            used.push_constants |= push.contains(id);
        }
    }
    used
}
