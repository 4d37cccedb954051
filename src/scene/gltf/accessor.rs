//! Random access to an accessor's elements, of any component type and storage.

use ::gltf::json::accessor::{Accessor, ComponentType, Type, sparse};
use ::gltf::json::validation::Checked;

use super::buffers::{Buffers, View};
use super::fault::{Fault, Outcome, Within, label, lookup};

/// Size of the largest element in bytes: a matrix of 16 components of four bytes.
const MAX_ELEMENT: usize = 64;

/// An accessor whose elements have all been checked to be readable.
pub struct Elements<'a> {
    pub count: usize,
    pub component: ComponentType,
    /// Number of components in an element: 1 to 4, or 16.
    pub width: usize,
    normalized: bool,
    base: Option<Strided<'a>>,
    sparse: Option<Sparse<'a>>,
}

/// Elements at a constant stride. Invariant: `(count - 1) * stride + element size <= bytes.len()`, where `count` is the
/// number of the accessor's elements.
#[derive(Clone, Copy)]
struct Strided<'a> {
    bytes: &'a [u8],
    stride: usize,
}

struct Sparse<'a> {
    /// Strictly increasing indices, all below the accessor's count.
    indices: Vec<u32>,
    /// Packed elements, one per index.
    values: &'a [u8],
}

impl<'a> Elements<'a> {
    pub fn open(buffers: &'a Buffers, index: usize) -> Outcome<Self> {
        Self::open_decoded(buffers, index, None)
    }

    /// Opens an accessor whose elements are those of `decoded`, packed, instead of those of its buffer view. `None` opens
    /// it like [`open`](Self::open).
    pub fn open_decoded(buffers: &'a Buffers, index: usize, decoded: Option<&'a [u8]>) -> Outcome<Self> {
        let accessor = lookup(&buffers.root.accessors, "accessor", index)?;
        Self::of(buffers, accessor, decoded).within(|| label("accessor", index, &accessor.name))
    }

    fn of(buffers: &'a Buffers, accessor: &Accessor, decoded: Option<&'a [u8]>) -> Outcome<Self> {
        let Checked::Valid(component) = accessor.component_type else {
            return Err(Fault::Invalid("its componentType is unknown".into()));
        };
        let component = component.0;
        let width = width_of(accessor.type_)?;
        let size = component.size() * width;
        let count = usize::try_from(accessor.count.0).unwrap_or(usize::MAX);
        if u32::try_from(count).is_err() {
            return Err(Fault::Invalid(format!("its count of {count} does not fit in 32 bits")));
        }
        let offset = accessor.byte_offset.unwrap_or_default().0;
        let count = decoded.map_or(count, |bytes| bytes.len() / size);
        let base = match (decoded, accessor.buffer_view) {
            (Some(bytes), _) => Some(Strided::new(View { bytes, stride: None }, 0, count, size)?),
            (None, Some(view)) => Some(Strided::new(buffers.view(view.value())?, offset, count, size)?),
            (None, None) => {
                buffers.take_zeros(count)?;
                None
            }
        };
        let sparse = accessor.sparse.as_ref().map(|s| Sparse::new(buffers, s, count, size)).transpose()?;
        Ok(Self { count, component, width, normalized: accessor.normalized, base, sparse })
    }

    /// Returns element `i` as floats, with absent components zero. Normalised integers map to 0..1 or -1..1. `i` must
    /// be below `count`.
    pub fn floats(&self, i: usize) -> [f32; 4] {
        self.convert(i, self.normalized)
    }

    /// Returns element `i` like [`floats`](Self::floats), but always treats integers as normalised. `i` must be below
    /// `count`.
    pub fn unit_floats(&self, i: usize) -> [f32; 4] {
        self.convert(i, true)
    }

    /// Returns the first component of element `i` of an accessor with unsigned components. `i` must be below `count`.
    pub fn unsigned(&self, i: usize) -> u32 {
        read_unsigned(self.component, self.element(i))
    }

    /// Returns the components of element `i` of an accessor with unsigned components, with absent ones zero. `i` must
    /// be below `count`.
    pub fn unsigneds(&self, i: usize) -> [u32; 4] {
        let mut out = [0; 4];
        let components = self.element(i).chunks_exact(self.component.size());
        out.iter_mut().zip(components).for_each(|(value, bytes)| *value = read_unsigned(self.component, bytes));
        out
    }

    /// Returns element `i` of an accessor with 16 components, in column-major order. `i` must be below `count`.
    pub fn matrix(&self, i: usize) -> [f32; 16] {
        self.convert(i, self.normalized)
    }

    fn convert<const N: usize>(&self, i: usize, normalized: bool) -> [f32; N] {
        let mut out = [0.0; N];
        let components = self.element(i).chunks_exact(self.component.size());
        for (value, bytes) in out.iter_mut().zip(components) {
            *value = to_float(self.component, bytes, normalized);
        }
        out
    }

