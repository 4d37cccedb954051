//! Reads glTF 2.0 (`.gltf` with its files, or `.glb`) into a [`Scene`], and [writes](write()) one.
//!
//! A file is somebody else's data: every index, offset, count and size in it is checked where it is used, before
//! memory is asked for. What cannot be read ends in one [`SceneError`] that names the place; what can be read
//! only in part is said in [`Scene::warnings`].
//!
//! - One [`Mesh`](crate::scene::Mesh) per (mesh, primitive) that the scene shows, shared by its instances, holding only
//!   the vertices that its triangles use.
//! - A mirroring transform (negative determinant) is left in [`Instance::world_from_local`]; glTF then means the
//!   winding of the instance's triangles to be reversed, which is up to whoever flattens the instances.
//! - A mesh whose material has a normal map has tangents: the file's, else those of MikkTSpace, for which vertices are
//!   split where needed.
//! - A material of the file starts from glTF's defaults. A mesh without one has [`Material::default`], white and
//!   Lambertian, where glTF would have a white metal.
//! - Occlusion textures, animations, skins and morph targets are left out (the rest pose is shown).
//! - Photometric units are taken as radiometric ones: candela as W/sr, lux as W/m².

mod accessor;
mod buffers;
mod container;
mod extensions;
mod fault;
mod geometry;
mod hierarchy;
mod images;
mod layers;
mod materials;
mod meshopt;
mod placed;
mod tangents;
mod textures;
mod uri;
mod write;

#[cfg(test)]
mod tests;

use std::path::Path;

use ::gltf::json::Root;

use self::buffers::Buffers;
use self::fault::{Fault, Outcome, Warnings, Within, label};
use self::geometry::Geometry;
use self::hierarchy::PlacedNode;
use self::materials::Surfaces;
pub use self::write::write;
use super::folder::{self, Access, Folder};
use super::motion::Motion;
use super::{Environment, Instance, Material, Scene, SceneError};

/// More instances than this are taken for a damaged or hostile file.
const MAX_INSTANCES: usize = 1 << 22;

/// What an instance takes in a list that grows.
const INSTANCE_BYTES: usize = 3 * size_of::<Instance>();

/// Reads the default scene of the file at `path`; files it refers to are looked up beside it.
///
/// # Errors
/// [`SceneError::Read`] names a file that cannot be read, [`SceneError::Extensions`] the required extensions that are
/// not supported, [`SceneError::Invalid`] the part of the file that is wrong, [`SceneError::Refused`] what `access` has
/// no room for or does not allow.
pub fn load(path: &Path, access: Access) -> Result<Scene, SceneError> {
    let bytes = folder::read(path, access.budget).map_err(|error| error.in_file(&path.display().to_string()))?;
    parse(&bytes, path, access).map_err(|fault| fault.in_file(path))
}

/// `path` is where the `bytes` come from.
fn parse(bytes: &[u8], path: &Path, access: Access) -> Outcome<Scene> {
    let container = container::parse(bytes, access.budget)?;
    let root = &container.root;
    let mut warnings = Warnings::default();
    extensions::check(root, &mut warnings)?;
    let folder = Folder::of(path, access);
    let buffers = Buffers::new(root, container.bin, &folder);
    let nodes = hierarchy::walk(root)?;
    warn_of_motion(root, &nodes, &mut warnings);

    let Surfaces { mut materials, textures, images } = materials::read(&buffers, &mut warnings)?;
    let mut geometry = Geometry::new(&buffers, &materials);
    let instances = place_meshes(&buffers, &nodes, &mut geometry, &mut warnings)?;
    let lights = placed::lights(root, &nodes, &mut warnings)?;
    let cameras = placed::cameras(root, &nodes, &mut warnings)?;
    let needs_default = materials.is_empty() || geometry.uses_default_material();
    let meshes = geometry.into_meshes();
    if needs_default {
        materials.push(Material::default());
    }
    Ok(Scene {
        name: path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default(),
        meshes,
        instances,
        materials,
        textures,
        images,
        lights,
        environment: Environment::Black,
        cameras,
        motion: Motion::default(),
        warnings: warnings.into_texts(),
    })
}

fn place_meshes(
    buffers: &Buffers,
    nodes: &[PlacedNode],
    geometry: &mut Geometry,
    warnings: &mut Warnings,
) -> Outcome<Vec<Instance>> {
    let mut instances = Vec::new();
    for placed in nodes {
        let node = &buffers.root.nodes[placed.node];
        let Some(index) = node.mesh else { continue };
        let meshes =
            geometry.primitives_of(index.value(), warnings).within(|| label("node", placed.node, &node.name))?;
        if instances.len() + meshes.len() > MAX_INSTANCES {
            return Err(Fault::Invalid(format!("it places more than {MAX_INSTANCES} primitives")));
        }
        let world_from_local = placed.world_from_local_f32();
        buffers.budget().reserve((meshes.len() * INSTANCE_BYTES) as u64)?.keep();
        instances.extend(meshes.map(|mesh| Instance { mesh, world_from_local }));
    }
    Ok(instances)
}

fn warn_of_motion(root: &Root, nodes: &[PlacedNode], warnings: &mut Warnings) {
    if !root.animations.is_empty() {
        warnings.note("animations are left out: the scene stands still", "");
    }
    for placed in nodes {
        let node = &root.nodes[placed.node];
        if node.skin.is_some() {
            warnings.note("skins are left out: meshes stand as if unskinned", &label("node", placed.node, &node.name));
        }
    }
}
