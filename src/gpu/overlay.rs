//! Draws egui's panels over a picture.

use std::collections::HashMap;

use ash::vk;
use egui::{
    ClippedPrimitive, ColorImage, ImageData, TextureId, TexturesDelta,
    epaint::{ImageDelta, textures::TextureOptions},
};
use egui_ash_renderer::{DynamicRendering, Options, RenderMode, Renderer, RendererError};

use super::device::{Gpu, during};
use crate::{Error, Result};

pub struct Paint {
    /// Changed textures. Every change that egui reports must arrive here, in order.
    pub textures: TexturesDelta,
    /// The shapes to draw.
    pub primitives: Vec<ClippedPrimitive>,
    /// Pixels of the window in one of egui's points.
    pub pixels_per_point: f32,
}

/// Draws [`Paint`].
pub(super) struct Overlay {
    gpu: Gpu,
    renderer: Option<Renderer<egui_ash_renderer::allocator::DefaultAllocator>>,
    pool: vk::CommandPool,
    /// All textures, whole. The drawing crate would lose the rest of one that is updated in part.
    images: HashMap<TextureId, (ColorImage, TextureOptions)>,
}

fn failed(error: RendererError) -> Error {
    match error {
        RendererError::Vulkan(result) => during("drawing the panels")(result),
        error => Error::Internal(format!("drawing the panels: {error}")),
    }
}

impl Overlay {
    pub fn new(gpu: &Gpu, format: vk::Format, in_flight_frames: usize) -> Result<Self> {
        let shared = &gpu.0;
        let mode = RenderMode::DynamicRendering(DynamicRendering {
            color_attachment_format: format,
            depth_attachment_format: None,
            stencil_attachment_format: None,
        });
        let options = Options { in_flight_frames, ..Options::default() };
        let renderer =
            Renderer::with_default_allocator(&shared.instance, shared.physical, shared.device.clone(), mode, options);
        let renderer = Some(renderer.map_err(failed)?);
        let info = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::TRANSIENT)
            .queue_family_index(shared.queue_family);
        // SAFETY: the create info is valid.
        let pool = unsafe { shared.device.create_command_pool(&info, None) }.map_err(during("vkCreateCommandPool"))?;
        Ok(Self { gpu: gpu.clone(), renderer, pool, images: HashMap::new() })
    }

    /// Takes over changed textures. Waits for the queue if there are any, as when new letters are first used.
    pub fn update(&mut self, textures: &mut TexturesDelta) -> Result<()> {
        let Some(renderer) = &mut self.renderer else { return Ok(()) };
        for (id, deltas) in textures.set.drain() {
            for delta in deltas {
                let ImageData::Color(part) = &delta.image;
                match (delta.pos, self.images.get_mut(&id)) {
                    (Some(at), Some((whole, _))) => paste(whole, part, at),
                    _ => {
                        self.images.insert(id, (ColorImage::clone(part), delta.options));
                    }
                }
            }
            if let Some((whole, options)) = self.images.get(&id) {
                let delta = ImageDelta::full(whole.clone(), *options);
                let queue = self.gpu.0.queue();
                renderer.set_texture(*queue, self.pool, id, &delta).map_err(failed)?;
            }
        }
        for id in textures.free.drain() {
            self.images.remove(&id);
            // SAFETY: the lock serialises the queue.
            let waited = unsafe { self.gpu.0.device.queue_wait_idle(*self.gpu.0.queue()) };
            self.gpu.0.waited(waited).map_err(during("vkQueueWaitIdle"))?;
            renderer.free_texture(id).map_err(failed)?;
        }
        Ok(())
    }

    /// Records the drawing within a rendering to the window's image.
    pub fn draw(&mut self, commands: vk::CommandBuffer, extent: vk::Extent2D, paint: &Paint) -> Result<()> {
        let Some(renderer) = &mut self.renderer else { return Ok(()) };
        // a shrinking window can leave a clip rectangle outside, which would not be a valid scissor
        let [width, height] = [extent.width, extent.height].map(|n| n as f32 / paint.pixels_per_point);
        let inside = |p: &&ClippedPrimitive| {
            let clip = p.clip_rect;
            clip.min.x >= 0.0 && clip.min.y >= 0.0 && clip.max.x <= width + 0.01 && clip.max.y <= height + 0.01
        };
        if paint.primitives.iter().all(|p| inside(&p)) {
            return renderer.cmd_draw(commands, extent, paint.pixels_per_point, &paint.primitives).map_err(failed);
        }
        let screen = egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(width, height));
        let clipped: Vec<_> = paint
            .primitives
            .iter()
            .map(|p| ClippedPrimitive { clip_rect: p.clip_rect.intersect(screen), primitive: p.primitive.clone() })
            .filter(|p| p.clip_rect.is_positive())
            .collect();
        renderer.cmd_draw(commands, extent, paint.pixels_per_point, &clipped).map_err(failed)
    }
}

fn paste(whole: &mut ColorImage, part: &ColorImage, [x, y]: [usize; 2]) {
    let ([width, height], [part_width, part_height]) = (whole.size, part.size);
    if x + part_width > width || y + part_height > height {
        return;
    }
    for row in 0..part_height {
        let to = (y + row) * width + x;
        whole.pixels[to..to + part_width].copy_from_slice(&part.pixels[row * part_width..][..part_width]);
    }
}

impl Drop for Overlay {
    fn drop(&mut self) {
        if !self.gpu.0.may_free() {
            std::mem::forget(self.renderer.take());
            return;
        }
        drop(self.renderer.take());
        // SAFETY: whoever drops this has waited for what it drew.
        unsafe { self.gpu.0.device.destroy_command_pool(self.pool, None) };
    }
}
