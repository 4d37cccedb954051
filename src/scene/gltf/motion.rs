//! Motion of a file's scene: finds dynamic instances, and bakes static ones that are skinned or morphed.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use ::gltf::json::Root;
use ::gltf::json::scene::Node as JsonNode;
use glam::{Affine3A, Vec3};

use super::animations::{Animations, Reader};
use super::buffers::Buffers;
use super::fault::{Fault, Outcome, Warnings, Within, label};
use super::geometry::Wanted;
use super::hierarchy::PlacedNode;
use super::placed::PlacedLight;
use super::skins;
use crate::scene::motion::bake::deformed;
use crate::scene::motion::play::Play;
use crate::scene::motion::pose::wide;
use crate::scene::motion::{Animation, Attached, Body, Channel, Emitter, Motion, Node, Placement, Skin, Target};
use crate::scene::{Material, Scene};

/// Animations to play, and the nodes that they move.
pub struct Plan<'a, 'b> {
    buffers: &'a Buffers<'b>,
    nodes: &'a [PlacedNode],
    /// Index in `nodes` of each node of the file; `None` if the scene does not contain it. Variables named `place` hold
    /// such an index.
    places: Vec<Option<usize>>,
    /// Animations. Their node targets are indices into `nodes`; material and light targets are indices into the file's
    /// lists.
    animations: Vec<Animation>,
    loops: bool,
    /// For each entry of `nodes`, true if the transform of the node or of an ancestor is animated.
    moving: Vec<bool>,
    /// For each entry of `nodes`, true if the node's morph weights are animated.
    morphing: Vec<bool>,
}

/// An instance that may be dynamic or need baking.
pub struct Candidate {
    pub instance: usize,
    /// Index of its node in the list of placed nodes.
    pub place: usize,
}

impl<'a, 'b> Plan<'a, 'b> {
    pub fn new(
        buffers: &'a Buffers<'b>,
        file: &Animations,
        nodes: &'a [PlacedNode],
        play: &Play,
        warnings: &mut Warnings,
    ) -> Outcome<Self> {
        let mut places = vec![None; buffers.root.nodes.len()];
        for (place, node) in nodes.iter().enumerate() {
            places[node.node] = Some(place);
        }
        let animations = Reader { buffers, nodes, places: &places, play }.read(file, warnings)?;
        let (mut moving, mut morphing) = (vec![false; nodes.len()], vec![false; nodes.len()]);
        for channel in animations.iter().flat_map(|a| &a.channels) {
            match channel.target {
                Target::Weights(place) => morphing[place] = true,
                target => moved_node(target).into_iter().for_each(|place| moving[place] = true),
            }
        }
        for (place, node) in nodes.iter().enumerate() {
            moving[place] |= node.parent.is_some_and(|parent| moving[parent]);
        }
        Ok(Self { buffers, nodes, places, animations, loops: play.loops, moving, morphing })
    }

    fn json(&self, place: usize) -> &JsonNode {
        &self.buffers.root.nodes[self.nodes[place].node]
    }

    /// Returns the motion data that each mesh of the file needs.
    pub fn wanted(&self) -> Vec<Wanted> {
        let mut wanted = vec![Wanted::default(); self.buffers.root.meshes.len()];
        for place in 0..self.nodes.len() {
            let node = self.json(place);
            let Some(index) = node.mesh.map(|m| m.value()).filter(|m| *m < wanted.len()) else { continue };
            wanted[index].influences |= node.skin.is_some();
            wanted[index].morphs |= self.morphs(place);
        }
        wanted
    }

    /// Returns true if the weights of a node's mesh are animated, or nonzero at rest.
    fn morphs(&self, place: usize) -> bool {
        self.morphing[place] || rest_weights(self.buffers.root, self.json(place)).iter().any(|w| *w != 0.0)
    }

    /// Returns true if the instances of the node at index `place` may be skinned, morphed or dynamic.
    pub fn is_candidate(&self, place: usize) -> bool {
        self.json(place).skin.is_some() || self.moving[place] || self.morphs(place)
    }

