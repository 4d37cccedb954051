//! Tangents for meshes without any, as glTF 2.0 prescribes: MikkTSpace (Mikkelsen 2008, "Simulation of Wrinkled
//! Surfaces Revisited"). The tangent is the mean of the directions in which u grows on the triangles around a vertex,
//! projected onto its tangent plane and weighted by their angles. Triangles whose images are mirrored are separate.

use std::collections::HashMap;

use diptych::scene::{Mesh, TextureRef};
use glam::{DVec3, Vec4};

/// Gives the mesh tangents for a map on it.
///
/// # Panics
/// If the corners at a vertex have different tangents.
pub fn define(mesh: &mut Mesh, map: TextureRef) {
    let mut corners = Vec::new();
    let mut sums: HashMap<_, DVec3> = HashMap::new();
    for triangle in &mesh.triangles {
        let p = triangle.map(|v| mesh.positions[v as usize].as_dvec3());
        let uv = triangle.map(|v| map.uv_from_uv.transform_point2(mesh.uvs[map.uv_set][v as usize]).as_dvec2());
        let ([d1, d2], [e1, e2]) = ([p[1] - p[0], p[2] - p[0]], [uv[1] - uv[0], uv[2] - uv[0]]);
        let area = e1.perp_dot(e2);
        let (along_u, along_v) = ((d1 * e2.y - d2 * e1.y) / area, (d2 * e1.x - d1 * e2.x) / area);
        for k in 0..3 {
            let vertex = triangle[k] as usize;
            let flat = d1.cross(d2).normalize();
            let n = mesh.normals.get(vertex).map_or(flat, |n| n.as_dvec3().normalize());
            let in_plane = |d: DVec3| (d - n * n.dot(d)).normalize();
            let [before, after] = [2, 1].map(|step| in_plane(p[(k + step) % 3] - p[k]));
            let place = mesh.positions[vertex].to_array().map(f32::to_bits);
            let image = uv[k].to_array().map(f64::to_bits);
            let key = (place, n.to_array().map(f64::to_bits), image, area > 0.0);
            *sums.entry(key).or_default() += in_plane(along_u) * before.angle_between(after);
            // Green points up the image, where v decreases.
            let sign = if n.cross(along_u).dot(along_v) < 0.0 { 1.0 } else { -1.0 };
            corners.push((vertex, key, sign));
        }
    }
    let mut tangents = vec![Vec4::ZERO; mesh.positions.len()];
    for (vertex, key, sign) in corners {
        let tangent = sums[&key].normalize().as_vec3().extend(sign);
        assert!(tangents[vertex] == Vec4::ZERO || tangents[vertex] == tangent, "vertex {vertex} has two tangents");
        tangents[vertex] = tangent;
    }
    mesh.tangents = tangents;
}
