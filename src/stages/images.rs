//! The images of a frame on one device. Every image spans the whole frame, whatever the device owns of it: stripes may
//! move from frame to frame, and a row has the same address everywhere. What leaves a frame is there once per frame in
//! flight, in slots; what a frame keeps for the next is there twice, and frames take turns.

use std::collections::HashMap;
use std::ops::Range;

use super::StageSettings;
use crate::device::GpuDevice;
use crate::graph::PhysicalImage;
use crate::image::Extent;
use crate::scene::rig::Eye;

pub struct Images {
    extent: Extent,
    /// Whether a frame keeps anything for the next.
    keeps: bool,
    buffers: HashMap<(PhysicalImage, Eye, usize), wgpu::Buffer>,
}

/// Which of the images that are there several times are a frame's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Place {
    /// Of what leaves the frame.
    pub slot: usize,
    /// 0 or 1: of what the frame keeps for the next.
    pub turn: usize,
}

impl Place {
    /// Of the `number`th frame, of which `slots` may be in flight.
    pub fn of(number: u64, slots: usize) -> Self {
        Self { slot: (number % slots as u64) as usize, turn: (number % 2) as usize }
    }
}

const PER_VIEW: [PhysicalImage; 12] = [
    PhysicalImage::Hit,
    PhysicalImage::Guide,
    PhysicalImage::Albedo,
    PhysicalImage::Emission,
    PhysicalImage::Radiance,
    PhysicalImage::Ping,
    PhysicalImage::Pong,
    PhysicalImage::Tally,
    PhysicalImage::Holes,
    PhysicalImage::RowTally,
    PhysicalImage::Linear,
    PhysicalImage::Display,
];

/// What a frame leaves for the next, beside its guide.
const KEPT: [PhysicalImage; 3] = [PhysicalImage::Moments, PhysicalImage::History, PhysicalImage::Resolved];

#[derive(Debug, thiserror::Error)]
#[error(
    "one image at {extent} takes {mib} MiB, more than the {limit} MiB that device {device} lets a shader read at once: choose a smaller --size"
)]
pub struct TooLarge {
    extent: Extent,
    mib: u64,
    limit: u64,
    device: usize,
}

impl Images {
    pub fn new(gpu: &GpuDevice, settings: &StageSettings) -> Result<Self, TooLarge> {
        let extent = settings.extent;
        let keeps = settings.keeps_history();
        let kept: &[PhysicalImage] = if keeps { &KEPT } else { &[] };
        let aovs = (0..settings.aovs.len()).map(|i| PhysicalImage::Aov(i as u8));
        let all = PER_VIEW.iter().chain(kept).copied().chain(aovs);
        let mut buffers = HashMap::new();
        for image in all {
            let size = image.header_bytes() + image.row_bytes(extent.width) * u64::from(extent.height);
            let limit = gpu.info.max_storage_bytes;
            if size > limit {
                return Err(TooLarge { extent, mib: size >> 20, limit: limit >> 20, device: gpu.info.index });
            }
            let slots = match image {
                PhysicalImage::Guide if keeps => 2,
                _ if kept.contains(&image) => 2,
                _ if image.is_output() => settings.frames_in_flight,
                _ => 1,
            };
            for (eye, slot) in Eye::ALL.into_iter().flat_map(|e| (0..slots).map(move |s| (e, s))) {
                let buffer = new_buffer(gpu, image, size);
                if image == PhysicalImage::Holes {
                    // Hole-filling runs as many workgroups in x as reprojection counts; y and z are always 1.
                    gpu.queue.write_buffer(&buffer, 8, bytemuck::cast_slice(&[1u32, 1]));
                }
                buffers.insert((image, eye, slot), buffer);
            }
        }
        Ok(Self { extent, keeps, buffers })
    }

    /// The image of the frame in this place.
    ///
    /// # Panics
    /// On an image that the settings do not ask for, and a slot that is not there.
    pub fn buffer(&self, image: PhysicalImage, eye: Eye, place: Place) -> &wgpu::Buffer {
        let turn = if self.keeps { place.turn } else { 0 };
        let (image, number) = match image {
            PhysicalImage::LastGuide => (PhysicalImage::Guide, 1 - turn),
            PhysicalImage::LastMoments => (PhysicalImage::Moments, 1 - turn),
            PhysicalImage::LastHistory => (PhysicalImage::History, 1 - turn),
            PhysicalImage::LastResolved => (PhysicalImage::Resolved, 1 - turn),
            PhysicalImage::Guide => (image, turn),
            _ if KEPT.contains(&image) => (image, turn),
            _ if image.is_output() => (image, place.slot),
            _ => (image, 0),
        };
        &self.buffers[&(image, eye, number)]
    }

    /// Bytes of rows `rows` of an image: offset and size.
    pub fn span(&self, image: PhysicalImage, rows: &Range<u32>) -> (u64, u64) {
        let row = image.row_bytes(self.extent.width);
        (image.header_bytes() + row * u64::from(rows.start), row * u64::from(rows.end - rows.start))
    }
}

fn new_buffer(gpu: &GpuDevice, image: PhysicalImage, size: u64) -> wgpu::Buffer {
    let indirect =
        if image == PhysicalImage::Holes { wgpu::BufferUsages::INDIRECT } else { wgpu::BufferUsages::empty() };
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(&format!("{image:?}")),
        size,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST | indirect,
        mapped_at_creation: false,
    })
}