    /// Moves the motion into the scene. Bakes each skinned or morphed instance that is not animated into a separate
    /// mesh.
    pub fn put_into(
        self,
        scene: &mut Scene,
        candidates: &[Candidate],
        lights: &[PlacedLight],
        cameras: &[usize],
        warnings: &mut Warnings,
    ) -> Outcome<()> {
        let (bodies, skins) = self.bodies(scene, candidates, warnings)?;
        let attach = |places: &mut dyn Iterator<Item = usize>| -> Vec<Attached> {
            let all = places.enumerate().map(|(index, node)| Attached { index, node });
            all.filter(|attached| self.moving[attached.node]).collect()
        };
        let mut motion = Motion {
            bodies,
            skins,
            lights: attach(&mut lights.iter().map(|l| l.place)),
            cameras: attach(&mut cameras.iter().copied()),
            loops: self.loops,
            ..Motion::default()
        };
        let numbers = self.take_nodes(&mut motion);
        self.take_animations(&mut motion, &numbers, scene, lights)?;
        tidy(scene, &motion);
        if !motion.is_empty() {
            motion.place(&motion.pose(0.0), scene);
            scene.motion = motion;
        }
        Ok(())
    }

    /// Returns the dynamic bodies and the skins that they use. Both refer to nodes by index into `self.nodes`.
    fn bodies(
        &self,
        scene: &mut Scene,
        candidates: &[Candidate],
        warnings: &mut Warnings,
    ) -> Outcome<(Vec<Body>, Vec<Skin>)> {
        let mut known: HashMap<usize, Skin> = HashMap::new();
        let mut most_joint: HashMap<usize, usize> = HashMap::new();
        let (mut bodies, mut skins, mut skin_numbers) = (Vec::new(), Vec::new(), HashMap::new());
        for &Candidate { instance, place } in candidates {
            let node = self.json(place);
            let within = || label("node", self.nodes[place].node, &node.name);
            let index = scene.instances[instance].mesh;
            let mesh = &scene.meshes[index];
            let weights = if self.morphs(place) { rest_weights(self.buffers.root, node) } else { &[] };
            let weights = weights_for(weights, mesh.morphs.len(), self.morphs(place)).within(within)?;
            self.buffers.budget().reserve((2 * size_of::<Body>() + size_of_val(&weights[..])) as u64)?.keep();
            let mut skin = node.skin.map(|s| s.value());
            if skin.is_some() && mesh.influences.is_empty() {
                warnings.note("meshes with a skin but without joints and weights are not skinned", &within());
                skin = None;
            }
            if let Some(number) = skin {
                if let Entry::Vacant(new) = known.entry(number) {
                    new.insert(skins::read(self.buffers, number, &self.places).within(within)?);
                }
                let named = mesh.influences.iter().flat_map(|i| i.joints).max().map_or(0, usize::from);
                let most = *most_joint.entry(index).or_insert(named);
                let count = known[&number].joints.len();
                if most >= count {
                    let what = format!("a vertex refers to joint {most}, but skin {number} has {count} joints");
                    return Err(Fault::Invalid(what)).within(within);
                }
            }
            let joints = skin.map(|number| &known[&number]);
            let moves = joints.map_or(self.moving[place], |s| s.joints.iter().any(|&j| self.moving[j]));
            if moves || self.morphing[place] {
                let skin = skin.map(|number| {
                    *skin_numbers.entry(number).or_insert_with(|| {
                        skins.push(known[&number].clone());
                        skins.len() - 1
                    })
                });
                if skin.is_some() {
                    scene.instances[instance].world_from_local = Affine3A::IDENTITY;
                }
                bodies.push(Body { instance, node: place, skin, weights });
            } else if joints.is_some() || !weights.is_empty() {
                self.buffers.budget().reserve(mesh.bytes())?.keep();
                let world = |(&joint, bind): (&usize, &Affine3A)| self.nodes[joint].world_from_node * wide(bind);
                let joints: Option<Vec<_>> = joints.map(|s| s.joints.iter().zip(&s.inverse_bind).map(world).collect());
                let shape = deformed(mesh, &weights, joints.as_deref());
                let place = &mut scene.instances[instance];
                if joints.is_some() {
                    place.world_from_local = Affine3A::IDENTITY;
                }
                place.mesh = scene.meshes.len();
                scene.meshes.push(shape);
            }
        }
        Ok((bodies, skins))
    }

