//! Custom passes, declared in a few lines: images of other sizes, workgroups of other shapes, reads of blocks and of
//! whole images, tables that each device computes for itself, and data kept between frames. Every number of devices
//! gives the same bytes, which match plain Rust.

use crate::common::{Stage as Bench, Subject};
use diptych::graph::{
    Assignment, Dispatch, Grid, Image, Kernel, Partition, Pass, Reach, Resource, Scope, Stage, Stripes, Use,
};
use diptych::image::Extent;
use diptych::passes::{Declarations, FrameSpec};
use diptych::quality::{Denoiser, Filter};
use diptych::scene::rig::Eye;
use diptych::schedule::{CostModel, Policy};
use diptych::stages::verify;

const WIDTH: u32 = 40;
const HEIGHT: u32 = 52;
const WRITES: Partition = Partition("writes");
const READS: Partition = Partition("reads");
const OUT: Resource = Resource::image::<u32>("test out").bound_as("found").output();
const IMAGE: Resource = Resource::image::<u32>("test image").bound_as("image");

/// Distributes rows differently for every group and every frame.
struct Ragged {
    devices: usize,
    frame: u32,
}

impl Policy for Ragged {
    fn name(&self) -> &'static str {
        "ragged"
    }

    fn assign(&mut self, _: &CostModel) -> Assignment {
        self.frame += 1;
        let mut assignment = Assignment::uniform(Stripes::even(HEIGHT, self.devices));
        for (i, group) in [WRITES, READS].into_iter().enumerate() {
            for eye in Eye::BOTH {
                let weight = |d: usize| 1.0 + ((d * 3 + i * 2 + self.frame as usize + eye.index()) % 4) as f64;
                let weights: Vec<f64> = (0..self.devices).map(weight).collect();
                assignment.set(group, eye, Stripes::from_weights(HEIGHT, &weights).expect("weights are above 0"));
            }
        }
        assignment
    }

    fn remove_device(&mut self, _: usize) {
        self.devices -= 1;
    }
}

/// Renders `frames` frames of these passes, on both views unless they have device scope. Checks each pass against its
/// shader, and every pixel of the output against `expected(eye, x, y, frame)`.
fn check(
    frames: u32,
    passes: impl Fn(&FrameSpec, Eye) -> Vec<Pass> + Clone + Send + Sync + 'static,
    expected: impl Fn(u32, u32, u32, u32) -> u32,
) {
    let subject = Subject::load("builtin:cornell");
    let declare = move |spec: &FrameSpec| {
        let mut all: Vec<Pass> = Eye::BOTH.into_iter().flat_map(|view| passes(spec, view)).collect();
        all.sort_by_key(|p| p.scope == Scope::View);
        let devices_own = all.iter().filter(|p| p.scope == Scope::Device).count() / 2;
        all.drain(..devices_own);
        all
    };
    let mut settings = subject.settings(WIDTH, HEIGHT);
    // This denoiser makes the previous frame available.
    settings.envelope.most.filter = Some(Filter::new(Denoiser::SVGF, 1));
    settings.buffers.declarations = Declarations::new(move |spec| {
        let passes = declare(spec);
        passes.iter().for_each(|p| verify(p).unwrap_or_else(|e| panic!("{}: {e}", p.stage.name())));
        passes
    });
    for devices in [1, 2, 4] {
        let mut bench = Bench::with(&subject, &settings, devices, Box::new(Ragged { devices, frame: 0 }));
        for frame in 0..frames {
            let params = bench.params(0.0, frame);
            bench.renderer().render(&params).unwrap();
            let found = bench.renderer().read_output(OUT).unwrap();
            for (eye, bytes) in [(0, found.left()), (1, found.right())] {
                let found: &[u32] = bytemuck::cast_slice(bytes);
                for (i, value) in (0..).zip(found) {
                    let (x, y) = (i % WIDTH, i / WIDTH);
                    let wanted = expected(eye, x, y, frame);
                    assert_eq!(*value, wanted, "({x}, {y}) of eye {eye}, frame {frame}, {devices} devices");
                }
                assert_eq!(found.len(), (WIDTH * HEIGHT) as usize);
            }
        }
    }
}

