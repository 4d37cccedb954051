//! Fingerprints of accumulations. Two accumulations with the same fingerprint hold samples of the same image.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::fnv::Fnv;
use crate::device::{SceneAccess, Traversal};
use crate::frame::Sampler;
use crate::image::{Extent, Image};
use crate::scene::rig::Rig;
use crate::scene::{Environment, Mesh, Scene};
use crate::stages::shader_text_of;

/// Everything that decides an accumulation's samples.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    pub scene: &'a Scene,
    pub rig: &'a Rig,
    pub time_s: f64,
    pub extent: Extent,
    pub seed: u32,
    /// Frame number, which seeds its random numbers.
    pub frame: u32,
    pub sampler: Sampler,
    pub bounces: u32,
    pub pass_spp: u32,
    /// Ray traversal of the devices.
    pub traversal: Traversal,
}

/// A subject as names and values. Scene, camera and shaders are given by their hashes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Fingerprint(BTreeMap<String, String>);

/// Name of the entry for the ray traversal, which is absent if compute shaders traverse rays.
const TRAVERSAL: &str = "traversal";

/// Shaders of the tracing stages. Their results may change between versions.
const SHADERS: [&str; 3] = ["gbuffer", "path_trace", "tonemap"];

impl Fingerprint {
    pub fn of(subject: &Subject<'_>) -> Self {
        let camera: Vec<_> = subject.rig.eyes().map(|eye| subject.rig.view(subject.time_s, eye)).collect();
        let optics = subject.rig.optics;
        let text = |value: &dyn std::fmt::Debug| format!("{value:?}").to_lowercase();
        let traversal = subject.traversal;
        let access = SceneAccess { traversal, ..Default::default() };
        let entries = [
            ("scene", scene_hash(subject.scene)),
            ("camera", hash(|h| write!(h, "{camera:?}"))),
            ("size", subject.extent.to_string()),
            ("seed", subject.seed.to_string()),
            ("frame", subject.frame.to_string()),
            ("sampler", text(&subject.sampler)),
            // 0 and 1 bounces are equivalent.
            ("bounces", subject.bounces.max(1).to_string()),
            ("pass_spp", subject.pass_spp.to_string()),
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ("shaders", hash(|h| SHADERS.iter().try_for_each(|s| h.write_str(&shader_text_of(s, access))))),
        ];
        let special = (traversal != Traversal::Compute).then(|| (TRAVERSAL, traversal.name().to_owned()));
        let shown =
            optics.map(|optics| ("eyes", hash(|h| write!(h, "{optics:?}{}", shader_text_of("to_eye", access)))));
        Self(entries.into_iter().chain(special).chain(shown).map(|(name, value)| (name.to_owned(), value)).collect())
    }

    /// Returns a name for files: 16 hexadecimal digits.
    pub fn key(&self) -> String {
        hash(|h| write!(h, "{:?}", self.0))
    }

    /// Returns the differences as parts of sentences: "size is 64x36 there and 32x18 here".
    pub fn differences(&self, here: &Self) -> Vec<String> {
        let names: std::collections::BTreeSet<_> = self.0.keys().chain(here.0.keys()).collect();
        let otherwise = |name: &str| if name == TRAVERSAL { Traversal::Compute.name() } else { "absent" };
        let value = |of: &Self, name: &str| of.0.get(name).map_or(otherwise(name).to_owned(), Clone::clone);
        let differs = |name: &&&String| self.0.get(**name) != here.0.get(**name);
        let say = |name: &String| format!("{name} is {} there and {} here", value(self, name), value(here, name));
        names.iter().filter(differs).map(|name| say(name)).collect()
    }
}

fn hash(write: impl FnOnce(&mut Fnv) -> std::fmt::Result) -> String {
    let mut fnv = Fnv::new();
    // Writing to a hash cannot fail.
    let _ = write(&mut fnv);
    fnv.hex()
}

