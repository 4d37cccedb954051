//! The declaration of a pass: its shader, what it reads and writes, and where it runs. Everything else follows from it:
//! bind groups and their order, images, transfers, what is kept between frames, units of cost, and names in reports.

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

/// The name of a group of passes that have the same stripes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CutGroup(pub &'static str);

/// What a shader does with the tables of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SceneUse {
    No,
    Read,
    /// Changes rows of tables, and reads none.
    Write,
}

/// A compute shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Kernel {
    /// The name of its file in `shaders/`, without the extension, or of a foreign shader.
    pub(crate) name: &'static str,
    /// Nothing outside this module sets it, so a foreign shader cannot pass for one of the library.
    foreign_text: Option<&'static str>,
    /// The size of a workgroup, in invocations.
    pub(crate) workgroup: [u32; 3],
    pub(crate) scene: SceneUse,
    /// Constants of its pass, by their names in the shader.
    pub(crate) constants: &'static [Constant],
}

impl Kernel {
    /// A kernel from a file of `shaders/`, with workgroups of 8 x 8, that does not read the scene.
    pub(crate) const fn new(name: &'static str) -> Self {
        Self { name, foreign_text: None, workgroup: [8, 8, 1], scene: SceneUse::No, constants: &[] }
    }

    /// A foreign kernel, whose shader is not part of the library, with workgroups of 8 x 8, that does not read the scene.
    /// `//!include` lines of its text bring in shared parts of the library's shaders. It runs with all run-time checks.
    pub const fn from_text(name: &'static str, text: &'static str) -> Self {
        Self { foreign_text: Some(text), ..Self::new(name) }
    }

    /// The text of a foreign kernel's shader before includes are expanded.
    pub fn foreign_text(&self) -> Option<&'static str> {
        self.foreign_text
    }

    /// A kernel like [`Self::new`] that reads the scene.
    pub(crate) const fn with_scene(name: &'static str) -> Self {
        Self::new(name).reading_scene()
    }

    /// The same kernel, which reads the scene.
    pub const fn reading_scene(self) -> Self {
        Self { scene: SceneUse::Read, ..self }
    }

    /// The same kernel with workgroups of this size, in invocations.
    pub const fn workgroup(self, workgroup: [u32; 3]) -> Self {
        Self { workgroup, ..self }
    }

    /// A kernel with workgroups of 64 x 1 that changes the scene.
    pub(crate) const fn changing_scene(name: &'static str) -> Self {
        Self { scene: SceneUse::Write, workgroup: [64, 1, 1], ..Self::new(name) }
    }

    /// The same kernel with these constants.
    pub(crate) const fn with(self, constants: &'static [Constant]) -> Self {
        Self { constants, ..self }
    }
}

/// What a pass does with an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    Read,
    /// Sets every texel of its rows.
    Write,
    /// Sets every texel of its rows, and reads what it has written itself.
    WriteThenRead,
    /// Changes some texels, in a way that has the same result when it is done twice.
    Update,
    /// Adds to every texel.
    Add,
}

impl Access {
    /// Whether it needs what earlier passes left.
    pub fn reads(self) -> bool {
        matches!(self, Self::Read | Self::Update | Self::Add)
    }

    pub fn writes(self) -> bool {
        self != Self::Read
    }
}

/// The rows of an image that a pass reads for its own rows.
#[derive(Clone, Copy, Debug)]
pub enum Reach {
    Own,
    /// Also this many rows above and below.
    Halo(u32),
    /// The blocks of `size` rows that its rows lie in; the first block begins `offset` rows above the image.
    Blocks {
        size: u32,
        offset: u32,
    },
    All,
    /// The rows that a function returns for given rows, both on the grid of the image that is read.
    Rows(fn(Range<u32>) -> Range<u32>),
}

impl Reach {
    /// The rows that are read for the rows `own` of an image with `height` rows.
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

    /// The number of rows above and below that are read, if it is a fixed one.
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
    /// Whether it is the image that the frame before left.
    pub is_before: bool,
    /// The eye whose image it is. Without it, it is the image of the pass's own view.
    pub eye: Option<Eye>,
    /// Whether it may be bound although no pass has written it; the shader then does not read it.
    pub is_optional: bool,
    /// Whether it is set to 0 before the pass. Of a list, only the counts are.
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

