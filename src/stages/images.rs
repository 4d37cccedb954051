//! The images of a frame on one device. Every image spans the whole frame, whatever the device owns of it: stripes may
//! move from frame to frame, and a row has the same address everywhere. What leaves a frame is there once per frame in
//! flight, in slots.

use std::collections::HashMap;
use std::ops::Range;

use crate::device::GpuDevice;
use crate::graph::PhysicalImage;
use crate::image::Extent;
use crate::scene::rig::Eye;

pub struct Images {
    extent: Extent,
    buffers: HashMap<(PhysicalImage, Eye, usize), wgpu::Buffer>,
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
    pub fn new(gpu: &GpuDevice, extent: Extent, aovs: u8, slots: usize) -> Result<Self, TooLarge> {
        let all = PER_VIEW.into_iter().chain((0..aovs).map(PhysicalImage::Aov));
        let mut buffers = HashMap::new();
        for image in all {
            let size = image.header_bytes() + image.row_bytes(extent.width) * u64::from(extent.height);
            let limit = gpu.info.max_storage_bytes;
            if size > limit {
                return Err(TooLarge { extent, mib: size >> 20, limit: limit >> 20, device: gpu.info.index });
            }
            let slots = if image.is_output() { slots } else { 1 };
            for (eye, slot) in Eye::ALL.into_iter().flat_map(|e| (0..slots).map(move |s| (e, s))) {
                let buffer = new_buffer(gpu, image, size);
                if image == PhysicalImage::Holes {
                    // Hole-filling runs as many workgroups in x as reprojection counts; y and z are always 1.
                    gpu.queue.write_buffer(&buffer, 8, bytemuck::cast_slice(&[1u32, 1]));
                }
                buffers.insert((image, eye, slot), buffer);
            }
        }
        Ok(Self { extent, buffers })
    }

    /// The image of the frame in this slot.
    ///
    /// # Panics
    /// On an auxiliary image that was not asked for, and a slot that is not there.
    pub fn buffer(&self, image: PhysicalImage, eye: Eye, slot: usize) -> &wgpu::Buffer {
        &self.buffers[&(image, eye, if image.is_output() { slot } else { 0 })]
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
