//! Changes of a frame to the tables of a dynamic scene.

use glam::Vec4;
use serde::{Deserialize, Serialize};

use super::moves::Moves;
use super::scene_tables::{SceneTables, bytes_of};
use crate::accel::{Moved, Poses, Triangle};
use crate::layout;
use crate::scene::Material;
use crate::tables::emitters::Emitters;
use crate::wgsl::ROW_BYTES;

/// Changes of a frame: plain data, the same for every device.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneUpdate {
    /// New contents of ranges of table rows: index of the first row, and bytes.
    pub rows: Vec<(u32, Vec<u8>)>,
    /// Joint matrices and morph weights of deforming bodies.
    pub pose: Vec<[f32; 4]>,
    /// Number of bodies left out of the frame because their scale, stretch or distance is too extreme for accurate ray
    /// intersections.
    pub left_out: u32,
}

impl SceneTables {
    /// Returns the changes to the tables for a frame at `now_s` that follows one at `last_s`, and updates the constants
    /// `frame` accordingly. Also returns, for each body, its current bounds relative to [`Self::origin`] and its
    /// maximum displacement between the two times, scene units.
    pub fn update(&self, frame: &mut layout::Frame, now_s: f64, last_s: f64) -> (SceneUpdate, Vec<Moved>) {
        let mut update = SceneUpdate::default();
        let Some(moves @ Moves { motion, rest }) = &self.moving else { return (update, Vec::new()) };
        let [now, last] = [now_s, last_s].map(|time_s| motion.pose(time_s));
        let pose = self.accel.pose_rows(motion, [&now, &last]);
        let poses = Poses { motion, now: &now, last: &last, rows: &pose };
        if self.accel.moves() {
            let placed = self.accel.placed_at(Some(&poses));
            let tree = self.accel.instance_tree * (size_of_val(&self.accel.nodes[0]) / ROW_BYTES) as u32;
            update.rows.push((tree, bytes_of(&placed.nodes).into_owned()));
            update.rows.push((self.instances, bytes_of(&placed.instances).into_owned()));
            update.rows.push((self.numbers, bytes_of(&placed.numbers).into_owned()));
            frame.geometry.instance_count = placed.instances.len() as u32;
            update.left_out = placed.left_out;
        }
        let mut scene = rest.clone();
        motion.place(&now, &mut scene);
        let mut before = rest.clone();
        motion.place(&last, &mut before);
        frame.lights.change = self.sources.change(&before, &scene) as f32;
        update.rows.extend(motion.changing_materials().into_iter().map(|i| self.material_row(i, &scene.materials[i])));
        let glows = self.sources.triangles.last().is_some_and(|&last| last >= self.accel.skins.first_row);
        if moves.changes_lights() || (glows && !self.accel.skins.is_empty()) {
            let emitters = Emitters::placed(
                &scene,
                &self.sources,
                self.accel.origin,
                self.emissive_triangles(&pose),
                self.emitters.first_row(),
            );
            update.rows.push((self.emitters.first_row(), bytes_of(&emitters.trees).into_owned()));
            update.rows.push((self.first_rows.lights, bytes_of(&emitters.lights).into_owned()));
        }
        update.pose = pose.iter().map(Vec4::to_array).collect();
        (update, self.accel.moved(&poses).collect())
    }

    /// Returns the triangles that may emit, at their current positions.
    fn emissive_triangles<'a>(&'a self, pose: &'a [Vec4]) -> impl Iterator<Item = (u32, Triangle)> + 'a {
        let skins = &self.accel.skins;
        self.sources.triangles.iter().map(move |&prim| {
            let triangle = self.accel.triangles[prim as usize];
            let deforming = prim.wrapping_sub(skins.first_row) as usize;
            if deforming >= skins.triangles.len() {
                return (prim, triangle);
            }
            let [v0, v1, v2] = skins.corners(deforming, pose);
            (prim, Triangle { v0, v1, v2, ..triangle })
        })
    }

    /// Returns the first row and the table entry of an animated material with its current colours.
    fn material_row(&self, number: usize, now: &Material) -> (u32, Vec<u8>) {
        let Material { base_color, emissive, .. } = *now;
        let entry = layout::Material { base_color, emissive, ..self.materials[number] };
        let row = self.first_rows.materials + (number * size_of::<layout::Material>() / ROW_BYTES) as u32;
        (row, bytemuck::bytes_of(&entry).to_vec())
    }
}
