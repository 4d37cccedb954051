//! The quality of frames that settings ask for.

use super::{Foveation, FoveationMode, Settings};
use crate::projection::PolarSpace;
use crate::quality::{Denoiser, Filter, Quality};

/// Iterations of the inner, middle and outer layer in the three-layer configuration of Peres, section 6.
const LAYER_ITERATIONS: [u32; 3] = [2, 3, 5];

impl Settings {
    /// Returns the quality of every frame. Values without effect at the others yield to them.
    pub fn quality(&self) -> Quality {
        let filter = self.filter();
        let scale = if filter.is_some() { self.render_scale } else { 1.0 };
        Quality {
            spp: self.spp,
            bounces: self.bounces,
            filter,
            fovea: self.layer_radii(),
            polar: self.polar_space(),
            scale,
        }
    }

    /// Returns the filter; `None` if all layers have 0 iterations. The denoiser limits their number.
    pub(super) fn filter(&self) -> Option<Filter> {
        let most = self.denoiser.map_or(0, Denoiser::most_iterations);
        let iterations = self.layer_iterations(self.layer_radii().is_some());
        Filter::in_effect(self.denoiser, iterations.unwrap_or([Denoiser::DEFAULT_ITERATIONS; 3]).map(|n| n.min(most)))
    }

    /// Returns the radii of the inner and the middle foveal layer; `None` without layers.
    pub fn layer_radii(&self) -> Option<[f64; 2]> {
        (self.foveation == FoveationMode::Layers).then_some(Foveation::RADII)
    }

    /// Returns the polar space that replaces the screen's pixel grid, if any.
    pub fn polar_space(&self) -> Option<PolarSpace> {
        match (self.foveation, self.polar) {
            (FoveationMode::None | FoveationMode::Layers, _) => None,
            (FoveationMode::Polar(PolarSpace::Log(_)), Some(map)) => Some(PolarSpace::Log(map)),
            (FoveationMode::Polar(space), _) => Some(space),
        }
    }

    /// Returns the iterations of the inner, middle and outer layer, those of Peres by default. Without layers, the largest
    /// number applies to the whole image, if one is set.
    fn layer_iterations(&self, has_layers: bool) -> Option<[u32; 3]> {
        match self.iterations {
            layers if has_layers => Some(layers.unwrap_or(LAYER_ITERATIONS)),
            all => all.map(|[inner, middle, outer]| [inner.max(middle).max(outer); 3]),
        }
    }

    /// Caps the iterations of a quality at those of the settings.
    pub fn limit(&self, quality: &Quality) -> Quality {
        let Some(limits) = self.layer_iterations(quality.fovea.is_some()) else { return *quality };
        let iterations = limits.map(|limit| limit.min(quality.most_iterations()));
        Quality { filter: Filter::in_effect(quality.denoiser(), iterations), ..*quality }
    }
}
