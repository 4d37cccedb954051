//! Reads a file's animations. This module parses their JSON itself, since the parser of the other parts does not
//! support `KHR_animation_pointer`.

use std::collections::HashSet;

use ::gltf::json::accessor::ComponentType::{self, F32, I8, I16, U8, U16};
use serde::Deserialize;
use serde::de::IgnoredAny;

use super::accessor::Elements;
use super::buffers::Buffers;
use super::fault::{Fault, Outcome, Warnings, Within, label, lookup};
use super::hierarchy::PlacedNode;
use crate::scene::motion::keys::{Interpolation, Keys};
use crate::scene::motion::play::{Choice, Moved, Play};
use crate::scene::motion::{Animation, Channel, Target};

/// The part of a file's JSON that this module reads.
#[derive(Default, Deserialize)]
pub struct Animations {
    #[serde(default)]
    animations: Vec<Part<AnimationJson>>,
}

/// A part of the JSON that has a fault of its own if it does not have the form that it should.
#[derive(Deserialize)]
#[serde(untagged)]
enum Part<T> {
    Sound(T),
    Broken(IgnoredAny),
}

impl<T> Part<T> {
    fn sound(&self) -> Outcome<&T> {
        match self {
            Self::Sound(part) => Ok(part),
            Self::Broken(_) => Err(Fault::Invalid("its JSON is not valid glTF 2.0".into())),
        }
    }
}

#[derive(Deserialize)]
struct AnimationJson {
    name: Option<String>,
    #[serde(default)]
    channels: Vec<Part<ChannelJson>>,
    #[serde(default)]
    samplers: Vec<Part<SamplerJson>>,
}

#[derive(Deserialize)]
struct ChannelJson {
    sampler: usize,
    target: TargetJson,
}

#[derive(Deserialize)]
struct TargetJson {
    node: Option<usize>,
    path: String,
    #[serde(default)]
    extensions: TargetExtensions,
}

#[derive(Default, Deserialize)]
struct TargetExtensions {
    #[serde(rename = "KHR_animation_pointer")]
    pointer: Option<Pointer>,
}

#[derive(Deserialize)]
struct Pointer {
    pointer: String,
}

#[derive(Deserialize)]
struct SamplerJson {
    input: usize,
    output: usize,
    interpolation: Option<String>,
}

const FLOAT: &[ComponentType] = &[F32];
const UNIT: &[ComponentType] = &[F32, I8, U8, I16, U16];

/// Maximum number of names that a message lists.
const MOST_NAMES: usize = 20;

/// Reads the animations to play. Targets refer to nodes by their index in `nodes`, and to materials and lights by their
/// index in the file.
pub struct Reader<'a, 'b> {
    pub buffers: &'a Buffers<'b>,
    pub nodes: &'a [PlacedNode],
    /// Index in `nodes` of each node of the file; `None` if the scene does not contain it.
    pub places: &'a [Option<usize>],
    pub play: &'a Play,
}

impl Reader<'_, '_> {
    pub fn read(&self, file: &Animations, warnings: &mut Warnings) -> Outcome<Vec<Animation>> {
        let moves = self.moves()?;
        let moved: HashSet<Target> = moves.iter().flat_map(|a| &a.channels).map(|c| c.target).collect();
        let (mut taken, mut covered) = (HashSet::new(), false);
        let (mut played, strict) = (Vec::new(), self.buffers.folder.access.strict);
        for (index, json) in self.chosen(file, warnings)? {
            let place = label("animation", index, &json.name);
            let mut animation =
                Animation { name: json.name.clone().unwrap_or_default(), channels: Vec::new(), duration_s: 0.0 };
            for (number, channel) in json.channels.iter().enumerate() {
                let place = format!("{place} channel {number}");
                let read = channel.sound().and_then(|channel| self.channel(json, channel, &place, warnings));
                let channel = warnings.tolerate(read, "animation channels with faults are left out", &place, strict)?;
                let Some(channel) = channel.flatten() else { continue };
                animation.duration_s = animation.duration_s.max(channel.keys.end_s());
                if moved.contains(&channel.target) {
                    continue;
                }
                if !taken.insert(channel.target) {
                    covered = true;
                    continue;
                }
                animation.channels.push(channel);
            }
            played.push(animation);
        }
        if covered {
            let names: Vec<_> = played.iter().take(MOST_NAMES).map(|a: &Animation| a.name.as_str()).collect();
            let hint =
                "several animations move the same property: the first takes precedence; one can be chosen by its name";
            warnings.note(&format!("{hint}: {}", names.join(", ")), "");
        }
        played.extend(moves);
        Ok(played)
    }