    /// Reads what the frame before left, with this many rows above and below. With none there is no such frame, and the
    /// image is bound but not read.
    pub fn before(self, rows: Option<u32>) -> Self {
        Self { is_before: true, is_optional: rows.is_none(), ..self.halo(rows.unwrap_or(0)) }
    }

    /// Takes the image of this eye, whatever the view of the pass is.
    pub fn of(self, eye: Eye) -> Self {
        Self { eye: Some(eye), ..self }
    }

    pub fn if_written(self) -> Self {
        Self { is_optional: true, ..self }
    }

    pub fn cleared(self) -> Self {
        Self { is_cleared: true, ..self }
    }

    /// Whether the graph must bring its rows to the device.
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
    /// One workgroup for each tile of this many columns and rows that there can be where tiles begin anywhere: the
    /// shader says where.
    Displaced([u32; 2]),
    /// As many workgroups as a list asks for.
    List(Resource),
    /// This many workgroups, once for each device.
    Once([u32; 3]),
}

impl Dispatch {
    pub const PIXELS: Self = Self::Invocations([1, 1]);
}

/// The quantity to which the time of a pass is proportional.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// The rays of its view, as the frame before counted them.
    Rays,
    /// The rows that it computes.
    Rows,
    /// Nothing. The time is the same on each device that has any rows.
    Once,
}

/// Whether a pass belongs to a chain, in which each pass reads rows around its own from what the pass before it wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chain {
    No,
    /// It does. The halo plan says whether rows are received before it, or each device computes a margin of what is
    /// read.
    Planned,
    /// It does, and each device computes a margin.
    Margin,
}

/// A pass on one view, or one that each device runs for itself.
#[derive(Clone, Debug)]
pub struct Pass {
    pub stage: Stage,
    /// [`Eye::Left`] where [`Self::scope`] is a device.
    pub view: Eye,
    pub scope: Scope,
    /// Which of the stage's repetitions it is, from 0.
    pub index: u32,
    pub kernel: Kernel,
    pub grid: Grid,
    /// The uses in the order of the bindings of group 1.
    pub uses: Vec<Use>,
    pub dispatch: Dispatch,
    /// The runs of the kernel, one after another.
    pub launches: Vec<Launch>,
    pub work: Work,
    pub cut_group: CutGroup,
    pub chain: Chain,
    /// The table of vertices from which each device builds its acceleration structures of what moves after the pass.
    pub builds_from: Option<Resource>,
}

impl Pass {
    /// A pass with one invocation per pixel of a view, and rows as its unit of cost.
    pub fn new(stage: Stage, view: Eye, cut_group: CutGroup, kernel: Kernel) -> Self {
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
            cut_group,
            chain: Chain::No,
            builds_from: None,
        }
    }

    /// A pass that every device runs for itself.
    pub fn once(stage: Stage, cut_group: CutGroup, kernel: Kernel, workgroups: [u32; 3]) -> Self {
        let (dispatch, scope) = (Dispatch::Once(workgroups), Scope::Device);
        Self { scope, dispatch, work: Work::Once, ..Self::new(stage, Eye::Left, cut_group, kernel) }
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

    /// Has each device build its acceleration structures of what moves after it, from these vertices that it writes.
    pub fn builds_from(self, vertices: Resource) -> Self {
        Self { builds_from: Some(vertices), ..self }
    }

    /// The eye whose image a binding takes.
    pub fn eye_of(&self, used: &Use) -> Eye {
        match used.image.resource.scope {
            Scope::View => used.eye.unwrap_or(self.view),
            Scope::Device => Eye::Left,
        }
    }

    /// The number of rows above and below its own that it reads of what passes of this frame wrote.
    pub fn halo_rows(&self) -> u32 {
        self.uses.iter().filter(|u| u.is_read() && !u.is_before).map(|u| u.reach.halo_rows()).max().unwrap_or(0)
    }
}
