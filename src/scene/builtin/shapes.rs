//! Ready shapes of the building kit: boxes, spheres, turned and extruded pieces, arches, vaults and cloth.

use super::geometry::{Outline, Surface, Vertex};
use super::maths::{cos, sin, sin_cos};
use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec3A};
use std::f32::consts::{PI, TAU};

/// Returns an axis-aligned box.
pub fn cuboid(min: [f32; 3], max: [f32; 3]) -> Surface {
    let (min, max) = (Vec3::from(min), Vec3::from(max));
    let size = max - min;
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    Surface::union([
        Surface::quad(min + x, -x, y),
        Surface::quad(min + z, x, y),
        Surface::quad(min, z, y),
        Surface::quad(min + x + z, -z, y),
        Surface::quad(min, x, z),
        Surface::quad(min + y + z, x, -z),
    ])
}

/// Returns a box of `size` with the middle of its bottom at `foot`.
pub fn block(foot: [f32; 3], size: [f32; 3]) -> Surface {
    let half = [size[0] / 2.0, size[2] / 2.0];
    cuboid([foot[0] - half[0], foot[1], foot[2] - half[1]], [foot[0] + half[0], foot[1] + size[1], foot[2] + half[1]])
}

/// Returns a sphere about the origin, tessellated into `around` cells of longitude and `up` cells of latitude. Texture
/// coordinates cover the unit square.
pub fn sphere(radius: f32, around: usize, up: usize) -> Surface {
    Surface::grid(up, around, |u, v| {
        // Exact coordinates at the poles and the seam close the surface.
        let (ring, height) = match u {
            u if u <= 0.0 => (0.0, -1.0),
            u if u >= 1.0 => (0.0, 1.0),
            u => (sin(u * PI), -cos(u * PI)),
        };
        let (s, c) = sin_cos(if v < 1.0 { v * TAU } else { 0.0 });
        let normal = Vec3::new(ring * c, height, ring * s);
        Vertex { position: normal * radius, normal, uv: Vec2::new(1.0 - v, 1.0 - u) }
    })
}

/// Returns the frames of a full turn about +y in `sides` steps. They map an outline's x to the radius and its y to +y.
fn turn(sides: usize) -> Vec<Affine3A> {
    (0..=sides)
        .map(|i| {
            let (s, c) = sin_cos((i % sides) as f32 / sides as f32 * TAU);
            frame(Vec3::ZERO, Vec3::new(c, 0.0, s), Vec3::Y)
        })
        .collect()
}

/// Returns the frame that maps x and y of an outline's plane to the given axes, and z to their cross product.
fn frame(origin: Vec3, x: Vec3, y: Vec3) -> Affine3A {
    Affine3A { matrix3: Mat3A::from_cols(x.into(), y.into(), x.cross(y).into()), translation: origin.into() }
}

/// Turns an outline about the y axis. The outline must run upwards, with x ≥ 0.
pub fn lathe(profile: &Outline, sides: usize) -> Surface {
    profile.sweep(&turn(sides))
}

/// Returns a cylinder along +y with the centre of its bottom at the origin.
pub fn cylinder(radius: f32, height: f32, sides: usize) -> Surface {
    lathe(&Outline::open([[0.0, 0.0], [radius, 0.0], [radius, height], [0.0, height]]), sides)
}

/// Returns a torus around the y axis.
pub fn torus(radius: f32, thickness: f32, sides: usize, around: usize) -> Surface {
    lathe(&Outline::circle([radius, 0.0], thickness, around), sides)
}

/// Extrudes the outline along +z from 0 to `length`.
pub fn extrude(outline: &Outline, length: f32) -> Surface {
    let end = Affine3A::from_translation(Vec3::Z * length);
    outline.sweep_solid(&[Affine3A::IDENTITY, end])
}

/// Returns the frame of a horizontal cross-section at height `y`, scaled by `scale`. It maps an outline's x to x and
/// its y to −z.
fn level(y: f32, scale: f32) -> Affine3A {
    frame(Vec3::Y * y, Vec3::X * scale, Vec3::NEG_Z * scale)
}

/// Sweeps a cross-section upwards through levels of (height, scale). The ends are open.
pub fn rise(outline: &Outline, levels: &[[f32; 2]]) -> Surface {
    let frames: Vec<_> = levels.iter().map(|&[y, scale]| level(y, scale)).collect();
    outline.sweep(&frames)
}

/// Sweeps the outline over an arch about the z axis, from +x over +y to −x, and caps the ends. The outline's x is the
/// radius; its y is −z.
pub fn arch(outline: &Outline, steps: usize) -> Surface {
    let frames: Vec<_> = (0..=steps)
        .map(|i| {
            let (s, c) = sin_cos(i as f32 / steps as f32 * PI);
            frame(Vec3::ZERO, Vec3::new(c, s, 0.0), Vec3::NEG_Z)
        })
        .collect();
    outline.sweep_solid(&frames)
}

