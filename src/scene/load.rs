//! From a command line's `SHOT` to a shot and the scene it shows, with the shot's lights and environment in it.

use std::io;
use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use super::budget::Budget;
use super::environment::read_latlong;
use super::folder::{self, Access, Folder};
use super::rig::{Rig, RigKey};
use super::shot::{Gaze, SceneSource, Shot, ShotEnvironment, Sky};
use super::viewpoint::Viewpoint;
use super::{Environment, Scene, SceneError, builtin, gltf, viewpoint};

/// [`load_shot_within`] half of the host's memory and the folders of the files.
///
/// # Errors
/// [`SceneError`], naming the file.
pub fn load_shot(arg: &str) -> Result<(Shot, Scene), SceneError> {
    load_shot_within(arg, Access { budget: &Budget::of_host(), allow_outside: false })
}

/// Loads `builtin:NAME`, a `.toml` shot, or a `.gltf`/`.glb`.
///
/// A glTF file is seen by its first camera, or from where [`viewpoint::find`] puts one, by its own lights; if it has
/// none but surfaces that emit, in a white environment of radiance 1.
///
/// # Errors
/// [`SceneError`], naming the file.
pub fn load_shot_within(arg: &str, access: Access) -> Result<(Shot, Scene), SceneError> {
    let path = Path::new(arg);
    let folder = Folder::of(path, access);
    if let Some(name) = arg.strip_prefix("builtin:") {
        let shot = Shot::parse(builtin::find(name)?.shot, arg)?;
        return load_scene_of(shot, arg, &folder);
    }
    let extension = path.extension().map(|e| e.to_ascii_lowercase().to_string_lossy().into_owned());
    match extension.as_deref() {
        Some("toml") => {
            let shot = Shot::parse(&read_text(path, access)?, arg)?;
            load_scene_of(shot, arg, &folder)
        }
        Some("gltf" | "glb") => load_bare_gltf(path, &folder),
        _ => Err(SceneError::Invalid {
            path: arg.to_owned(),
            what: "give a shot (.toml), a scene (.gltf, .glb) or builtin:NAME".to_owned(),
        }),
    }
}

fn read_text(path: &Path, access: Access) -> Result<String, SceneError> {
    let name = path.display().to_string();
    let held = folder::read(path, access.budget).map_err(|error| error.in_file(&name))?;
    let no_text = |error| SceneError::Read { path: name, source: io::Error::new(io::ErrorKind::InvalidData, error) };
    String::from_utf8(held.bytes).map_err(no_text)
}

/// `origin` is the shot's file; names in it start from `folder`.
fn load_scene_of(shot: Shot, origin: &str, folder: &Folder) -> Result<(Shot, Scene), SceneError> {
    let mut scene = match &shot.scene {
        SceneSource::Builtin(name) => (builtin::find(name)?.build)(),
        SceneSource::File(name) => {
            let path = folder.find(name).map_err(|error| error.in_file(origin))?;
            gltf::load(&path, folder.access)?
        }
    };
    apply(&shot, origin, folder, &mut scene)?;
    Ok((shot, scene))
}

fn load_bare_gltf(path: &Path, folder: &Folder) -> Result<(Shot, Scene), SceneError> {
    let mut scene = gltf::load(path, folder.access)?;
    let shot = shot_for(&mut scene, path, folder.access.budget);
    apply(&shot, &path.display().to_string(), folder, &mut scene)?;
    Ok((shot, scene))
}

/// The shot of a scene that came without one.
fn shot_for(scene: &mut Scene, path: &Path, budget: &Budget) -> Shot {
    let white = ShotEnvironment { sky: Sky::Constant(Vec3::ONE), scale: 1.0, rotation_deg: 0.0 };
    Shot {
        name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        scene: SceneSource::File(path.display().to_string()),
        rig: match scene.cameras.first() {
            Some(&camera) => Rig::from_camera(camera),
            None => found_rig(scene, budget),
        },
        environment: (!has_light(scene)).then_some(white),
        lights: Vec::new(),
        gaze: Gaze::default(),
        exposure_ev: 0.0,
    }
}

