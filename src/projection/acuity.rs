//! Visual acuity by eccentricity (Koskela et al. 2019, "Foveated Real-Time Path Tracing in Visual-Polar Space").

/// Eccentricity at which acuity begins to fall, degrees.
pub const FOVEA_DEG: f64 = 5.79;

/// Returns visual acuity at an eccentricity of `degrees`, as a fraction of the acuity in the fovea. Acuity is 60 cycles
/// per degree in the fovea, and 449.4 / (0.3 e + 1)² cycles per degree at an eccentricity of e degrees outside it.
pub fn acuity(degrees: f64) -> f64 {
    if degrees < FOVEA_DEG { 1.0 } else { 449.4 / 60.0 / (0.3 * degrees + 1.0).powi(2) }
}
