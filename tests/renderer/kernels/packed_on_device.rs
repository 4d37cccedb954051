//! Compares the shaders' packing with its twins: each reads the other's output.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::camera::Constants;
use super::harness::{Buffer, Kernel, Stripe};
use super::inputs::{HEIGHT, Random, WIDTH};
use super::pack::{Albedo, Counts, Format, Light, MISSING, UNKNOWN, floats, pack_normal, unpack_normal};

/// Unpacks and packs each pixel once.
const ROUND_TRIP: &str = "
@group(1) @binding(0) var<storage, read_write> light: array<vec4<u32>>;
@group(1) @binding(1) var<storage, read_write> albedo: array<vec4<u32>>;
@group(1) @binding(2) var<storage, read_write> normal: array<vec4<f32>>;
@group(1) @binding(3) var<storage, read_write> packed_normal: array<u32>;
@group(1) @binding(4) var<storage, read_write> counts: array<u32>;
@group(1) @binding(5) var<storage, read> unpacked: array<vec4<f32>>;
@group(1) @binding(6) var<storage, read_write> sampled: array<vec4<u32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if pixel.x >= frame.camera.width || pixel.y >= pass_.row_end {
        return;
    }
    let at = pixel_index(pixel);
    light[at] = pack_light(unpack_light(light[at]));
    albedo[at] = pack_albedo(unpack_albedo(albedo[at]));
    let bits = packed_normal[at];
    packed_normal[at] = pack_normal(normal[at].xyz);
    normal[at] = vec4<f32>(unpack_normal(bits), 0.0);
    counts[at] = add_tally(counts[at], pass_.args[0], pass_.args[1]);
    sampled[at] = pack_sampled(unpacked[at].rgb, unpacked[at].brg);
}
";