    /// Reads a channel. Returns `None` if its target isn't in the scene or isn't supported.
    fn channel(
        &self,
        animation: &AnimationJson,
        json: &ChannelJson,
        place: &str,
        warnings: &mut Warnings,
    ) -> Outcome<Option<Channel>> {
        let Some(target) = self.target(&json.target, place, warnings)? else { return Ok(None) };
        let sampler = lookup(&animation.samplers, "sampler", json.sampler)?.sound()?;
        Ok(Some(Channel { target, keys: self.keys(sampler, target)? }))
    }

    fn chosen<'f>(&self, file: &'f Animations, warnings: &mut Warnings) -> Outcome<Vec<(usize, &'f AnimationJson)>> {
        if self.play.animation == Choice::None {
            return Ok(Vec::new());
        }
        let mut all = Vec::with_capacity(file.animations.len());
        for (index, animation) in file.animations.iter().enumerate() {
            let place = format!("animation {index}");
            let strict = self.buffers.folder.access.strict;
            let sound = warnings.tolerate(animation.sound(), "animations with faults are left out", &place, strict)?;
            all.extend(sound.map(|animation| (index, animation)));
        }
        let Choice::Named(wanted) = &self.play.animation else { return Ok(all) };
        let found = all.iter().find(|(_, a)| a.name.as_ref() == Some(wanted));
        found.map(|one| vec![*one]).ok_or_else(|| {
            let names: Vec<_> = all.iter().filter_map(|(_, a)| a.name.as_deref()).take(MOST_NAMES).collect();
            let hint = if names.is_empty() { "none with a name".into() } else { names.join(", ") };
            Fault::Invalid(format!("it has no animation named '{wanted}': it has {hint}"))
        })
    }

    /// Resolves a channel's target. Returns `None` if it isn't in the scene or, with a warning, if its property isn't
    /// supported.
    fn target(&self, json: &TargetJson, place: &str, warnings: &mut Warnings) -> Outcome<Option<Target>> {
        let node = |index: usize, part: &str| -> Outcome<Option<Target>> {
            lookup(&self.buffers.root.nodes, "node", index)?;
            let Some(node) = self.places[index] else { return Ok(None) };
            Ok(match part {
                "translation" => Some(Target::Translation(node)),
                "rotation" => Some(Target::Rotation(node)),
                "scale" => Some(Target::Scale(node)),
                "weights" => Some(Target::Weights(node)),
                other => return Err(Fault::Invalid(format!("nodes have no '{other}' that could be animated"))),
            })
        };
        let Some(Pointer { pointer }) = &json.extensions.pointer else {
            return match json.node {
                Some(index) => node(index, &json.path),
                None => Ok(None),
            };
        };
        let steps: Vec<&str> = pointer.split('/').collect();
        let number = |text: &str| text.parse::<usize>().ok();
        let material = |text: &str| {
            number(text).map(|i| lookup(&self.buffers.root.materials, "material", i).map(|_| i)).transpose()
        };
        let light = |text: &str| {
            let lights = self.buffers.root.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
            let lights = lights.map_or(&[][..], |l| &l.lights);
            number(text).map(|i| lookup(lights, "light", i).map(|_| i)).transpose()
        };
        let target = match steps[..] {
            ["", "nodes", index, part @ ("translation" | "rotation" | "scale" | "weights")] => {
                number(index).map_or(Ok(None), |index| node(index, part))?
            }
            ["", "materials", index, "pbrMetallicRoughness", "baseColorFactor"] => {
                material(index)?.map(Target::BaseColor)
            }
            ["", "materials", index, "emissiveFactor"] => material(index)?.map(Target::EmissiveColor),
            ["", "materials", index, "extensions", "KHR_materials_emissive_strength", "emissiveStrength"] => {
                material(index)?.map(Target::EmissiveStrength)
            }
            ["", "extensions", "KHR_lights_punctual", "lights", index, "color"] => {
                light(index)?.map(Target::LightColor)
            }
            ["", "extensions", "KHR_lights_punctual", "lights", index, "intensity"] => {
                light(index)?.map(Target::LightIntensity)
            }
            _ => {
                let shown: String = pointer.chars().take(100).collect();
                warnings.note(&format!("animations of {shown} are left out"), place);
                None
            }
        };
        Ok(target)
    }

    fn keys(&self, json: &SamplerJson, target: Target) -> Outcome<Keys> {
        let interpolation = match json.interpolation.as_deref() {
            None | Some("LINEAR") => Interpolation::Linear,
            Some("STEP") => Interpolation::Step,
            Some("CUBICSPLINE") => Interpolation::CubicSpline,
            Some(other) => return Err(Fault::Invalid(format!("there is no interpolation '{other}'"))),
        };
        let (width, components) = match target {
            Target::Translation(_) | Target::Scale(_) => (3, FLOAT),
            Target::EmissiveColor(_) | Target::LightColor(_) => (3, UNIT),
            Target::Rotation(_) | Target::BaseColor(_) => (4, UNIT),
            Target::Weights(_) => (1, UNIT),
            Target::EmissiveStrength(_) | Target::LightIntensity(_) => (1, FLOAT),
        };
        let times = self.numbers(json.input, 1, FLOAT).within(|| "input".into())?;
        let values = self.numbers(json.output, width, components).within(|| "output".into())?;
        let width = match target {
            Target::Weights(node) => self.weight_count(node)?,
            _ => width,
        };
        let keys = Keys::new(times, values, width, interpolation).map_err(|e| Fault::Invalid(e.to_string()))?;
        if matches!(target, Target::Rotation(_)) && !keys.are_rotations() {
            return Err(Fault::Invalid("one of its rotations is no quaternion".into()));
        }
        Ok(keys)
    }

    /// Returns the number of morph targets of a node's mesh.
    fn weight_count(&self, place: usize) -> Outcome<usize> {
        let node = self.nodes[place].node;
        let mesh = self.buffers.root.nodes[node].mesh.ok_or_else(|| Fault::Invalid("its node has no mesh".into()))?;
        let mesh = lookup(&self.buffers.root.meshes, "mesh", mesh.value())?;
        match mesh.primitives.first().and_then(|p| p.targets.as_ref()).map_or(0, Vec::len) {
            0 => Err(Fault::Invalid("the mesh of its node has no morph targets".into())),
            count => Ok(count),
        }
    }

    fn numbers(&self, accessor: usize, width: usize, components: &[ComponentType]) -> Outcome<Vec<f32>> {
        let elements = Elements::open(self.buffers, accessor)?;
        if elements.width != width || !components.contains(&elements.component) {
            return Err(Fault::Invalid(format!(
                "accessor {accessor} holds {:?} x {}, which is not allowed here",
                elements.component, elements.width
            )));
        }
        let bytes = (elements.count as u64).saturating_mul((width * size_of::<f32>()) as u64);
        self.buffers.budget().reserve(bytes)?.keep();
        let mut numbers = Vec::with_capacity(elements.count * width);
        (0..elements.count).for_each(|i| numbers.extend_from_slice(&elements.unit_floats(i)[..width]));
        Ok(numbers)
    }

    /// Returns an animation with the motion that the shot's `[[move]]` entries define for nodes; `None` if no entry
    /// moves a node.
    fn moves(&self) -> Outcome<Option<Animation>> {
        let mut channels = Vec::new();
        for one in &self.play.moves {
            let Moved::Node(name) = &one.of else { continue };
            let named = |n: &&PlacedNode| self.buffers.root.nodes[n.node].name.as_ref() == Some(name);
            let node = self.nodes.iter().find(named).and_then(|n| self.places[n.node]);
            let node =
                node.ok_or_else(|| Fault::Invalid(format!("its scene has no node named '{name}' for a [[move]]")))?;
            channels.extend(one.channels(node));
        }
        Ok((!channels.is_empty()).then(|| self.play.animation_of(channels)))
    }
}
