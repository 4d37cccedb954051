//! What passes leave for one another: images, lists and constants, as plain data.

use crate::image::Extent;

/// How many columns and rows of texels there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Size {
    /// As many as the frame has.
    Frame,
    /// The frame's columns and rows over this number, rounded up.
    FrameOver(u32),
    /// One column, as many rows as the frame has.
    FrameRows,
    /// So many, whatever the frame has.
    Fixed(Extent),
}

/// How a texel becomes a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Projection {
    /// Through an image plane in front of the eye.
    Perspective,
    /// It stands for no direction: sums, lists, tables.
    None,
}

/// Where the texels of a resource or the invocations of a pass are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Grid {
    pub size: Size,
    pub projection: Projection,
}

impl Grid {
    /// The image of an eye at full size.
    pub const FRAME: Self = Self { size: Size::Frame, projection: Projection::Perspective };

    pub const fn table(size: Size) -> Self {
        Self { size, projection: Projection::None }
    }

    /// Columns and rows in a frame of this extent, 1 each at least.
    pub fn extent(self, frame: Extent) -> Extent {
        match self.size {
            Size::Frame => frame,
            Size::FrameOver(n) => Extent::new(frame.width.div_ceil(n.max(1)), frame.height.div_ceil(n.max(1))),
            Size::FrameRows => Extent::new(1, frame.height),
            Size::Fixed(extent) => extent,
        }
    }
}

/// What a resource is to shaders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Format {
    /// A row-major array in a storage buffer, so many bytes a texel.
    Texels(u32),
    /// Indices of texels, 4 bytes each, behind the count and the three numbers of workgroups that go through them all.
    List,
    /// Constants in a uniform buffer, so many bytes.
    Uniform(u32),
}

/// Numbers before the first index of a [`Format::List`].
pub const LIST_HEADER: u32 = 4;

/// Of which there is one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Scope {
    /// For each eye, shared out in stripes.
    View,
    /// For each device, which makes all of it itself.
    Device,
}

/// How long its contents last. What a pass reads of the frame before is kept until then, whatever else is said here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Life {
    /// Until the next frame's take their place.
    Frame,
    /// It leaves the frame: whole on the primary, and one for each frame in flight.
    Output,
    /// As `Frame`; its rows never leave the device that made them.
    Local,
    /// Set by the host.
    Input,
}

/// What passes leave for one another.
///
/// Two with the same name and number are the same.
#[derive(Clone, Copy, Debug)]
pub struct Resource {
    /// In reports and traces, and of its buffer.
    pub name: &'static str,
    /// Which of several alike.
    pub number: u8,
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
    /// An image of each eye at full size.
    pub const fn image(name: &'static str, texel_bytes: u32) -> Self {
        let (format, grid) = (Format::Texels(texel_bytes), Grid::FRAME);
        Self { name, number: 0, format, grid, scope: Scope::View, life: Life::Frame }
    }

    /// ... of another size.
    pub const fn on(self, grid: Grid) -> Self {
        Self { grid, ..self }
    }

    /// Pixels of an eye, listed on the device that has their rows.
    pub const fn list(name: &'static str) -> Self {
        let grid = Grid::table(Size::Frame);
        Self { name, number: 0, format: Format::List, grid, scope: Scope::View, life: Life::Local }
    }

    /// Constants that the host sets with every frame.
    pub const fn constants(name: &'static str, bytes: u32) -> Self {
        let grid = Grid::table(Size::Fixed(Extent::new(1, 1)));
        Self { name, number: 0, format: Format::Uniform(bytes), grid, scope: Scope::Device, life: Life::Input }
    }

    /// What every device makes for itself.
    pub const fn table(name: &'static str, texel_bytes: u32, texels: Extent) -> Self {
        let (format, grid) = (Format::Texels(texel_bytes), Grid::table(Size::Fixed(texels)));
        Self { name, number: 0, format, grid, scope: Scope::Device, life: Life::Frame }
    }

    pub const fn output(self) -> Self {
        Self { life: Life::Output, ..self }
    }

    pub const fn numbered(self, number: u8) -> Self {
        Self { number, ..self }
    }

    /// Its columns and rows in a frame of this extent.
    pub fn extent(&self, frame: Extent) -> Extent {
        self.grid.extent(frame)
    }

    /// Bytes of one row.
    pub fn row_bytes(&self, frame: Extent) -> u64 {
        let texel_bytes = match self.format {
            Format::Texels(bytes) | Format::Uniform(bytes) => bytes,
            Format::List => 4,
        };
        u64::from(texel_bytes) * u64::from(self.extent(frame).width)
    }

    /// Bytes before the first row.
    pub fn header_bytes(&self) -> u64 {
        if self.format == Format::List { u64::from(4 * LIST_HEADER) } else { 0 }
    }

    /// Bytes of all of it.
    pub fn bytes(&self, frame: Extent) -> u64 {
        self.header_bytes() + self.row_bytes(frame) * u64::from(self.extent(frame).height)
    }
}

/// One state of a resource in a frame: passes that cannot write in place read one version and write the next.
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

    /// Which of its resource's buffers it is in: versions take turns.
    pub fn buffer(self) -> u8 {
        self.version % 2
    }
}