    /// Adds the nodes that the motion's lights, cameras, skins and bodies need to [`Motion::nodes`], and changes their
    /// references from indices into `self.nodes` to indices into that list. Returns the new index of each entry of
    /// `self.nodes`; `None` if it was not added.
    fn take_nodes(&self, motion: &mut Motion) -> Vec<Option<usize>> {
        let mut needed = vec![false; self.nodes.len()];
        let attached = motion.lights.iter().chain(&motion.cameras).map(|a| a.node);
        let joints = motion.skins.iter().flat_map(|s| s.joints.iter().copied());
        for place in attached.chain(joints).chain(motion.bodies.iter().map(|b| b.node)) {
            needed[place] = true;
        }
        let mut animated = vec![false; self.nodes.len()];
        for channel in self.animations.iter().flat_map(|a| &a.channels) {
            moved_node(channel.target).into_iter().for_each(|place| animated[place] = true);
        }
        // Parents precede their children.
        for place in (0..self.nodes.len()).rev().filter(|p| self.nodes[*p].parent.is_some()) {
            if let Some(parent) = self.nodes[place].parent.filter(|_| needed[place]) {
                needed[parent] = true;
            }
        }
        let mut numbers: Vec<Option<usize>> = vec![None; self.nodes.len()];
        for (place, node) in self.nodes.iter().enumerate().filter(|(place, _)| needed[*place]) {
            numbers[place] = Some(motion.nodes.len());
            let rest = if animated[place] { parts(node.rest) } else { node.rest };
            let name = self.json(place).name.clone().unwrap_or_default();
            motion.nodes.push(Node { name, parent: node.parent.and_then(|p| numbers[p]), rest });
        }
        let renumber = |place: &mut usize| *place = numbers[*place].unwrap_or_default();
        motion.lights.iter_mut().chain(&mut motion.cameras).for_each(|a| renumber(&mut a.node));
        motion.skins.iter_mut().flat_map(|s| &mut s.joints).for_each(renumber);
        motion.bodies.iter_mut().for_each(|b| renumber(&mut b.node));
        numbers
    }

    /// Moves the channels with targets in the scene into the motion.
    fn take_animations(
        self,
        motion: &mut Motion,
        numbers: &[Option<usize>],
        scene: &Scene,
        lights: &[PlacedLight],
    ) -> Outcome<()> {
        let root = self.buffers.root;
        for animation in self.animations {
            let mut channels = Vec::new();
            for Channel { target, keys } in animation.channels {
                let node = |place: usize| numbers[place];
                let targets: Vec<Target> = match target {
                    Target::Translation(place) => node(place).map(Target::Translation).into_iter().collect(),
                    Target::Rotation(place) => node(place).map(Target::Rotation).into_iter().collect(),
                    Target::Scale(place) => node(place).map(Target::Scale).into_iter().collect(),
                    Target::Weights(place) => node(place).map(Target::Weights).into_iter().collect(),
                    Target::BaseColor(_) => vec![target],
                    Target::EmissiveColor(material) | Target::EmissiveStrength(material) => {
                        let of = if matches!(target, Target::EmissiveColor(_)) {
                            Target::EmissiveColor
                        } else {
                            Target::EmissiveStrength
                        };
                        let emitter = emitter(root, scene, material);
                        emitter.map(|e| of(number_of(&mut motion.emitters, e))).into_iter().collect()
                    }
                    Target::LightColor(light) | Target::LightIntensity(light) => {
                        let of = if matches!(target, Target::LightColor(_)) {
                            Target::LightColor
                        } else {
                            Target::LightIntensity
                        };
                        let lamps = lamps(root, lights, light);
                        lamps.into_iter().map(|l| of(number_of(&mut motion.lamps, l))).collect()
                    }
                };
                let Some((&last, others)) = targets.split_last() else { continue };
                for &target in others {
                    self.buffers.budget().reserve(keys.bytes())?.keep();
                    channels.push(Channel { target, keys: keys.clone() });
                }
                channels.push(Channel { target: last, keys });
            }
            if !channels.is_empty() {
                motion.animations.push(Animation { channels, ..animation });
            }
        }
        Ok(())
    }
}

/// Returns the node whose transform the target animates.
fn moved_node(target: Target) -> Option<usize> {
    match target {
        Target::Translation(place) | Target::Rotation(place) | Target::Scale(place) => Some(place),
        _ => None,
    }
}

