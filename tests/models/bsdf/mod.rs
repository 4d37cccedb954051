//! Tests the reference's material model: densities, reciprocity, energy and smooth limits.

mod densities;
mod energy;
mod layers;
mod limits;

use glam::DVec3;

use crate::reference::bsdf::{Brushed, Bsdf, Coat, Interior};
use crate::reference::sheen::Sheen;

/// A white material without textures on the plane z = 0.
#[derive(Clone, Copy, Debug)]
struct Finish {
    roughness: f64,
    metallic: f64,
    specular: f64,
    ior: f64,
    transmission: f64,
    thick: bool,
    on_back: bool,
    /// Roughness of a full clearcoat.
    coat: Option<f64>,
    /// Fraction of diffuse transmission.
    through: f64,
    /// Roughness of a white sheen.
    sheen: Option<f64>,
    /// Strength of anisotropy along x.
    brushed: f64,
    dispersion: f64,
}

const MATTE: Finish = Finish {
    roughness: 1.0,
    metallic: 0.0,
    specular: 0.0,
    ior: 1.5,
    transmission: 0.0,
    thick: false,
    on_back: false,
    coat: None,
    through: 0.0,
    sheen: None,
    brushed: 0.0,
    dispersion: 0.0,
};

impl Finish {
    fn seen_from(self, to_viewer: DVec3) -> Bsdf {
        let normal = DVec3::Z * to_viewer.z.signum();
        let reflectance = if self.ior == 0.0 { 1.0 } else { ((self.ior - 1.0) / (self.ior + 1.0)).powi(2) };
        let index = if self.ior == 0.0 { 1.0 } else { self.ior };
        let across = self.roughness.powi(2);
        let along = across + (1.0 - across) * self.brushed.powi(2);
        Bsdf {
            to_viewer,
            normal,
            geometric_normal: normal,
            base: DVec3::ONE,
            metal_f0: DVec3::ONE,
            metallic: self.metallic,
            alpha: (along * across).sqrt(),
            brushed: (self.brushed > 0.0).then_some(Brushed { alpha: [along, across], along: DVec3::X }),
            f0: DVec3::splat(reflectance * self.specular),
            f90: self.specular,
            transmission: self.transmission,
            interior: if self.thick { Interior::Thick { index } } else { Interior::Thin },
            dispersion: self.dispersion,
            on_back: self.on_back,
            coat: self.coat.map(|roughness| Coat { strength: 1.0, alpha: roughness.powi(2), normal }),
            through: self.through,
            through_color: DVec3::ONE,
            sheen: self.sheen.map(|roughness| Sheen { color: DVec3::ONE, roughness }),
        }
    }

    /// Returns the material seen at that cosine, from an azimuth that is not along an axis.
    fn seen_at(self, mu: f64) -> Bsdf {
        let across = (1.0 - mu * mu).sqrt();
        self.seen_from(DVec3::new(0.8 * across, -0.6 * across, mu))
    }

    /// Returns the index of refraction for red light on the viewer's side over the one beyond.
    fn index_ratio(self) -> f64 {
        let index = if self.thick && self.ior > 1.0 { self.ior - self.dispersion } else { 1.0 };
        if self.on_back { index } else { 1.0 / index }
    }

    /// Returns the albedo for light from the viewer's direction: the mean weight over `n` points spread evenly in the
    /// cube (in two dimensions by the recurrence of Roberts 2018). The radiance of refracted light is not scaled.
    fn albedo(self, mu: f64, n: u32) -> f64 {
        let bsdf = self.seen_at(mu);
        let steps = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];
        let mut sum = 0.0;
        for i in 0..n {
            let [u, v] = steps.map(|step| (0.5 + step * f64::from(i)).fract());
            if let Some(scattered) = bsdf.sample([(f64::from(i) + 0.5) / f64::from(n), u, v]) {
                let beyond = self.thick && scattered.direction.z * bsdf.normal.z < 0.0;
                let unscaled = if beyond { self.index_ratio().powi(-2) } else { 1.0 };
                sum += scattered.weight.x * unscaled;
            }
        }
        sum / f64::from(n)
    }
}