/// A rig for a scene without a camera, of which the scene's warnings tell.
fn found_rig(scene: &mut Scene, budget: &Budget) -> Rig {
    let Viewpoint { rig, is_inside } = viewpoint::find(scene, budget);
    let RigKey { position, target, .. } = rig.keys[0];
    let place = if is_inside { "within it" } else { "before it" };
    scene.warnings.push(format!(
        "the file has no camera: one was put {place}, at {position:.3}, looking at {target:.3}; a shot says another place"
    ));
    rig
}

/// Surfaces that emit do not count: they are displays and small lamps more often than what a scene is lit by.
fn has_light(scene: &Scene) -> bool {
    !scene.lights.is_empty() || scene.environment != Environment::Black
}

fn apply(shot: &Shot, origin: &str, folder: &Folder, scene: &mut Scene) -> Result<(), SceneError> {
    scene.lights.extend(shot.lights());
    let Some(environment) = &shot.environment else {
        return Ok(());
    };
    scene.environment = match &environment.sky {
        Sky::Constant(radiance) => constant(*radiance * environment.scale),
        Sky::Image(name) => {
            let path = folder.find(name).map_err(|error| error.in_file(origin))?;
            let (image, bad_pixels) = read_latlong(&path, environment.scale, folder.access.budget)?;
            if bad_pixels > 0 {
                let path = path.display();
                scene.warnings.push(format!(
                    "{bad_pixels} pixels of '{path}' have negative or non-finite values, which are taken as 0"
                ));
            }
            let rotation_deg = environment.rotation_deg;
            Environment::Map { image: Arc::new(image), rotation_deg }
        }
    };
    Ok(())
}

fn constant(radiance: Vec3) -> Environment {
    if radiance == Vec3::ZERO { Environment::Black } else { Environment::Constant(radiance) }
}

#[cfg(test)]
mod tests {
    use super::super::{Camera, Instance, Light, LightKind, Material, Mesh};
    use super::*;
    use crate::image::{Extent, Image, exr};
    use glam::Affine3A;

    fn triangle() -> Scene {
        let mesh =
            Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let instance = Instance { mesh: 0, world_from_local: Affine3A::IDENTITY };
        let (meshes, instances, materials) = (vec![mesh], vec![instance], vec![Material::default()]);
        Scene { meshes, instances, materials, ..Scene::empty("triangle") }
    }

    fn light() -> Light {
        let kind = LightKind::Point { position: Vec3::ONE, radius: 0.0 };
        Light { kind, strength: Vec3::ONE }
    }

    fn shot(environment: &str) -> Shot {
        let text = format!("scene = 'builtin:x'\n[[rig.key]]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\n{environment}");
        let text = text.replacen("[[rig.key]]", "[rig]\n[[rig.key]]", 1);
        Shot::parse(&text, "x.toml").unwrap()
    }

    /// As of a shot in that folder.
    fn apply_in(folder: &Path, shot: &Shot, scene: &mut Scene) -> Result<(), SceneError> {
        let access = Access { budget: &Budget::unlimited(), allow_outside: false };
        apply(shot, "x.toml", &Folder::of(&folder.join("x.toml"), access), scene)
    }

    #[test]
    fn a_bare_scene_is_looked_at_and_lit_white() {
        let mut scene = triangle();
        let shot = shot_for(&mut scene, Path::new("models/chair.glb"), &Budget::unlimited());
        apply_in(Path::new(""), &shot, &mut scene).unwrap();
        assert_eq!(shot.name, "chair");
        assert_eq!(scene.environment, Environment::Constant(Vec3::ONE));
        assert_eq!(shot.rig, viewpoint::find(&scene, &Budget::unlimited()).rig);
        assert!(matches!(&scene.warnings[..], [said] if said.contains("no camera")), "{:?}", scene.warnings);
    }

    #[test]
    fn a_scene_with_light_or_camera_keeps_them() {
        let mut scene = triangle();
        let camera = Camera { world_from_view: Affine3A::IDENTITY, yfov_rad: 0.5 };
        scene.cameras.push(camera);
        scene.lights.push(light());
        let shot = shot_for(&mut scene, Path::new("a.gltf"), &Budget::unlimited());
        assert_eq!((&shot.rig, &shot.environment), (&Rig::from_camera(camera), &None));
        assert!(scene.warnings.is_empty());

        let mut emissive = triangle();
        emissive.materials[0].emissive = Vec3::X;
        assert!(shot_for(&mut emissive, Path::new("a.gltf"), &Budget::unlimited()).environment.is_some());
    }

