//! Reads what a shader binds from its SPIR-V. Checks a declaration against it, so that Rust and GLSL agree.

use std::collections::{HashMap, HashSet};

use ash::vk;
use rspirv::{
    binary::{Consumer, ParseAction, parse_words},
    dr::{Instruction, ModuleHeader, Operand},
    spirv::{Decoration, Dim, ExecutionMode, ImageFormat, Op, StorageClass},
};

use super::{
    hazard::Access,
    layout::Fields,
    memory::Format,
    pass::{Constant, PassDeclaration},
};
use crate::{Error, Result};

type Checked<T> = std::result::Result<T, String>;

/// The kind of resource at a binding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// A storage buffer.
    StorageBuffer,
    /// A uniform buffer.
    UniformBuffer,
    /// An image that is loaded from or stored to. `array` means that it has layers.
    StorageImage { format: Format, array: bool },
    /// An image that is sampled.
    Sampled { array: bool, integer: bool },
    /// What ray queries search.
    Acceleration,
}

impl Kind {
    pub(super) fn descriptor(self) -> vk::DescriptorType {
        match self {
            Self::StorageBuffer => vk::DescriptorType::STORAGE_BUFFER,
            Self::UniformBuffer => vk::DescriptorType::UNIFORM_BUFFER,
            Self::StorageImage { .. } => vk::DescriptorType::STORAGE_IMAGE,
            Self::Sampled { .. } => vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
            Self::Acceleration => vk::DescriptorType::ACCELERATION_STRUCTURE_KHR,
        }
    }
}

/// One binding of a shader, in set 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Binding {
    /// Its GLSL name. A block goes by its instance name.
    pub name: String,
    /// The binding's number.
    pub number: u32,
    /// How the shader accesses it, from `readonly` and `writeonly`.
    pub access: Access,
    /// The kind of resource that it takes.
    pub kind: Kind,
}

/// Lists the bindings that a shader's functions use.
///
/// # Errors
/// Fails if the SPIR-V cannot be read or binds something of an unknown kind.
pub fn bindings(spirv: &[u32]) -> Result<Vec<Binding>> {
    let found = parse(spirv).and_then(|instructions| Shader::new(&instructions).bindings());
    found.map_err(|problem| Error::Internal(format!("a shader: {problem}")))
}

pub(super) fn parse(spirv: &[u32]) -> Checked<Vec<Instruction>> {
    let mut module = Instructions::default();
    parse_words(spirv, &mut module).map_err(|error| format!("its SPIR-V cannot be read: {error}"))?;
    Ok(module.0)
}

/// The instructions of a module in their order. rspirv's own loader fails on `OpExecutionModeId`.
#[derive(Default)]
struct Instructions(Vec<Instruction>);

impl Consumer for Instructions {
    fn initialize(&mut self) -> ParseAction {
        ParseAction::Continue
    }

    fn finalize(&mut self) -> ParseAction {
        ParseAction::Continue
    }

    fn consume_header(&mut self, _: ModuleHeader) -> ParseAction {
        ParseAction::Continue
    }

    fn consume_instruction(&mut self, instruction: Instruction) -> ParseAction {
        self.0.push(instruction);
        ParseAction::Continue
    }
}

/// A global variable that some function refers to.
#[derive(Clone, Copy)]
struct Variable {
    id: u32,
    class: StorageClass,
    /// The type that it points to.
    ty: u32,
}

/// What a decoration is on: an id, or one of its members.
type Decorated = (u32, Option<u32>);

/// A SPIR-V module, indexed for the questions below.
pub(super) struct Shader<'a> {
    globals: HashMap<u32, &'a Instruction>,
    names: HashMap<u32, &'a str>,
    member_names: HashMap<(u32, u32), &'a str>,
    /// Each decoration with its first operand, or with 0 if it has none.
    decorations: HashMap<Decorated, Vec<(Decoration, u32)>>,
    local_size: Option<&'a [Operand]>,
    variables: Vec<Variable>,
}

fn id(operand: Option<&Operand>) -> Option<u32> {
    operand.and_then(Operand::id_ref_any)
}

fn number(operand: Option<&Operand>) -> Option<u32> {
    match operand {
        Some(Operand::LiteralBit32(value)) => Some(*value),
        _ => None,
    }
}

impl<'a> Shader<'a> {
    pub(super) fn new(instructions: &'a [Instruction]) -> Self {
        let body = instructions.iter().position(|i| i.class.opcode == Op::Function).unwrap_or(instructions.len());
        let (global, functions) = instructions.split_at(body);
        let touched: HashSet<u32> =
            functions.iter().flat_map(|i| i.operands.iter().filter_map(Operand::id_ref_any)).collect();
        let mut shader = Self {
            globals: global.iter().filter_map(|i| Some((i.result_id?, i))).collect(),
            names: HashMap::new(),
            member_names: HashMap::new(),
            decorations: HashMap::new(),
            local_size: None,
            variables: Vec::new(),
        };
        for instruction in global {
            shader.index(instruction, &touched);
        }
        shader
    }

