//! Table of scenes.

use std::f32::consts::PI;

use diptych::image::{Extent, Image, RgbImage};
use diptych::scene::{AlphaMode, Environment, Light, LightKind, Material, Mesh, Scene};
use glam::{Affine3A, Vec2, Vec3, vec2, vec3, vec4};

use super::{Effort, Row, image, surfaces};
use crate::pictures::{brightest, mean};
use crate::reference::Pinhole;
use crate::reference::sampling::Rng;
use crate::reference::scenes::matte::{box_area_light, sphere_light};
use crate::reference::scenes::{
    add_material, add_matte, add_mesh, add_quad, add_texture, block, colored, empty, icosphere, instance, matte, place,
    place_at, quad, scaled_at,
};

/// 64 samples, six bounces.
pub const FULL: Effort = Effort::new(64, 6);
/// One sample through the pixel's centre, direct light only.
const DIRECT: Effort = Effort::new(1, 1);

pub type Claim = Box<dyn Fn(&RgbImage)>;

pub fn all() -> Vec<Row> {
    [lights(), materials(), surfaces::rows(), geometry(), cameras(), surroundings()].into_iter().flatten().collect()
}

pub fn row(name: &'static str, seen: (Scene, Pinhole), effort: Effort, claim: Claim) -> Row {
    Row { name, seen, effort, claim }
}

/// Returns a claim without conditions beyond those of every row.
pub fn finite() -> Claim {
    Box::new(|_| {})
}

fn all_are(value: f32, tolerance: f32) -> Claim {
    Box::new(move |image| {
        for v in image.pixels.as_flattened() {
            assert!((v - value).abs() <= tolerance, "{v} where {value} ± {tolerance} is right");
        }
    })
}

pub fn at_most(limit: f32) -> Claim {
    Box::new(move |image| {
        let brightest = brightest(image);
        assert!(brightest <= limit, "light is made: {brightest}");
    })
}

pub fn mean_is(value: f64, tolerance: f64) -> Claim {
    Box::new(move |image| {
        let mean = mean(image);
        assert!((mean - value).abs() <= tolerance, "a mean of {mean} where {value} ± {tolerance} is right");
    })
}

/// Claims that each pixel is `factor` times that of another image, to a relative `tolerance`.
fn times(factor: f32, tolerance: f32, other: RgbImage) -> Claim {
    Box::new(move |image| {
        assert!(other.pixels.as_flattened().iter().any(|v| *v > 0.0));
        for (i, (found, right)) in image.pixels.iter().zip(&other.pixels).enumerate() {
            for (f, r) in found.iter().zip(right.map(|r| r * factor)) {
                assert!((f - r).abs() <= tolerance * r, "pixel {i}: {found:?}, not {factor} times {right:?}");
            }
        }
    })
}

fn point(position: Vec3, radius: f32, strength: f32) -> Light {
    Light { kind: LightKind::Point { position, radius }, strength: Vec3::splat(strength) }
}

/// Returns a grey floor of 8 x 8 around the origin, seen from the front, with additions by `more`.
fn floor_with(name: &str, more: impl FnOnce(&mut Scene)) -> (Scene, Pinhole) {
    let mut scene = empty(name);
    add_quad(&mut scene, (vec3(-4.0, 0.0, -4.0), 8.0 * Vec3::Z, 8.0 * Vec3::X), colored(Vec3::splat(0.5)));
    more(&mut scene);
    (scene, Pinhole::looking_at(vec3(0.0, 1.5, 4.0), vec3(0.0, 0.25, 0.0), Vec3::Y, 45.0))
}

