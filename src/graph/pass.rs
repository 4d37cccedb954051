//! The declaration of a pass: its shader, what it reads and writes, and where it runs. All else follows from it: bind
//! groups and their order, images, transfers, what is kept between frames, units of cost, names in reports.

use std::ops::Range;

use super::resource::{Grid, Image, Resource, Scope};
use crate::scene::rig::Eye;
use crate::wgsl::Constant;

/// A kind of pass: all iterations of a filter, on both views, are one stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[serde(transparent)]
pub struct Stage(pub &'static str);

impl Stage {
    /// In reports, traces and on the command line.
    pub fn name(self) -> &'static str {
        self.0
    }
}

/// Passes that have the same stripes, by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CutGroup(pub &'static str);

/// A compute shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Kernel {
    /// Of its file in `shaders/`, without the extension.
    pub name: &'static str,
    /// Its text, includes not put in; none: that of the file.
    pub text: Option<&'static str>,
    /// Invocations of a workgroup.
    pub workgroup: [u32; 3],
    /// Whether it reads the scene.
    pub reads_scene: bool,
    /// What it knows of its pass, by the names that it has in the shader.
    pub constants: &'static [Constant],
}

impl Kernel {
    /// A file of `shaders/` with workgroups of 8 x 8 that does not read the scene.
    pub const fn new(name: &'static str) -> Self {
        Self { name, text: None, workgroup: [8, 8, 1], reads_scene: false, constants: &[] }
    }

    /// ... and reads the scene.
    pub const fn with_scene(name: &'static str) -> Self {
        Self { reads_scene: true, ..Self::new(name) }
    }

    /// ... and has these constants.
    pub const fn with(self, constants: &'static [Constant]) -> Self {
        Self { constants, ..self }
    }
}

/// What a pass does with an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    Read,
    /// Sets every texel of its rows.
    Write,
    /// ... and reads what it has itself written.
    WriteThenRead,
    /// Changes some texels, or in a way that does not show when it is done twice.
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

/// Which rows of an image a pass reads for rows of its own, beside those on the same place.
#[derive(Clone, Copy, Debug)]
pub enum Reach {
    Own,
    /// So many rows above and below.
    Halo(u32),
    /// The blocks of `size` rows that its rows lie in; the first block begins `offset` rows above the image.
    Blocks {
        size: u32,
        offset: u32,
    },
    All,
    /// What a function says of rows, both of the image that is read.
    Rows(fn(Range<u32>) -> Range<u32>),
}

impl Reach {
    /// Rows of an image `height` rows high that are read for its rows `own`.
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

    /// Rows above and below that are read, where that is a number.
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
    /// Whether it is what the frame before left.
    pub is_before: bool,
    /// Whose image it is; none: that of the pass's own view.
    pub eye: Option<Eye>,
    /// Whether it is bound and not read where no pass has written it.
    pub is_optional: bool,
    /// Set to 0 before the pass; of a list, its counts.
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

    /// Reads so many rows above and below.
    pub fn halo(self, rows: u32) -> Self {
        self.reaching(Reach::Halo(rows))
    }

    pub fn reaching(self, reach: Reach) -> Self {
        Self { reach, ..self }
    }

    /// What the frame before left, within so many rows; none: there is no such frame, and it is not read.
    pub fn before(self, rows: Option<u32>) -> Self {
        Self { is_before: true, is_optional: rows.is_none(), ..self.halo(rows.unwrap_or(0)) }
    }

    /// Of this eye, whatever view the pass is of.
    pub fn of(self, eye: Eye) -> Self {
        Self { eye: Some(eye), ..self }
    }

    pub fn if_written(self) -> Self {
        Self { is_optional: true, ..self }
    }

    pub fn cleared(self) -> Self {
        Self { is_cleared: true, ..self }
    }

    /// Whether the graph must bring it.
    pub fn is_read(&self) -> bool {
        self.access.reads() && self.image.resource.life != super::Life::Input
    }
}

/// How many invocations or workgroups run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dispatch {
    /// One invocation for each tile of so many columns and rows.
    Invocations([u32; 2]),
    /// One workgroup for each tile.
    Workgroups([u32; 2]),
    /// As many workgroups as a list asks for.
    List(Resource),
    /// So many workgroups, once for each device.
    Once([u32; 3]),
}

impl Dispatch {
    pub const PIXELS: Self = Self::Invocations([1, 1]);
}

/// A run of a kernel over a pass's rows, with the arguments that it gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Launch {
    Once([u32; 3]),
    /// For each batch of at most `most` samples of a pixel: the first, the last + 1, and `third`.
    Samples {
        most: u32,
        third: u32,
        /// Not in frames whose only sample is at the pixel's centre.
        only_jittered: bool,
    },
}

/// What the time of a pass is in proportion to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// Rays of its view, as the frame before counted them.
    Rays,
    /// Rows.
    Rows,
    /// Nothing: it is the same for each device that has any rows.
    Once,
}

/// Whether a pass belongs to those of which each reads rows around its own of what the one before it wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chain {
    No,
    /// It does; the halo plan says whether rows are received before it, or each device computes a margin of what is read.
    Planned,
    /// It does; each device computes a margin.
    Margin,
}

/// A pass on one view, or of a device.
#[derive(Clone, Debug)]
pub struct Pass {
    pub stage: Stage,
    /// [`Eye::Left`] where [`Self::scope`] is a device.
    pub view: Eye,
    pub scope: Scope,
    /// Which of a stage's repetitions, from 0.
    pub index: u32,
    pub kernel: Kernel,
    pub grid: Grid,
    /// In the order of the bindings of group 1.
    pub uses: Vec<Use>,
    pub dispatch: Dispatch,
    /// One after another.
    pub launches: Vec<Launch>,
    pub work: Work,
    pub cut_group: CutGroup,
    pub chain: Chain,
}

impl Pass {
    /// One invocation per pixel of a view, and rows as the unit of cost.
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

    /// Whose image a binding takes.
    pub fn eye_of(&self, used: &Use) -> Eye {
        match used.image.resource.scope {
            Scope::View => used.eye.unwrap_or(self.view),
            Scope::Device => Eye::Left,
        }
    }

    /// Rows above and below its own that it reads of what this frame's passes wrote.
    pub fn halo_rows(&self) -> u32 {
        self.uses.iter().filter(|u| u.is_read() && !u.is_before).map(|u| u.reach.halo_rows()).max().unwrap_or(0)
    }
}
