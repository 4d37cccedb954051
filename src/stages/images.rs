//! The images of a frame on one device. Every image spans the whole frame, whichever rows the device owns: stripes may
//! move between frames, and a row has the same address on every device. Outputs have one buffer per frame in flight
//! (slots). History has two buffers, which frames use alternately (turns).

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use crate::device::{GpuDevice, Traversal};
use crate::graph::{Bound, Format, Life, Program, Resource, Scope};
use crate::image::Extent;
use crate::passes::PREVIOUS;
use crate::scene::rig::Eye;

/// The buffers of all resources of a run.
pub struct Images {
    extent: Extent,
    buffers: HashMap<(Resource, u8), Copies>,
}

/// The buffers of one resource, or of one of its two ping-pong versions.
struct Copies {
    kind: Kind,
    /// Buffers by eye (a single entry if the eyes share them), then by slot or turn.
    buffers: Vec<Vec<wgpu::Buffer>>,
}

impl Copies {
    fn number(&self, bound: &Bound, place: Place) -> usize {
        match self.kind {
            Kind::All => 0,
            Kind::Turns if bound.is_before => 1 - place.turn,
            Kind::Turns => place.turn,
            Kind::Slots => place.slot,
        }
    }
}

/// Rule by which frames share a buffer.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    All,
    /// Frames alternate between two buffers.
    Turns,
    /// Frames that are never in flight together share a buffer.
    Slots,
}

/// Selects a frame's buffers among the copies of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub struct Place {
    /// Index of the frame's output buffers, which no other frame in flight uses.
    pub slot: usize,
    /// Index, 0 or 1, of the history buffers that the frame writes. It reads the others, written by the previous frame.
    pub turn: usize,
}

impl Place {
    /// Returns the slot and the turn of frame number `number`, counted from 0, with `slots` frames in flight.
    pub fn of(number: u64, slots: usize) -> Self {
        Self { slot: (number % slots as u64) as usize, turn: (number % 2) as usize }
    }
}

impl Images {
    /// Creates the buffers of all images that any of these programs binds, with `slots` frames in flight.
    pub fn new(gpu: &GpuDevice, programs: &[Program], extent: Extent, slots: usize) -> Self {
        let bound = || programs.iter().flat_map(Program::images);
        let views = programs.iter().map(Program::views).max().unwrap_or(1);
        // The eyes share constants; more views have their own.
        let has_own = |r: &Resource| r.scope == Scope::View || (*r == PREVIOUS && views > 2);
        let kept: HashSet<Resource> = bound().filter(|b| b.is_before).map(|b| b.resource).collect();
        let mut buffers = HashMap::new();
        for Bound { resource, buffer, .. } in bound() {
            if buffers.contains_key(&(*resource, *buffer)) {
                continue;
            }
            let size = resource.bytes(extent);
            let (kind, count) = match resource.life {
                _ if kept.contains(resource) => (Kind::Turns, 2),
                Life::Output => (Kind::Slots, slots),
                Life::Frame | Life::Local | Life::Input => (Kind::All, 1),
            };
            let eyes = if has_own(resource) { views } else { 1 };
            let of_eye = |_| (0..count).map(|_| new_buffer(gpu, resource, size)).collect();
            buffers.insert((*resource, *buffer), Copies { kind, buffers: (0..eyes).map(of_eye).collect() });
        }
        Self { extent, buffers }
    }

    /// Returns the resource of this name and number.
    pub fn find(&self, name: &str, number: u8) -> Option<Resource> {
        self.buffers.keys().map(|(resource, _)| *resource).find(|r| r.name == name && r.number == number)
    }

    /// True if any program binds this resource.
    pub fn has(&self, resource: &Resource) -> bool {
        self.buffers.contains_key(&(*resource, 0))
    }

    /// Returns the buffers that hold an image of each view, see [`Self::buffer`].
    pub fn views<'a>(&'a self, bound: &Bound, place: Place) -> impl Iterator<Item = &'a wgpu::Buffer> + use<'a> {
        let copies = &self.buffers[&(bound.resource, bound.buffer)];
        let number = copies.number(bound, place);
        copies.buffers.iter().map(move |of_view| &of_view[number])
    }

    /// Returns the buffer that holds an image of an eye, for a frame with the slot and the turn of `place`.
    ///
    /// # Panics
    /// If no program binds the image, or if the slot does not exist.
    pub fn buffer(&self, bound: &Bound, eye: Eye, place: Place) -> &wgpu::Buffer {
        let copies = &self.buffers[&(bound.resource, bound.buffer)];
        &copies.buffers[eye.index().min(copies.buffers.len() - 1)][copies.number(bound, place)]
    }

    /// Returns the offset and the size of these rows of an image, bytes.
    pub fn span(&self, resource: &Resource, rows: &Range<u32>) -> (u64, u64) {
        let row = resource.row_bytes(self.extent);
        (resource.header_bytes() + row * u64::from(rows.start), row * u64::from(rows.end - rows.start))
    }

    /// Returns the offset and the size of all rows of an image, bytes.
    pub fn whole(&self, resource: &Resource) -> (u64, u64) {
        self.span(resource, &resource.extent(self.extent).rows())
    }
}

fn new_buffer(gpu: &GpuDevice, resource: &Resource, size: u64) -> wgpu::Buffer {
    use wgpu::BufferUsages as Usage;
    let usage = match resource.format {
        Format::Texels { .. } => Usage::STORAGE,
        Format::List => Usage::STORAGE | Usage::INDIRECT,
        Format::Uniform { .. } => Usage::UNIFORM,
    };
    // Passes write the vertices from which acceleration structures are built.
    let is_input = gpu.info.traversal == Traversal::Hardware && matches!(resource.format, Format::Texels { .. });
    let usage = if is_input { usage | Usage::BLAS_INPUT } else { usage };
    let buffer = gpu.buffer(resource.name, size, usage | Usage::COPY_SRC | Usage::COPY_DST);
    if resource.format == Format::List {
        // Arguments of the indirect dispatch: the shader that fills the list counts the workgroups in x; y and z are
        // always 1.
        gpu.queue.write_buffer(&buffer, 8, bytemuck::cast_slice(&[1u32, 1]));
    }
    buffer
}
