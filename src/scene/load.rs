//! Loads the `SHOT` argument of a command line: the shot, and its scene with the shot's lights and environment.

use std::io;
use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use super::budget::Budget;
use super::complete::{Look, Overrides, complete};
use super::environment::read_latlong;
use super::error::Fault;
use super::folder::{self, Access, Folder, Source};
use super::motion::Motion;
use super::motion::play::{Choice, Move, Moved, Play};
use super::rig::Rig;
use super::shot::{Draft, SceneSource, Shot, ShotEnvironment, Sky};
use super::{Environment, Material, Scene, SceneError, builtin, gltf, studio};

/// Loads a shot like [`load_shot_within`], with the default [`Budget`], without overrides or access outside the files'
/// folders.
///
/// # Errors
/// [`SceneError`], naming the file.
pub fn load_shot(arg: &str) -> Result<(Shot, Scene), SceneError> {
    load_shot_within(arg, &Overrides::default(), Access::of(&Budget::default()))
}

/// Loads `builtin:NAME`, a `.toml` shot or a `.gltf`/`.glb`. [`complete`] fills in the values that a shot omits. A glTF
/// file acts as a shot that omits all of them.
///
/// # Errors
/// [`SceneError`], naming the file or the override.
pub fn load_shot_within(arg: &str, overrides: &Overrides, access: Access) -> Result<(Shot, Scene), SceneError> {
    let is_trusted = access.allow_outside || matches!(access.source, Source::Shot(_));
    let folder = Folder::of(Path::new(arg), Access { allow_outside: is_trusted, ..access });
    let (draft, mut scene) = open(arg, overrides, &folder, access)?;
    let overrides =
        &Overrides { look: if is_scene_file(arg) { overrides.look } else { Look::Plain }, ..overrides.clone() };
    let (shot, bounds) = if scene.motion.is_empty() {
        let shot = complete(draft, overrides, &mut scene, &Motion::default(), access.budget)?;
        (shot, studio::bounds_of_object(&scene))
    } else {
        let _copy = access.budget.reserve(scene.bytes_at()).map_err(|error| Fault::from(error).in_file(arg))?;
        let mut still = scene.at(overrides.time_s);
        let shot = complete(draft, overrides, &mut still, &scene.motion, access.budget)?;
        let bounds = studio::bounds_of_object(&still);
        scene.notes = still.notes;
        (shot, bounds)
    };
    let first = scene.lights.len();
    scene.lights.extend(shot.lights());
    shot.play.move_lights(&mut scene, first);
    if let Some(environment) = &shot.environment {
        let folder = match overrides.environment {
            // The user may name files anywhere.
            Some(_) => Folder::of(Path::new(""), Access { allow_outside: true, ..access }),
            None => folder,
        };
        put_around(&mut scene, environment, &shot.rig, arg, &folder)?;
        if let (Sky::Studio, Environment::Map { image, .. }) = (&environment.sky, scene.environment.clone()) {
            studio::add_ground(&mut scene, &bounds, &shot.rig, &image);
        }
    }
    scene.warnings.extend(lost_light(&scene));
    Ok((shot, scene))
}

/// Returns a warning if a scene with delta lights has smooth glass with a volume: the glass refracts their light into
/// paths that cannot be sampled.
pub(super) fn lost_light(scene: &Scene) -> Option<String> {
    let lights = scene.lights.iter().filter(|light| light.is_delta()).count();
    // An index of refraction of 1 does not bend light, at any roughness.
    let is_lost = |m: &&Material| m.may_transmit_smoothly() || (m.ior - 1.0).abs() < 1e-3;
    let refracts = |m: &&Material| m.enclosed_volume().is_some() && is_lost(m);
    let used = scene.instances.iter().map(|instance| &scene.materials[scene.meshes[instance.mesh].material]);
    let glass = used.filter(refracts).map(|m| m.name.as_str()).next().filter(|_| lights > 0)?;
    Some(format!(
        "{lights} delta light(s) (suns, points and spots without a radius) cast no light through smooth glass that has a \
         volume (material '{glass}'): use emissive surfaces, lights with a radius or a roughness of at least 0.011"
    ))
}

/// True if the argument names a glTF file.
fn is_scene_file(arg: &str) -> bool {
    let extension = Path::new(arg).extension().map(|e| e.to_ascii_lowercase());
    !arg.starts_with("builtin:") && extension.is_some_and(|e| e == "gltf" || e == "glb")
}

