//! Decompression of buffer views with `EXT_meshopt_compression` and `KHR_meshopt_compression`.
//!
//! The decoders accept untrusted streams but trust counts and strides, so these are checked first. The claimed size is
//! bounded, too, by the stream's length.

use ::gltf::json::{Value, buffer};
use ::meshopt::ffi::meshopt_decodeVertexBuffer;
use ::meshopt::{
    decode_filter_color, decode_filter_exp, decode_filter_oct, decode_filter_quat, decode_index_buffer,
    decode_index_sequence,
};
use serde::Deserialize;

use super::fault::{Fault, Outcome};
use crate::scene::budget::{Budget, Held};

/// Largest number of decoded bytes per stream byte. The densest coding is a vertex block of 256 equal elements, for
/// which the stream holds two bits per byte of one element.
const MAX_EXPANSION: usize = 1024;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Mode {
    Attributes,
    Triangles,
    Indices,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Filter {
    #[default]
    None,
    Octahedral,
    Quaternion,
    Exponential,
    Color,
}

/// Validated contents of the extension's JSON object in a buffer view.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Compressed {
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: u64,
    pub byte_length: u64,
    byte_stride: usize,
    count: usize,
    mode: Mode,
    #[serde(default)]
    filter: Filter,
}

impl Compressed {
    pub fn parse(extension: &Value, view: &buffer::View) -> Outcome<Self> {
        let this = Self::deserialize(extension)
            .map_err(|e| Fault::Invalid(format!("its meshopt compression cannot be parsed: {e}")))?;
        this.check(view).map_err(|what| Fault::Invalid(format!("its meshopt compression: {what}")))?;
        Ok(this)
    }

    /// Returns the number of decompressed bytes. It cannot overflow, since [`parse`](Self::parse) has checked it.
    pub fn decoded_len(&self) -> usize {
        self.byte_stride * self.count
    }

    fn check(&self, view: &buffer::View) -> Result<(), String> {
        let stride = self.byte_stride;
        let stride_fits = match (self.mode, self.filter) {
            (Mode::Attributes, Filter::None | Filter::Exponential) => {
                stride.is_multiple_of(4) && (4..=256).contains(&stride)
            }
            (Mode::Attributes, Filter::Octahedral | Filter::Color) => stride == 4 || stride == 8,
            (Mode::Attributes, Filter::Quaternion) => stride == 8,
            (Mode::Triangles | Mode::Indices, Filter::None) => stride == 2 || stride == 4,
            _ => return Err(format!("mode {:?} takes no filter, but has {:?}", self.mode, self.filter)),
        };
        if !stride_fits {
            return Err(format!("stride {stride} is not valid for mode {:?}, filter {:?}", self.mode, self.filter));
        }
        if view.byte_stride.is_some_and(|s| s.0 != stride) {
            return Err(format!("its stride {stride} differs from the buffer view's"));
        }
        if self.mode == Mode::Triangles && !self.count.is_multiple_of(3) {
            return Err(format!("the number of indices, {}, is not a multiple of 3", self.count));
        }
        let length = self.count.checked_mul(stride).map(|n| n as u64);
        if length != Some(view.byte_length.0) {
            return Err(format!(
                "{} elements of {stride} bytes do not fill the view of {} bytes exactly",
                self.count, view.byte_length.0
            ));
        }
        Ok(())
    }
}

/// Decompresses a buffer view. Returns its bytes in the layout that accessors expect.
pub fn decode<'b>(compressed: &Compressed, source: &[u8], budget: &'b Budget) -> Outcome<Held<'b>> {
    let Compressed { mode, count, byte_stride, .. } = *compressed;
    if compressed.decoded_len() > source.len().saturating_mul(MAX_EXPANSION) {
        return Err(Fault::Invalid(format!(
            "its {} compressed bytes cannot hold {count} elements of {byte_stride} bytes",
            source.len()
        )));
    }
    // Elements are decoded as typed values, then copied as bytes.
    let mut reserved = budget.reserve(2 * compressed.decoded_len() as u64)?;
    let decoded = match (mode, byte_stride) {
        (Mode::Attributes, _) => decode_attributes(compressed, source),
        (Mode::Triangles, 2) => decode_index_buffer::<u16>(source, count).map(to_bytes),
        (Mode::Triangles, _) => decode_index_buffer::<u32>(source, count).map(to_bytes),
        (Mode::Indices, 2) => decode_index_sequence::<u16>(source, count).map(to_bytes),
        (Mode::Indices, _) => decode_index_sequence::<u32>(source, count).map(to_bytes),
    };
    let damaged = |e| Fault::Invalid(format!("its meshopt stream of {} bytes is damaged: {e}", source.len()));
    let bytes = decoded.map_err(damaged)?;
    reserved.shrink_to(bytes.len() as u64);
    Ok(Held { bytes, reserved })
}

fn to_bytes<T: bytemuck::NoUninit>(elements: Vec<T>) -> Vec<u8> {
    bytemuck::cast_slice(&elements).to_vec()
}

fn decode_attributes(compressed: &Compressed, source: &[u8]) -> ::meshopt::Result<Vec<u8>> {
    let Compressed { count, byte_stride, filter, .. } = *compressed;
    // The filters need the alignment of words; `check` has made the stride a multiple of four.
    let mut words = vec![0u32; count * byte_stride / 4];
    // SAFETY: `words` holds `count` elements of `byte_stride` bytes, and `check` admits only strides that the decoder
    // accepts. The decoder reads no further than the length of `source`.
    let code = unsafe {
        meshopt_decodeVertexBuffer(words.as_mut_ptr().cast(), count, byte_stride, source.as_ptr(), source.len())
    };
    if code != 0 {
        return Err(::meshopt::Error::Native(code));
    }
    match (filter, byte_stride) {
        (Filter::None, _) => {}
        (Filter::Octahedral, 4) => decode_filter_oct::<i8>(bytemuck::cast_slice_mut(&mut words)),
        (Filter::Octahedral, _) => decode_filter_oct::<i16>(bytemuck::cast_slice_mut(&mut words)),
        (Filter::Quaternion, _) => decode_filter_quat(bytemuck::cast_slice_mut(&mut words)),
        (Filter::Exponential, _) => decode_filter_exp::<1>(bytemuck::cast_slice_mut(&mut words)),
        (Filter::Color, 4) => decode_filter_color::<u8>(bytemuck::cast_slice_mut(&mut words)),
        (Filter::Color, _) => decode_filter_color::<u16>(bytemuck::cast_slice_mut(&mut words)),
    }
    Ok(to_bytes(words))
}