fn lights() -> Vec<Row> {
    let of_radius = |radius| floor_with("small light", |s| s.lights.push(point(vec3(0.3, 1.0, 0.2), radius, 1.0)));
    let as_point = |effort| image("point light", of_radius(0.0), effort);
    let (mut bright, camera) = box_area_light();
    let mild = image("mild lamp", (bright.clone(), camera), FULL);
    let factor = (1u32 << 27) as f32;
    for material in &mut bright.materials {
        material.emissive *= factor;
    }
    let touching = floor_with("lights on the floor", |s| {
        s.lights.push(point(vec3(-0.5, 0.25, 0.0), 0.25, 1.0));
        s.lights.push(point(vec3(0.7, 0.0, 0.5), 0.0, 1.0));
        let lamp = add_material(s, Material { emissive: Vec3::splat(3.0), ..matte() });
        place(s, quad(vec3(0.25, 0.0, -0.5), Vec3::Z, Vec3::X, lamp));
        place(s, quad(vec3(1.5, 0.0, 0.0), Vec3::X, Vec3::Y, lamp));
    });
    let inside = floor_with("lights in a block", |s| {
        place_at(s, block(0), Affine3A::from_translation(vec3(0.0, 0.5, 0.0)));
        s.lights.push(point(vec3(0.0, 0.5, 0.0), 0.25, 1e4));
        s.lights.push(point(vec3(0.2, 0.5, 0.3), 0.0, 1e4));
        let lamp = add_material(s, Material { emissive: Vec3::splat(1e4), double_sided: true, ..matte() });
        place(s, quad(vec3(-0.4, 0.2, -0.4), 0.8 * Vec3::X, 0.8 * Vec3::Z, lamp));
    });
    let mut rng = Rng::new(11, 0);
    let many = floor_with("10,000 spheres", |s| {
        let mut random = || rng.uniform() as f32;
        for _ in 0..10_000 {
            let at = vec3(4.0 * random() - 2.0, 0.01 + 1.2 * random(), 4.0 * random() - 3.0);
            s.lights.push(point(at, 0.002, 1e-4));
        }
    });
    let odd = floor_with("spots and suns at their limits", |s| {
        let down = vec3(0.1, -1.0, 0.0).normalize();
        for (cos_inner, cos_outer) in [(1.0, 0.0), (0.5, 0.5), (1.0, 1.0 - f32::EPSILON), (1.0, 1.0)] {
            for radius in [0.0, 0.1] {
                let position = vec3(cos_inner - 0.5, 1.0, radius);
                let kind = LightKind::Spot { position, radius, direction: down, cos_inner, cos_outer };
                s.lights.push(Light { kind, strength: Vec3::ONE });
            }
        }
        for angle_rad in [0.0, 1e-6, 1.5, 0.5 * PI] {
            s.lights.push(Light { kind: LightKind::Directional { direction: down, angle_rad }, strength: Vec3::ONE });
        }
    });
    let grazing = floor_with("light that grazes", |s| {
        for lift in [1e-7, 1e-4] {
            let direction = vec3(1.0, -lift, 0.0).normalize();
            s.lights.push(Light { kind: LightKind::Directional { direction, angle_rad: 1e-3 }, strength: Vec3::ONE });
            s.lights.push(point(vec3(-1.0, lift, 0.0), 0.0, 1.0));
        }
    });
    let bright_point = |radius| floor_with("bright point", |s| s.lights.push(point(vec3(0.3, 1.0, 0.2), radius, 1e12)));
    let brightest = image("bright point light", bright_point(0.0), DIRECT);
    vec![
        row("a light of radius 1e-21", of_radius(1e-21), DIRECT, times(1.0, 0.0, as_point(DIRECT))),
        row("a light of radius 1e-14 and 1e12 W/sr", bright_point(1e-14), DIRECT, times(1.0, 0.0, brightest)),
        row("a light of radius 1e-6, direct", of_radius(1e-6), DIRECT, times(1.0, 1e-4, as_point(DIRECT))),
        row("a light of radius 1e-6", of_radius(1e-6), FULL, finite()),
        row("emission of 1e8", (bright, camera), FULL, times(factor, 0.0, mild)),
        row("lights that touch a surface", touching, FULL, finite()),
        row("lights inside an object", inside, FULL, all_are(0.0, 0.0)),
        row("10,000 spherical lights", many, Effort { size: [16, 9], ..Effort::new(2, 2) }, finite()),
        row("spots and suns at their limits", odd, FULL, finite()),
        row("lights that graze a surface", grazing, FULL, finite()),
        row("lights that are seen", sphere_light(), FULL, finite()),
    ]
}

