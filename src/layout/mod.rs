//! Structs and constants that shaders and host share, byte for byte. Every shader's source begins with
//! [`declarations`].

mod tables;

use std::ops::Range;

use glam::{UVec3, Vec2, Vec3, Vec4};

pub use self::tables::*;
use self::tables::{ROLES, TABLES};
use crate::accel::{self, SPHERE, TRIANGLE_ALPHA};
use crate::graph::{LIST_GROUP, LIST_HEADER};
use crate::image::tone::{TONE_ACES, TONE_AGX, TONE_NEUTRAL, TONE_NONE};
use crate::passes::SKIPPED;
use crate::plan::commands;
pub use crate::plan::commands::PassConstants;
use crate::projection;
pub use crate::projection::View;
use crate::samples;
use crate::samples::PixelSamples;
use crate::wgsl::{Declaration, Table, constants, declare, shared_constants, shared_structs};

shared_structs! {
    /// Projective map from an eye's displayed image to its rectified image, both in pixels. The point (x, y) maps to
    /// (a, b) / c, where (a, b, c) = x · `across` + y · `down` + `corner`, if the eye has not moved since the image was
    /// rendered. Late reprojection to a later pose replaces (a, b, c) by t · (a, b, c) + `moved`, where t is the depth
    /// of the displayed surface along the later eye's axis. All members are 0 if images are displayed as rendered.
    pub struct DisplayMap {
        pub across: Vec3,
        pub pad0: u32,
        pub down: Vec3,
        pub pad1: u32,
        pub corner: Vec3,
        pub pad2: u32,
        pub moved: Vec3,
        pub pad3: u32,
    }

    /// Views of both eyes, and size of their images.
    pub struct Camera {
        /// Views of the left and the right eye.
        pub views: [View; 2],
        /// Sub-pixel position, 0 to 1, of the rays that represent the whole pixel.
        pub centre: Vec2,
        /// Size of the traced images, pixels.
        pub width: u32,
        pub height: u32,
        /// Display resampling of the left and the right eye.
        pub display_maps: [DisplayMap; 2],
    }

    /// Sampling of a frame: random sequences, sampling mask and length of paths.
    pub struct Sampling {
        /// Number of the frame.
        pub index: u32,
        pub seed: u32,
        /// Maximum number of reflections of a path.
        pub reflections: u32,
        /// Clamp of indirect radiance; 0 disables it.
        pub indirect_clamp: f32,
        /// Fraction of all pixels that is sampled, before foveation leaves out more.
        pub sampled_fraction: f32,
        /// Value added to the sampling threshold of every pixel, modulo 2^32. It changes the mask from frame to frame.
        pub mask_turn: u32,
        pub pad0: u32,
        pub pad1: u32,
        pub samples: PixelSamples,
    }

    /// Positions of the lights in the tables, and their counts.
    pub struct Lights {
        /// Rows of the sphere tree in the tables: the first, and the one after the last.
        pub sphere_tree: u32,
        pub sphere_tree_end: u32,
        /// Row of the light tree's root in the tables.
        pub tree: u32,
        /// Number of nonempty groups among local lights, directional lights and the environment image.
        pub group_count: u32,
        /// Number of lights in the light tree. Directional lights follow them in `lights`.
        pub local_count: u32,
        pub directional_count: u32,
        /// Fraction of all light that changed since the previous frame.
        pub change: f32,
        /// Index of the first of the local lights with hard shadows, which follow one another, and their number.
        pub first_hard: u32,
        pub hard_count: u32,
        /// 1 if there are directional lights and all have hard shadows, otherwise 0.
        pub has_hard_suns: u32,
        pub pad0: u32,
        pub pad1: u32,
    }

    /// Environment lighting.
    pub struct Environment {
        /// Radiance of an environment without an image.
        pub radiance: Vec3,
        /// Rotation of the image, turns.
        pub rotation: f32,
        /// Size of the image, pixels; 0 without one.
        pub width: u32,
        pub height: u32,
        /// Size of the grid that directions are sampled from, cells.
        pub grid_width: u32,
        pub grid_height: u32,
    }

    /// World origin of the scene's tables, and the positions of instances and deforming bodies in the tables.
    pub struct Geometry {
        /// World position of the tables' (0, 0, 0), scene units.
        pub world_origin: Vec3,
        /// Index, among all nodes, of the root of the tree over all instances but the first. The first instance holds
        /// the flattened static triangles.
        pub instance_tree: u32,
        /// First row of the instances in the tables.
        pub instances: u32,
        pub instance_count: u32,
        /// First row, in the tables, of the map from triangle numbers to instances.
        pub instance_numbers: u32,
        /// Index in the triangle table of the deforming bodies' first triangle, and the number of their triangles.
        pub first_deforming: u32,
        pub deforming_count: u32,
        pub pad0: u32,
        pub pad1: u32,
        pub pad2: u32,
    }

    /// Foveal layers around the gaze.
    pub struct Foveation {
        /// Gaze of the left eye in x and y, of the right eye in z and w; pixels.
        pub gaze: Vec4,
        /// Filter iterations that pixels of the inner, middle and outer layer take part in. Without layers, the first
        /// number applies to all pixels.
        pub layer_iterations: UVec3,
        /// Fraction of the outer layer's pixels that foveation leaves unsampled, out of those that would be sampled
        /// without it.
        pub unsampled_fraction: f32,
        /// Radii at which the inner and the middle layer end, pixels.
        pub radii: Vec2,
        pub pad0: u32,
        pub pad1: u32,
    }

    /// Availability of the previous frame's history.
    pub struct History {
        /// Maximum vertical motion since the previous frame, rows; [`NO_HISTORY`] if there is no history.
        pub rows: u32,
        /// Rows whose history was lost with a failed device: the first, and the one after the last.
        pub lost_begin: u32,
        pub lost_end: u32,
        pub pad0: u32,
    }

    /// Mapping of radiance to display values.
    pub struct Display {
        /// Exposure factor: multiplies radiance so that white maps to 1.
        pub exposure: f32,
        /// Number of the [`ToneCurve`](crate::image::tone::ToneCurve).
        pub tone: u32,
        /// Factor from radiance to the light that images store between path tracing and compose, the power of two that is
        /// nearest to the exposure of the run. TAA weighs noise by it. It is the same in all frames of a run, since each
        /// frame reads the history of the one before.
        pub storage_scale: f32,
        pub pad0: u32,
    }

    /// Constants of a frame.
    pub struct Frame {
        pub camera: Camera,
        pub sampling: Sampling,
        pub lights: Lights,
        pub environment: Environment,
        pub geometry: Geometry,
        pub tables: Tables,
        pub foveation: Foveation,
        pub history: History,
        pub display: Display,
    }

    /// Constants of the previous frame.
    pub struct Previous {
        pub views: [View; 2],
        pub sampling: Sampling,
    }
}