/// Returns a horizontal moulding: the outline (x outward, y up), extruded from `start` in the direction `outward` × up
/// by `length`. `mitre` holds the slopes of the cuts at the start and at the end: a point of the cut at outline
/// coordinate x moves along the moulding by slope · x. +1 at the start and −1 at the end fit inner corners.
pub fn moulding(profile: &Outline, start: Vec3, outward: Vec3, length: f32, mitre: [f32; 2]) -> Surface {
    let along = outward.cross(Vec3::Y);
    let mut s = profile.sweep(&[Affine3A::IDENTITY, Affine3A::from_translation(Vec3::Z * length)]);
    for v in &mut s.vertices {
        let p = v.position;
        let end = if p.z > 0.0 { mitre[1] } else { mitre[0] };
        v.position = start + outward * p.x + Vec3::Y * p.y + along * (p.z + end * p.x);
        v.normal = outward * v.normal.x + Vec3::Y * v.normal.y;
    }
    s
}

/// Returns a round limb, such as a branch, along a curve of (centre, radius), with closed ends.
pub fn limb(path: &[(Vec3, f32)], sides: usize) -> Surface {
    ribbon(path, 1.0, sides, Vec3::new(0.31, 0.11, 0.94))
}

/// Returns a limb flattened to `flatness` of its width in the direction nearest to `face`.
pub fn ribbon(path: &[(Vec3, f32)], flatness: f32, sides: usize, face: Vec3) -> Surface {
    let mut frames: Vec<Affine3A> = Vec::with_capacity(path.len());
    for (i, &(centre, radius)) in path.iter().enumerate() {
        let before = path[i.saturating_sub(1)].0;
        let after = path[(i + 1).min(path.len() - 1)].0;
        let onwards = (after - before).normalize();
        let side = face.cross(onwards).normalize();
        // Avoids a flip of the side where the curve passes through the direction of `face`.
        let swapped = frames.last().is_some_and(|f| side.dot(f.matrix3.x_axis.into()) < 0.0);
        let x = if swapped { -side } else { side };
        let y = onwards.cross(x) * flatness;
        frames.push(Affine3A {
            matrix3: Mat3A::from_cols(Vec3A::from(x), y.into(), onwards.into()) * radius,
            translation: centre.into(),
        });
    }
    Outline::circle([0.0, 0.0], 1.0, sides).sweep_solid(&frames)
}

/// Returns the wall above an arched opening: `width` wide from y = 0 (the springing) up to `height`, `depth` thick
/// about z = 0, minus a half disc of `radius` about the origin. Its outer ends and top are open.
pub fn spandrel(width: f32, height: f32, radius: f32, depth: f32, steps: usize) -> Surface {
    let mut edge: Vec<Vec2> = vec![Vec2::new(-width / 2.0, 0.0)];
    edge.extend((0..=steps).map(|i| {
        let (s, c) = sin_cos(PI - i as f32 / steps as f32 * PI);
        Vec2::new(c, if i == 0 || i == steps { 0.0 } else { s }) * radius
    }));
    edge.push(Vec2::new(width / 2.0, 0.0));
    let mut front = Surface::default();
    for p in &edge {
        for q in [*p, Vec2::new(p.x, height)] {
            let position = q.extend(depth / 2.0);
            front.vertices.push(Vertex { position, normal: Vec3::Z, uv: Vec2::new(q.x, -q.y) });
        }
    }
    for i in 0..edge.len() as u32 - 1 {
        front.face([2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1]);
    }
    let back = front.clone().transformed(super::maths::quarter_turn_y(2));
    let soffit = Outline::open(edge.iter().map(|p| p.to_array()));
    let frames = [-depth / 2.0, depth / 2.0].map(|z| Affine3A::from_translation(Vec3::Z * z));
    front.with(back).with(soffit.sweep(&frames))
}

/// Returns the underside of a groin vault over `width` × `depth` about the origin: two intersecting half barrels that
/// rise from y = 0 to `rise`.
pub fn groin_vault(width: f32, depth: f32, rise: f32, steps: usize) -> Surface {
    let half = Vec3::new(width / 2.0, rise, depth / 2.0);
    Surface::union((0..4).map(|side| {
        let swap = side % 2 == 1;
        // Web on the +x side of a unit vault whose barrel runs along x: y² + z² = 1.
        let web = Surface::grid(steps * 2, steps, |u, v| {
            let reach = v * PI / 2.0;
            let (z, y) = sin_cos((1.0 - 2.0 * u) * reach);
            let x = if v >= 1.0 { 1.0 } else { sin(reach) };
            let y = if v >= 1.0 && (u <= 0.0 || u >= 1.0) { 0.0 } else { y };
            let local = Vec3::new(x, y, z);
            Vertex { position: local, normal: -Vec3::new(0.0, y, z), uv: Vec2::new(x, z) }
        });
        let turned = web.transformed(super::maths::quarter_turn_y(side));
        let size = if swap { Vec2::new(half.z, half.x) } else { Vec2::new(half.x, half.z) };
        turned.transformed(Affine3A::from_scale(half)).uv_scaled(size)
    }))
}
