use super::*;
use crate::graph::{Kernel, Partition, Resource, SceneUse, Stage};
use crate::image::Extent;
use crate::scene::rig::Eye;

const READ: Resource = Resource::image("read", 16);
const WRITTEN: Resource = Resource::image("written", 4);
const ADDED: Resource = Resource::image("added", 4);
const CONSTANTS: Resource = Resource::constants("constants", 16);

const TEXT: &str = "
//!include frame
struct Constants { a: vec4<f32> }
@group(1) @binding(0) var<storage, read> source: array<vec4<f32>>;
@group(1) @binding(1) var<storage, read_write> target_: array<u32>;
@group(1) @binding(2) var<storage, read_write> sums: array<atomic<u32>>;
@group(1) @binding(3) var<uniform> constants: Constants;
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    target_[id.x] = u32(source[id.x].x + constants.a.x);
    atomicAdd(&sums[id.y], 1u);
}";

const UNUSED: &str = "
//!include frame
@group(1) @binding(0) var<storage, read> source: array<vec4<f32>>;
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
}";

fn kernel() -> Kernel {
    Kernel::from_text("test", TEXT)
}

fn uses() -> [Use; 4] {
    [Use::read(READ), Use::write(WRITTEN), Use::add(ADDED), Use::read(CONSTANTS)]
}

fn check(kernel: Kernel, uses: impl IntoIterator<Item = Use>) -> Result<(), Mismatch> {
    verify(&Pass::new(Stage("test"), Eye::Left, Partition("test"), kernel).uses(uses))
}

#[test]
fn a_declaration_that_is_right_is_accepted() {
    assert_eq!(check(kernel(), uses()), Ok(()));
    let texel_of_four = Use::write(Resource::image("written", 16));
    assert_eq!(check(kernel(), [uses()[0], texel_of_four, uses()[2], uses()[3]]), Ok(()));
}

/// Each declaration is wrong in one way.
#[test]
fn declarations_that_are_wrong_are_refused() {
    let with = |place: usize, used: Use| {
        let mut uses = uses();
        uses[place] = used;
        check(kernel(), uses).unwrap_err()
    };
    assert_eq!(with(1, Use::read(WRITTEN)), Mismatch::Written("written"));
    assert_eq!(with(2, Use::read(ADDED)), Mismatch::Written("added"));
    assert_eq!(with(0, Use::write(READ)), Mismatch::Unwritten("read"));
    assert_eq!(with(0, Use::update(READ)), Mismatch::Unwritten("read"));
    assert_eq!(with(2, Use::write(ADDED)), Mismatch::Read("added"));
    assert_eq!(with(1, Use::update(WRITTEN)), Mismatch::Unread("written"));
    assert_eq!(with(1, Use::write_then_read(WRITTEN)), Mismatch::Unread("written"));
    assert_eq!(with(0, Use::read(Resource::image("read", 12))), Mismatch::Format("read", 12, 16));
    assert_eq!(with(3, Use::read(Resource::constants("constants", 32))), Mismatch::Format("constants", 32, 16));
    assert_eq!(with(1, Use::write_then_read(Resource::list("list"))), Mismatch::Unread("list"));
    assert_eq!(with(0, Use::read(Resource::table("table", 4, Extent::new(1, 1)))), Mismatch::Format("table", 4, 16));

    assert_eq!(check(kernel(), uses()[..3].to_vec()), Err(Mismatch::Undeclared(3)));
    let surplus = uses().into_iter().chain([Use::read(READ)]);
    assert_eq!(check(kernel(), surplus), Err(Mismatch::Unused("read")));
    let unused = Kernel::from_text("test", UNUSED);
    assert_eq!(check(unused, [Use::read(READ)]), Err(Mismatch::Unused("read")));

    let workgroup = kernel().workgroup([64, 1, 1]);
    assert_eq!(check(workgroup, uses()), Err(Mismatch::Workgroup([64, 1, 1], [8, 8, 1])));
    assert_eq!(check(kernel().reading_scene(), uses()), Err(Mismatch::Scene(SceneUse::Read, SceneUse::No)));
    let no_main = Kernel::from_text("test", "fn other() {}");
    assert_eq!(check(no_main, []), Err(Mismatch::NoMain));
    let invalid = check(Kernel::from_text("test", "fn main("), []);
    assert!(matches!(invalid, Err(Mismatch::Invalid(_))), "{invalid:?}");
}