fn ball(name: &str, material: Material, environment: Environment) -> (Scene, Pinhole) {
    let mut scene = Scene { environment, ..empty(name) };
    let material = add_material(&mut scene, material);
    place(&mut scene, icosphere(3, true, material));
    (scene, Pinhole::looking_at(vec3(0.0, 0.0, 3.0), Vec3::ZERO, Vec3::Y, 45.0))
}

fn materials() -> Vec<Row> {
    let white = || Environment::Constant(Vec3::ONE);
    let of_roughness = |roughness, metallic| ball("white ball", Material { roughness, metallic, ..matte() }, white());
    let (mut bright, camera) = box_area_light();
    for material in &mut bright.materials {
        material.base_color = vec4(1.0, 1.0, 1.0, 1.0);
    }
    let black = Material { base_color: vec4(0.0, 0.0, 0.0, 1.0), ..matte() };
    let few = Effort { size: [4, 3], ..DIRECT };
    vec![
        row("roughness 0", of_roughness(0.0, 0.0), FULL, at_most(1.0 + 1e-4)),
        row("roughness 0, metal", of_roughness(0.0, 1.0), FULL, at_most(1.0 + 1e-4)),
        row("albedo 1 in a closed box, 100 reflections", (bright, camera), Effort::new(64, 100), finite()),
        row("albedo 0", ball("black ball", black, white()), FULL, at_most(1.0 + 1e-4)),
        row("100 layers of alpha 0", layers(100, AlphaMode::Mask { cutoff: 0.5 }), few, all_are(1.0, 0.0)),
    ]
}

/// Returns panes with zero coverage in front of a white sky.
pub fn layers(count: u32, alpha_mode: AlphaMode) -> (Scene, Pinhole) {
    let mut scene = Scene { environment: Environment::Constant(Vec3::ONE), ..empty("layers") };
    let open = Material { base_color: vec4(0.2, 0.5, 0.9, 0.0), alpha_mode, double_sided: true, ..matte() };
    let open = add_material(&mut scene, open);
    for i in 0..count {
        let corner = vec3(-2.0, -2.0, -0.001 * i as f32);
        place(&mut scene, quad(corner, 4.0 * Vec3::X, 4.0 * Vec3::Y, open));
    }
    (scene, Pinhole::looking_at(vec3(0.0, 0.0, 1.0), Vec3::ZERO, Vec3::Y, 45.0))
}

/// Returns two lamps that light each other and a glossy floor. They are so bright that f32 can hold the light of each
/// but not their sum.
pub fn too_bright() -> (Scene, Pinhole) {
    floor_with("too bright", |s| {
        s.materials[0] = Material { metallic: 0.5, roughness: 0.3, ..matte() };
        let lamp = add_material(s, Material { emissive: Vec3::splat(3e38), double_sided: true, ..matte() });
        place(s, quad(vec3(-0.6, 0.1, -0.5), Vec3::Z, Vec3::Y, lamp));
        place(s, quad(vec3(0.6, 0.1, -0.5), Vec3::Z, Vec3::Y, lamp));
    })
}

/// Returns the floor under a lamp and a sky, with additions by `more`.
fn lit_floor(more: impl FnOnce(&mut Scene)) -> (Scene, Pinhole) {
    floor_with("lit floor", |s| {
        s.lights.push(point(vec3(0.3, 1.2, 0.2), 0.1, 1.0));
        s.environment = Environment::Constant(Vec3::splat(0.1));
        more(s);
    })
}

