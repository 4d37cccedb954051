//! The declaration of a pass: its shader, its bindings, and where it runs. Everything else is derived from it: bind
//! groups and their order, images, transfers, history, units of cost, and names in reports.

use std::ops::Range;

use super::launch::Launch;
use super::resource::{Grid, Image, Resource, Scope};
use crate::scene::rig::Eye;
use crate::wgsl::Constant;

/// A kind of pass. All iterations of a filter on both views are one stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[serde(transparent)]
pub struct Stage(pub &'static str);

impl Stage {
    /// The name in reports, in traces and on the command line.
    pub fn name(self) -> &'static str {
        self.0
    }
}

/// Name of a group of passes that use the same stripes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Partition(pub &'static str);

/// Access of a shader to the scene tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SceneUse {
    No,
    Read,
    /// Writes rows of tables, and reads none.
    Write,
}

/// A compute shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Kernel {
    /// Name of the shader's file under `shaders/`, without the extension, or the name given to a foreign shader.
    pub(crate) name: &'static str,
    /// WGSL text of a foreign shader, which is not part of the library; `None` for the library's own shaders. The field
    /// is private, so that no other module can declare a foreign shader as the library's own.
    foreign_text: Option<&'static str>,
    /// The size of a workgroup, in invocations.
    pub(crate) workgroup: [u32; 3],
    pub(crate) scene: SceneUse,
    /// Constants to declare in the shader's text: names and values.
    pub(crate) constants: &'static [Constant],
}

impl Kernel {
    /// Makes a kernel from a file in `shaders/`. It has workgroups of 8 x 8 and does not read the scene.
    pub(crate) const fn new(name: &'static str) -> Self {
        Self { name, foreign_text: None, workgroup: [8, 8, 1], scene: SceneUse::No, constants: &[] }
    }

    /// Makes a kernel from a shader outside the library. It has workgroups of 8 x 8 and does not read the scene.
    /// `//!include` lines in its text include shared parts of the library's shaders. It runs with all run-time checks.
    pub const fn from_text(name: &'static str, text: &'static str) -> Self {
        Self { foreign_text: Some(text), ..Self::new(name) }
    }

    /// Returns the text of a foreign kernel's shader before includes are expanded.
    pub fn foreign_text(&self) -> Option<&'static str> {
        self.foreign_text
    }

    /// Makes a kernel like [`Self::new`] that reads the scene.
    pub(crate) const fn with_scene(name: &'static str) -> Self {
        Self::new(name).reading_scene()
    }

    /// Returns this kernel with read access to the scene.
    pub const fn reading_scene(self) -> Self {
        Self { scene: SceneUse::Read, ..self }
    }

    /// Returns this kernel with workgroups of this size, in invocations.
    pub const fn workgroup(self, workgroup: [u32; 3]) -> Self {
        Self { workgroup, ..self }
    }

    /// Makes a kernel with workgroups of 64 x 1 that changes the scene.
    pub(crate) const fn changing_scene(name: &'static str) -> Self {
        Self { scene: SceneUse::Write, workgroup: [64, 1, 1], ..Self::new(name) }
    }

    /// Returns this kernel with these constants.
    pub(crate) const fn with(self, constants: &'static [Constant]) -> Self {
        Self { constants, ..self }
    }
}

/// Access of a pass to an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    Read,
    /// Writes every texel of its rows.
    Write,
    /// Writes every texel of its rows, and reads back only its own writes.
    WriteThenRead,
    /// Changes some texels, idempotently: a second run leaves the same result.
    Update,
    /// Adds to every texel.
    Add,
}

impl Access {
    /// Returns true if this access needs the output of earlier passes.
    pub fn reads(self) -> bool {
        matches!(self, Self::Read | Self::Update | Self::Add)
    }

    pub fn writes(self) -> bool {
        self != Self::Read
    }
}

/// Rows of an image that a pass reads in order to compute its own rows.
#[derive(Clone, Copy, Debug)]
pub enum Reach {
    Own,
    /// Also this many rows above and below.
    Halo(u32),
    /// All blocks of `size` rows that contain its own rows. The first block begins `offset` rows above the image.
    Blocks {
        size: u32,
        offset: u32,
    },
    All,
    /// The rows that this function returns for the pass's own rows. Argument and result count rows of the image that is
    /// read.
    Rows(fn(Range<u32>) -> Range<u32>),
}

