//! Contact sheets, and what they are good for: every kind of material is seen at a glance in the default look.

use diptych::image::exr::read_channels;
use diptych::scene::{Instance, Material, Mesh, Scene, gltf};
use glam::{Affine3A, Vec3, Vec4};

use crate::common::Folder;

/// Returns a smooth ball of radius 1 that stands on y = 0.
fn ball() -> Mesh {
    const ROWS: u32 = 24;
    const COLUMNS: u32 = 48;
    let normal = |i: u32| {
        let (theta, phi) = ((i / COLUMNS) as f32 / ROWS as f32, (i % COLUMNS) as f32 / COLUMNS as f32);
        let ((sin, cos), (x, z)) = ((theta * std::f32::consts::PI).sin_cos(), (phi * std::f32::consts::TAU).sin_cos());
        Vec3::new(sin * x, cos, sin * z)
    };
    let normals: Vec<Vec3> = (0..(ROWS + 1) * COLUMNS).map(normal).collect();
    let triangles = (0..ROWS * COLUMNS).flat_map(|i| {
        let right = i - i % COLUMNS + (i + 1) % COLUMNS;
        [[i, i + COLUMNS, right + COLUMNS], [i, right + COLUMNS, right]]
    });
    let positions = normals.iter().map(|n| *n + Vec3::Y).collect();
    Mesh { positions, normals, triangles: triangles.collect(), ..Mesh::default() }
}

/// Writes a ball of this material as `NAME.glb`.
fn write(folder: &Folder, name: &str, material: Material) {
    let instances = vec![Instance { mesh: 0, world_from_local: Affine3A::IDENTITY }];
    let scene = Scene { meshes: vec![ball()], instances, materials: vec![material], ..Scene::empty(name) };
    gltf::write(&folder.path(&format!("{name}.glb")), &scene).unwrap();
}

fn plastic(grey: f32, roughness: f32) -> Material {
    Material { base_color: Vec4::new(grey, grey, grey, 1.0), roughness, specular: 1.0, ..Material::default() }
}

fn metal(color: Vec3, roughness: f32) -> Material {
    Material { base_color: color.extend(1.0), metallic: 1.0, ..plastic(1.0, roughness) }
}

const SIZE: [usize; 2] = [96, 72];

/// Renders a file as `sheet` does. Returns the mean of the picture, and the mean difference between both sides of the
/// object's silhouette.
fn seen(folder: &Folder, name: &str) -> [f32; 2] {
    let size = format!("{}x{}", SIZE[0], SIZE[1]);
    folder.run(&format!("render ./{name}.glb --size {size} --spp 4 --warm-up 3 --aov position --out ./out"));
    let picture = image::open(folder.path("out/left.png")).unwrap().to_luma32f();
    let positions = read_channels(&folder.path("out/left.position.exr"), ["X", "Y", "Z"]).unwrap().image;
    let is_object = |x: usize, y: usize| positions.pixels[y * SIZE[0] + x][1] > 0.01;
    let value = |x: usize, y: usize| picture.get_pixel(x as u32, y as u32).0[0];
    let mut differences = Vec::new();
    for y in 0..SIZE[1] {
        for x in 2..SIZE[0] - 3 {
            if is_object(x, y) != is_object(x + 1, y) {
                // Pixels beside the silhouette show both sides.
                differences.push((value(x - 1, y) - value(x + 2, y)).abs());
            }
        }
    }
    assert!(differences.len() > 40, "{name}: {} pixels", differences.len());
    let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
    [mean(picture.as_raw()), mean(&differences)]
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn every_material_stands_out_from_its_background() {
    let folder = Folder::new();
    let glass = Material { transmission: 1.0, roughness: 0.0, ..plastic(1.0, 0.0) };
    let red = Material { base_color: Vec4::new(0.6, 0.05, 0.04, 1.0), ..plastic(1.0, 0.4) };
    let materials = [
        ("white", plastic(0.9, 0.9)),
        ("grey", plastic(0.5, 0.6)),
        ("black", plastic(0.02, 0.4)),
        ("red", red),
        ("chrome", metal(Vec3::splat(0.9), 0.05)),
        ("gold", metal(Vec3::new(1.0, 0.75, 0.3), 0.3)),
        ("glass", glass),
    ];
    for (name, material) in materials {
        write(&folder, name, material);
        let [mean, edge] = seen(&folder, name);
        println!("{name}: mean {mean:.3}, silhouette {edge:.3}");
        assert!((0.15..0.7).contains(&mean), "{name}: the picture's mean is {mean}");
        // The rim of a mirror shows what is behind it, and glass shows it everywhere.
        let is_seen_by_reflections = ["chrome", "gold", "glass"].contains(&name);
        assert!(edge >= 0.1 || is_seen_by_reflections, "{name}: the silhouette differs by {edge} from its background");
    }
}

#[test]
fn sheet_names_scenes_that_cannot_be_loaded() {
    let folder = Folder::new();
    write(&folder, "good", plastic(0.5, 0.5));
    folder.write("bad.glb", "glTF");
    let scenes = "./good.glb ./bad.glb ./good.glb";
    let said = folder.try_run(&format!("export {scenes} --size 64x48 --columns 2 --out ./sheets/all.png"));
    assert_eq!(said.status, Some(2), "{}", said.errors);
    assert!(said.errors.contains("bad.glb") && said.errors.contains("1 of 3 file(s)"), "{}", said.errors);
    let sheet = image::open(folder.path("sheets/all.png")).unwrap().to_luma8();
    // Each picture has two lines of text below it.
    assert_eq!(sheet.dimensions(), (2 * 64 + 4, 2 * (48 + 44) + 4));
    let brightest = |x: u32, y: u32| (0..48).map(|dy| sheet.get_pixel(x + 32, y + dy).0[0]).max();
    assert!(brightest(0, 0) > Some(100) && brightest(68, 0) == Some(0), "the second picture is missing");
    assert!(brightest(0, 96) > Some(100));
}
