//! Deforming bodies in poses that no animation contains: their triangles, and the trees over them.

mod refit;
mod skin;

use diptych::accel::{Accel, COLUMNS};
use diptych::layout::Frame;
use diptych::scene::motion::pose::Pose;
use diptych::scene::{Material, Scene};
use diptych::tables::SceneTables;
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3, Vec4};

use super::harness::{Buffer, Kernel, Outputs};
use super::inputs::Random;
use crate::reference::scenes::moving::{Draft, add_mapped, add_patch, add_tube, patch, tube};
use crate::reference::scenes::{add_material, add_mesh, block, matte};

/// Returns bodies of all kinds: two skinned, one of them mirrored, one skinned and morphed, one morphed, and an
/// emissive block, which moves as a body with one joint.
fn bodies() -> Scene {
    let mut draft = Draft::room("bodies");
    let mapped = add_mapped(&mut draft.scene, Vec3::splat(0.5));
    let glow = add_material(&mut draft.scene, Material { emissive: Vec3::ONE, ..matte() });
    let mesh = add_mesh(&mut draft.scene, tube(7, 5, mapped));
    add_tube(&mut draft, mesh, DVec3::X, DVec3::ONE);
    add_tube(&mut draft, mesh, DVec3::NEG_X, DVec3::new(-1.0, 1.0, 1.0));
    let mut both = tube(5, 4, mapped);
    both.morphs = patch(1, mapped).morphs;
    let vertices = both.positions.len();
    for morph in &mut both.morphs {
        let stretched = |list: &[Vec3]| list.iter().cycle().take(list.len().min(1) * vertices).copied().collect();
        (morph.positions, morph.normals) = (stretched(&morph.positions), stretched(&morph.normals));
        morph.tangents = stretched(&morph.tangents);
    }
    // Where the base has no tangent, a morph target must not add one.
    both.tangents[2] = Vec4::ZERO;
    let mesh = add_mesh(&mut draft.scene, both);
    add_tube(&mut draft, mesh, DVec3::Z, DVec3::ONE);
    let mesh = add_mesh(&mut draft.scene, patch(6, mapped));
    add_patch(&mut draft, mesh, DVec3::Y);
    let mesh = add_mesh(&mut draft.scene, block(glow));
    let node = draft.node(None, DVec3::Y, DVec3::ONE);
    draft.body(mesh, node, None, Vec::new());
    draft.done()
}

/// Returns a transform that rotates, scales and shears by up to `by`, from 0 to 1, and mirrors if `sign` is negative.
fn transform(random: &mut Random, by: f64, sign: f64) -> DAffine3 {
    let turn = DQuat::from_axis_angle(random.tilted(DVec3::Z, 3.0), by * random.within(-3.0..3.0));
    let scale = DVec3::from_array(std::array::from_fn(|_| (by * random.within(-1.2..0.7)).exp()));
    let mut shear = DMat3::IDENTITY;
    (shear.y_axis.x, shear.z_axis.y) = (by * random.within(-0.4..0.4), by * random.within(-0.4..0.4));
    let linear = DMat3::from_quat(turn) * shear * DMat3::from_diagonal(scale * DVec3::new(sign, 1.0, 1.0));
    let translation = by * DVec3::from_array(std::array::from_fn(|_| random.within(-3.0..3.0)));
    DAffine3 { matrix3: linear, translation }
}

/// Returns a random pose with the mirroring of the rest pose. Blended joints turn some parts inside out.
fn pose(scene: &Scene, random: &mut Random) -> Pose {
    let mut pose = scene.motion.pose(0.0);
    let whole = transform(random, 1.0, 1.0);
    for world in &mut pose.world_from_node {
        let sign = world.matrix3.determinant().signum();
        *world = whole * transform(random, 1.0, 1.0) * DAffine3::from_scale(DVec3::new(sign, 1.0, 1.0));
    }
    let weight = |random: &mut Random| if random.chance(0.2) { 0.0 } else { random.within(-1.0..2.0) as f32 };
    pose.weights.iter_mut().flatten().for_each(|w| *w = weight(random));
    pose
}

/// A device's data of the scene.
struct Device {
    accel: Accel,
    frame: Frame,
    /// Rows of all tables before the ones that change.
    rows: usize,
}

impl Device {
    fn new(scene: &Scene) -> Self {
        let [accel, again] = [0, 1].map(|_| Accel::build(scene).unwrap());
        let mut frame = Frame::default();
        SceneTables::new(scene, again).unwrap().describe(&mut frame);
        let rows = frame.tables.last_corners as usize + 3 * accel.skins.triangles.len();
        Self { accel, frame, rows }
    }

    /// Runs `skin` on two poses; everything else in the tables stays as in `tables`.
    fn skin(&self, scene: &Scene, poses: [&Pose; 2], tables: &[[u32; 4]]) -> Outputs {
        let skins = &self.accel.skins;
        let rows = self.accel.pose_rows(&scene.motion, poses);
        let count = skins.triangles.len() as u32;
        let boxes = vec![[f32::NAN; 4]; 2 * (skins.nodes.len() + skins.triangles.len())];
        let words = vec![[f32::NAN; 16]; skins.vertices.len()];
        let buffers = |skinned: &[[f32; 16]]| {
            [
                ("tables", Buffer::whole(tables)),
                ("skin_triangles", Buffer::whole(&skins.triangles)),
                ("skin_vertices", Buffer::whole(&skins.vertices)),
                ("skin_morphs", Buffer::whole(&skins.morphs)),
                ("pose", Buffer::whole(&rows)),
                ("skinned", Buffer::whole(skinned)),
                ("boxes", Buffer::whole(&boxes)),
            ]
        };
        let run = |count: u32, args, skinned: &[[f32; 16]]| {
            assert!(count < COLUMNS);
            Kernel::new("skin", &[]).run_once(&self.frame, args, [count.div_ceil(64), 1], &buffers(skinned))
        };
        // Process vertices, then triangles.
        let vertices = skins.vertices.len() as u32;
        let skinned = run(vertices, [vertices, 0, 1], &words).get::<[f32; 16]>("skinned");
        run(count, [count, 2 * skins.nodes.len() as u32, 0], &skinned)
    }
}