fn compare(gloss: bool, seed: u64) {
    let mut random = Random::new(seed);
    let constants = Constants::new(WIDTH, HEIGHT);
    let format = Format { gloss };
    let area = constants.area();
    let lights: Vec<Light> = (0..area)
        .map(|at| {
            let variance = match at % 4 {
                0 => DVec2::splat(UNKNOWN),
                1 => DVec2::splat(MISSING),
                _ => DVec2::new(random.within(0.0..9.0), random.within(0.0..0.1)),
            };
            // Values exceed half floats, and are as small as their smallest steps.
            let scale = [1e6, 1e-5, 1.0, 100.0][at % 4];
            Light { variance, ..random.light(scale) }
        })
        .collect();
    let albedos: Vec<Albedo> = (0..area)
        .map(|_| {
            let matte = random.color(0.5);
            Albedo { all: matte + random.color(0.2), matte, roughness: random.within(0.0..1.0) }
        })
        .collect();
    // Directions everywhere, and around the axes, where the octahedron's faces meet.
    let axes = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let spread = |at: usize| [0.0, 0.1, PI][at / axes.len() % 3];
    let normals: Vec<DVec3> = (0..area).map(|at| random.tilted(axes[at % axes.len()], spread(at))).collect();
    let tally: Vec<u32> = (0..area).map(|_| random.pick(&[5, 0x0ff0_0003, 0x30ff_fffe, 0x7000_0000])).collect();
    let packed_lights: Vec<_> = lights.iter().map(|light| format.pack(light)).collect();
    let packed_albedos: Vec<_> = albedos.iter().map(|albedo| format.pack_albedo(albedo)).collect();
    let packed_normals: Vec<u32> = normals.iter().map(|&n| pack_normal(n)).collect();
    let float_normals: Vec<[f32; 4]> = normals.iter().map(|n| n.as_vec3().extend(0.0).to_array()).collect();
    let stripe = Stripe { rows: 0..HEIGHT, valid: 0..HEIGHT };
    let unpacked: Vec<_> = lights.iter().map(|l| floats(l.matte, 0.0)).collect();
    let buffers = [
        ("light", Buffer::image(&packed_lights)),
        ("albedo", Buffer::image(&packed_albedos)),
        ("normal", Buffer::image(&float_normals)),
        ("packed_normal", Buffer::image(&packed_normals)),
        ("counts", Buffer::image(&tally)),
        ("unpacked", Buffer::image(&unpacked)),
        ("sampled", Buffer::image(&packed_lights)),
    ];
    let kernel = Kernel::beside("compose", &[("HAS_GLOSS", gloss)], ROUND_TRIP);
    let outputs = kernel.run(&constants, stripe.pass(0, [3, 2, 0]), WIDTH, &buffers);
    let (light, albedo) = (outputs.get::<[u32; 4]>("light"), outputs.get::<[u32; 4]>("albedo"));
    let (normal, packed) = (outputs.get::<[f32; 4]>("normal"), outputs.get::<u32>("packed_normal"));
    let (counts, sampled) = (outputs.get::<u32>("counts"), outputs.get::<[u32; 4]>("sampled"));
    for at in 0..area {
        // Rounded values do not change again.
        let unpacked = format.unpack(packed_lights[at]);
        assert!(format.holds(light[at], &unpacked, 0.0, 0.0), "{:?} instead of {unpacked:?}", format.unpack(light[at]));
        let matte = lights[at].matte;
        let gloss = DVec3::new(matte.z, matte.x, matte.y);
        let light = Light { matte, gloss, variance: DVec2::splat(UNKNOWN) };
        let holds = format.holds_sampled(sampled[at], &light, 1e-6);
        assert!(holds, "{:?} instead of {matte} and {gloss}", format.unpack(sampled[at]));
        let (got, want) = (format.unpack_albedo(albedo[at]), format.unpack_albedo(packed_albedos[at]));
        let apart = (got.all - want.all).abs().max((got.matte - want.matte).abs()).max_element();
        assert!(apart < 2e-3 * want.all.max_element(), "{got:?} instead of {want:?}");
        assert!((got.roughness - want.roughness).abs() < 1e-3);
        // There are sixteen bits for each axis of the octahedron's square, which is distorted by less than 3.
        let unpacked = DVec3::new(normal[at][0].into(), normal[at][1].into(), normal[at][2].into());
        assert!(unpacked.distance(unpack_normal(packed_normals[at])) < 1e-6, "{at}: {unpacked}");
        assert!(unpacked.distance(normals[at]) < 1e-4, "{at}: {unpacked} instead of {}", normals[at]);
        assert!(unpack_normal(packed[at]).distance(normals[at]) < 1e-4, "{at}: {:08x}", packed[at]);
        let before = Counts::unpack(tally[at]);
        let rays = (before.rays + 3).min(0xf_ffff);
        assert_eq!(Counts::unpack(counts[at]), Counts { rays, ..before }.with_dropped(2), "{before:?}");
    }
}

#[test]
fn packed_floats_and_half_floats_match_the_host() {
    compare(false, 51);
    compare(true, 52);
}

/// Without a device: unpacked values equal the packed ones within the format's rounding.
#[test]
fn light_and_normals_survive_packing() {
    let mut random = Random::new(53);
    for gloss in [false, true] {
        let format = Format { gloss };
        for _ in 0..200 {
            let light = Light { variance: DVec2::splat(random.within(0.0..4.0)), ..random.light(2.0) };
            let unpacked = format.unpack(format.pack(&light));
            let step = if gloss { 1.0 / 1024.0 } else { 1e-6 };
            assert!((unpacked.matte - light.matte).abs().max_element() <= step * light.matte.max_element() + 1e-6);
            assert!((unpacked.variance - light.variance).abs().max_element() <= 2.0 * step * light.variance.x);
            assert_eq!(unpacked.gloss == DVec3::ZERO, !gloss);
            let normal = random.tilted(DVec3::NEG_Z, PI);
            assert!(unpack_normal(pack_normal(normal)).distance(normal) < 1e-4, "{normal}");
        }
    }
}
