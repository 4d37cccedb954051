//! The file's buffers and views of them, decompressed where they are compressed.

use std::borrow::Cow;
use std::cell::{Cell, OnceCell};
use std::path::Path;

use ::gltf::json::{Root, Value, buffer};

use super::fault::{Fault, Outcome, Within, label, lookup};
use super::meshopt::{self, Compressed};
use super::uri;

/// Extension under its ratified name and the one of its successor.
const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// All views of a file decompress to at most this, bytes.
const MAX_DECODED: usize = 1 << 33;

/// An accessor without a buffer view is all zeros and costs the file nothing; a file that reads more elements of such
/// accessors than this, however often it uses one, is a trap.
const MAX_ZEROS: usize = 1 << 22;

pub struct Buffers<'a> {
    pub root: &'a Root,
    /// None: a placeholder without bytes, behind views that are compressed.
    data: Vec<Option<Cow<'a, [u8]>>>,
    decoded: Vec<OnceCell<Vec<u8>>>,
    decoded_left: Cell<usize>,
    zeros_left: Cell<usize>,
}

/// Bytes of a buffer view.
#[derive(Clone, Copy)]
pub struct View<'a> {
    pub bytes: &'a [u8],
    /// Distance between elements; None: they are packed.
    pub stride: Option<usize>,
}

impl<'a> Buffers<'a> {
    /// `bin` is the binary chunk of a GLB; relative URIs start from `base`.
    pub fn load(root: &'a Root, bin: Option<&'a [u8]>, base: &Path) -> Outcome<Self> {
        let data = root
            .buffers
            .iter()
            .enumerate()
            .map(|(i, buffer)| load_buffer(i, buffer, bin, base).within(|| label("buffer", i, &buffer.name)))
            .collect::<Outcome<_>>()?;
        let decoded = root.buffer_views.iter().map(|_| OnceCell::new()).collect();
        let (decoded_left, zeros_left) = (Cell::new(MAX_DECODED), Cell::new(MAX_ZEROS));
        Ok(Self { root, data, decoded, decoded_left, zeros_left })
    }

    /// Notes that `count` elements without bytes are read.
    pub fn take_zeros(&self, count: usize) -> Outcome<()> {
        let left = self.zeros_left.get().checked_sub(count);
        let left = left.ok_or_else(|| Fault::Invalid(format!("it has no buffer view for its {count} elements")))?;
        self.zeros_left.set(left);
        Ok(())
    }

    pub fn view(&self, index: usize) -> Outcome<View<'_>> {
        let view = lookup(&self.root.buffer_views, "buffer view", index)?;
        self.bytes_of(index, view).within(|| label("buffer view", index, &view.name))
    }

    fn bytes_of(&self, index: usize, view: &buffer::View) -> Outcome<View<'_>> {
        let stride = view.byte_stride.map(|s| s.0);
        if let Some(extension) = compression(view) {
            if self.decoded[index].get().is_none() {
                let bytes = self.decompress(view, extension)?;
                let _ = self.decoded[index].set(bytes);
            }
            let bytes = self.decoded[index].get().map_or(&[][..], Vec::as_slice);
            return Ok(View { bytes, stride });
        }
        let bytes = self.slice(view.buffer.value(), view.byte_offset.unwrap_or_default().0, view.byte_length.0)?;
        Ok(View { bytes, stride })
    }

    fn decompress(&self, view: &buffer::View, extension: &Value) -> Outcome<Vec<u8>> {
        let compressed = Compressed::parse(extension, view)?;
        let left =
            self.decoded_left.get().checked_sub(compressed.decoded_len()).ok_or_else(|| {
                Fault::Invalid(format!("the file's views decompress to more than {MAX_DECODED} bytes"))
            })?;
        let source = self.slice(compressed.buffer, compressed.byte_offset, compressed.byte_length)?;
        let bytes = meshopt::decode(&compressed, source)?;
        self.decoded_left.set(left);
        Ok(bytes)
    }

    fn slice(&self, index: usize, offset: u64, length: u64) -> Outcome<&[u8]> {
        let data = lookup(&self.data, "buffer", index)?
            .as_deref()
            .ok_or_else(|| Fault::Invalid(format!("buffer {index} has no bytes: it names no file")))?;
        let range = || {
            let start = usize::try_from(offset).ok()?;
            let end = start.checked_add(usize::try_from(length).ok()?)?;
            data.get(start..end)
        };
        range().ok_or_else(|| {
            Fault::Invalid(format!(
                "{length} bytes from byte {offset} are beyond buffer {index} of {} bytes",
                data.len()
            ))
        })
    }
}

fn load_buffer<'a>(
    index: usize,
    buffer: &buffer::Buffer,
    bin: Option<&'a [u8]>,
    base: &Path,
) -> Outcome<Option<Cow<'a, [u8]>>> {
    if is_fallback(buffer) {
        return Ok(None);
    }
    let bytes = match (&buffer.uri, bin) {
        (Some(uri), _) => Cow::Owned(uri::fetch(base, uri)?),
        (None, Some(bin)) if index == 0 => Cow::Borrowed(bin),
        (None, _) => return Ok(None),
    };
    if (bytes.len() as u64) < buffer.byte_length.0 {
        return Err(Fault::Invalid(format!(
            "it is cut short: {} of {} bytes are there",
            bytes.len(),
            buffer.byte_length.0
        )));
    }
    Ok(Some(bytes))
}

fn is_fallback(buffer: &buffer::Buffer) -> bool {
    let Some(extensions) = &buffer.extensions else { return false };
    MESHOPT
        .iter()
        .any(|name| extensions.others.get(*name).and_then(|e| e.get("fallback")).and_then(Value::as_bool) == Some(true))
}

fn compression(view: &buffer::View) -> Option<&Value> {
    let extensions = view.extensions.as_ref()?;
    MESHOPT.iter().find_map(|name| extensions.others.get(*name))
}
