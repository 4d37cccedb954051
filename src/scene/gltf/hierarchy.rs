//! Node hierarchy of the scene. Files may nest nodes arbitrarily deep, so traversal does not recurse.

use std::collections::BTreeSet;
use std::iter::successors;

use ::gltf::json::Root;
use ::gltf::json::scene::Node;
use glam::{DAffine3, DMat4, DQuat, DVec3};

use super::fault::{Fault, Outcome, Warnings, Within, label, lookup};
use crate::scene::motion::Placement;

/// A node of the scene with its transform.
pub struct PlacedNode {
    /// Index into the file's nodes.
    pub node: usize,
    /// Index of the parent in the list of placed nodes, smaller than the node's own; `None` for a root.
    pub parent: Option<usize>,
    /// Transform from the node to its parent, unless animated.
    pub rest: Placement,
    pub world_from_node: DAffine3,
    /// False if the file hides the node or an ancestor (`KHR_node_visibility`).
    pub is_visible: bool,
}

/// Returns the nodes of the default scene, and the joints of its skins. Without a default scene, returns those of
/// scene 0, and without scenes, all nodes of the file. Parents precede their children. If the default scene does not
/// exist, warns and does the same.
pub fn walk(root: &Root, warnings: &mut Warnings) -> Outcome<Vec<PlacedNode>> {
    let parents = parents(root)?;
    let tops: Vec<usize> = (0..parents.len()).filter(|&i| parents[i].is_none()).collect();
    reject_cycles(root, &parents, &tops)?;

    let asked = root.scene.map(|scene| scene.value());
    if let Some(scene) = asked.filter(|&scene| scene >= root.scenes.len()) {
        let taken = if root.scenes.is_empty() { "all nodes" } else { "the first one" };
        warnings.note(&format!("the file shows scene {scene}, which it does not have: took {taken}"), "");
    }
    let shown = asked.and_then(|scene| root.scenes.get(scene)).or_else(|| root.scenes.first());
    let starts = shown.map_or(tops, |scene| scene.nodes.iter().map(|n| n.value()).collect());
    let mut pending: Vec<(usize, Option<usize>)> = starts.into_iter().rev().map(|n| (n, None)).collect();
    let mut tree = Tree { root, places: vec![None; root.nodes.len()], nodes: Vec::new() };
    while let Some((index, parent)) = pending.pop() {
        let node = lookup(&root.nodes, "node", index).within(|| "its scene".into())?;
        if tree.places[index].is_some() {
            return Err(Fault::Invalid(format!("its scene contains {} twice", label("node", index, &node.name))));
        }
        let is_visible = !is_hidden(node) && parent.is_none_or(|p| tree.nodes[p].is_visible);
        let place = tree.place(index, parent, is_visible)?;
        pending.extend(node.children.iter().flatten().rev().map(|c| (c.value(), Some(place))));
    }
    tree.place_joints(&parents, warnings)?;
    Ok(tree.nodes)
}

/// Nodes that have been placed so far.
struct Tree<'a> {
    root: &'a Root,
    /// Index in `nodes` of each of the file's nodes.
    places: Vec<Option<usize>>,
    nodes: Vec<PlacedNode>,
}

impl Tree<'_> {
    /// Places a node below the placed node `parent`. Returns its index in the list of placed nodes.
    fn place(&mut self, index: usize, parent: Option<usize>, is_visible: bool) -> Outcome<usize> {
        let node = &self.root.nodes[index];
        let within = || label("node", index, &node.name);
        let world_from_parent = parent.map_or(DAffine3::IDENTITY, |p| self.nodes[p].world_from_node);
        let rest = placement(node).within(within)?;
        let world_from_node = check_range(world_from_parent * rest.affine()).within(within)?;
        self.places[index] = Some(self.nodes.len());
        self.nodes.push(PlacedNode { node: index, parent, rest, world_from_node, is_visible });
        Ok(self.nodes.len() - 1)
    }

    /// Places the joints of the scene's skins that are outside the scene, and their ancestors, as hidden nodes.
    fn place_joints(&mut self, parents: &[Option<usize>], warnings: &mut Warnings) -> Outcome<()> {
        let skins = self.nodes.iter().filter_map(|placed| self.root.nodes[placed.node].skin);
        let skins: BTreeSet<usize> = skins.map(|skin| skin.value()).collect();
        let skins = skins.into_iter().filter_map(|skin| self.root.skins.get(skin));
        let joints: Vec<usize> = skins.flat_map(|skin| &skin.joints).map(|joint| joint.value()).collect();
        for joint in joints.into_iter().filter(|&joint| joint < parents.len()) {
            let is_new = |node: &usize| self.places[*node].is_none();
            let mut chain: Vec<usize> = successors(Some(joint), |&node| parents[node]).take_while(is_new).collect();
            if !chain.is_empty() {
                let place = || label("node", joint, &self.root.nodes[joint].name);
                warnings.note("joints outside the scene are placed at its origin, with their ancestors", &place());
            }
            while let Some(node) = chain.pop() {
                self.place(node, parents[node].and_then(|parent| self.places[parent]), false)?;
            }
        }
        Ok(())
    }
}