    #[test]
    fn lights_are_added_and_the_environment_replaced() {
        let mut scene = triangle();
        scene.lights.push(light());
        scene.environment = Environment::Constant(Vec3::ONE);
        let lit = "[environment]\nradiance = [1, 2, 3]\nscale = 2\n[[light]]\nkind = 'point'\nposition = [0, 1, 0]";
        apply_in(Path::new(""), &shot(lit), &mut scene).unwrap();
        assert_eq!(scene.lights.len(), 2);
        assert_eq!(scene.environment, Environment::Constant(Vec3::new(2.0, 4.0, 6.0)));
        apply_in(Path::new(""), &shot(""), &mut scene).unwrap();
        assert_eq!(scene.environment, Environment::Constant(Vec3::new(2.0, 4.0, 6.0)));
        apply_in(Path::new(""), &shot("[environment]\nscale = 0"), &mut scene).unwrap();
        assert_eq!(scene.environment, Environment::Black);
    }

    #[test]
    fn sky_images_are_relative_to_the_shot() {
        let folder = tempfile::tempdir().unwrap();
        let sky = Image { extent: Extent::new(2, 1), pixels: vec![[1.0, 2.0, 3.0], [-1.0, 0.0, 0.0]] };
        exr::write_rgb(&folder.path().join("sky.exr"), &sky).unwrap();
        let mut scene = triangle();
        let lit = shot("[environment]\nimage = 'sky.exr'\nscale = 2\nrotation_deg = 30");
        apply_in(folder.path(), &lit, &mut scene).unwrap();
        let Environment::Map { image, rotation_deg } = &scene.environment else { panic!("{:?}", scene.environment) };
        assert_eq!((image.pixels[0], *rotation_deg), ([2.0, 4.0, 6.0], 30.0));
        assert_eq!(scene.warnings.len(), 1);
        let error = apply_in(Path::new("nowhere"), &lit, &mut scene).unwrap_err();
        assert!(error.to_string().contains("sky.exr"), "{error}");
    }

    #[test]
    fn every_builtin_scene_loads_with_light() {
        for builtin in builtin::BUILTINS {
            let (shot, scene) = load_shot(&format!("builtin:{}", builtin.name)).unwrap();
            assert_eq!(shot.scene, SceneSource::Builtin(builtin.name.to_owned()));
            let emits = scene.materials.iter().any(|m| m.emissive.max_element() > 0.0);
            assert!(scene.triangle_count() > 0 && (emits || has_light(&scene)), "{}", builtin.name);
        }
    }

    #[test]
    fn shots_and_bare_files_on_disk_load_with_light() {
        let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes");
        let folder = std::env::var_os("DIPTYCH_SCENES").map_or(here, Into::into);
        let path = |name: &str| folder.join(name).display().to_string();
        if !folder.join("garage.toml").exists() {
            eprintln!("SKIPPED: no garage.toml in {}: set DIPTYCH_SCENES", folder.display());
            return;
        }
        for name in ["garage.toml", "garage/garage.gltf"] {
            let (shot, scene) = load_shot(&path(name)).unwrap();
            assert_eq!(shot.name, "garage");
            assert!(scene.triangle_count() > 0 && has_light(&scene), "{name}");
        }
    }

    #[test]
    fn what_cannot_be_loaded_is_named() {
        let says = |arg: &str, part: &str| {
            let error = load_shot(arg).unwrap_err().to_string();
            assert!(error.contains(arg) && error.contains(part), "{error}");
        };
        says("scene.obj", ".gltf");
        says("nothing", "builtin:NAME");
        says("", "builtin:NAME");
        says("no/such.toml", "cannot read");
        let folder = tempfile::tempdir().unwrap();
        let latin1 = folder.path().join("latin1.toml");
        std::fs::write(&latin1, b"name = \"\xe9\"").unwrap();
        says(latin1.to_str().unwrap(), "cannot read");
        assert!(load_shot("builtin:no-such-scene").is_err());
        assert!(load_shot("no/such.glb").is_err());
    }
}