    fn element(&self, i: usize) -> &[u8] {
        const ZEROS: [u8; MAX_ELEMENT] = [0; MAX_ELEMENT];
        let size = self.component.size() * self.width;
        if let Some(sparse) = &self.sparse
            && let Ok(at) = sparse.indices.binary_search(&(i as u32))
        {
            return &sparse.values[at * size..][..size];
        }
        match &self.base {
            Some(base) => &base.bytes[i * base.stride..][..size],
            None => &ZEROS[..size],
        }
    }
}

impl<'a> Strided<'a> {
    fn new(view: View<'a>, offset: u64, count: usize, size: usize) -> Outcome<Self> {
        let stride = view.stride.unwrap_or(size);
        if stride < size {
            return Err(Fault::Invalid(format!("a stride of {stride} bytes is less than the element size, {size}")));
        }
        let bytes = usize::try_from(offset).ok().and_then(|start| view.bytes.get(start..));
        let needed = count.checked_sub(1).map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size));
        match (bytes, needed) {
            (Some(bytes), Some(needed)) if needed <= bytes.len() => Ok(Self { bytes, stride }),
            _ => Err(Fault::Invalid(format!(
                "{count} elements of {size} bytes at stride {stride} and offset {offset} exceed its view of {} bytes",
                view.bytes.len()
            ))),
        }
    }
}

impl<'a> Sparse<'a> {
    fn new(buffers: &'a Buffers, json: &sparse::Sparse, accessor_count: usize, size: usize) -> Outcome<Self> {
        let count = usize::try_from(json.count.0).unwrap_or(usize::MAX);
        if count > accessor_count {
            return Err(Fault::Invalid(format!("{count} sparse elements exceed its count of {accessor_count}")));
        }
        let Checked::Valid(component) = json.indices.component_type else {
            return Err(Fault::Invalid("its sparse indices have an unknown componentType".into()));
        };
        let component = component.0;
        let packed = |view: usize, offset: u64, size: usize| {
            let view = View { stride: None, ..buffers.view(view)? };
            Strided::new(view, offset, count, size)
        };
        let indices = &json.indices;
        let indices = packed(indices.buffer_view.value(), indices.byte_offset.0, component.size())?;
        let indices: Vec<u32> =
            indices.bytes.chunks_exact(component.size()).take(count).map(|b| read_unsigned(component, b)).collect();
        if !indices.is_sorted_by(|a, b| a < b) || indices.last().is_some_and(|&i| i as usize >= accessor_count) {
            return Err(Fault::Invalid("its sparse indices do not increase, or exceed its element count".into()));
        }
        let values = packed(json.values.buffer_view.value(), json.values.byte_offset.0, size)?;
        Ok(Self { indices, values: values.bytes })
    }
}

fn width_of(type_: Checked<Type>) -> Outcome<usize> {
    match type_ {
        Checked::Valid(Type::Scalar) => Ok(1),
        Checked::Valid(Type::Vec2) => Ok(2),
        Checked::Valid(Type::Vec3) => Ok(3),
        Checked::Valid(Type::Vec4) => Ok(4),
        Checked::Valid(Type::Mat4) => Ok(16),
        Checked::Valid(other) => Err(Fault::Invalid(format!("its type {other:?} is not supported"))),
        Checked::Invalid => Err(Fault::Invalid("its type is unknown".into())),
    }
}

/// Reads an unsigned integer from `bytes` of the component's size. Floats and signed integers, which no caller admits,
/// read as 0.
fn read_unsigned(component: ComponentType, bytes: &[u8]) -> u32 {
    match (component, bytes) {
        (ComponentType::U8, &[a]) => a.into(),
        (ComponentType::U16, &[a, b]) => u16::from_le_bytes([a, b]).into(),
        (ComponentType::U32, &[a, b, c, d]) => u32::from_le_bytes([a, b, c, d]),
        _ => 0,
    }
}

/// Converts `bytes` of the component's size to a float.
fn to_float(component: ComponentType, bytes: &[u8], normalized: bool) -> f32 {
    let (value, max) = match (component, bytes) {
        (ComponentType::I8, &[a]) => (f32::from(a as i8), f32::from(i8::MAX)),
        (ComponentType::U8, &[a]) => (f32::from(a), f32::from(u8::MAX)),
        (ComponentType::I16, &[a, b]) => (f32::from(i16::from_le_bytes([a, b])), f32::from(i16::MAX)),
        (ComponentType::U16, &[a, b]) => (f32::from(u16::from_le_bytes([a, b])), f32::from(u16::MAX)),
        (ComponentType::U32, &[a, b, c, d]) => (u32::from_le_bytes([a, b, c, d]) as f32, u32::MAX as f32),
        (ComponentType::F32, &[a, b, c, d]) => return f32::from_le_bytes([a, b, c, d]),
        _ => return 0.0,
    };
    if normalized { (value / max).max(-1.0) } else { value }
}