fn soup(corners: &[[Vec3; 3]], material: usize) -> Mesh {
    let triangles = (0..corners.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Mesh { positions: corners.concat(), triangles, material, ..Mesh::default() }
}

fn needles(height: f32) -> Mesh {
    let needle = |i: usize| {
        let start = vec3(0.02 * i as f32 - 1.0, 0.05 + 0.003 * i as f32, -1.0);
        [start, start + vec3(0.5, 0.3, 1.5), start + vec3(0.0, height, 0.0)]
    };
    soup(&(0..100).map(needle).collect::<Vec<_>>(), 0)
}

fn geometry() -> Vec<Row> {
    let plain = image("lit floor", lit_floor(|_| {}), FULL);
    let zero_area = lit_floor(|s| {
        let p = vec3(0.1, 0.2, 0.3);
        place(s, soup(&[[p, p, p], [p, p, Vec3::ZERO], [p, 2.0 * p, 3.0 * p]], 0));
    });
    let twice = lit_floor(|s| {
        let red = add_matte(s, vec3(0.8, 0.1, 0.1));
        place(s, quad(vec3(-1.0, 0.0, -1.0), 2.0 * Vec3::Z, 2.0 * Vec3::X, red));
        place(s, quad(vec3(-1.0, 0.0, -1.0), 2.0 * Vec3::Z, 2.0 * Vec3::X, 0));
        place(s, quad(vec3(1.0, 0.0, -1.0), 2.0 * Vec3::Z, -2.0 * Vec3::X, red));
    });
    let with_normals = |normal: fn(usize) -> Vec3| {
        lit_floor(|s| {
            let mut mesh = icosphere(2, false, 0);
            mesh.normals = (0..mesh.positions.len()).map(normal).collect();
            place_at(s, mesh, scaled_at(0.5, vec3(0.0, 0.5, 0.0)));
        })
    };
    let flat = lit_floor(|s| place_at(s, icosphere(2, false, 0), scaled_at(0.5, vec3(0.0, 0.5, 0.0))));
    let flat = image("flat ball", flat, FULL);
    let opposite = |i: usize| if i.is_multiple_of(2) { Vec3::Y } else { Vec3::NEG_Y };
    let uvs = |uv: Vec2| {
        let (mut scene, camera) = lit_floor(|_| {});
        let texture = add_texture(&mut scene, Image::filled(Extent::new(3, 3), [200, 100, 50, 255]), true);
        scene.materials[0].base_color_texture = Some(texture);
        scene.meshes[0].uvs[0] = vec![uv, Vec2::ZERO, -uv, Vec2::ONE];
        (scene, camera)
    };
    let flattened = lit_floor(|s| {
        let cube = add_mesh(s, block(0));
        instance(s, cube, Affine3A::from_scale(vec3(1.0, 0.0, 1.0)));
        instance(s, cube, Affine3A::from_scale(Vec3::splat(1e-30)));
    });
    vec![
        row("triangles without area", zero_area, FULL, times(1.0, 0.0, plain)),
        row("needles of 1e-12", lit_floor(|s| place(s, needles(1e-12))), FULL, finite()),
        row("needles of 1e-6", lit_floor(|s| place(s, needles(1e-6))), FULL, finite()),
        row("the same face several times", twice, FULL, finite()),
        row("normals without direction", with_normals(|_| Vec3::ZERO), FULL, times(1.0, 0.0, flat.clone())),
        row("normals that are NaN", with_normals(|_| Vec3::NAN), FULL, times(1.0, 0.0, flat)),
        row("normals that point inwards, and apart", with_normals(opposite), FULL, finite()),
        row("texture coordinates of 1e9", uvs(vec2(1e9, -1e9)), FULL, finite()),
        row("texture coordinates that are NaN", uvs(Vec2::NAN), FULL, finite()),
        row("instances flattened to nothing", flattened, FULL, finite()),
        huge_triangle(),
    ]
}

/// A floor of one triangle with an edge of 1e6, lit by a point light. The radiance is known exactly: albedo / π · I cos
/// / d².
fn huge_triangle() -> Row {
    let mut scene = empty("huge triangle");
    let grey = add_matte(&mut scene, Vec3::splat(0.5));
    place(&mut scene, soup(&[[vec3(-1e6, 0.0, -7e5), vec3(3e5, 0.0, 1e6), vec3(8e5, 0.0, -6e5)]], grey));
    let lamp = vec3(0.4, 1.5, 0.2);
    scene.lights.push(point(lamp, 0.0, 3.0));
    let camera = Pinhole::looking_at(vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, -0.5), Vec3::Y, 40.0);
    let claim = move |image: &RgbImage| {
        let Extent { width, height } = image.extent;
        let half = [camera.tan_half_yfov * width as f32 / height as f32, camera.tan_half_yfov];
        for (i, pixel) in image.pixels.iter().enumerate() {
            let (x, y) = (i as u32 % width, i as u32 / width);
            let across = half[0] * (2.0 * (x as f32 + 0.5) / width as f32 - 1.0);
            let along = half[1] * (1.0 - 2.0 * (y as f32 + 0.5) / height as f32);
            let way = camera.forward + camera.right * across + camera.up * along;
            let p = camera.origin - way * (camera.origin.y / way.y);
            let to_lamp = lamp - p;
            let right = 0.5 / PI * 3.0 * to_lamp.y / to_lamp.length().powi(3);
            assert!((pixel[0] - right).abs() < 1e-4 * right, "pixel {x},{y}: {} where {right} is right", pixel[0]);
        }
    };
    row("a triangle of 1e6, seen closely", (scene, camera), DIRECT, Box::new(claim))
}

