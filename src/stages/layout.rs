//! What shaders and host share, byte for byte: the text of every shader begins with [`declarations`].

mod tables;

use std::ops::Range;

use glam::{UVec3, Vec2, Vec3, Vec4};

pub use self::tables::*;
use self::tables::{ROLES, TABLES};
use crate::accel::{self, SPHERE, TRIANGLE_ALPHA};
use crate::graph::LIST_HEADER;
use crate::passes::SKIPPED;
use crate::scene::rig;
use crate::wgsl::{Declaration, Table, constants, declare, shared_constants, shared_structs};

shared_structs! {
    /// An eye: a pinhole, and where it looks if its image is polar. Its axes are of unit length.
    pub struct View {
        /// Relative to the origin of the scene's tables, scene units.
        pub origin: Vec3,
        /// Tangent of half the horizontal field of view.
        pub tan_half_x: f32,
        pub right: Vec3,
        /// Tangent of half the vertical field of view.
        pub tan_half_y: f32,
        pub up: Vec3,
        /// Of a polar image: rows, and how many of them are of the fovea, or the square of pixels around the gaze; 0: it
        /// has none.
        pub rows: f32,
        pub forward: Vec3,
        pub fovea_rows: f32,
        /// Where it looks, and the direction from there in which columns begin.
        pub gaze: Vec3,
        /// ... and where that is on the screen, pixels; of log-polar images.
        pub gaze_x: f32,
        pub gaze_right: Vec3,
        pub gaze_y: f32,
    }

    /// How rings of log-polar images grow. All is 0 where there are none.
    pub struct LogPolar {
        /// Of an eye's screen, pixels.
        pub screen: Vec2,
        /// The logarithm of its diagonal.
        pub log_diagonal: f32,
        /// Exponent by which rings are moved away from the gaze.
        pub kernel: f32,
        /// Up to the diagonal, those included that the image around the gaze replaces; and how many it does.
        pub rings: f32,
        pub first_ring: f32,
        /// Of the image around the gaze, pixels.
        pub radius: f32,
        /// Of a ring.
        pub columns: f32,
        /// Distances from the gaze, pixels: from where on there is a blur, and where it is strongest.
        pub blur_begins: f32,
        pub blur_full: f32,
        pub pad0: u32,
        pub pad1: u32,
    }

    /// Where the rectified image of an eye has what the eye shows at a point (x, y) of its own image, in pixels: at (a, b) / c
    /// for (a, b, c) = x · `across` + y · `down` + `corner`, if it is seen from where the image is rendered. From a later
    /// place, what is t away along the eye's axis is where t · (a, b, c) + `moved` says. All is 0 where images are shown as
    /// they are rendered.
    pub struct Shown {
        pub across: Vec3,
        pub pad0: u32,
        pub down: Vec3,
        pub pad1: u32,
        pub corner: Vec3,
        pub pad2: u32,
        pub moved: Vec3,
        pub pad3: u32,
    }

    /// What is seen, on how many pixels.
    pub struct Camera {
        /// Of the left and the right eye.
        pub views: [View; 2],
        /// Where in a pixel rays go that stand for all of it.
        pub centre: Vec2,
        /// Of the images that are traced, pixels.
        pub width: u32,
        pub height: u32,
        pub log_polar: LogPolar,
        /// Of the left and the right eye.
        pub shown: [Shown; 2],
    }

    /// Which random numbers a frame draws, of which pixels and for how long paths.
    pub struct Sampling {
        /// Number of the frame.
        pub index: u32,
        pub seed: u32,
        /// Samples per pixel.
        pub spp: u32,
        /// Number of the frame's first sample: passes of one accumulation continue one another's sequences.
        pub sample_base: u32,
        /// Bits of a sample's number below its pixel's place on the Z curve; [`NO_CURVE`]: each pixel has sequences of
        /// its own.
        pub curve_shift: u32,
        /// Surfaces that a path is reflected by, at most.
        pub reflections: u32,
        /// Upper bound of indirect radiance; 0: none.
        pub indirect_clamp: f32,
        /// Of all pixels, before foveation leaves out more.
        pub sampled_share: f32,
        /// Added to every pixel's threshold of being sampled; 2^32 is a whole turn.
        pub mask_turn: u32,
        /// 1 if samples are spread over their pixels, 0 if the only one goes through [`Camera::centre`].
        pub is_jittered: u32,
        pub pad0: u32,
        pub pad1: u32,
    }

    /// Where shaders find the lights.
    pub struct Lights {
        /// In the tables: first row of the tree of spheres, and the row after its last.
        pub sphere_tree: u32,
        pub sphere_tree_end: u32,
        /// In the tables: row of the light tree's root.
        pub tree: u32,
        /// How many of the groups local, directional and environment have any.
        pub group_count: u32,
        /// In `lights`: those that the light tree picks from; directional ones stand behind them.
        pub local_count: u32,
        pub directional_count: u32,
        /// Share of all light that has become more or less since the frame before.
        pub change: f32,
        pub pad0: u32,
    }

    /// Light from infinitely far.
    pub struct Environment {
        /// Where there is no image.
        pub radiance: Vec3,
        /// Of the image, in whole turns.
        pub rotation: f32,
        /// Of the image, pixels; 0: there is none.
        pub width: u32,
        pub height: u32,
        /// Of the grid that directions are drawn from, cells.
        pub grid_width: u32,
        pub grid_height: u32,
    }

    /// Where the scene is and shaders find its instances.
    pub struct Geometry {
        /// Where (0, 0, 0) of the tables is in the world, scene units.
        pub world_origin: Vec3,
        /// In the tables: the root of the tree over all instances but the first.
        pub instance_tree: u32,
        /// In the tables: the instances' first row.
        pub instances: u32,
        pub instance_count: u32,
        /// In the tables: the first of the rows that lead from triangles' numbers to instances.
        pub instance_numbers: u32,
        /// Of the triangles, the first of bodies that deform, and how many these are.
        pub first_deforming: u32,
        pub deforming_count: u32,
        pub pad0: u32,
        pub pad1: u32,
        pub pad2: u32,
    }

    /// Layers around the gaze.
    pub struct Foveation {
        /// Of the left eye in x and y, of the right eye in z and w; pixels.
        pub gaze: Vec4,
        /// Filter iterations that pixels of the inner, middle and outer layer take part in; the first number is that of
        /// all pixels where there are no layers.
        pub layer_iterations: UVec3,
        /// Of the outer layer's pixels that would be sampled without foveation.
        pub unsampled_share: f32,
        /// Where the inner and the middle layer end, pixels.
        pub radii: Vec2,
        pub pad0: u32,
        pub pad1: u32,
    }

    /// What is known of the frame before.
    pub struct History {
        /// How many rows up and down it may have moved; [`NO_HISTORY`]: nothing is known.
        pub rows: u32,
        /// Rows of which nothing is known: the first, and the one after the last.
        pub lost_begin: u32,
        pub lost_end: u32,
        pub pad0: u32,
    }

    /// How light becomes what a display shows.
    pub struct Display {
        /// What radiance is multiplied by, so that white is 1.
        pub exposure: f32,
        pub pad0: u32,
        pub pad1: u32,
        pub pad2: u32,
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

    /// Constants of the frame before.
    pub struct Previous {
        pub views: [View; 2],
        pub sampling: Sampling,
    }

    /// Constants of a dispatch.
    pub struct PassConstants {
        pub view: u32,
        /// The rows to compute: the first, and the one after the last.
        pub row_begin: u32,
        pub row_end: u32,
        /// Rows that may be read: the stripe plus what was received or recomputed around it.
        pub valid_begin: u32,
        pub valid_end: u32,
        /// What these mean is the pass's own business.
        pub args: [u32; 3],
        /// Columns and rows of the pass's grid.
        pub width: u32,
        pub height: u32,
        /// Number of the device.
        pub device: u32,
    }
}

impl View {
    pub fn new(view: &rig::View, aspect: f64) -> Self {
        Self {
            origin: view.origin,
            tan_half_x: (f64::from(view.tan_half_yfov) * aspect) as f32,
            right: view.right,
            tan_half_y: view.tan_half_yfov,
            up: view.up,
            forward: view.forward,
            ..Self::default()
        }
    }
}

impl From<&Frame> for Previous {
    fn from(frame: &Frame) -> Self {
        Self { views: frame.camera.views, sampling: frame.sampling }
    }
}

impl History {
    /// That reaches so many rows up and down, or none, without those rows that are lost.
    pub fn new(rows: Option<u32>, lost: Range<u32>) -> Self {
        Self { rows: rows.unwrap_or(NO_HISTORY), lost_begin: lost.start, lost_end: lost.end, ..Self::default() }
    }
}

shared_constants! {
    /// Of [`Sampling::curve_shift`]: each pixel has sequences of its own.
    pub const NO_CURVE: u32 = 32;
    /// Of [`History::rows`]: the frame knows nothing of the one before.
    pub const NO_HISTORY: u32 = u32::MAX;
}

/// All structs that shaders have.
pub fn all_structs() -> Vec<Declaration> {
    [accel::structs(), accel::skin_structs(), tables::structs(), structs()].concat()
}

/// The functions that read entries of the scene's tables.
pub fn readers() -> String {
    let structs = all_structs();
    let reader = |table: &Table| {
        let entry = structs.iter().find(|s| s.name == table.entry).expect("tables are of shared structs");
        entry.reader(table)
    };
    TABLES.iter().map(reader).collect()
}

/// What every shader's text begins with: structs and constants.
pub fn declarations() -> String {
    let structs: String = all_structs().iter().map(ToString::to_string).collect();
    let of_others = constants![SKIPPED, LIST_HEADER, SPHERE, TRIANGLE_ALPHA];
    let constants = [CONSTANTS, accel::SKIN_CONSTANTS, tables::CONSTANTS, ROLES, of_others].concat();
    structs + &declare(&constants) + &format!("const SMOOTH: f32 = {SMOOTH:?}f;\n")
}