    fn index(&mut self, instruction: &'a Instruction, touched: &HashSet<u32>) {
        let operands = instruction.operands.as_slice();
        match (instruction.class.opcode, operands) {
            (Op::Name, [Operand::IdRef(id), Operand::LiteralString(name)]) => {
                self.names.insert(*id, name);
            }
            (Op::MemberName, [Operand::IdRef(id), Operand::LiteralBit32(member), Operand::LiteralString(name)]) => {
                self.member_names.insert((*id, *member), name);
            }
            (Op::Decorate, [Operand::IdRef(id), Operand::Decoration(decoration), rest @ ..]) => {
                let value = number(rest.first()).unwrap_or(0);
                self.decorations.entry((*id, None)).or_default().push((*decoration, value));
            }
            (
                Op::MemberDecorate,
                [Operand::IdRef(id), Operand::LiteralBit32(member), Operand::Decoration(decoration), rest @ ..],
            ) => {
                let value = number(rest.first()).unwrap_or(0);
                self.decorations.entry((*id, Some(*member))).or_default().push((*decoration, value));
            }
            (
                Op::ExecutionMode | Op::ExecutionModeId,
                [_, Operand::ExecutionMode(ExecutionMode::LocalSize | ExecutionMode::LocalSizeId), size @ ..],
            ) => self.local_size = Some(size),
            (Op::Variable, [Operand::StorageClass(class), ..]) => {
                let ty = instruction.result_type.and_then(|pointer| self.operand_id(pointer, 1));
                if let (Some(id), Some(ty)) = (instruction.result_id, ty)
                    && touched.contains(&id)
                {
                    self.variables.push(Variable { id, class: *class, ty });
                }
            }
            _ => {}
        }
    }

    /// Lists the bindings, and checks that names and numbers are unique.
    pub(super) fn bindings(&self) -> Checked<Vec<Binding>> {
        let mut all: Vec<Binding> = Vec::new();
        for variable in self.resources() {
            let number = self.decoration(variable.id, None, Decoration::Binding).unwrap_or(0);
            let name = self.names.get(&variable.id).copied().unwrap_or("");
            if name.is_empty() {
                return Err(format!("binding {number} has no instance name"));
            }
            if let Some(set @ 1..) = self.decoration(variable.id, None, Decoration::DescriptorSet) {
                return Err(format!("binding {name} is in set {set}, not 0"));
            }
            if let Some(other) = all.iter().find(|other| other.number == number) {
                return Err(format!("{name} and {} share binding {number}", other.name));
            }
            let (kind, access) = self.kind(name, variable)?;
            all.push(Binding { name: name.to_owned(), number, access, kind });
        }
        Ok(all)
    }

    /// Compares push constants and the structs in buffers with their Rust declarations.
    pub(super) fn check(&self, declaration: &PassDeclaration) -> Checked<()> {
        let block = self.variables.iter().find(|v| v.class == StorageClass::PushConstant);
        match (block, &declaration.push) {
            (None, None) => {}
            (Some(_), None) => return Err("its push constants are not declared".into()),
            (None, Some(_)) => return Err("push constants are declared and the shader does not use them".into()),
            (Some(block), Some(push)) => {
                if push.size > 128 {
                    return Err(format!("push constants take {} bytes and Vulkan promises 128", push.size));
                }
                self.check_fields("push constants", block.ty, push.size, push.fields)?;
            }
        }
        for variable in self.resources() {
            self.visit_structs(variable.ty, None, &mut |block, stride| {
                let name = self.names.get(&block).copied().unwrap_or("without a name");
                let Some(&(_, size, fields)) = declaration.structs.iter().find(|(known, ..)| *known == name) else {
                    // a block is described by its members, but other structs have a twin in Rust
                    let is_block = block == variable.ty;
                    return if is_block {
                        Ok(())
                    } else {
                        Err(format!("Rust knows no struct {name} that is in a buffer"))
                    };
                };
                if let Some(stride) = stride
                    && stride != size
                {
                    return Err(format!("struct {name}: its array stride is {stride} in GLSL and {size} in Rust"));
                }
                self.check_fields(&format!("struct {name}"), block, size, fields)
            })?;
        }
        Ok(())
    }

    /// The id of a specialization constant.
    pub(super) fn constant(&self, name: &str) -> Option<u32> {
        let mut named = self.names.iter().filter(|(_, known)| **known == name);
        named.find_map(|(id, _)| self.decoration(*id, None, Decoration::SpecId))
    }

