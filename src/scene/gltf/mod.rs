//! Reads glTF 2.0 (`.gltf` with its files, or `.glb`) into a [`Scene`], and [writes](write()) one.
//!
//! Files are untrusted: every index, offset, count and size is checked where it is used, before memory is allocated. A
//! failure is a [`SceneError`] that names the faulty part of the file; [`Scene::warnings`] lists the parts that are
//! read only partially.
//!
//! - One [`Mesh`](crate::scene::Mesh) per (mesh, primitive) in the scene, shared by its instances, with only
//!   the vertices that its triangles use.
//! - Mirroring transforms (negative determinant) stay in [`Instance::world_from_local`]. glTF then reverses
//!   the winding of the instance's triangles, which is left to the code that flattens instances.
//! - Meshes of materials with a normal map have tangents: the file's, else those of MikkTSpace, for which
//!   vertices are split if necessary.
//! - A material of the file starts from glTF's defaults. A mesh without one has [`Material::default`], white and
//!   Lambertian, where glTF specifies a white metal.
//! - Animations become the scene's [`Motion`]. Skins and morph targets that nothing animates are baked. The
//!   transform of a skinned mesh's own node is ignored.
//! - Animations may target nodes, morph weights, and by `KHR_animation_pointer` base colour, emission, light
//!   intensity and light colour. Occlusion textures are ignored.
//! - Photometric units are taken as radiometric ones: candela as W/sr, lux as W/m².

mod accessor;
mod animations;
mod buffers;
mod container;
mod draco;
mod extensions;
mod fault;
mod geometry;
mod hierarchy;
mod images;
mod instancing;
mod layers;
mod materials;
mod meshopt;
mod morphs;
mod motion;
mod placed;
mod skins;
mod tangents;
mod textures;
mod topology;
mod uri;
mod variants;
mod vertices;
mod write;

#[cfg(test)]
mod tests;

use std::path::Path;

use glam::DAffine3;

use self::buffers::Buffers;
use self::fault::{Fault, Outcome, Warnings, Within, label};
use self::geometry::Geometry;
use self::hierarchy::PlacedNode;
use self::materials::Surfaces;
use self::motion::{Candidate, Plan};
pub use self::write::write;
use super::folder::{self, Access, Folder};
use super::motion::Motion;
use super::motion::play::Play;
use super::motion::pose::narrow;
use super::{Environment, Instance, Material, Scene, SceneError};

/// Limit on instances. Files with more are taken for damaged or hostile.
const MAX_INSTANCES: usize = 1 << 22;

/// Upper bound on the bytes per instance in a growing list, including the list's spare capacity.
const INSTANCE_BYTES: usize = 3 * size_of::<Instance>();

/// Reads the default scene of the file at `path`, whose references are relative to its folder. `play` selects the
/// scene's motion, and `variant` is the name of a material variant; `None` is the default look.
///
/// # Errors
/// [`SceneError::Read`] names a file that cannot be read, [`SceneError::Extensions`] the unsupported required
/// extensions, [`SceneError::Invalid`] the invalid part of the file, or the animation, node or variant that it lacks,
/// [`SceneError::Refused`] a request that `access` has no room for or does not allow.
pub fn load(path: &Path, play: &Play, variant: Option<&str>, access: Access) -> Result<Scene, SceneError> {
    let read = || parse(&folder::read(path, access)?, path, play, variant, access);
    read().map_err(|fault| fault.in_file(path))
}

/// Parses `bytes` that were read from `path`.
fn parse(bytes: &[u8], path: &Path, play: &Play, variant: Option<&str>, access: Access) -> Outcome<Scene> {
    let container = container::parse(bytes, access.budget)?;
    let root = &container.root;
    let mut warnings = Warnings::default();
    extensions::check(root, &mut warnings)?;
    let folder = Folder::of(path, access);
    let buffers = Buffers::new(root, container.bin, &folder);
    let nodes = hierarchy::walk(root, &mut warnings)?;
    let plan = Plan::new(&buffers, &container.animations, &nodes, play, &mut warnings)?;

    let Surfaces { mut materials, textures, images } = materials::read(&buffers, &mut warnings)?;
    let wanted = plan.wanted();
    let variant = variants::find(root, variant)?;
    let mut geometry = Geometry::new(&buffers, &materials, &wanted, variant);
    let (instances, candidates) = place_meshes(&buffers, &nodes, &plan, &mut geometry, &mut warnings)?;
    let lights = placed::lights(root, &nodes, &mut warnings)?;
    let (cameras, camera_places): (Vec<_>, Vec<_>) = placed::cameras(root, &nodes, &mut warnings)?.into_iter().unzip();
    let needs_default = materials.is_empty() || geometry.uses_default_material();
    let meshes = geometry.into_meshes();
    if needs_default {
        materials.push(Material::default());
    }
    let mut scene = Scene {
        name: path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default(),
        meshes,
        instances,
        materials,
        textures,
        images,
        lights: lights.iter().map(|l| l.light).collect(),
        environment: Environment::Black,
        cameras,
        motion: Motion::default(),
        warnings: Vec::new(),
        notes: Vec::new(),
    };
    plan.put_into(&mut scene, &candidates, &lights, &camera_places, &mut warnings)?;
    scene.warnings = warnings.into_texts();
    Ok(scene)
}

fn too_many_instances() -> Fault {
    Fault::Invalid(format!("it places more than {MAX_INSTANCES} primitives"))
}

fn place_meshes(
    buffers: &Buffers,
    nodes: &[PlacedNode],
    plan: &Plan,
    geometry: &mut Geometry,
    warnings: &mut Warnings,
) -> Outcome<(Vec<Instance>, Vec<Candidate>)> {
    let (mut instances, mut candidates) = (Vec::new(), Vec::new());
    for (place, placed) in nodes.iter().enumerate() {
        let node = &buffers.root.nodes[placed.node];
        let Some(index) = node.mesh.filter(|_| placed.is_visible) else { continue };
        let within = || label("node", placed.node, &node.name);
        let meshes = geometry.primitives_of(index.value(), warnings).within(within)?;
        let copies = instancing::places(buffers, node).within(within)?;
        let count = meshes.len().saturating_mul(copies.as_ref().map_or(1, Vec::len));
        if instances.len().saturating_add(count) > MAX_INSTANCES {
            return Err(too_many_instances());
        }
        buffers.budget().reserve((count * INSTANCE_BYTES) as u64)?.keep();
        let first = instances.len();
        let own = || vec![DAffine3::IDENTITY];
        for node_from_copy in copies.clone().unwrap_or_else(own) {
            let world_from_local = narrow(&(placed.world_from_node * node_from_copy));
            if !world_from_local.is_finite() {
                return Err(Fault::Invalid("its instances are not finite".into())).within(within);
            }
            instances.extend(meshes.clone().map(|mesh| Instance { mesh, world_from_local }));
        }
        if copies.is_some() && plan.is_candidate(place) {
            warnings.note("instances of a moving or deformed node stand still", &within());
        } else if plan.is_candidate(place) {
            candidates.extend((first..instances.len()).map(|instance| Candidate { instance, place }));
        }
    }
    Ok((instances, candidates))
}
