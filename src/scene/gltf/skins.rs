//! Skins: joints, their inverse bind matrices, and their influences on vertices.

use ::gltf::json::accessor::ComponentType::{F32, U8, U16};
use ::gltf::json::mesh::Semantic;
use ::gltf::json::validation::Checked;
use glam::Affine3A;

use super::accessor::Elements;
use super::buffers::Buffers;
use super::fault::{Fault, Outcome, Warnings, Within, label, lookup};
use super::hierarchy::affine_from_matrix;
use super::vertices::Vertices;
use crate::scene::motion::pose::narrow;
use crate::scene::motion::{Influence, Skin};

/// Maximum number of joints of a skin, since an influence stores the index of a joint in 16 bits.
const MAX_JOINTS: usize = 1 << 16;

/// Maximum number of joint sets per vertex (`JOINTS_n` and `WEIGHTS_n`), of four joints each.
const SETS: u32 = 2;

/// Reads a skin by its index in the file. `places` maps each node of the file to its index in
/// [`Motion::nodes`](crate::scene::motion::Motion::nodes), or `None` if the loaded scene does not contain the node.
pub fn read(buffers: &Buffers, index: usize, places: &[Option<usize>]) -> Outcome<Skin> {
    let json = lookup(&buffers.root.skins, "skin", index)?;
    read_skin(buffers, json, places).within(|| label("skin", index, &json.name))
}

fn read_skin(buffers: &Buffers, json: &::gltf::json::Skin, places: &[Option<usize>]) -> Outcome<Skin> {
    let count = json.joints.len();
    if count == 0 || count > MAX_JOINTS {
        return Err(Fault::Invalid(format!("it has {count} joints, not 1 to {MAX_JOINTS}")));
    }
    buffers.budget().reserve((count * (size_of::<usize>() + size_of::<Affine3A>())) as u64)?.keep();
    let place = |node: usize| {
        let place = *lookup(places, "node", node)?;
        place.ok_or_else(|| Fault::Invalid(format!("its joint, node {node}, is not part of the loaded scene")))
    };
    let joints = json.joints.iter().map(|j| place(j.value())).collect::<Outcome<_>>()?;
    let Some(accessor) = json.inverse_bind_matrices else {
        return Ok(Skin { joints, inverse_bind: vec![Affine3A::IDENTITY; count] });
    };
    let elements = Elements::open(buffers, accessor.value()).within(|| "inverseBindMatrices".into())?;
    if elements.width != 16 || elements.component != F32 {
        return Err(Fault::Invalid(format!("inverseBindMatrices: accessor {accessor} is not of type MAT4 and float")));
    }
    if elements.count < count {
        let what = format!("inverseBindMatrices: {} matrices for {count} joints", elements.count);
        return Err(Fault::Invalid(what));
    }
    let matrix = |i: usize| {
        let columns = elements.matrix(i);
        let what = || format!("inverse bind matrix {i}");
        if !columns.iter().all(|x| x.is_finite()) {
            return Err(Fault::Invalid("it is not finite".into())).within(what);
        }
        affine_from_matrix(columns).map(|m| narrow(&m)).within(what)
    };
    Ok(Skin { joints, inverse_bind: (0..count).map(matrix).collect::<Outcome<_>>()? })
}

/// Reads the influences of a primitive's vertices; empty if it has no joints or no weights.
pub fn influences(vertices: &Vertices, place: &str, warnings: &mut Warnings) -> Outcome<Vec<Influence>> {
    let mut sets = Vec::new();
    for set in 0..SETS {
        let joints = vertices.open(Semantic::Joints(set), 4..=4, &[U8, U16])?;
        let weights = vertices.open(Semantic::Weights(set), 4..=4, &[F32, U8, U16])?;
        match joints.zip(weights) {
            Some(pair) => sets.push(pair),
            None => break,
        }
    }
    if sets.is_empty() {
        return Ok(Vec::new());
    }
    let is_more = |semantic: &Checked<Semantic>| matches!(semantic, Checked::Valid(Semantic::Joints(SETS..)));
    if vertices.primitive.attributes.keys().any(is_more) {
        warnings.note("joints after the first eight of a vertex are left out", place);
    }
    let (mut bad, mut unbound) = (false, false);
    let gather = |&vertex: &u32| {
        let mut influence = Influence::default();
        let slots = influence.joints.iter_mut().zip(&mut influence.weights);
        let given = sets.iter().flat_map(|(joints, weights)| {
            let (joints, weights) = (joints.unsigneds(vertex as usize), weights.unit_floats(vertex as usize));
            joints.into_iter().zip(weights)
        });
        let mut sum = 0.0;
        for ((joint, weight), (named, given)) in slots.zip(given) {
            let sane = if given.is_finite() { given.max(0.0) } else { 0.0 };
            bad |= sane != given;
            *weight = sane;
            *joint = if sane > 0.0 { named as u16 } else { 0 };
            sum += f64::from(sane);
        }
        if sum > 0.0 {
            influence.weights.iter_mut().for_each(|w| *w = (f64::from(*w) / sum) as f32);
        } else {
            unbound = true;
            influence.joints[0] = sets[0].0.unsigneds(vertex as usize)[0] as u16;
            influence.weights[0] = 1.0;
        }
        influence
    };
    let influences = vertices.used.iter().map(gather).collect();
    if bad {
        warnings.note("weights of joints that are negative or not finite are taken as 0", place);
    }
    if unbound {
        warnings.note("vertices without weights follow the first joint that they name", place);
    }
    Ok(influences)
}