    /// The values of specialization constants, by id.
    pub(super) fn specialization(&self, constants: &[Constant]) -> Checked<Vec<(u32, u32)>> {
        let value = |&(name, value): &Constant| {
            let id = self.constant(name).ok_or_else(|| format!("it has no specialization constant {name}"))?;
            Ok((id, value))
        };
        constants.iter().map(value).collect()
    }

    /// Variables that are bound by descriptors.
    fn resources(&self) -> impl Iterator<Item = Variable> {
        let classes = [StorageClass::StorageBuffer, StorageClass::Uniform, StorageClass::UniformConstant];
        self.variables.iter().copied().filter(move |v| classes.contains(&v.class))
    }

    fn opcode(&self, id: u32) -> Op {
        self.globals.get(&id).map_or(Op::Nop, |i| i.class.opcode)
    }

    fn operand(&self, id: u32, n: usize) -> Option<&'a Operand> {
        self.globals.get(&id).and_then(|i| i.operands.get(n))
    }

    fn operand_id(&self, of: u32, n: usize) -> Option<u32> {
        id(self.operand(of, n))
    }

    fn decoration(&self, id: u32, member: Option<u32>, wanted: Decoration) -> Option<u32> {
        self.decorations.get(&(id, member))?.iter().find(|(d, _)| *d == wanted).map(|(_, value)| *value)
    }

    /// Whether a variable, or every member of its block, has this decoration.
    fn restricted(&self, variable: Variable, by: Decoration) -> bool {
        let members = match (self.opcode(variable.ty), self.globals.get(&variable.ty)) {
            (Op::TypeStruct, Some(block)) => block.operands.len() as u32,
            _ => 0,
        };
        self.decoration(variable.id, None, by).is_some()
            || members > 0 && (0..members).all(|m| self.decoration(variable.ty, Some(m), by).is_some())
    }

    fn kind(&self, name: &str, variable: Variable) -> Checked<(Kind, Access)> {
        let (readonly, writeonly) =
            (self.restricted(variable, Decoration::NonWritable), self.restricted(variable, Decoration::NonReadable));
        let access = match (readonly, writeonly) {
            (true, _) => Access::Read,
            (false, true) => Access::Write,
            (false, false) => Access::ReadWrite,
        };
        let unknown = || Err(format!("binding {name} is of a kind that nothing here uses"));
        match (variable.class, self.opcode(variable.ty)) {
            (StorageClass::StorageBuffer, Op::TypeStruct) => Ok((Kind::StorageBuffer, access)),
            (StorageClass::Uniform, Op::TypeStruct) => Ok((Kind::UniformBuffer, Access::Read)),
            (StorageClass::UniformConstant, Op::TypeAccelerationStructureKHR) => Ok((Kind::Acceleration, Access::Read)),
            (StorageClass::UniformConstant, Op::TypeImage) => {
                let (Some(array), Some(format)) = (self.flat_image(variable.ty), self.operand(variable.ty, 6)) else {
                    return unknown();
                };
                let Operand::ImageFormat(format) = format else { return unknown() };
                let format = match format {
                    ImageFormat::R32f => Format::R32f,
                    ImageFormat::R8Snorm => Format::R8Snorm,
                    ImageFormat::R16f => Format::R16f,
                    ImageFormat::Rg16f => Format::Rg16f,
                    ImageFormat::Rg32f => Format::Rg32f,
                    ImageFormat::Rg32ui => Format::Rg32u,
                    ImageFormat::Rgba16f => Format::Rgba16f,
                    ImageFormat::Rgba32f => Format::Rgba32f,
                    ImageFormat::Rgba8 => Format::Rgba8,
                    ImageFormat::R32ui => Format::R32u,
                    ImageFormat::Rgba32ui => Format::Rgba32u,
                    other => return Err(format!("image {name} has the format {other:?}, which nothing here uses")),
                };
                Ok((Kind::StorageImage { format, array }, access))
            }
            (StorageClass::UniformConstant, Op::TypeSampledImage) => {
                let image = self.operand_id(variable.ty, 0);
                let Some((image, array)) = image.and_then(|i| Some((i, self.flat_image(i)?))) else {
                    return unknown();
                };
                let integer = self.operand_id(image, 0).is_some_and(|t| self.opcode(t) == Op::TypeInt);
                Ok((Kind::Sampled { array, integer }, Access::Read))
            }
            _ => unknown(),
        }
    }

    /// Whether a 2D image has layers. `None` for images of other kinds.
    fn flat_image(&self, ty: u32) -> Option<bool> {
        let multisampled = number(self.operand(ty, 4))?;
        let flat = matches!(self.operand(ty, 1), Some(Operand::Dim(Dim::Dim2D))) && multisampled == 0;
        flat.then_some(number(self.operand(ty, 3))? == 1)
    }

    /// Compares the names, offsets and sizes of a GLSL struct's members with those in Rust.
    fn check_fields(&self, what: &str, block: u32, size: usize, fields: Fields) -> Checked<()> {
        let members = self.globals.get(&block).map_or(&[][..], |block| &block.operands);
        if members.len() != fields.len() {
            return Err(format!("{what}: GLSL has {} fields and Rust {}", members.len(), fields.len()));
        }
        for (i, (ty, &(name, offset))) in (0..).zip(members.iter().zip(fields)) {
            let glsl = self.member_names.get(&(block, i)).copied().unwrap_or("without a name");
            if glsl != name {
                return Err(format!("{what}: field {i} is {glsl} in GLSL and {name} in Rust"));
            }
            let there = self.decoration(block, Some(i), Decoration::Offset);
            if there != u32::try_from(offset).ok() {
                let there = there.map_or("unknown".to_owned(), |o| o.to_string());
                return Err(format!("{what}: offset of {name} is {there} in GLSL and {offset} in Rust"));
            }
            // Plain-data structs have no padding, so a field ends where the next one begins.
            let rust = fields.get(i as usize + 1).map_or(size, |next| next.1).checked_sub(offset);
            let glsl =
                id(Some(ty)).and_then(|ty| self.bytes(ty, self.decoration(block, Some(i), Decoration::MatrixStride)));
            if let (Some(glsl), Some(rust)) = (glsl, rust)
                && glsl != rust
            {
                return Err(format!("{what}: {name} takes {glsl} bytes in GLSL and {rust} in Rust"));
            }
        }
        Ok(())
    }

    /// The bytes of a value in a buffer, if they are known. `matrix_stride` is that of its member.
    fn bytes(&self, ty: u32, matrix_stride: Option<u32>) -> Option<usize> {
        let count = number(self.operand(ty, 1));
        match self.opcode(ty) {
            Op::TypeInt | Op::TypeFloat => Some(number(self.operand(ty, 0))? as usize / 8),
            Op::TypeVector => Some(self.bytes(self.operand_id(ty, 0)?, None)? * count? as usize),
            Op::TypeMatrix => Some(matrix_stride? as usize * count? as usize),
            Op::TypeArray => {
                let length = self.operand_id(ty, 1)?;
                let fixed = self.opcode(length) == Op::Constant;
                let length = fixed.then(|| number(self.operand(length, 0))).flatten()?;
                Some(self.decoration(ty, None, Decoration::ArrayStride)? as usize * length as usize)
            }
            Op::TypeStruct => {
                let last = self.globals.get(&ty)?.operands.len().checked_sub(1)?;
                let member = Some(last as u32);
                let stride = self.decoration(ty, member, Decoration::MatrixStride);
                let size = self.bytes(self.operand_id(ty, last)?, stride)?;
                Some(self.decoration(ty, member, Decoration::Offset)? as usize + size)
            }
            _ => None,
        }
    }

    /// Calls `visit` for every struct within `ty`, with the stride of the array that holds it.
    fn visit_structs(
        &self,
        ty: u32,
        stride: Option<usize>,
        visit: &mut dyn FnMut(u32, Option<usize>) -> Checked<()>,
    ) -> Checked<()> {
        match (self.opcode(ty), self.globals.get(&ty)) {
            (Op::TypeArray | Op::TypeRuntimeArray, Some(array)) => {
                let stride = self.decoration(ty, None, Decoration::ArrayStride).map(|s| s as usize);
                id(array.operands.first()).map_or(Ok(()), |element| self.visit_structs(element, stride, visit))
            }
            (Op::TypeStruct, Some(block)) => {
                visit(ty, stride)?;
                let mut members = block.operands.iter().filter_map(Operand::id_ref_any);
                members.try_for_each(|member| self.visit_structs(member, None, visit))
            }
            _ => Ok(()),
        }
    }

    /// Threads of a workgroup along each axis.
    pub(super) fn local_size(&self, specialization: &[(u32, u32)]) -> Option<[u32; 3]> {
        let mut threads = [0; 3];
        for (threads, operand) in threads.iter_mut().zip(self.local_size?) {
            let constant = id(Some(operand));
            let spec_id = constant.and_then(|c| self.decoration(c, None, Decoration::SpecId));
            let chosen = specialization.iter().find(|(id, _)| spec_id == Some(*id)).map(|(_, value)| *value);
            *threads = chosen.or_else(|| match constant {
                Some(constant) => number(self.operand(constant, 0)),
                None => number(Some(operand)),
            })?;
        }
        threads.iter().all(|&n| n > 0).then_some(threads)
    }
}
