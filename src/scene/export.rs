//! Exports a shot and its scene, whether built in or read from files, as a plain glTF file and a shot file.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::motion::play::Play;
use super::shot::{SceneSource, Shot, ShotEnvironment, ShotLight, ShotLightKind, Sky};
use super::{Environment, Light, LightKind, Scene, SceneError, gltf};
use crate::image::exr;
use crate::image::file::atomic_write;

/// Writes `NAME.glb`, `NAME.toml` and, if the environment is an image, `NAME.exr` into `folder`, for the given name.
/// Returns the path of the TOML file. Loading it gives the same scene; the shot then holds all lights, including those
/// of the scene file. Motion is not exported: for a dynamic scene, pass the result of [`Scene::at`].
///
/// # Errors
/// [`SceneError`] if a file cannot be written.
pub fn export(shot: &Shot, scene: &Scene, folder: &Path, name: &str) -> Result<PathBuf, SceneError> {
    let scene_file = format!("{name}.glb");
    gltf::write(&folder.join(&scene_file), scene)?;
    let (sky, rotation_deg) = match &scene.environment {
        Environment::Black => (None, 0.0),
        Environment::Constant(radiance) => (Some(Sky::Constant(*radiance)), 0.0),
        Environment::Map { image, rotation_deg } => {
            let image_file = format!("{name}.exr");
            exr::write_rgb(&folder.join(&image_file), image)?;
            (Some(Sky::Image(image_file)), *rotation_deg)
        }
    };
    let exported = Shot {
        scene: SceneSource::File(scene_file),
        play: Play::default(),
        environment: sky.map(|sky| ShotEnvironment { sky, scale: 1.0, rotation_deg }),
        lights: scene.lights.iter().map(|light| shot_light(light, shot.rig.metres_per_unit)).collect(),
        ..shot.clone()
    };
    let path = folder.join(format!("{name}.toml"));
    atomic_write(&path, |file| file.write_all(exported.text().as_bytes()))?;
    Ok(path)
}

/// Returns a safe file name of a shot, which may have any name, even `../x`.
pub fn file_name(shot: &str) -> String {
    let name: String = shot.chars().map(|c| if c.is_alphanumeric() || c == '_' { c } else { '-' }).collect();
    if name.is_empty() { "shot".into() } else { name }
}

fn shot_light(light: &Light, metres_per_unit: f64) -> ShotLight {
    let metres = |units: f32| f64::from(units) * metres_per_unit;
    let degrees = |cos: f32| f64::from(cos).acos().to_degrees();
    let kind = match light.kind {
        LightKind::Point { position, radius } => ShotLightKind::Point { position, radius_m: metres(radius) },
        LightKind::Directional { direction, angle_rad } => {
            ShotLightKind::Directional { direction, angle_deg: f64::from(angle_rad).to_degrees() }
        }
        LightKind::Spot { position, radius, direction, cos_inner, cos_outer } => ShotLightKind::Spot {
            position,
            radius_m: metres(radius),
            direction,
            inner_cone_deg: degrees(cos_inner),
            outer_cone_deg: degrees(cos_outer),
        },
    };
    ShotLight { kind, strength: light.strength }
}

#[cfg(test)]
mod tests {
    use glam::{Affine2, Affine3A, Quat, Vec2, Vec3, Vec4};

    use super::*;
    use crate::image::{Extent, Image};
    use crate::scene::budget::Budget;
    use crate::scene::builtin::BUILTINS;
    use crate::scene::complete::{Overrides, complete};
    use crate::scene::load::{load_shot, lost_light};
    use crate::scene::motion::Motion;
    use crate::scene::shot::Draft;
    use crate::scene::{
        AlphaMode, Anisotropy, Clearcoat, DiffuseTransmission, Instance, Iridescence, Material, Mesh, NormalMap, Sheen,
        Texture, TextureRef, Volume, Wrap,
    };

    fn round_trip(shot: &Shot, scene: &Scene) -> (Shot, Scene) {
        let folder = tempfile::tempdir().unwrap();
        let path = export(shot, scene, folder.path(), &file_name(&shot.name)).unwrap();
        assert_eq!(path.parent(), Some(folder.path()), "{}", shot.name);
        load_shot(path.to_str().unwrap()).unwrap_or_else(|e| panic!("{}: {e}", shot.name))
    }