/// Returns true if the file hides a node and its descendants.
fn is_hidden(node: &Node) -> bool {
    let extension = node.extensions.as_ref().and_then(|e| e.others.get("KHR_node_visibility"));
    extension.and_then(|e| e.get("visible")?.as_bool()) == Some(false)
}

/// Returns the index of each node's parent; `None` for roots.
fn parents(root: &Root) -> Outcome<Vec<Option<usize>>> {
    let mut parents = vec![None; root.nodes.len()];
    for (index, node) in root.nodes.iter().enumerate() {
        for child in node.children.iter().flatten().map(|c| c.value()) {
            lookup(&root.nodes, "node", child).within(|| label("node", index, &node.name))?;
            if let Some(other) = parents[child].replace(index) {
                return Err(Fault::Invalid(format!(
                    "{} is a child of node {other} and of node {index}: a node has one parent",
                    label("node", child, &root.nodes[child].name)
                )));
            }
        }
    }
    Ok(parents)
}

/// Returns an error if the nodes contain a cycle. `tops` are the roots. Each node has at most one parent, so a node
/// that cannot be reached from a root is on a cycle or below one.
fn reject_cycles(root: &Root, parents: &[Option<usize>], tops: &[usize]) -> Outcome<()> {
    let mut reached = vec![false; parents.len()];
    let mut pending = tops.to_vec();
    while let Some(index) = pending.pop() {
        reached[index] = true;
        pending.extend(root.nodes[index].children.iter().flatten().map(|c| c.value()));
    }
    let Some(mut lost) = reached.iter().position(|r| !r) else { return Ok(()) };
    for _ in 0..parents.len() {
        lost = parents[lost].unwrap_or(lost);
    }
    Err(Fault::Invalid(format!("{} is its own ancestor", label("node", lost, &root.nodes[lost].name))))
}

fn placement(node: &Node) -> Outcome<Placement> {
    if let Some(columns) = node.matrix {
        return affine_from_matrix(columns).map(Placement::Matrix);
    }
    let translation = node.translation.unwrap_or_default();
    let scale = node.scale.unwrap_or([1.0; 3]);
    let rotation = node.rotation.map_or(DQuat::IDENTITY, |q| DQuat::from_array(q.0.map(f64::from)));
    let length = rotation.length();
    if !length.is_finite() || length == 0.0 {
        return Err(Fault::Invalid("its rotation is a quaternion of length 0 or not finite".into()));
    }
    Ok(Placement::Parts {
        translation: DVec3::from_array(translation.map(f64::from)),
        rotation: DQuat::from_vec4(glam::DVec4::from(rotation) / length),
        scale: DVec3::from_array(scale.map(f64::from)),
    })
}

/// Converts a column-major matrix, which must be affine.
pub fn affine_from_matrix(columns: [f32; 16]) -> Outcome<DAffine3> {
    const TOLERANCE: f32 = 1e-3;
    let last_row = [columns[3], columns[7], columns[11], columns[15] - 1.0];
    if !last_row.iter().all(|x| x.abs() <= TOLERANCE) {
        return Err(Fault::Invalid("its matrix is not affine: the last row must be 0 0 0 1".into()));
    }
    Ok(DAffine3::from_mat4(DMat4::from_cols_array(&columns.map(f64::from))))
}

fn check_range(transform: DAffine3) -> Outcome<DAffine3> {
    let representable = transform.to_cols_array().iter().all(|x| (*x as f32).is_finite());
    if representable { Ok(transform) } else { Err(Fault::Invalid("its transform is not finite".into())) }
}
