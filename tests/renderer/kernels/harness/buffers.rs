//! Inputs and outputs of a kernel.

use std::collections::BTreeMap;
use std::ops::Range;

use bytemuck::Pod;
use diptych::layout::PassConstants;
use diptych::wgsl::Words;

/// The rows that a dispatch computes, and the rows that it may read.
#[derive(Clone, Debug)]
pub struct Stripe {
    pub rows: Range<u32>,
    pub valid: Range<u32>,
}

impl Stripe {
    pub fn pass(&self, view: usize, args: [u32; 3]) -> PassConstants {
        PassConstants {
            view: view as u32,
            row_begin: self.rows.start,
            row_end: self.rows.end,
            valid_begin: self.valid.start,
            valid_end: self.valid.end,
            args: Words(args),
            ..PassConstants::default()
        }
    }

    /// Returns the pixels of an image of this width that the dispatch computes.
    pub fn pixels(&self, width: u32) -> impl Iterator<Item = (u32, u32)> + use<> {
        self.rows.clone().flat_map(move |y| (0..width).map(move |x| (x, y)))
    }

    /// Returns an image of which the kernel may read only the rows that it computes.
    pub fn own<T: Pod>(&self, width: u32, pixels: &[T]) -> Buffer {
        Buffer::image(&only_in(&self.rows, width, pixels))
    }

    /// Returns an image of which the kernel may read the valid rows.
    pub fn valid<T: Pod>(&self, width: u32, pixels: &[T]) -> Buffer {
        Buffer::image(&only_in(&self.valid, width, pixels))
    }
}

/// Contents of a binding: an image, of which the kernel may write only the stripe's rows, or any other data.
pub enum Buffer {
    Image(Vec<u8>),
    Whole(Vec<u8>),
}

impl Buffer {
    pub fn image<T: Pod>(pixels: &[T]) -> Self {
        Self::Image(bytemuck::cast_slice(pixels).to_vec())
    }

    pub fn whole<T: Pod>(values: &[T]) -> Self {
        Self::Whole(bytemuck::cast_slice(values).to_vec())
    }

    pub(super) fn bytes(&self) -> &[u8] {
        match self {
            Self::Image(bytes) | Self::Whole(bytes) => bytes,
        }
    }
}

/// Contents of the writable bindings after a dispatch.
pub struct Outputs(pub(super) BTreeMap<String, Vec<u8>>);

impl Outputs {
    pub fn get<T: Pod>(&self, name: &str) -> Vec<T> {
        let bytes = self.0.get(name).unwrap_or_else(|| panic!("no writable binding is named '{name}'"));
        bytemuck::pod_collect_to_vec(bytes)
    }
}

/// Returns an image with only the rows `rows`. Other rows hold bits that are not finite in any format.
pub fn only_in<T: Pod>(rows: &Range<u32>, width: u32, pixels: &[T]) -> Vec<T> {
    let mut out = pixels.to_vec();
    let (begin, end) = ((rows.start * width) as usize, (rows.end * width) as usize);
    for (at, pixel) in out.iter_mut().enumerate() {
        if at < begin || at >= end {
            bytemuck::bytes_of_mut(pixel).fill(0xff);
        }
    }
    out
}