/// Returns a hash of everything visible. It excludes names, cameras and warnings.
fn scene_hash(scene: &Scene) -> String {
    let mut fnv = Fnv::new();
    for mesh in &scene.meshes {
        let Mesh { positions, normals, tangents, uvs: [uv0, uv1], colors, triangles, material, .. } = mesh;
        for bytes in [
            bytemuck::cast_slice(positions),
            bytemuck::cast_slice(normals),
            bytemuck::cast_slice(tangents),
            bytemuck::cast_slice(uv0),
            bytemuck::cast_slice(uv1),
            bytemuck::cast_slice(colors),
            bytemuck::cast_slice(triangles),
            bytemuck::bytes_of(material),
        ] {
            array(&mut fnv, bytes);
        }
    }
    for image in &scene.images {
        array(&mut fnv, bytemuck::cast_slice(&image.pixels));
    }
    let mut sky = scene.environment.clone();
    if let Environment::Map { image, .. } = &mut sky {
        array(&mut fnv, bytemuck::cast_slice(&image.pixels));
        *image = Arc::new(Image { extent: image.extent, pixels: Vec::new() });
    }
    let Scene { instances, materials, textures, lights, .. } = scene;
    let sizes: Vec<Extent> = scene.images.iter().map(|i| i.extent).collect();
    // Writing to a hash cannot fail.
    let _ = write!(fnv, "{instances:?}{materials:?}{textures:?}{lights:?}{sizes:?}{sky:?}");
    fnv.hex()
}

fn array(fnv: &mut Fnv, bytes: &[u8]) {
    fnv.bytes(&bytes.len().to_le_bytes());
    fnv.bytes(bytes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::load::load_shot;

    fn with(change: impl FnOnce(&mut Scene, &mut Subject<'_>)) -> Fingerprint {
        let (shot, mut scene) = load_shot("builtin:cornell").unwrap();
        let still = scene.clone();
        let mut subject = Subject {
            scene: &still,
            rig: &shot.rig,
            time_s: 0.0,
            extent: Extent::new(64, 36),
            seed: 0,
            frame: 0,
            sampler: Sampler::Sobol,
            bounces: 6,
            pass_spp: 8,
            traversal: Traversal::Compute,
        };
        change(&mut scene, &mut subject);
        Fingerprint::of(&Subject { scene: &scene, ..subject })
    }

    #[test]
    fn differences_of_fingerprints_are_named() {
        let here = with(|_, _| ());
        assert_eq!(here, with(|_, _| ()));
        let changed: [(&str, Fingerprint); 8] = [
            ("size is 32x18 there and 64x36 here", with(|_, s| s.extent = Extent::new(32, 18))),
            ("seed is 3 there and 0 here", with(|_, s| s.seed = 3)),
            ("sampler is pcg there and sobol here", with(|_, s| s.sampler = Sampler::Pcg)),
            ("bounces is 2 there", with(|_, s| s.bounces = 2)),
            ("camera is ", with(|_, s| s.time_s = 1.0)),
            ("scene is ", with(|scene, _| scene.meshes[0].positions[0].x += 1e-3)),
            ("scene is ", with(|scene, _| scene.materials[0].base_color.x *= 0.5)),
            ("scene is ", with(|scene, _| scene.environment = Environment::Constant(glam::Vec3::ONE))),
        ];
        for (part, there) in changed {
            let differences = there.differences(&here);
            assert_eq!(differences.len(), 1, "{part}: {differences:?}");
            assert!(differences[0].starts_with(part), "{part}: {differences:?}");
            assert_ne!(there.key(), here.key());
        }
    }

    #[test]
    fn traversal_is_named_beside_its_shaders() {
        let [here, there] = Traversal::ALL.map(|traversal| with(|_, s| s.traversal = traversal));
        let differences = there.differences(&here);
        assert_eq!(differences.len(), 2, "{differences:?}");
        assert!(differences[0].starts_with("shaders is "), "{differences:?}");
        assert_eq!(differences[1], "traversal is hardware there and compute here");
        assert_ne!(there.key(), here.key());
    }

    #[test]
    fn fingerprint_ignores_names_and_warnings() {
        let renamed = with(|scene, _| {
            scene.name = "another".into();
            scene.warnings.push("something".into());
        });
        assert_eq!(renamed, with(|_, _| ()));
    }
}