impl Reach {
    /// Returns the rows that are read for the rows `own` of an image with `height` rows.
    pub fn rows(self, own: &Range<u32>, height: u32) -> Range<u32> {
        match self {
            Self::Own => own.clone(),
            Self::Halo(rows) => own.start.saturating_sub(rows)..own.end.saturating_add(rows).min(height),
            Self::Blocks { size, offset } => {
                let size = size.max(1);
                let begin = (own.start + offset) / size * size;
                let end = (own.end + offset).next_multiple_of(size);
                begin.saturating_sub(offset)..(end - offset).min(height)
            }
            Self::All => 0..height,
            Self::Rows(map) => {
                let rows = map(own.clone());
                rows.start.min(height)..rows.end.min(height)
            }
        }
    }

    /// Returns the number of rows read above and below, which is 0 unless this is a [`Self::Halo`].
    pub fn halo_rows(self) -> u32 {
        if let Self::Halo(rows) = self { rows } else { 0 }
    }
}

/// One binding of a pass.
#[derive(Clone, Copy, Debug)]
pub struct Use {
    pub image: Image,
    pub access: Access,
    pub reach: Reach,
    /// True if the pass binds the image of the previous frame.
    pub is_before: bool,
    /// The eye whose image is bound. By default it is the eye of the pass.
    pub eye: Option<Eye>,
    /// True if the image may be bound although no pass has written it. The shader then does not read it.
    pub is_optional: bool,
    /// True if the image is cleared to 0 before the pass. In a list, only the counts are cleared.
    pub is_cleared: bool,
}

impl Use {
    fn new(image: impl Into<Image>, access: Access) -> Self {
        let image = image.into();
        let (reach, eye) = (Reach::Own, None);
        Self { image, access, reach, is_before: false, eye, is_optional: false, is_cleared: false }
    }

    pub fn read(image: impl Into<Image>) -> Self {
        Self::new(image, Access::Read)
    }

    pub fn write(image: impl Into<Image>) -> Self {
        Self::new(image, Access::Write)
    }

    pub fn write_then_read(image: impl Into<Image>) -> Self {
        Self::new(image, Access::WriteThenRead)
    }

    pub fn update(image: impl Into<Image>) -> Self {
        Self::new(image, Access::Update)
    }

    pub fn add(image: impl Into<Image>) -> Self {
        Self::new(image, Access::Add)
    }

    /// Reads this many rows above and below as well.
    pub fn halo(self, rows: u32) -> Self {
        self.reaching(Reach::Halo(rows))
    }

    pub fn reaching(self, reach: Reach) -> Self {
        Self { reach, ..self }
    }

    /// Binds the image of the previous frame, and reads this many rows above and below as well. `None` means that there
    /// is no previous frame: the image is bound but not read.
    pub fn before(self, rows: Option<u32>) -> Self {
        Self { is_before: true, is_optional: rows.is_none(), ..self.halo(rows.unwrap_or(0)) }
    }

    /// Binds the image of this eye, whichever view the pass has.
    pub fn of(self, eye: Eye) -> Self {
        Self { eye: Some(eye), ..self }
    }

    pub fn if_written(self) -> Self {
        Self { is_optional: true, ..self }
    }

    pub fn cleared(self) -> Self {
        Self { is_cleared: true, ..self }
    }

    /// Returns true if the graph must bring the rows of the image to the device: the pass reads the image, and the host
    /// does not set it.
    pub fn is_read(&self) -> bool {
        self.access.reads() && self.image.resource.life != super::Life::Input
    }
}

/// The number of invocations or workgroups that run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dispatch {
    /// One invocation for each tile of this many columns and rows.
    Invocations([u32; 2]),
    /// One workgroup for each tile of this many columns and rows.
    Workgroups([u32; 2]),
    /// One workgroup for each tile of this many columns and rows that the device's rows can overlap, wherever the
    /// shader places the origin of the tiles.
    Displaced([u32; 2]),
    /// Indirect dispatch with the workgroup counts in the header of this list.
    List(Resource),
    /// This many workgroups, once per device.
    Once([u32; 3]),
}