    fn near(a: &[f32], b: &[f32]) -> bool {
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 2e-6 * (1.0 + a.abs()))
    }

    /// Returns an attribute at each corner of each triangle; empty if it is absent.
    fn corners<T: Copy>(mesh: &Mesh, attribute: &[T]) -> Vec<T> {
        let indices = mesh.triangles.as_flattened();
        if attribute.is_empty() { Vec::new() } else { indices.iter().map(|&i| attribute[i as usize]).collect() }
    }

    /// Compares all values. Those that are rounded again when they are read may differ slightly: angles and lengths in
    /// metres.
    #[track_caller]
    fn assert_same(what: &str, (shot, scene): (&Shot, &Scene), (shot_read, read): (&Shot, &Scene)) {
        assert_eq!(read.warnings, Vec::from_iter(lost_light(scene)), "{what}");
        assert_eq!(read.materials, scene.materials, "{what}");
        assert_eq!((&read.textures, &read.images), (&scene.textures, &scene.images), "{what}");
        assert_eq!(read.environment, scene.environment, "{what}");
        assert_eq!(read.instances.len(), scene.instances.len(), "{what}");
        for (a, b) in scene.instances.iter().zip(&read.instances) {
            assert_eq!(a.world_from_local, b.world_from_local, "{what}");
            let (a, b) = (&scene.meshes[a.mesh], &read.meshes[b.mesh]);
            // Compares triangle corners, since unused vertices are dropped.
            assert!(a.material == b.material && corners(a, &a.positions) == corners(b, &b.positions), "{what}");
            assert!((0..2).all(|set| corners(a, &a.uvs[set]) == corners(b, &b.uvs[set])), "{what}");
            assert!(corners(a, &a.colors) == corners(b, &b.colors), "{what}");
            assert!(corners(a, &a.tangents) == corners(b, &b.tangents), "{what}");
            assert!(corners(a, &a.normals) == corners(b, &b.normals), "{what}");
        }
        assert_eq!(read.lights.len(), scene.lights.len(), "{what}");
        let numbers = |l: &Light| match l.kind {
            LightKind::Point { position, radius } => vec![position.x, position.y, position.z, radius],
            LightKind::Directional { direction: d, angle_rad } => vec![d.x, d.y, d.z, angle_rad],
            LightKind::Spot { position: p, radius, direction: d, cos_inner, cos_outer } => {
                vec![p.x, p.y, p.z, radius, d.x, d.y, d.z, cos_inner, cos_outer]
            }
        };
        for (a, b) in scene.lights.iter().zip(&read.lights) {
            assert_eq!(a.strength, b.strength, "{what}");
            let (kind_a, kind_b) = (std::mem::discriminant(&a.kind), std::mem::discriminant(&b.kind));
            assert!(kind_a == kind_b && near(&numbers(a), &numbers(b)), "{what}: {a:?}, {b:?}");
        }
        assert_eq!((&shot_read.gaze, shot_read.exposure_ev), (&shot.gaze, shot.exposure_ev), "{what}");
        assert_eq!(shot_read.settings, shot.settings, "{what}");
        assert_eq!(shot_read.rig.keys.len(), shot.rig.keys.len(), "{what}");
        for (a, b) in shot.rig.keys.iter().zip(&shot_read.rig.keys) {
            assert_eq!((a.time_s, a.position, a.target), (b.time_s, b.position, b.target), "{what}");
            assert!(a.up.abs_diff_eq(b.up, 1e-12), "{what}");
        }
        assert!((shot_read.rig.yfov_rad - shot.rig.yfov_rad).abs() < 1e-12, "{what}");
        assert_eq!(shot_read.rig.baseline_m, shot.rig.baseline_m, "{what}");
    }

    #[test]
    fn built_in_scenes_round_trip() {
        for builtin in BUILTINS {
            let (shot, scene) = load_shot(&format!("builtin:{}", builtin.name)).unwrap();
            let (shot_read, read) = round_trip(&shot, &scene);
            assert_same(builtin.name, (&shot, &scene), (&shot_read, &read));
        }
    }

    /// Returns a triangle with a material that uses every feature, and lights of every kind.
    fn everything() -> (Shot, Scene) {
        let texture = |i: usize| TextureRef {
            texture: i,
            uv_set: i % 2,
            uv_from_uv: match i {
                0 => Affine2::IDENTITY,
                1 => Affine2::from_scale_angle_translation(Vec2::splat(2.0), 0.0, Vec2::new(0.25, 0.5)),
                // Flips v with a negative scale.
                2 => Affine2::from_scale(Vec2::new(1.0, -1.0)),
                _ => Affine2::from_translation(Vec2::new(0.0, i as f32)),
            },
        };
        let map = |i: usize| Some(NormalMap { texture: texture(i), scale: 0.5 });
        let all = Material {
            name: "all".into(),
            base_color: Vec4::new(0.1, 0.2, 0.3, 0.4),
            base_color_texture: Some(texture(0)),
            metallic: 0.25,
            roughness: 0.75,
            metallic_roughness_texture: Some(texture(1)),
            normal_map: map(2),
            emissive: Vec3::new(17.0, 12.0, 0.1),
            emissive_texture: Some(texture(3)),
            alpha_mode: AlphaMode::Mask { cutoff: 0.3 },
            double_sided: true,
            ior: 1.33,
            specular: 0.5,
            specular_texture: Some(texture(4)),
            specular_color: Vec3::new(1.0, 0.5, 2.0),
            specular_color_texture: Some(texture(5)),
            transmission: 0.6,
            transmission_texture: Some(texture(6)),
            volume: Some(Volume { attenuation_color: Vec3::new(0.9, 0.8, 0.7), attenuation_distance: 3.0 }),
            clearcoat: Clearcoat {
                factor: 0.7,
                factor_texture: Some(texture(7)),
                roughness: 0.2,
                roughness_texture: Some(texture(8)),
                normal_map: map(9),
            },
            dispersion: 0.4,
            anisotropy: Anisotropy { strength: 0.6, rotation: 0.7, texture: Some(texture(16)) },
            iridescence: Iridescence {
                factor: 0.8,
                factor_texture: Some(texture(14)),
                ior: 1.4,
                thickness_nm: [200.0, 500.0],
                thickness_texture: Some(texture(15)),
            },
            diffuse_transmission: DiffuseTransmission {
                factor: 0.4,
                factor_texture: Some(texture(12)),
                color: Vec3::new(0.9, 0.5, 0.1),
                color_texture: Some(texture(13)),
            },
            sheen: Sheen {
                color: Vec3::new(0.2, 0.3, 0.4),
                color_texture: Some(texture(10)),
                roughness: 0.6,
                roughness_texture: Some(texture(11)),
            },
            unlit: false,
        };
        let plain = Material { specular: 1.0, ..Material::default() };
        let clear = Volume { attenuation_color: Vec3::ONE, attenuation_distance: f32::INFINITY };
        let materials = vec![
            all,
            Material { alpha_mode: AlphaMode::Blend, ior: 0.0, volume: Some(clear), ..plain.clone() },
            Material { unlit: true, specular: 0.0, ..plain.clone() },
            Material::default(),
        ];
        let mesh = |material| Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            tangents: if material == 0 { vec![Vec4::new(1.0, 0.0, 0.0, -1.0); 3] } else { Vec::new() },
            uvs: [vec![Vec2::ZERO, Vec2::X, Vec2::Y], vec![Vec2::ONE, Vec2::X, Vec2::Y]],
            colors: vec![Vec4::new(0.5, 0.25, 1.0, 0.125); 3],
            triangles: vec![[0, 1, 2]],
            material,
            ..Mesh::default()
        };
        let wraps = [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge];
        let textures = |i: usize| Texture {
            image: i,
            wrap_u: wraps[i % 3],
            wrap_v: wraps[(i + 1) % 3],
            linear: i.is_multiple_of(2),
        };
        let (direction, position) = (Vec3::NEG_Y, Vec3::new(1.0, 2.0, 3.0));
        let kinds = [
            LightKind::Point { position, radius: 2.0 },
            LightKind::Directional { direction, angle_rad: 0.005 },
            LightKind::Spot { position, radius: 0.0, direction, cos_inner: 0.9, cos_outer: 0.5 },
        ];
        let turned = Quat::from_rotation_y(0.3);
        let places = [
            Affine3A::IDENTITY,
            Affine3A::from_scale_rotation_translation(Vec3::new(1.0, -2.0, 3.0), turned, position),
            Affine3A::from_translation(position),
            Affine3A::from_rotation_x(1.0),
        ];
        let texel = |i: usize| Image { extent: Extent::new(2, 1), pixels: vec![[i as u8, 1, 2, 0], [3, 4, 5, 255]] };
        let sky = Image { extent: Extent::new(2, 1), pixels: vec![[0.5, 1.0, 2.0], [3.0, 0.0, 1e-3]] };
        let scene = Scene {
            meshes: (0..4).map(mesh).collect(),
            instances: places
                .into_iter()
                .enumerate()
                .map(|(mesh, world_from_local)| Instance { mesh, world_from_local })
                .collect(),
            materials,
            textures: (0..17).map(textures).collect(),
            images: (0..17).map(|i| texel(i).into()).collect(),
            lights: kinds.map(|kind| Light { kind, strength: Vec3::new(0.3, 1e6, 0.0) }).to_vec(),
            environment: Environment::Map { image: sky.into(), rotation_deg: 30.0 },
            ..Scene::empty("everything")
        };
        let text = "scene = 'a.glb'\nrig.metres_per_unit = 0.01\nrig.yfov_deg = 51.7\n[[rig.key]]\nposition = [0, 0, 1]\n\
            target = [0, 0, 0]\nup = [0, 1, 0.5]\n[[rig.key]]\ntime_s = 2\nposition = [0, 0, 2]\ntarget = [0, 0.1, 0]\n\
            [gaze]\npath = [[0, 0.25, 0.75], [1, 0.5, 0.5]]\n[exposure]\nev = -1.5\n\
            [render]\nsize = '1280x720'\nspp = 1.5\niterations = [2, 3, 5]\nreproject = false";
        let mut seen = scene.clone();
        let draft = Draft::parse(text, "everything.toml").unwrap();
        (complete(draft, &Overrides::default(), &mut seen, &Motion::default(), &Budget::unlimited()).unwrap(), scene)
    }

    #[test]
    fn scene_with_every_feature_round_trips() {
        let (shot, scene) = everything();
        let (shot_read, read) = round_trip(&shot, &scene);
        assert_same("everything", (&shot, &scene), (&shot_read, &read));
    }

    #[test]
    fn exported_files_stay_in_their_folder() {
        let (shot, scene) = everything();
        for name in ["../../x", "/etc/x", "", "a\\b", ".."] {
            round_trip(&Shot { name: name.into(), ..shot.clone() }, &scene);
        }
    }
}