impl From<&Frame> for Previous {
    fn from(frame: &Frame) -> Self {
        Self { views: frame.camera.views, sampling: frame.sampling }
    }
}

impl History {
    /// Describes a history for surfaces that moved by at most `rows` rows since the previous frame. `None` means no
    /// history. The rows `lost` of the history are missing.
    pub fn new(rows: Option<u32>, lost: Range<u32>) -> Self {
        Self { rows: rows.unwrap_or(NO_HISTORY), lost_begin: lost.start, lost_end: lost.end, ..Self::default() }
    }
}

shared_constants! {
    /// Value of [`History::rows`] of a frame without history.
    pub const NO_HISTORY: u32 = u32::MAX;
}

/// Returns all structs shared with shaders.
pub fn all_structs() -> Vec<Declaration> {
    [
        accel::structs(),
        accel::skin_structs(),
        projection::structs(),
        samples::structs(),
        tables::structs(),
        commands::structs(),
        structs(),
    ]
    .concat()
}

/// Returns the WGSL functions that read entries of the scene's tables.
pub fn readers() -> String {
    let structs = all_structs();
    let reader = |table: &Table| {
        let entry = structs.iter().find(|s| s.name == table.entry).expect("entries of tables are shared structs");
        entry.reader(table)
    };
    TABLES.iter().map(reader).collect()
}

/// Returns the structs and constants that every shader's text begins with.
pub fn declarations() -> String {
    let structs: String = all_structs().iter().map(ToString::to_string).collect();
    let of_lists = constants![LIST_HEADER, LIST_GROUP];
    let of_others = constants![SKIPPED, SPHERE, TRIANGLE_ALPHA, TONE_NEUTRAL, TONE_AGX, TONE_ACES, TONE_NONE];
    let constants =
        [CONSTANTS, samples::CONSTANTS, accel::SKIN_CONSTANTS, tables::CONSTANTS, ROLES, of_lists, of_others].concat();
    let floats = [("SMOOTH", SMOOTH), ("LEAST_SHEEN_ROUGHNESS", LEAST_SHEEN_ROUGHNESS)];
    let floats: String = floats.iter().map(|(name, value)| format!("const {name}: f32 = {value:?}f;\n")).collect();
    structs + &declare(&constants) + &floats
}