fn kernel(name: &'static str, text: &'static str, workgroup: [u32; 3]) -> Kernel {
    Kernel::from_text(name, text).workgroup(workgroup)
}

/// Returns a kernel that runs `body` for each pixel, `at` being its index.
fn per_pixel(name: &'static str, body: &str) -> Kernel {
    let text = format!(
        "
//!include frame bindings
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {{
    let y = pass_.row_begin + id.y;
    if id.x >= pass_.width || y >= pass_.row_end {{
        return;
    }}
    let at = y * pass_.width + id.x;
    {body}
}}"
    );
    kernel(name, text.leak(), [8, 8, 1])
}

fn pass(name: &'static str, view: Eye, group: Partition, kernel: Kernel) -> Pass {
    Pass::new(Stage(name), view, group, kernel)
}

/// Returns a value that differs by pixel, eye and frame.
fn value(eye: u32, x: u32, y: u32, frame: u32) -> u32 {
    x * 1009 + y * 7919 + eye * 104_729 + frame * 15_485_863
}

/// Returns a pass that writes [`value`] to every texel of its grid.
fn fill(view: Eye, image: impl Into<Image>) -> Pass {
    const TEXT: &str = "
//!include frame bindings
@compute @workgroup_size(16, 4)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let at = vec2<u32>(id.x, pass_.row_begin + id.y);
    if at.x >= pass_.width || at.y >= pass_.row_end {
        return;
    }
    let which = pass_.view * 104729u + frame.sampling.index * 15485863u;
    image[at.y * pass_.width + at.x] = at.x * 1009u + at.y * 7919u + which;
}";
    let image = image.into();
    let kernel = kernel("test fill", TEXT, [16, 4, 1]);
    pass("test fill", view, WRITES, kernel).uses([Use::write(image).named("image")]).on(image.resource.grid)
}

#[test]
fn passes_support_other_image_and_workgroup_sizes() {
    const GROW: &str = "
//!include frame bindings
@compute @workgroup_size(5, 1, 3)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let y = pass_.row_begin + id.y;
    if id.z > 0u || id.x >= pass_.width || y >= pass_.row_end {
        return;
    }
    let width = (pass_.width + 2u) / 3u;
    let below = min(y / 3u + 1u, (pass_.height + 2u) / 3u - 1u);
    found[y * pass_.width + id.x] = small[y / 3u * width + id.x / 3u] ^ small[below * width + id.x / 3u];
}";
    const SMALL: Resource = Resource::image::<u32>("test small").bound_as("small").on(Grid::FrameOver(3));
    let grow = |view| {
        let uses = [Use::read(SMALL).halo(1), Use::write(OUT)];
        pass("test grow", view, READS, kernel("test grow", GROW, [5, 1, 3])).uses(uses)
    };
    check(
        1,
        move |_, view| vec![fill(view, SMALL), grow(view)],
        |eye, x, y, frame| {
            let below = (y / 3 + 1).min(HEIGHT.div_ceil(3) - 1);
            value(eye, x / 3, y / 3, frame) ^ value(eye, x / 3, below, frame)
        },
    );
}

#[test]
fn workgroup_per_block_reads_the_whole_block() {
    const SUM: &str = "
//!include frame bindings
@compute @workgroup_size(8)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let first = vec2<u32>(group.x * 8u, (pass_.row_begin / 8u + group.y) * 8u);
    var sum = 0u;
    for (var i = 0u; i < 64u; i += 1u) {
        let at = first + vec2<u32>(i % 8u, i / 8u);
        if at.x < pass_.width && at.y < pass_.height {
            sum += image[at.y * pass_.width + at.x];
        }
    }
    let x = first.x + lane;
    for (var y = max(first.y, pass_.row_begin); y < min(first.y + 8u, pass_.row_end); y += 1u) {
        if x < pass_.width {
            found[y * pass_.width + x] = sum;
        }
    }
}";
    let sum = |view| {
        let uses = [Use::read(IMAGE).reaching(Reach::Blocks { size: 8, offset: 0 }), Use::write(OUT)];
        let pass = pass("test sum", view, READS, kernel("test sum", SUM, [8, 1, 1]));
        pass.uses(uses).dispatch(Dispatch::Workgroups([8, 8]))
    };
    check(
        1,
        move |_, view| vec![fill(view, IMAGE), sum(view)],
        |eye, x, y, frame| {
            let block = |v: u32, end: u32| (v / 8 * 8)..(v / 8 * 8 + 8).min(end);
            let texels = block(y, HEIGHT).flat_map(|y| block(x, WIDTH).map(move |x| (x, y)));
            texels.map(|(x, y)| value(eye, x, y, frame)).fold(0, u32::wrapping_add)
        },
    );
}

