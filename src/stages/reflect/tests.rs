use glam::Vec4;

use super::*;
use crate::graph::{Kernel, Partition, Resource, SceneUse, Stage};
use crate::image::Extent;
use crate::scene::rig::Eye;
use crate::wgsl::Texel;

const READ: Resource = Resource::image::<Vec4>("read").bound_as("source");
const WRITTEN: Resource = Resource::image::<u32>("written");
const ADDED: Resource = Resource::image::<Sum>("added");
const CONSTANTS: Resource = Resource::constants("constants", "Constants", 16);

const TEXT: &str = "
//!include frame bindings
struct Constants { a: vec4<f32> }
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    written[id.x] = u32(source[id.x].x + constants.a.x);
    atomicAdd(&added[id.y], 1u);
}";

struct Sum;

impl Texel for Sum {
    const ELEMENT: &'static str = "atomic<u32>";
}

const UNUSED: &str = "
//!include frame bindings
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
    verify(&Pass::new(Stage("test"), Eye::LEFT, Partition("test"), kernel).uses(uses))
}

#[test]
fn correct_declarations_are_accepted() {
    assert_eq!(check(kernel(), uses()), Ok(()));
    let texel_of_four = Use::write(Resource::image::<[u32; 4]>("written"));
    assert_eq!(check(kernel(), [uses()[0], texel_of_four, uses()[2], uses()[3]]), Ok(()));
}

/// Each declaration is wrong in one way.
#[test]
fn rejects_wrong_declarations() {
    let with = |place: usize, used: Use| {
        let mut uses = uses();
        uses[place] = used;
        check(kernel(), uses).unwrap_err()
    };
    let assert_invalid = |place, used: Use| {
        let found = with(place, used);
        assert!(matches!(found, Mismatch::Invalid(_)), "{found:?}");
    };
    assert_invalid(1, Use::read(WRITTEN));
    assert_invalid(2, Use::read(ADDED));
    assert_eq!(with(0, Use::write(READ)), Mismatch::Unwritten("read"));
    assert_eq!(with(0, Use::update(READ)), Mismatch::Unwritten("read"));
    assert_eq!(with(2, Use::write(ADDED)), Mismatch::Read("added"));
    assert_eq!(with(1, Use::add(WRITTEN)), Mismatch::Unread("written"));
    assert_eq!(with(1, Use::write_then_read(WRITTEN)), Mismatch::Unread("written"));
    assert_invalid(0, Use::read(READ).viewed_as::<u32>());
    let narrow = Resource::image::<[u32; 3]>("read").bound_as("source");
    assert_eq!(with(0, Use::read(narrow).viewed_as::<Vec4>()), Mismatch::Format("read", 12, 16));
    let long = Resource::constants("constants", "Constants", 32);
    assert_eq!(with(3, Use::read(long)), Mismatch::Format("constants", 32, 16));
    assert_invalid(0, Use::read(READ).named("other"));
    assert_eq!(with(1, Use::write_then_read(Resource::list("written"))), Mismatch::Unread("written"));
    assert_invalid(0, Use::read(Resource::table::<u32>("source", Extent::new(1, 1))));
    assert_invalid(3, Use::read(Resource::constants("constants", "Frame", 16)));

    let too_few = check(kernel(), uses()[..3].to_vec());
    assert!(matches!(too_few, Err(Mismatch::Invalid(_))), "{too_few:?}");
    let surplus = uses().into_iter().chain([Use::read(READ).named("more")]);
    assert_eq!(check(kernel(), surplus), Err(Mismatch::Unused("read")));
    let unused = Kernel::from_text("test", UNUSED);
    assert_eq!(check(unused, [Use::read(READ)]), Err(Mismatch::Unused("read")));

    let workgroup = kernel().workgroup([64, 1, 1]);
    assert_eq!(check(workgroup, uses()), Err(Mismatch::Workgroup([64, 1, 1], [8, 8, 1])));
    assert_eq!(check(kernel().reading_scene(), uses()), Err(Mismatch::Scene(SceneUse::Read, SceneUse::No)));
    let own = Kernel::from_text("test", "@group(1) @binding(0) var<storage, read> source: array<vec4<f32>>;");
    assert_eq!(check(own, [Use::read(READ)]), Err(Mismatch::OwnBindings));
    let no_main = Kernel::from_text("test", "fn other() {}");
    assert_eq!(check(no_main, []), Err(Mismatch::NoMain));
    let invalid = check(Kernel::from_text("test", "fn main("), []);
    assert!(matches!(invalid, Err(Mismatch::Invalid(_))), "{invalid:?}");
}
