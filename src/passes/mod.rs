//! The passes: one file each, under the name that shader, timing and documents use.
//!
//! Per new video frame: [`radiance_pyramid`], [`normals`], [`depth_pyramid`], [`light_table`]. Per frame: [`gbuffer`], [`sampling_mask`],
//! [`irradiance`], [`interpolate`], [`temporal`], [`atrous`], [`composite`]. Each runs on a [`view::View`]: the picture, or the relit
//! panorama's map, which is a picture too. Outside of frames: [`trace_rays`], and
//! for the window [`display`] and [`unknown`].

pub mod atrous;
pub mod brdf;
pub mod composite;
pub mod depth_pyramid;
pub mod display;
#[doc(hidden)]
pub mod fault;
pub mod gbuffer;
pub mod interpolate;
pub mod irradiance;
pub mod light_table;
pub mod normals;
pub mod panorama;
pub mod radiance_pyramid;
pub mod resources;
pub mod sampling_mask;
pub mod scene;
pub mod temporal;
pub mod trace_rays;
pub mod unknown;
pub mod view;
