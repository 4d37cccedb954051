//! Spatial filters, which read guides and light around each pixel.

use super::camera::Constants;
use super::edges::Surface;
use super::harness::{Buffer, Kernel, Stripe};
use super::inputs::Random;

/// Unpacked inputs of a filter, and its packed result.
pub struct Filter<'a, L> {
    pub constants: &'a Constants,
    pub stripe: &'a Stripe,
    pub view: usize,
    pub guide: Vec<Option<Surface>>,
    pub source: Vec<L>,
    pub filtered: Vec<[u32; 4]>,
}

impl<'a, L> Filter<'a, L> {
    /// Filters light, which `unpack` unpacks.
    pub fn run(
        kernel: &Kernel,
        random: &mut Random,
        (constants, stripe, view): (&'a Constants, &'a Stripe, usize),
        args: [u32; 3],
        [guide, source]: [&[[u32; 4]]; 2],
        unpack: impl Fn([u32; 4]) -> L,
    ) -> Self {
        let width = constants.width;
        let buffers = [
            ("guide_image", stripe.valid(width, guide)),
            ("source", stripe.valid(width, source)),
            ("filtered", Buffer::image(&random.rubbish::<4>(constants.area()))),
        ];
        let filtered = kernel.run(constants, stripe.pass(view, args), width, &buffers).get("filtered");
        let guide = guide.iter().map(|bits| Surface::unpack(*bits)).collect();
        Self { constants, stripe, view, guide, source: source.iter().map(|bits| unpack(*bits)).collect(), filtered }
    }
}