/// Returns the morph weights of a node that is not animated: the node's own, or else those of its mesh.
fn rest_weights<'r>(root: &'r Root, node: &'r JsonNode) -> &'r [f32] {
    let mesh = node.mesh.and_then(|m| root.meshes.get(m.value()));
    node.weights.as_deref().or_else(|| mesh?.weights.as_deref()).unwrap_or_default()
}

/// Returns a weight for each of `targets` morph targets: the `given` ones, or zeros if the file gives none. Returns no
/// weights if `morphs` is false.
fn weights_for(given: &[f32], targets: usize, morphs: bool) -> Outcome<Vec<f32>> {
    if !morphs || targets == 0 {
        return Ok(Vec::new());
    }
    if !given.iter().all(|w| w.is_finite()) {
        return Err(Fault::Invalid("one of its weights is not finite".into()));
    }
    match given.len() {
        0 => Ok(vec![0.0; targets]),
        count if count == targets => Ok(given.to_vec()),
        count => Err(Fault::Invalid(format!("it has {count} weights for {targets} morph targets"))),
    }
}

/// Decomposes a matrix into translation, rotation and scale. If that is impossible, keeps only the translation.
fn parts(rest: Placement) -> Placement {
    let Placement::Matrix(matrix) = rest else { return rest };
    let (scale, rotation, translation) = matrix.to_scale_rotation_translation();
    match scale.is_finite() && rotation.is_finite() && rotation.is_normalized() {
        true => Placement::Parts { translation, rotation, scale },
        false => Placement::Parts { translation, rotation: glam::DQuat::IDENTITY, scale: glam::DVec3::ONE },
    }
}

/// Returns a material's emission; `None` if the material is unlit, its emissive texture cannot be used, or its values
/// are not finite.
fn emitter(root: &Root, scene: &Scene, index: usize) -> Option<Emitter> {
    let (json, material) = (root.materials.get(index)?, scene.materials.get(index)?);
    let lost = |m: &Material| m.unlit || (json.emissive_texture.is_some() && m.emissive_texture.is_none());
    let strength = json.extensions.as_ref().and_then(|e| e.emissive_strength.as_ref());
    let strength = strength.map_or(1.0, |s| s.emissive_strength.0);
    let color = Vec3::from_array(json.emissive_factor.0);
    (!lost(material) && strength.is_finite() && color.is_finite()).then_some(Emitter { index, color, strength })
}

/// Returns an emitter for each entry of `lights` that places light `light` of the file. Several nodes may place one
/// light.
fn lamps(root: &Root, lights: &[PlacedLight], light: usize) -> Vec<Emitter> {
    let declared = root.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
    let Some(json) = declared.and_then(|l| l.lights.get(light)) else { return Vec::new() };
    let color = Vec3::from_array(json.color);
    let of = lights.iter().enumerate().filter(|(_, l)| l.index == light);
    of.map(|(index, _)| Emitter { index, color, strength: json.intensity }).collect()
}

/// Returns an emitter's index in the list. Appends it if it is missing.
fn number_of(list: &mut Vec<Emitter>, one: Emitter) -> usize {
    list.iter().position(|e| e.index == one.index).unwrap_or_else(|| {
        list.push(one);
        list.len() - 1
    })
}

/// Removes meshes without instances, and influences and morphs that no body needs.
fn tidy(scene: &mut Scene, motion: &Motion) {
    let (mut shown, mut needed) = (vec![false; scene.meshes.len()], vec![false; scene.meshes.len()]);
    scene.instances.iter().for_each(|i| shown[i.mesh] = true);
    for body in motion.bodies.iter().filter(|b| b.deforms()) {
        needed[scene.instances[body.instance].mesh] = true;
    }
    let mut numbers = Vec::with_capacity(shown.len());
    let mut kept = Vec::with_capacity(scene.meshes.len());
    for ((mut mesh, shown), needed) in std::mem::take(&mut scene.meshes).into_iter().zip(&shown).zip(&needed) {
        numbers.push(kept.len());
        if !needed {
            (mesh.influences, mesh.morphs) = (Vec::new(), Vec::new());
        }
        if *shown {
            kept.push(mesh);
        }
    }
    scene.meshes = kept;
    scene.instances.iter_mut().for_each(|i| i.mesh = numbers[i.mesh]);
}