impl Dispatch {
    pub const PIXELS: Self = Self::Invocations([1, 1]);
}

/// The quantity to which the time of a pass is proportional.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// The rays of its view, as counted in the previous frame.
    Rays,
    /// The rows that it computes.
    Rows,
    /// Nothing. The time is the same on each device that has any rows.
    Once,
}

/// Role of a pass in a filter chain. There, each pass reads a halo: rows above and below its own that the previous pass
/// wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chain {
    No,
    /// The pass reads such a halo. The halo plan decides whether a device receives the halo from its neighbours or
    /// computes it as a margin.
    Planned,
    /// The pass reads such a halo, which each device computes as a margin.
    Margin,
}

/// A pass on one view, or one that each device runs for itself.
#[derive(Clone, Debug)]
pub struct Pass {
    pub stage: Stage,
    /// [`Eye::Left`] if [`Self::scope`] is [`Scope::Device`].
    pub view: Eye,
    pub scope: Scope,
    /// Index among the repetitions of its stage, from 0.
    pub index: u32,
    pub kernel: Kernel,
    pub grid: Grid,
    /// The bindings of group 1, in order.
    pub uses: Vec<Use>,
    pub dispatch: Dispatch,
    /// The runs of the kernel, one after another.
    pub launches: Vec<Launch>,
    pub work: Work,
    pub partition: Partition,
    pub chain: Chain,
    /// Vertices from which each device builds its acceleration structures of dynamic geometry after the pass.
    pub builds_from: Option<Resource>,
}

impl Pass {
    /// Makes a pass with one invocation per pixel of a view, whose cost is proportional to its rows.
    pub fn new(stage: Stage, view: Eye, partition: Partition, kernel: Kernel) -> Self {
        Self {
            stage,
            view,
            scope: Scope::View,
            index: 0,
            kernel,
            grid: Grid::FRAME,
            uses: Vec::new(),
            dispatch: Dispatch::PIXELS,
            launches: vec![Launch::Once([0; 3])],
            work: Work::Rows,
            partition,
            chain: Chain::No,
            builds_from: None,
        }
    }

    /// Makes a pass that every device runs for itself.
    pub fn once(stage: Stage, partition: Partition, kernel: Kernel, workgroups: [u32; 3]) -> Self {
        let (dispatch, scope) = (Dispatch::Once(workgroups), Scope::Device);
        Self { scope, dispatch, work: Work::Once, ..Self::new(stage, Eye::Left, partition, kernel) }
    }

    pub fn uses(mut self, uses: impl IntoIterator<Item = Use>) -> Self {
        self.uses.extend(uses);
        self
    }

    pub fn index(self, index: u32) -> Self {
        Self { index, ..self }
    }

    pub fn on(self, grid: Grid) -> Self {
        Self { grid, ..self }
    }

    pub fn dispatch(self, dispatch: Dispatch) -> Self {
        Self { dispatch, ..self }
    }

    pub fn args(self, args: [u32; 3]) -> Self {
        Self { launches: vec![Launch::Once(args)], ..self }
    }

    pub fn launches(self, launches: Vec<Launch>) -> Self {
        Self { launches, ..self }
    }

    pub fn counted_by(self, work: Work) -> Self {
        Self { work, ..self }
    }

    pub fn chain(self, chain: Chain) -> Self {
        Self { chain, ..self }
    }

    /// Makes each device build its acceleration structures of dynamic geometry after the pass, from these vertices that
    /// the pass writes.
    pub fn builds_from(self, vertices: Resource) -> Self {
        Self { builds_from: Some(vertices), ..self }
    }

    /// Returns the eye whose image a binding uses.
    pub fn eye_of(&self, used: &Use) -> Eye {
        match used.image.resource.scope {
            Scope::View => used.eye.unwrap_or(self.view),
            Scope::Device => Eye::Left,
        }
    }

    /// Returns the maximum number of rows above and below its own that the pass reads from an image of this frame.
    pub fn halo_rows(&self) -> u32 {
        self.uses.iter().filter(|u| u.is_read() && !u.is_before).map(|u| u.reach.halo_rows()).max().unwrap_or(0)
    }
}