#[test]
fn passes_reach_whole_images_or_computed_rows() {
    const FLIP: &str = "found[at] = image[(pass_.height - 1u - y) * pass_.width + id.x];";
    let mirrored = Reach::Rows(|rows| HEIGHT - rows.end..HEIGHT - rows.start);
    for reach in [Reach::All, mirrored] {
        let flip = move |view| {
            let uses = [Use::read(IMAGE).reaching(reach), Use::write(OUT)];
            pass("test flip", view, READS, per_pixel("test flip", FLIP)).uses(uses)
        };
        let passes = move |_: &FrameSpec, view| vec![fill(view, IMAGE), flip(view)];
        check(1, passes, |eye, x, y, frame| value(eye, x, HEIGHT - 1 - y, frame));
    }
}

#[test]
fn pass_once_runs_once_on_each_device() {
    const TABLE: Resource = Resource::table::<u32>("test table", Extent { width: 16, height: 1 }).bound_as("table");
    const MAKE: &str = "
//!include frame bindings
@compute @workgroup_size(4)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    table[id.x] = id.x * id.x + frame.sampling.index;
}";
    const LOOK_UP: &str = "found[at] = table[(id.x + y) % 16u];";
    let passes = |_: &FrameSpec, view| {
        let make = kernel("test make", MAKE, [4, 1, 1]);
        let make = Pass::once(Stage("test make"), WRITES, make, [4, 1, 1]).uses([Use::write(TABLE)]);
        let look_up = per_pixel("test look up", LOOK_UP);
        vec![make, pass("test look up", view, READS, look_up).uses([Use::read(TABLE), Use::write(OUT)])]
    };
    check(2, passes, |_, x, y, frame| ((x + y) % 16).pow(2) + frame);
}

/// WGSL defines the result of division by 0, but only run-time checks enforce it on every device.
#[test]
fn custom_shaders_run_with_all_runtime_checks() {
    const DIVIDE: &str = "found[at] = (id.x + 100u * y + 1u) / frame.sampling.index;";
    let divide = |_: &FrameSpec, view| {
        vec![pass("test divide", view, WRITES, per_pixel("test divide", DIVIDE)).uses([Use::write(OUT)])]
    };
    check(2, divide, |_, x, y, frame| (x + 100 * y + 1) / frame.max(1));
}

/// Tests versions of an image, and history of another image from whichever device had its rows.
#[test]
fn passes_read_image_versions_and_history() {
    const COUNT: Resource = Resource::image::<u32>("test count").bound_as("count");
    const ADD: &str = "
    var known = 0u;
    if frame.history.rows != NO_HISTORY {
        known = before[at];
    }
    count[at] = known + 1u;
    next[at] = source[at] + known + 1u;";
    let passes = |spec: &FrameSpec, view| {
        let first = Image::from(IMAGE);
        let uses = [
            Use::read(COUNT).before(spec.history_halo()).named("before"),
            Use::read(first).named("source"),
            Use::write(COUNT),
            Use::write(first.next()).named("next"),
        ];
        let add = pass("test add", view, READS, per_pixel("test add", ADD)).uses(uses);
        let copy = pass("test copy", view, WRITES, per_pixel("test copy", "found[at] = source[at];"));
        vec![fill(view, first), add, copy.uses([Use::read(first.next()).named("source"), Use::write(OUT)])]
    };
    check(4, passes, |eye, x, y, frame| value(eye, x, y, frame) + frame + 1);
}
