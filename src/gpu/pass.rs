//! A compute shader as a value: its declaration, and the pipeline made from it.

use std::{
    fmt,
    sync::{Arc, Mutex, Weak},
    time::Instant,
};

use ash::vk;

pub use super::hazard::Access;
use super::{
    device::{Gpu, during, lock},
    layout::{PushLayout, StructLayout},
    reflect::{self, Binding, Shader},
    specialize::specialized,
};
use crate::{Error, Result, shaders};

/// A specialization constant: its GLSL name, and the bits of its value.
pub type Constant = (&'static str, u32);

/// What defines a pass. The shader says what it binds, and [`Gpu::pass`] checks the rest against it.
#[derive(Clone, Copy, Debug)]
pub struct PassDeclaration {
    /// The shader's stem, which also names the pass in timings and labels.
    pub name: &'static str,
    /// The shader.
    pub spirv: &'static [u32],
    /// Its push constant block.
    pub push: Option<PushLayout>,
    /// Rust's structs by GLSL name. Every struct in the shader's buffers must be among them.
    pub structs: &'static [StructLayout],
}

/// A compute pipeline. A clone is the same pipeline, and the last one frees it.
#[derive(Clone)]
pub struct Pass(pub(super) Arc<PassData>);

pub(super) struct PassData {
    pub gpu: Gpu,
    pub name: &'static str,
    pub slots: Vec<Binding>,
    pub push: Option<PushLayout>,
    pub local_size: [u32; 3],
    pub set_layout: vk::DescriptorSetLayout,
    pub layout: vk::PipelineLayout,
    pub pipeline: vk::Pipeline,
}

/// What identifies a pipeline: its name, the address of its static SPIR-V, and its specialization.
#[derive(Clone, PartialEq, Eq, Hash)]
pub(super) struct PassKey {
    name: &'static str,
    shader: usize,
    specialization: Vec<(u32, u32)>,
}

impl Pass {
    /// The name in its declaration.
    pub fn name(&self) -> &'static str {
        self.0.name
    }

    /// What the shader binds, by GLSL name. A block goes by its instance name.
    pub fn bindings(&self) -> &[Binding] {
        &self.0.slots
    }

    /// Threads of one workgroup along each axis.
    pub fn local_size(&self) -> [u32; 3] {
        self.0.local_size
    }
}

impl fmt::Debug for Pass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Pass({}, {:?})", self.0.name, self.0.local_size)
    }
}

/// How a handle of the device makes passes.
#[derive(Clone, Default)]
pub(super) struct Making {
    /// The number of a planted fault, and the passes that have it.
    #[cfg(feature = "faults")]
    fault: Option<(u32, &'static [&'static str])>,
    /// Keeps passes alive that were made by this handle.
    kept: Option<Arc<Mutex<Vec<Pass>>>>,
}

impl Gpu {
    /// Returns a handle that keeps the passes it makes alive, so that an equal pass is not built again. They
    /// live as long as the handle and its clones.
    pub fn keeping_passes(&self) -> Self {
        let mut making = self.1.clone();
        making.kept = Some(Arc::default());
        Self(self.0.clone(), making)
    }

