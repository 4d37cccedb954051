//! The declaration of a pass: its shader, its bindings, and where it runs. Everything else is derived from it: bind
//! groups and their order, images, transfers, history, units of cost, and names in reports.

use super::resource::{Grid, Life, Resource, Scope};
use super::uses::Use;
use crate::samples::Launch;
use crate::scene::rig::Eye;
use crate::wgsl::{Arguments, Constant, Words};

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
    /// Names and WGSL types of the arguments that passes give it.
    pub(crate) arguments: &'static [(&'static str, &'static str)],
}

impl Kernel {
    /// Makes a kernel from a file in `shaders/`. It has workgroups of 8 x 8 and does not read the scene.
    pub(crate) const fn new(name: &'static str) -> Self {
        Self { name, foreign_text: None, workgroup: [8, 8, 1], scene: SceneUse::No, constants: &[], arguments: &[] }
    }

    /// Makes a kernel from a shader outside the library. It has workgroups of 8 x 8 and does not read the scene.
    /// `//!include` lines in its text include shared parts of the library's shaders, with all parts that these use. The
    /// shader is compiled with all run-time checks, such as bounds checks.
    pub const fn from_text(name: &'static str, text: &'static str) -> Self {
        Self { foreign_text: Some(text), ..Self::new(name) }
    }

    /// Returns the text of a foreign kernel's shader before includes are expanded.
    pub fn foreign_text(&self) -> Option<&'static str> {
        self.foreign_text
    }

    /// Makes a kernel that traces rays. Its workgroups have 8 x 4 invocations: drivers for AMD run workgroups of up to 32
    /// invocations in waves of 32 lanes, in which rays diverge less than in 64, and which may use more registers.
    pub(crate) const fn tracing_rays(name: &'static str) -> Self {
        Self::new(name).reading_scene().workgroup([8, 4, 1])
    }

    /// Returns this kernel with read access to the scene.
    pub const fn reading_scene(self) -> Self {
        Self { scene: SceneUse::Read, ..self }
    }

    /// Returns this kernel with workgroups of this size, in invocations.
    pub const fn workgroup(self, workgroup: [u32; 3]) -> Self {
        Self { workgroup, ..self }
    }

    /// Makes a kernel with workgroups of 64 x 1 that writes rows of the scene tables.
    pub(crate) const fn changing_scene(name: &'static str) -> Self {
        Self { scene: SceneUse::Write, workgroup: [64, 1, 1], ..Self::new(name) }
    }

    /// Returns this kernel with these constants.
    pub(crate) const fn with(self, constants: &'static [Constant]) -> Self {
        Self { constants, ..self }
    }
}

/// The number of invocations or workgroups that run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dispatch {
    /// One invocation for each tile of this many columns and rows.
    Invocations([u32; 2]),
    /// One workgroup for each tile of this many columns and rows.
    Workgroups([u32; 2]),
    /// One workgroup for each tile that the device's rows can overlap, for any origin that the shader gives the grid of
    /// tiles. A tile has this many columns and rows.
    Displaced([u32; 2]),
    /// Indirect dispatch with the workgroup counts in the header of this list.
    List(Resource),
    /// This many workgroups along x, y and z, once per device.
    Once([u32; 3]),
}

impl Dispatch {
    pub const PIXELS: Self = Self::Invocations([1, 1]);
}

/// The quantity to which the time of a pass is proportional.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// The number of rays of the pass's view, as counted in the previous frame.
    Rays,
    /// The number of rows that the pass computes.
    Rows,
    /// No quantity: the pass takes a constant time on a device, however many rows the device computes.
    Once,
}

/// Role of a pass in a filter chain. Each pass of a chain reads the rows of the previous pass's output that lie in its
/// own stripe, and a halo of rows above and below.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chain {
    No,
    /// The pass is in a chain. The halo plan decides whether a device receives the halo from its neighbours or computes
    /// it as a margin.
    Planned,
    /// The pass is in a chain, and each device always computes the halo as a margin.
    Margin,
}

/// A pass on one view, divided into stripes, or a pass that every device runs in full.
#[derive(Clone, Debug)]
pub struct Pass {
    pub stage: Stage,
    /// The view; if [`Self::scope`] is [`Scope::Device`], the main view of the frame.
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
            grid: Grid::Frame,
            uses: Vec::new(),
            dispatch: Dispatch::PIXELS,
            launches: vec![Launch::Once(Words::default())],
            work: Work::Rows,
            partition,
            chain: Chain::No,
            builds_from: None,
        }
    }

    /// Makes a pass that every device runs in full, with this number of workgroups along x, y and z.
    pub fn once(stage: Stage, partition: Partition, kernel: Kernel, workgroups: [u32; 3]) -> Self {
        let (dispatch, scope) = (Dispatch::Once(workgroups), Scope::Device);
        Self { scope, dispatch, work: Work::Once, ..Self::new(stage, Eye::LEFT, partition, kernel) }
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

    /// Sets the arguments of the kernel as words without names, which its shader reads as an array.
    pub fn args(mut self, args: [u32; 3]) -> Self {
        self.kernel.arguments = &[];
        Self { launches: vec![Launch::Once(Words(args))], ..self }
    }

    /// Runs the kernel once with each of these arguments, one after another.
    pub fn with<A: Arguments>(self, all: impl IntoIterator<Item = A>) -> Self {
        let launches = all.into_iter().map(|arguments| Launch::Once(arguments.words())).collect();
        self.launches(launches).taking::<A>()
    }

    /// Sets the launches of the kernel, one after another.
    pub fn launches(self, launches: Vec<Launch>) -> Self {
        Self { launches, ..self }
    }

    /// Gives the kernel's arguments the names and types of `A`.
    pub fn taking<A: Arguments>(mut self) -> Self {
        self.kernel.arguments = A::MEMBERS;
        self
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

    /// Returns the eye whose image a binding uses: the main one for what all views share, except constants of the pass's
    /// view.
    pub fn eye_of(&self, used: &Use) -> Eye {
        let Resource { scope, life, .. } = used.image.resource;
        match scope {
            Scope::View => used.eye.unwrap_or(self.view),
            Scope::Device if life == Life::Input => self.view,
            Scope::Device => self.view.main(),
        }
    }

    /// Returns true if the pass binds images of its view's partner. The first camera of its constants is then the
    /// partner's instead of the source's.
    pub fn sees_partner(&self) -> bool {
        let mut others = self.uses.iter().filter_map(|used| used.eye).filter(|eye| *eye != self.view.source());
        others.any(|eye| Some(eye) == self.view.partner())
    }

    /// Returns the maximum number of rows above and below its own that the pass reads from an image of this frame.
    pub fn halo_rows(&self) -> u32 {
        self.uses.iter().filter(|u| u.is_read() && !u.is_before).map(|u| u.reach.halo_rows()).max().unwrap_or(0)
    }
}
