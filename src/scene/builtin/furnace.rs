//! White furnace: spheres in an environment of radiance 1. Apart from mutual occlusion, the white sphere must be
//! invisible and the grey ones must show their albedo. Occlusion takes 0.3 % of the white sphere's light on average:
//! nothing at its middle, and 1.4 % where its rim faces a grey sphere.

use super::super::Scene;
use super::assembly::{Assembly, matte};
use super::maths::shift;
use super::shapes::sphere;

pub fn build() -> Scene {
    let mut a = Assembly::new("furnace");
    let spheres = [
        ("albedo 1.0", 1.0, 0.5, [0.0, 0.0, 0.0]),
        ("albedo 0.5", 0.5, 0.16, [-1.7, 0.75, 0.0]),
        ("albedo 0.2", 0.2, 0.16, [1.7, 0.75, 0.0]),
        ("albedo 0.5", 0.5, 0.16, [1.7, -0.75, 0.0]),
        ("albedo 0.2", 0.2, 0.16, [-1.7, -0.75, 0.0]),
    ];
    for (name, albedo, radius, [x, y, z]) in spheres {
        let material = a.material(matte(name, [albedo; 3]));
        let mut mesh = sphere(radius, 96, 48).into_mesh(material);
        // Interpolated normals lose or gain a little light; a furnace should test only the estimator.
        mesh.normals.clear();
        let mesh = a.raw_mesh(mesh);
        a.place(mesh, shift(x, y, z));
    }
    a.finish()
}