    /// Returns a handle whose passes of these names have the planted fault of this number in the shaders.
    #[cfg(feature = "faults")]
    pub fn with_fault(&self, fault: u32, passes: &'static [&'static str]) -> Self {
        Self(self.0.clone(), Making { fault: Some((fault, passes)), ..self.1.clone() })
    }

    /// Makes a pass, or returns the living one that is equal.
    ///
    /// # Errors
    /// Fails with [`Error::Internal`] if the declaration and the SPIR-V disagree or the shader lacks a
    /// constant, and with [`Error::Input`] if the workgroup exceeds the device's limits.
    pub fn pass(&self, declaration: &PassDeclaration, constants: &[Constant]) -> Result<Pass> {
        let fault = |problem: String| Error::Internal(format!("shader {}: {problem}", declaration.name));
        #[cfg(feature = "faults")]
        let (declaration, constants) = &self.planted(declaration, constants);
        let declaration = &PassDeclaration { spirv: shaders::current(declaration.spirv)?, ..*declaration };
        let pass = self.new_or_alive(declaration, constants, fault)?;
        if let Some(kept) = &self.1.kept {
            let mut kept = lock(kept);
            if !kept.iter().any(|known| Arc::ptr_eq(&known.0, &pass.0)) {
                kept.push(pass.clone());
            }
        }
        Ok(pass)
    }

    /// Returns the declaration with the fault that this handle plants, or unchanged.
    #[cfg(feature = "faults")]
    fn planted(&self, declaration: &PassDeclaration, constants: &[Constant]) -> (PassDeclaration, Vec<Constant>) {
        let (mut declaration, mut constants) = (*declaration, constants.to_vec());
        if let Some((fault, passes)) = self.1.fault
            && passes.contains(&declaration.name)
            && let Some(spirv) = shaders::faulty(declaration.spirv)
        {
            declaration.spirv = spirv;
            constants.push(("FAULT", fault));
        }
        (declaration, constants)
    }

    fn new_or_alive(
        &self,
        declaration: &PassDeclaration,
        constants: &[Constant],
        fault: impl Fn(String) -> Error,
    ) -> Result<Pass> {
        let name = declaration.name;
        let instructions = reflect::parse(declaration.spirv).map_err(&fault)?;
        let shader = Shader::new(&instructions);
        let slots = shader.bindings().map_err(&fault)?;
        shader.check(declaration).map_err(&fault)?;
        let specialization = shader.specialization(constants).map_err(&fault)?;
        let size = shader.local_size(&specialization).ok_or_else(|| fault("its local size is unknown".into()))?;
        let limits = &self.0.limits;
        let threads = size.iter().map(|&n| u64::from(n)).product::<u64>();
        if threads > u64::from(limits.max_compute_work_group_invocations)
            || (0..3).any(|i| size[i] > limits.max_compute_work_group_size[i])
        {
            return Err(Error::input(
                format!("shader {name}"),
                format!("its workgroup of {size:?} exceeds this device's limits"),
                "use another device",
            ));
        }
        if declaration.push.is_some_and(|push| push.size % 4 != 0) {
            return Err(fault("push constants are not a multiple of 4 bytes".into()));
        }
        let key = PassKey { name, shader: declaration.spirv.as_ptr() as usize, specialization: specialization.clone() };
        if let Some(alive) = lock(&self.0.passes).get(&key).and_then(Weak::upgrade) {
            return Ok(Pass(alive));
        }
        // From here on, dropping `data` frees what has been made.
        let mut data = PassData {
            gpu: Self(self.0.clone(), Making::default()), // a pass that is kept must not keep its keeper alive
            name,
            slots,
            push: declaration.push,
            local_size: size,
            set_layout: vk::DescriptorSetLayout::null(),
            layout: vk::PipelineLayout::null(),
            pipeline: vk::Pipeline::null(),
        };
        let start = Instant::now();
        data.build(declaration.spirv, &specialization)?;
        tracing::debug!("{name}: a pipeline was made, {:.0} ms", start.elapsed().as_secs_f64() * 1e3);
        let pass = Arc::new(data);
        let mut passes = lock(&self.0.passes);
        passes.retain(|_, pass| pass.strong_count() > 0);
        passes.insert(key, Arc::downgrade(&pass));
        Ok(Pass(pass))
    }
}

impl PassData {
    fn build(&mut self, spirv: &[u32], specialization: &[(u32, u32)]) -> Result<()> {
        let shared = &self.gpu.0;
        let (device, name) = (&shared.device, self.name);
        let bindings: Vec<_> = self
            .slots
            .iter()
            .map(|binding| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding.number)
                    .descriptor_type(binding.kind.descriptor())
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let spirv = specialized(spirv, specialization);
        // SAFETY: the SPIR-V was parsed, and the layouts are made from it.
        unsafe {
            self.set_layout = device
                .create_descriptor_set_layout(&vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings), None)
                .map_err(during(format!("vkCreateDescriptorSetLayout for {name}")))?;
            let layouts = [self.set_layout];
            let ranges = [vk::PushConstantRange::default()
                .stage_flags(vk::ShaderStageFlags::COMPUTE)
                .size(self.push.map_or(0, |push| push.size as u32))];
            let mut info = vk::PipelineLayoutCreateInfo::default().set_layouts(&layouts);
            if self.push.is_some() {
                info = info.push_constant_ranges(&ranges);
            }
            self.layout = device
                .create_pipeline_layout(&info, None)
                .map_err(during(format!("vkCreatePipelineLayout for {name}")))?;
            let module = device
                .create_shader_module(&vk::ShaderModuleCreateInfo::default().code(&spirv), None)
                .map_err(during(format!("vkCreateShaderModule for {name}")))?;
            shared.label(module, name);
            let stage = vk::PipelineShaderStageCreateInfo::default()
                .stage(vk::ShaderStageFlags::COMPUTE)
                .module(module)
                .name(c"main");
            let info = vk::ComputePipelineCreateInfo::default()
                .flags(vk::PipelineCreateFlags::DISPATCH_BASE) // frames in pieces cut large dispatches
                .stage(stage)
                .layout(self.layout);
            let made = device.create_compute_pipelines(shared.pipeline_cache.handle(), &[info], None);
            device.destroy_shader_module(module, None);
            let made = made.map_err(|(_, result)| during(format!("vkCreateComputePipelines for {name}"))(result))?;
            self.pipeline = made[0];
            shared.label(self.set_layout, name);
            shared.label(self.layout, name);
            shared.label(self.pipeline, name);
        }
        Ok(())
    }
}

impl Drop for PassData {
    fn drop(&mut self) {
        let device = &self.gpu.0.device;
        if !self.gpu.0.may_free() {
            return;
        }
        // SAFETY: frames that use the pass hold it, and the last holder is gone. Null handles are ignored.
        unsafe {
            device.destroy_pipeline(self.pipeline, None);
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}