/// Reads a shot, scene file or built-in scene, including the scene that a shot names. `folder` is that of the shot, and
/// `access` applies to files that the scene names.
fn open(arg: &str, overrides: &Overrides, folder: &Folder, access: Access) -> Result<(Draft, Scene), SceneError> {
    let path = Path::new(arg);
    let extension = path.extension().map(|e| e.to_ascii_lowercase().to_string_lossy().into_owned());
    let asked = |draft: Draft| Draft { animation: overrides.animation.clone().or(draft.animation.clone()), ..draft };
    let draft = match (access.source, arg.strip_prefix("builtin:"), extension.as_deref()) {
        (Source::Shot(text), ..) => Draft::parse(text, arg)?,
        (_, Some(name), _) => Draft::parse(builtin::find(name)?.shot, arg)?,
        (_, None, Some("toml")) => Draft::parse(&read_text(path, access)?, arg)?,
        (_, None, Some("gltf" | "glb")) => {
            let [name, stem] = [path.file_name(), path.file_stem()].map(|p| p.unwrap_or_default().to_string_lossy());
            let draft = asked(Draft::of(SceneSource::File(name.into_owned()), stem.into_owned()));
            let scene = gltf::load(path, &draft.play(), overrides.variant.as_deref(), access)?;
            return Ok((draft, scene));
        }
        _ => {
            let what =
                "give a shot (.toml), a scene (.gltf, .glb) or builtin:NAME; Blender and assimp convert other formats \
                        to glTF, for example `assimp export house.obj house.glb`"
                    .to_owned();
            return Err(SceneError::Invalid { path: arg.to_owned(), what });
        }
    };
    let draft = asked(draft);
    match draft.scene.clone() {
        SceneSource::Builtin(name) => {
            let builtin = builtin::find(&name)?;
            let is_seen = !draft.rig.keys.is_empty();
            let draft = if is_seen { draft } else { draft.or(Draft::parse(builtin.shot, &name)?) };
            let mut scene = builtin.build();
            play_builtin(&mut scene, &draft.play(), arg)?;
            Ok((draft, scene))
        }
        SceneSource::File(name) => {
            let path = folder.find(&name).map_err(|error| error.in_file(arg))?;
            let scene = gltf::load(&path, &draft.play(), overrides.variant.as_deref(), access)?;
            Ok((draft, scene))
        }
    }
}

/// Applies playback settings to a built-in scene, whose nodes a shot cannot move.
fn play_builtin(scene: &mut Scene, play: &Play, arg: &str) -> Result<(), SceneError> {
    let invalid = |what| Err(SceneError::Invalid { path: arg.to_owned(), what });
    if let Some(Move { of: Moved::Node(name), .. }) = play.moves.iter().find(|m| matches!(m.of, Moved::Node(_))) {
        return invalid(format!("[[move]] names node '{name}', but in a built-in scene it can only name a light"));
    }
    match &play.animation {
        Choice::All => scene.motion.loops = play.loops,
        Choice::None => *scene = scene.at(0.0),
        Choice::Named(name) if scene.motion.animations.iter().all(|a| a.name != *name) => {
            let names: Vec<_> = scene.motion.animations.iter().map(|a| a.name.as_str()).collect();
            let hint = if names.is_empty() { "none, since it is static".to_owned() } else { names.join(", ") };
            return invalid(format!("it has no animation named '{name}': it has {hint}"));
        }
        Choice::Named(name) => {
            scene.motion.loops = play.loops;
            scene.motion.animations.retain(|a| a.name == *name);
        }
    }
    Ok(())
}

fn read_text(path: &Path, access: Access) -> Result<String, SceneError> {
    let held = folder::read(path, access).map_err(|error| error.in_file(path))?;
    let no_text = |error| SceneError::Read {
        path: path.display().to_string(),
        source: io::Error::new(io::ErrorKind::InvalidData, error),
    };
    String::from_utf8(held.bytes).map_err(no_text)
}