fn cameras() -> Vec<Row> {
    let seen = |name, origin: Vec3, target: Vec3| {
        let (scene, _) = lit_floor(|s| {
            place_at(s, block(0), Affine3A::from_translation(vec3(0.0, 0.5, 0.0)));
        });
        row(name, (scene, Pinhole::looking_at(origin, target, Vec3::Y, 60.0)), FULL, finite())
    };
    vec![
        seen("a camera on a surface", vec3(0.0, 0.0, 2.0), vec3(0.0, 0.0, 0.0)),
        seen("a camera on a surface, looking down", vec3(0.5, 0.0, 2.0), vec3(0.2, -1.0, 1.0)),
        seen("a camera on a vertex", vec3(0.5, 1.0, 0.5), vec3(0.0, 0.0, 0.0)),
        seen("a camera in a block", vec3(0.1, 0.4, 0.2), vec3(0.0, 0.0, -3.0)),
        seen("a camera in a lamp", vec3(0.3, 1.2, 0.2), vec3(0.0, 0.0, 0.0)),
        seen("a camera that grazes", vec3(-3.9, 1e-6, 2.0), vec3(3.9, 1e-6, 2.1)),
    ]
}

fn surroundings() -> Vec<Row> {
    let looking = Pinhole::looking_at(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y, 60.0);
    let nothing = |environment| (Scene { environment, ..empty("nothing") }, looking);
    let hot = |at: usize, value| {
        let mut image = Image::filled(Extent::new(32, 16), [0.5f32; 3]);
        image.pixels[at] = [value; 3];
        Environment::Map { image: image.into(), rotation_deg: 77.0 }
    };
    let ball_in = |environment| ball("ball", matte(), environment);
    let mut shut = empty("shut box");
    let white = add_matte(&mut shut, Vec3::ONE);
    place_at(&mut shut, block(white), Affine3A::from_scale(Vec3::splat(3.0)));
    let inside = Pinhole::looking_at(vec3(0.2, 0.1, 1.2), vec3(-0.3, -0.4, 0.0), Vec3::Y, 90.0);
    let shut_in = |environment, sun: f32| {
        let direction = vec3(-1.0, -1.0, -1.0).normalize();
        let kind = LightKind::Directional { direction, angle_rad: 0.01 };
        let lights = vec![Light { kind, strength: Vec3::splat(sun) }, point(vec3(0.0, 1.7, 0.0), 0.1, sun)];
        (Scene { environment, lights, ..shut.clone() }, inside)
    };
    let far = Effort::new(256, 30);
    vec![
        row("no scene in a white sky", nothing(Environment::Constant(Vec3::ONE)), FULL, all_are(1.0, 0.0)),
        row("no scene at all", nothing(Environment::Black), FULL, all_are(0.0, 0.0)),
        row("a sky with one pixel of 1e6", ball_in(hot(203, 1e6)), FULL, finite()),
        row("a sky with one pixel of 1e6 at its pole", ball_in(hot(3, 1e6)), FULL, finite()),
        row("a sky with one pixel of 1e30", ball_in(hot(203, 1e30)), FULL, finite()),
        row("a sky of 1e-30", ball_in(Environment::Constant(Vec3::splat(1e-30))), FULL, at_most(1.001e-30)),
        row(
            "a shut box in a bright sky",
            shut_in(Environment::Constant(Vec3::splat(1e6)), 1e6),
            far,
            all_are(0.0, 0.0),
        ),
        row("a shut box in a sky with a sun", shut_in(hot(100, 1e6), 1e6), far, all_are(0.0, 0.0)),
    ]
}
