//! Inputs of a frame, from which it is planned and the orders to the devices are made.

use std::sync::Arc;

use super::late_latching::Late;
use super::output::Output;
use super::watch::Watch;
use crate::accel::Moved;
use crate::frame::RunConfig;
use crate::frame::search_range::history_rows;
use crate::layout;
use crate::quality::Quality;
use crate::schedule::RelativeCost;
use crate::stages::Place;
use crate::tables::{SceneTables, SceneUpdate};

/// Inputs of a frame. They are kept so that it can be rendered again after a device failure.
#[derive(Clone)]
pub struct Inputs {
    pub constants: layout::Frame,
    pub quality: Quality,
    /// Cost of the frame's stages relative to other qualities.
    pub relative_cost: RelativeCost,
    /// Constants of the previous frame.
    pub previous: layout::Previous,
    /// Each view of this and of the previous frame.
    pub views: Vec<[layout::View; 2]>,
    /// Changes to the scene tables.
    pub update: SceneUpdate,
    /// Bounds of each moving body, relative to the tables' origin, and its maximum displacement since the previous
    /// frame, in scene units.
    pub moved: Vec<Moved>,
    pub place: Place,
    /// Images that the primary returns with its answer, in addition to the row tallies.
    pub reads: Arc<[Output]>,
    /// Images to gather on the primary; `None` gathers all outputs.
    pub outputs: Option<Arc<[Output]>>,
    /// Source of the late-latched pose; `None` uses the pose in the constants.
    pub late: Option<Late>,
    /// `None` if nothing watches the frame.
    pub watch: Option<Arc<Watch>>,
}

impl Inputs {
    /// Returns the number of samples in the images of all views.
    pub(super) fn samples(&self) -> u64 {
        let layout::Frame { camera, sampling, .. } = self.constants;
        self.views.len() as u64
            * u64::from(camera.width)
            * u64::from(camera.height)
            * u64::from(sampling.samples.most())
    }

    /// Returns the number of pixels of each view's traced image.
    pub(super) fn pixels(&self, config: &RunConfig) -> Vec<u64> {
        self.views.iter().map(|[now, _]| config.pixels(now)).collect()
    }

    /// Returns the search range of the frame's temporal reprojection, in rows above and below. Returns `None` if the
    /// frame uses no history.
    pub(super) fn history_rows(&self, config: &RunConfig, tables: &SceneTables) -> Option<u32> {
        let Self { constants, previous, moved, .. } = self;
        let polar = config.envelope.most.polar;
        let rows = || history_rows(polar, &constants.camera, &previous.views, tables, moved);
        config.keeps_history().then(rows).flatten()
    }
}
