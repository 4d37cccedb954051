//! The harness detects mistakes of tests, and kernels that write where they should not.

use super::{Buffer, Kernel, Override, Stripe};
use crate::kernels::camera::Constants;

/// Writes to every row of an image, whatever the stripe.
const WRITES_EVERYWHERE: &str = "
@group(1) @binding(0) var<storage, read_write> image: array<u32>;
@group(1) @binding(1) var<uniform> step: vec4<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.camera.width && id.y < frame.camera.height {
        image[id.y * frame.camera.width + id.x] += step.x + pass_.args[0];
    }
}
";

fn add(rows: std::ops::Range<u32>, overrides: &[Override], buffers: &[(&str, Buffer)]) -> Vec<u32> {
    let constants = Constants::new(5, 4);
    let stripe = Stripe { valid: rows.clone(), rows };
    let kernel = Kernel::beside("tally", overrides, WRITES_EVERYWHERE);
    kernel.run(&constants, stripe.pass(0, [30, 0, 0]), 5, buffers).get("image")
}

fn buffers() -> [(&'static str, Buffer); 2] {
    [("step", Buffer::whole(&[2u32, 0, 0, 0])), ("image", Buffer::image(&(0..20).collect::<Vec<u32>>()))]
}

#[test]
fn harness_finds_bindings_by_name() {
    assert_eq!(add(0..4, &[], &buffers()), (32..52).collect::<Vec<u32>>());
}

#[test]
#[should_panic(expected = "'image' was written above the stripe")]
fn rejects_writes_above_the_stripe() {
    add(1..4, &[], &buffers());
}

#[test]
#[should_panic(expected = "'image' was written below the stripe")]
fn rejects_writes_below_the_stripe() {
    add(0..3, &[], &buffers());
}

#[test]
#[should_panic(expected = r#"the test lacks ["step"] and has ["stride"] beside them"#)]
fn rejects_other_names_of_bindings() {
    let [(_, step), image] = buffers();
    add(0..4, &[], &[("stride", step), image]);
}

#[test]
#[should_panic(expected = r#"override constants: the shader declares []; the test lacks [] and has ["SPARSE"]"#)]
fn rejects_other_names_of_overrides() {
    add(0..4, &[("SPARSE", true)], &buffers());
}
