//! What passes leave for one another: images, lists and constants, as plain data.

use crate::image::Extent;

/// The number of columns and rows of texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Size {
    /// As many as the frame has.
    Frame,
    /// The frame's columns and rows over this number, rounded up.
    FrameOver(u32),
    /// One column, and as many rows as the frame has.
    FrameRows,
    /// A fixed number, whatever the extent of the frame is.
    Fixed(Extent),
}

/// The way in which a texel becomes a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Projection {
    /// Through an image plane in front of the eye.
    Perspective,
    /// A texel stands for no direction, as in sums, lists and tables.
    None,
}

/// The positions of the texels of a resource, or of the invocations of a pass.
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

    /// The columns and rows in a frame of this extent, at least 1 of each.
    pub fn extent(self, frame: Extent) -> Extent {
        match self.size {
            Size::Frame => frame,
            Size::FrameOver(n) => Extent::new(frame.width.div_ceil(n.max(1)), frame.height.div_ceil(n.max(1))),
            Size::FrameRows => Extent::new(1, frame.height),
            Size::Fixed(extent) => extent,
        }
    }
}

/// The layout of a resource as shaders see it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Format {
    /// A row-major array in a storage buffer, with this many bytes per texel.
    Texels(u32),
    /// Indices of texels, 4 bytes each. The count and the three numbers of workgroups that cover the list stand before
    /// them.
    List,
    /// Constants in a uniform buffer of this many bytes.
    Uniform(u32),
}

/// Numbers before the first index of a [`Format::List`].
pub const LIST_HEADER: u32 = 4;

/// Says how many there are of a resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Scope {
    /// One for each eye, divided into stripes.
    View,
    /// One for each device, which makes all of it itself.
    Device,
}

/// Says how long the contents of a resource last. What a pass reads of the frame before is kept until then in any case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Life {
    /// The contents last until those of the next frame take their place.
    Frame,
    /// It leaves the frame. It is whole on the primary at the end, and there is one for each frame in flight.
    Output,
    /// As `Frame`, but its rows never leave the device that made them.
    Local,
    /// The host sets it.
    Input,
}

/// What passes leave for one another.
///
/// Two resources with the same name and number are the same.
#[derive(Clone, Copy, Debug)]
pub struct Resource {
    /// The name in reports and traces, and of its buffer.
    pub name: &'static str,
    /// Tells resources of the same name apart.
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

    /// The same resource on another grid.
    pub const fn on(self, grid: Grid) -> Self {
        Self { grid, ..self }
    }

    /// A list of pixels of an eye, on the device that has their rows.
    pub const fn list(name: &'static str) -> Self {
        let grid = Grid::table(Size::Frame);
        Self { name, number: 0, format: Format::List, grid, scope: Scope::View, life: Life::Local }
    }

    /// Constants that the host sets with every frame.
    pub const fn constants(name: &'static str, bytes: u32) -> Self {
        let grid = Grid::table(Size::Fixed(Extent::new(1, 1)));
        Self { name, number: 0, format: Format::Uniform(bytes), grid, scope: Scope::Device, life: Life::Input }
    }

    /// A table that every device makes for itself.
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

/// One state of a resource in a frame. Passes that cannot write in place read one version and write the next.
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

    /// Which of its resource's two buffers it is in. Versions take turns.
    pub fn buffer(self) -> u8 {
        self.version % 2
    }
}
