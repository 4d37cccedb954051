//! Sums the counts of pixels by row.

use super::camera::Constants;
use super::harness::{Buffer, Kernel, Stripe};
use super::inputs::{Cases, Random};
use super::pack::Counts;

const HEIGHT: u32 = 11;
/// Number of pixels that one invocation sums.
const SEGMENT: u32 = 64;

/// Rays, dropped samples, holes by reason 1 to 6, pixels left to the denoiser, clipped pixels.
type Row = [u32; 10];

fn sum(pixels: &[u32], cases: &mut Cases) -> Row {
    let mut row = Row::default();
    for counts in pixels.iter().map(|&bits| Counts::unpack(bits)) {
        row[0] += counts.rays;
        row[1] += counts.dropped;
        row[9] += u32::from(counts.clipped);
        match counts.why {
            0 => cases.meet("no hole"),
            1..=6 => {
                cases.meet("hole");
                row[1 + counts.why as usize] += 1;
            }
            _ => {
                cases.meet("left to the denoiser");
                row[8] += 1;
            }
        }
    }
    row
}

fn compare(width: u32, seed: u64) {
    let mut random = Random::new(seed);
    let constants = Constants::new(width, HEIGHT);
    let mut pixel = || Counts {
        rays: random.pick(&[0, 1, 7, 900, 0xf_ffff]),
        dropped: random.pick(&[0, 0, 1, 255]),
        why: random.pick(&[0, 0, 1, 2, 3, 4, 5, 6, 7]),
        clipped: random.pick(&[false, false, true]),
    };
    let tally: Vec<u32> = (0..constants.area()).map(|_| pixel().pack()).collect();
    // The kernel adds to existing sums.
    let before: Vec<Row> = (0..HEIGHT).map(|y| std::array::from_fn(|i| 1000 * y + i as u32)).collect();
    let mut cases = Cases::default();
    for rows in [0..HEIGHT, 3..10, 4..5] {
        let stripe = Stripe { rows: rows.clone(), valid: rows };
        let buffers = [("tally_image", stripe.own(width, &tally)), ("row_tally", Buffer::image(&before))];
        let columns = width.div_ceil(SEGMENT);
        let outputs = Kernel::new("tally", &[]).run(&constants, stripe.pass(0, [0; 3]), columns, &buffers);
        let after = outputs.get::<Row>("row_tally");
        for y in stripe.rows {
            let pixels = &tally[constants.index(0, y)..constants.index(0, y + 1)];
            let sums = sum(pixels, &mut cases);
            let expected: Row = std::array::from_fn(|i| before[y as usize][i] + sums[i]);
            assert_eq!(after[y as usize], expected, "row {y}");
        }
    }
    cases.assert_met(&["no hole", "hole", "left to the denoiser"]);
}

#[test]
fn counts_are_summed_by_rows() {
    // One workgroup's maximum number of segments, then a partial segment.
    compare(8 * SEGMENT, 31);
    compare(2 * SEGMENT + 5, 32);
    compare(7, 33);
}