/// Sets the scene's environment. An image's path is relative to `folder`. If access to the image is denied, the error
/// names `origin`, the file that refers to it. Built-in environments face the first view of the rig.
fn put_around(
    scene: &mut Scene,
    environment: &ShotEnvironment,
    rig: &Rig,
    origin: &str,
    folder: &Folder,
) -> Result<(), SceneError> {
    scene.environment = match &environment.sky {
        Sky::Constant(radiance) => constant(*radiance * environment.scale),
        Sky::Image(name) => {
            let path = folder.find(name).map_err(|error| error.in_file(origin))?;
            let (image, bad_pixels) = read_latlong(&path, environment.scale, folder.access)?;
            if bad_pixels > 0 {
                let path = path.display();
                scene.warnings.push(format!(
                    "{bad_pixels} pixels of '{path}' have negative or non-finite values, which are taken as 0"
                ));
            }
            let rotation_deg = environment.rotation_deg;
            Environment::Map { image: Arc::new(image), rotation_deg }
        }
        Sky::Studio | Sky::Clear => {
            let mut image = if environment.sky == Sky::Studio { studio::studio() } else { studio::sky() };
            let bytes = size_of_val(&image.pixels[..]) as u64;
            folder.access.budget.reserve(bytes).map_err(|error| Fault::from(error).in_file(origin))?.keep();
            image
                .pixels
                .as_flattened_mut()
                .iter_mut()
                .for_each(|channel| *channel = (*channel * environment.scale).min(f32::MAX));
            let rotation_deg = environment.rotation_deg + studio::rotation_deg(rig);
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
    use glam::Affine3A;

    use super::super::{Instance, Mesh, Volume};
    use super::*;
    use crate::image::{Extent, Image, exr};

    /// Loads a shot with these tables whose scene is a triangle in a glTF file in `folder`.
    fn load_in(folder: &Path, tables: &str, overrides: &Overrides) -> Result<(Shot, Scene), SceneError> {
        let mesh =
            Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let instances = vec![Instance { mesh: 0, world_from_local: Affine3A::IDENTITY }];
        let materials = vec![Material::default()];
        let scene = Scene { meshes: vec![mesh], instances, materials, ..Scene::empty("triangle") };
        gltf::write(&folder.join("triangle.glb"), &scene)?;
        let shot = folder.join("shot.toml");
        let key = "[[rig.key]]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\n";
        std::fs::write(&shot, format!("scene = 'triangle.glb'\n{key}{tables}")).unwrap();
        let budget = Budget::unlimited();
        load_shot_within(shot.to_str().unwrap(), overrides, Access::of(&budget))
    }

    #[test]
    fn shot_sets_lights_and_environment() {
        let folder = tempfile::tempdir().unwrap();
        let lit = "[environment]\nradiance = [1, 2, 3]\nscale = 2\n[[light]]\nkind = 'point'\nposition = [0, 1, 0]";
        let load = |tables| load_in(folder.path(), tables, &Overrides::default()).unwrap().1;
        let scene = load(lit);
        assert_eq!((scene.lights.len(), scene.environment), (1, Environment::Constant(Vec3::new(2.0, 4.0, 6.0))));
        assert_eq!(load("").environment, Environment::Black);
        assert_eq!(load("[environment]\nscale = 0").environment, Environment::Black);
    }

    #[test]
    fn bare_file_loads_like_an_empty_shot() {
        let folder = tempfile::tempdir().unwrap();
        load_in(folder.path(), "", &Overrides::default()).unwrap();
        let (shot, scene) = load_shot(folder.path().join("triangle.glb").to_str().unwrap()).unwrap();
        assert_eq!((shot.name.as_str(), &shot.scene), ("triangle", &SceneSource::File("triangle.glb".into())));
        assert_eq!(scene.environment, Environment::Constant(Vec3::ONE));
        assert!(scene.notes[0].contains("no camera in the file"), "{:?}", scene.notes);

        let studio = Overrides { look: Look::Studio, ..Overrides::default() };
        let budget = Budget::unlimited();
        let lit = |name: &str| {
            let path = folder.path().join(name).display().to_string();
            load_shot_within(&path, &studio, Access::of(&budget)).unwrap().1
        };
        assert!(matches!(lit("triangle.glb").environment, Environment::Map { .. }));
        let on_a_ground = 1 + studio::GROUND_TRIANGLES;
        assert_eq!(lit("triangle.glb").triangle_count(), on_a_ground);
        assert_eq!(lit("shot.toml").environment, Environment::Black, "a shot has its own look");

        let alone = folder.path().join("atrium.toml");
        std::fs::write(&alone, "scene = 'builtin:atrium'\n[exposure]\nev = 3").unwrap();
        let (shot, _) = load_shot(alone.to_str().unwrap()).unwrap();
        let (builtin, _) = load_shot("builtin:atrium").unwrap();
        assert_eq!(shot, Shot { exposure_ev: 3.0, ..builtin });
    }

    #[test]
    fn sky_images_are_relative_to_the_shot() {
        let folder = tempfile::tempdir().unwrap();
        let sky = Image { extent: Extent::new(2, 1), pixels: vec![[1.0, 2.0, 3.0], [-1.0, 0.0, 0.0]] };
        exr::write_rgb(&folder.path().join("sky.exr"), &sky).unwrap();
        let (_, scene) = load_in(folder.path(), "[environment]\nimage = 'studio'", &Overrides::default()).unwrap();
        assert!(matches!(&scene.environment, Environment::Map { rotation_deg: 0.0, .. }));

        let lit = "[environment]\nimage = 'sky.exr'\nscale = 2\nrotation_deg = 30";
        let (_, scene) = load_in(folder.path(), lit, &Overrides::default()).unwrap();
        let Environment::Map { image, rotation_deg } = &scene.environment else { panic!("{:?}", scene.environment) };
        assert_eq!((image.pixels[0], *rotation_deg), ([2.0, 4.0, 6.0], 30.0));
        assert_eq!(scene.warnings.len(), 1);

        // The user may name files anywhere.
        let elsewhere = tempfile::tempdir().unwrap();
        let name = folder.path().join("sky.exr").display().to_string();
        let sky = ShotEnvironment { sky: Sky::Image(name), scale: 1.0, rotation_deg: 0.0 };
        let wanted = Overrides { environment: Some(sky), ..Overrides::default() };
        let (_, scene) = load_in(elsewhere.path(), "[environment]", &wanted).unwrap();
        assert!(matches!(&scene.environment, Environment::Map { image, .. } if image.pixels[0] == [1.0, 2.0, 3.0]));
        let error = load_in(elsewhere.path(), lit, &Overrides::default()).unwrap_err();
        assert!(error.to_string().contains("sky.exr"), "{error}");
    }

    #[test]
    fn delta_lights_before_solid_glass_cause_a_warning() {
        let folder = tempfile::tempdir().unwrap();
        let warnings = |material: Material, light: &str| {
            let mut scene = load_in(folder.path(), &format!("[[light]]\n{light}"), &Overrides::default()).unwrap().1;
            scene.materials[0] = Material { name: "pane".to_owned(), ..material };
            lost_light(&scene)
        };
        let point = "kind = 'point'\nposition = [0, 1, 0]";
        let volume = Some(Volume { attenuation_color: Vec3::ONE, attenuation_distance: 1.0 });
        let glass = Material { transmission: 1.0, roughness: 0.0, ..Material::default() };
        let solid = Material { volume, ..glass.clone() };
        let warning = warnings(solid.clone(), point).expect("a warning");
        assert!(warning.contains("'pane'") && warning.starts_with("1 "), "{warning}");
        assert!(warnings(Material { roughness: 0.3, ior: 1.0, ..solid.clone() }, point).is_some());
        let harmless =
            [glass, Material { transmission: 0.0, ..solid.clone() }, Material { roughness: 0.3, ..solid.clone() }];
        for material in harmless {
            assert_eq!(warnings(material, point), None);
        }
        assert_eq!(warnings(solid, &format!("{point}\nradius_m = 0.1")), None);
    }

    fn is_lit(scene: &Scene) -> bool {
        !scene.lights.is_empty() || scene.environment != Environment::Black
    }

    #[test]
    fn every_builtin_scene_loads_with_light() {
        for builtin in builtin::BUILTINS {
            let (shot, scene) = load_shot(&format!("builtin:{}", builtin.name)).unwrap();
            assert_eq!(shot.scene, SceneSource::Builtin(builtin.name.to_owned()));
            let emits = scene.materials.iter().any(|m| m.emissive.max_element() > 0.0);
            assert!(scene.triangle_count() > 0 && (emits || is_lit(&scene)), "{}", builtin.name);
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
            assert!(scene.triangle_count() > 0 && is_lit(&scene), "{name}");
        }
    }

    #[test]
    fn shot_of_the_caller_can_name_files_anywhere() {
        let folder = tempfile::tempdir().unwrap();
        load_in(folder.path(), "", &Overrides::default()).unwrap();
        let path = folder.path().join("triangle.glb").display().to_string();
        let text = format!("scene = '{path}'\n[[rig.key]]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\n");
        let budget = Budget::unlimited();
        let access = Access { source: Source::Shot(&text), ..Access::of(&budget) };
        let (shot, scene) = load_shot_within("dict", &Overrides::default(), access).unwrap();
        assert_eq!((shot.name.as_str(), scene.triangle_count()), ("dict", 1));
        let file = folder.path().join("shot.toml");
        std::fs::write(&file, &text).unwrap();
        let error = load_shot(file.to_str().unwrap()).unwrap_err().to_string();
        assert!(error.contains("not below its own folder"), "{error}");
    }

    #[test]
    fn rejects_missing_and_unknown_scenes() {
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
