//! Spatial filters, which read guides and light around each pixel.

use super::camera::Constants;
use super::edges::Surface;
use super::harness::{Buffer, Kernel, Stripe};
use super::inputs::Random;
use super::mask_compaction::list_of;

/// Number of listed pixels that one workgroup filters.
pub const UNFINISHED_GROUP: u32 = 64;
/// Index of the argument that selects a part of the list; 0 filters all pixels.
const LIST_PART: usize = 0;

/// Unpacked inputs of a filter, and its packed result.
pub struct Filter<'a, L> {
    pub constants: &'a Constants,
    pub stripe: &'a Stripe,
    pub view: usize,
    pub guide: Vec<Option<Surface>>,
    pub source: Vec<L>,
    /// The result, and what it was before.
    pub filtered: Vec<[u32; 4]>,
    pub before: Vec<[u32; 4]>,
}

impl<'a, L> Filter<'a, L> {
    /// Filters light, which `unpack` unpacks: of all pixels or, for kernels that can filter a list, of the listed ones.
    pub fn run(
        kernel: &Kernel,
        random: &mut Random,
        (constants, stripe, view): (&'a Constants, &'a Stripe, usize),
        args: [u32; 3],
        [guide, source]: [&[[u32; 4]]; 2],
        listed: Option<&[u32]>,
        unpack: impl Fn([u32; 4]) -> L,
    ) -> Self {
        let width = constants.width;
        let before = random.rubbish::<4>(constants.area());
        let mut buffers = vec![
            ("guide_image", stripe.valid(width, guide)),
            ("source", stripe.valid(width, source)),
            ("filtered", Buffer::image(&before)),
        ];
        let pass = stripe.pass(view, args);
        buffers.extend(listed.map(|listed| ("listed", Buffer::whole(&list_of(listed, UNFINISHED_GROUP)))));
        let groups = listed
            .filter(|_| args[LIST_PART] != 0)
            .map(|listed| listed.len().div_ceil(UNFINISHED_GROUP as usize) as u32);
        let outputs = match groups {
            None => kernel.run(constants, pass, width, &buffers),
            Some(groups) => kernel.run_groups(constants, pass, [groups, 1], &buffers),
        };
        let filtered = outputs.get("filtered");
        let guide = guide.iter().map(|bits| Surface::unpack(*bits)).collect();
        Self {
            constants,
            stripe,
            view,
            guide,
            source: source.iter().map(|bits| unpack(*bits)).collect(),
            filtered,
            before,
        }
    }
}

/// Returns half of the pixels that are not finished.
pub fn listed(random: &mut Random, area: usize, is_finished: impl Fn(usize) -> bool) -> Vec<u32> {
    (0..area).filter(|at| !is_finished(*at) && random.chance(0.5)).map(|at| at as u32).collect()
}
