//! Resources that passes write and read: images, lists and constants, as plain data.

use crate::image::Extent;
use crate::wgsl::Texel;

/// The columns and rows of a resource's texels, or of a pass's invocations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Grid {
    /// The frame's columns and rows.
    Frame,
    /// The frame's columns and rows divided by this number, rounded up.
    FrameOver(u32),
    /// The frame's columns divided by this number, rounded up, and its rows.
    FrameColumnsOver(u32),
    /// One column, and as many rows as the frame has.
    FrameRows,
    /// A fixed size, independent of the frame's extent.
    Fixed(Extent),
}

impl Grid {
    /// Returns the columns and rows for a frame of this extent.
    pub fn extent(self, frame: Extent) -> Extent {
        match self {
            Self::Frame => frame,
            Self::FrameOver(n) => Extent::new(frame.width.div_ceil(n.max(1)), frame.height.div_ceil(n.max(1))),
            Self::FrameColumnsOver(n) => Extent::new(frame.width.div_ceil(n.max(1)), frame.height),
            Self::FrameRows => Extent::new(1, frame.height),
            Self::Fixed(extent) => extent,
        }
    }
}

/// The layout of a resource as shaders see it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Format {
    /// A row-major array in a storage buffer. Its elements have this type in WGSL, and each texel consists of one or
    /// more of them.
    Texels { bytes: u32, element: &'static str },
    /// Indices of texels, 4 bytes each. A header holds their count and the three workgroup counts of an indirect
    /// dispatch over the list.
    List,
    /// Constants in a uniform buffer, which are this struct in WGSL.
    Uniform { bytes: u32, name: &'static str },
}

impl Format {
    const fn texels<T: Texel>() -> Self {
        Self::Texels { bytes: size_of::<T>() as u32, element: T::ELEMENT }
    }
}

/// Length of the header of a [`Format::List`], in 4-byte words.
pub const LIST_HEADER: u32 = 4;
/// Number of a list's pixels for each workgroup of its dispatch.
pub const LIST_GROUP: u32 = 32;
/// Maximum number of workgroups of a dispatch along an axis.
const MOST_GROUPS: u64 = 65535;

/// Number of instances of a resource, or of a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Scope {
    /// One per eye, divided into stripes.
    View,
    /// One per device, which computes all of it.
    Device,
}

/// Lifetime of a resource's contents. If a pass reads the contents of the previous frame, they are kept for another
/// frame, whatever the lifetime.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Life {
    /// The contents last until those of the next frame replace them.
    Frame,
    /// The resource is an output. It is gathered on the primary, and it has one buffer per frame in flight.
    Output,
    /// The contents last as in `Frame`, but their rows never leave the device that made them.
    Local,
    /// The host sets the contents.
    Input,
}

/// Resource that passes write and read.
///
/// Two resources with the same name and number are the same.
#[derive(Clone, Copy, Debug)]
pub struct Resource {
    /// Name of the resource in reports and traces, and label of its buffers.
    pub name: &'static str,
    /// Tells resources of the same name apart.
    pub number: u8,
    /// Name of the resource's variable in shaders, if it differs from `name`.
    pub variable: Option<&'static str>,
    pub format: Format,
    pub grid: Grid,
    pub scope: Scope,
    pub life: Life,
}

impl PartialEq for Resource {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name && self.number == other.number
    }
}

impl Eq for Resource {}

impl std::hash::Hash for Resource {
    fn hash<H: std::hash::Hasher>(&self, state: &mut H) {
        self.name.hash(state);
        self.number.hash(state);
    }
}

impl Resource {
    const fn new(name: &'static str, format: Format, grid: Grid, scope: Scope, life: Life) -> Self {
        Self { name, number: 0, variable: None, format, grid, scope, life }
    }

    /// Makes an image of each eye at full size.
    pub const fn image<T: Texel>(name: &'static str) -> Self {
        Self::new(name, Format::texels::<T>(), Grid::Frame, Scope::View, Life::Frame)
    }

    /// Returns this resource on another grid.
    pub const fn on(self, grid: Grid) -> Self {
        Self { grid, ..self }
    }

    /// Makes a list of an eye's pixels. Each device lists only pixels of its own rows.
    pub const fn list(name: &'static str) -> Self {
        Self::new(name, Format::List, Grid::Frame, Scope::View, Life::Local)
    }

    /// Makes a uniform buffer of `bytes` bytes that the host sets every frame. Its type in shaders is the struct
    /// `struct_name`.
    pub const fn constants(name: &'static str, struct_name: &'static str, bytes: u32) -> Self {
        let grid = Grid::Fixed(Extent::new(1, 1));
        Self::new(name, Format::Uniform { bytes, name: struct_name }, grid, Scope::Device, Life::Input)
    }

    /// Makes a table that every device computes for itself.
    pub const fn table<T: Texel>(name: &'static str, texels: Extent) -> Self {
        Self::new(name, Format::texels::<T>(), Grid::Fixed(texels), Scope::Device, Life::Frame)
    }

    /// Returns this resource with `variable` as the name of its variable in shaders.
    pub const fn bound_as(self, variable: &'static str) -> Self {
        Self { variable: Some(variable), ..self }
    }

    pub const fn output(self) -> Self {
        Self { life: Life::Output, ..self }
    }

    pub const fn numbered(self, number: u8) -> Self {
        Self { number, ..self }
    }

    /// Returns the columns and rows for a frame of this extent.
    pub fn extent(&self, frame: Extent) -> Extent {
        self.grid.extent(frame)
    }

    /// Returns the number of dispatches that a list of all texels of a frame of this extent needs.
    pub fn list_parts(&self, frame: Extent) -> u32 {
        let texels = self.extent(frame).area() as u64;
        texels.div_ceil(MOST_GROUPS * u64::from(LIST_GROUP)) as u32
    }

    /// Returns the size of one row in bytes.
    pub fn row_bytes(&self, frame: Extent) -> u64 {
        let texel_bytes = match self.format {
            Format::Texels { bytes, .. } | Format::Uniform { bytes, .. } => bytes,
            Format::List => 4,
        };
        u64::from(texel_bytes) * u64::from(self.extent(frame).width)
    }

    /// Returns the size in bytes of the header before the first row: 0 unless the resource is a list.
    pub fn header_bytes(&self) -> u64 {
        if self.format == Format::List { u64::from(4 * LIST_HEADER) } else { 0 }
    }

    /// Returns the size in bytes of one instance of the resource, including the header.
    pub fn bytes(&self, frame: Extent) -> u64 {
        self.header_bytes() + self.row_bytes(frame) * u64::from(self.extent(frame).height)
    }
}

/// One version of a resource in a frame. Passes that cannot write in place read one version and write the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Image {
    pub resource: Resource,
    pub version: u8,
}

impl From<Resource> for Image {
    fn from(resource: Resource) -> Self {
        Self { resource, version: 0 }
    }
}

impl Image {
    pub fn next(self) -> Self {
        Self { version: self.version + 1, ..self }
    }

    /// Returns the index of its buffer. Versions alternate between two buffers (ping-pong).
    pub fn buffer(self) -> u8 {
        self.version % 2
    }
}
