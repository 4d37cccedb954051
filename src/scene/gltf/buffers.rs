//! The file's buffers and views of them, decompressed if necessary.

use std::cell::{Cell, OnceCell, RefCell};
use std::collections::HashMap;
use std::rc::Rc;

use ::gltf::json::{Root, Value, buffer};

use super::fault::{Fault, Outcome, Within, label, lookup};
use super::meshopt::{self, Compressed};
use super::uri::Target;
use crate::scene::budget::{Budget, Held};
use crate::scene::folder::Folder;

/// Names of the meshopt compression extension and of its Khronos successor.
const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Limit on the total number of elements of accessors without a buffer view. These elements are all zero and take no
/// space in the file, so a hostile file could claim any number of them. An accessor counts each time it is used.
const MAX_ZEROS: usize = 1 << 22;

pub struct Buffers<'a> {
    pub root: &'a Root,
    /// Folder to which URIs are relative.
    pub folder: &'a Folder<'a>,
    bin: Option<&'a [u8]>,
    /// Data of each buffer, loaded on first use. `None` marks a buffer without bytes, such as the fallback buffer of
    /// compressed views.
    data: Vec<OnceCell<Option<Data<'a>>>>,
    /// Bytes by the target of a buffer's URI. Buffers whose URIs have the same target share them.
    targets: RefCell<HashMap<Target<'a>, Rc<Held<'a>>>>,
    decoded: Vec<OnceCell<Held<'a>>>,
    zeros_left: Cell<usize>,
}

/// A buffer's bytes.
enum Data<'a> {
    Chunk(&'a [u8]),
    Read(Rc<Held<'a>>),
}

impl Data<'_> {
    fn bytes(&self) -> &[u8] {
        match self {
            Self::Chunk(bytes) => bytes,
            Self::Read(held) => held,
        }
    }
}

/// Bytes of a buffer view.
#[derive(Clone, Copy)]
pub struct View<'a> {
    pub bytes: &'a [u8],
    /// Distance between elements in bytes; `None` if they are packed.
    pub stride: Option<usize>,
}

impl<'a> Buffers<'a> {
    /// Wraps the file's buffers. `bin` is the binary chunk of a GLB.
    pub fn new(root: &'a Root, bin: Option<&'a [u8]>, folder: &'a Folder<'a>) -> Self {
        let data = root.buffers.iter().map(|_| OnceCell::new()).collect();
        let decoded = root.buffer_views.iter().map(|_| OnceCell::new()).collect();
        Self { root, folder, bin, data, targets: RefCell::default(), decoded, zeros_left: Cell::new(MAX_ZEROS) }
    }

    pub fn budget(&self) -> &'a Budget {
        self.folder.access.budget
    }

    /// Counts `count` elements without a buffer view against `MAX_ZEROS`. Returns an error if they exceed it.
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
            let bytes = self.decoded[index].get().map_or(&[][..], |held| held);
            return Ok(View { bytes, stride });
        }
        let bytes = self.slice(view.buffer.value(), view.byte_offset.unwrap_or_default().0, view.byte_length.0)?;
        Ok(View { bytes, stride })
    }

    fn decompress(&self, view: &buffer::View, extension: &Value) -> Outcome<Held<'a>> {
        let compressed = Compressed::parse(extension, view)?;
        let source = self.slice(compressed.buffer, compressed.byte_offset, compressed.byte_length)?;
        meshopt::decode(&compressed, source, self.budget())
    }

    fn slice(&self, index: usize, offset: u64, length: u64) -> Outcome<&[u8]> {
        let cell = lookup(&self.data, "buffer", index)?;
        if cell.get().is_none() {
            let buffer = &self.root.buffers[index];
            let data = self.load(index, buffer).within(|| label("buffer", index, &buffer.name))?;
            let _ = cell.set(data);
        }
        let data = cell.get().and_then(Option::as_ref).map(Data::bytes);
        let data = data.ok_or_else(|| Fault::Invalid(format!("buffer {index} has no bytes: it names no file")))?;
        let range = || {
            let start = usize::try_from(offset).ok()?;
            let end = start.checked_add(usize::try_from(length).ok()?)?;
            data.get(start..end)
        };
        range().ok_or_else(|| {
            Fault::Invalid(format!("{length} bytes at offset {offset} exceed buffer {index} of {} bytes", data.len()))
        })
    }

    fn load(&self, index: usize, buffer: &'a buffer::Buffer) -> Outcome<Option<Data<'a>>> {
        if is_fallback(buffer) {
            return Ok(None);
        }
        let data = match (&buffer.uri, self.bin) {
            (Some(uri), _) => Data::Read(self.fetch(uri)?),
            (None, Some(bin)) if index == 0 => Data::Chunk(bin),
            (None, _) => return Ok(None),
        };
        let (length, claimed) = (data.bytes().len(), buffer.byte_length.0);
        if (length as u64) < claimed {
            return Err(Fault::Invalid(format!("it is cut short: {length} of {claimed} bytes are there")));
        }
        Ok(Some(data))
    }

    fn fetch(&self, uri: &'a str) -> Outcome<Rc<Held<'a>>> {
        let target = Target::of(uri, self.folder)?;
        if let Some(known) = self.targets.borrow().get(&target) {
            return Ok(Rc::clone(known));
        }
        let held = Rc::new(target.read(self.folder.access)?);
        self.targets.borrow_mut().insert(target, Rc::clone(&held));
        Ok(held)
    }
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
