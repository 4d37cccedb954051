//! Adds records of reflected light to the cells of the radiance cache.

use glam::DVec3;

use super::camera::Constants;
use super::harness::{Buffer, Kernel};
use super::inputs::{Cases, Random};

const SLOTS: u32 = 64;
const RECORDS: u32 = 3000;

/// First kernel arguments of `cache_sums`.
const CLAIM: u32 = 0;
const ADD: u32 = 1;

/// Samples that a mean remembers, and frames without samples after which a cell loses its slot.
const MOST_SAMPLES: f64 = 256.0;
const MOST_AGE: u32 = 64;

#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    key: u32,
    samples: f64,
    age: u32,
    light: DVec3,
}

impl Cell {
    fn pack(self) -> [[u32; 4]; 2] {
        let [r, g, b] = self.light.as_vec3().to_array().map(f32::to_bits);
        [[self.key, (self.samples as f32).to_bits(), self.age, 0], [r, g, b, 0]]
    }

    fn unpack([[key, samples, age, _], [r, g, b, _]]: [[u32; 4]; 2]) -> Self {
        let light = [r, g, b].map(|bits| f64::from(f32::from_bits(bits)));
        Self { key, samples: f32::from_bits(samples).into(), age, light: DVec3::from_array(light) }
    }
}

/// A channel of packed light, in units of 2^-24.
fn units(packed: u32, channel: u32) -> u128 {
    u128::from((packed >> (9 * channel)) & 511) << (packed >> 27)
}

/// Returns the cell that holds a slot after the records of a frame. `scale` is the factor from light to what is packed.
fn renewed(tenant: Cell, records: &[[u32; 2]], scale: f64, cases: &mut Cases) -> Cell {
    let is_kept = tenant.key != 0 && tenant.age < MOST_AGE;
    cases.meet(if is_kept { "a cell that stays" } else { "an empty slot" });
    let before = if is_kept { tenant } else { Cell::default() };
    let newest = records.iter().map(|[key, _]| *key).max().unwrap_or(0);
    let key = if is_kept { before.key } else { newest };
    let own: Vec<u32> = records.iter().filter(|[of, _]| *of == key).map(|[_, light]| *light).collect();
    cases.meet(if own.len() < records.len() { "a record without a slot" } else { "all records have the slot" });
    if own.is_empty() {
        cases.meet("no record");
        return Cell { key, age: before.age + 1, ..before };
    }
    let count = own.len() as f64;
    let mean = std::array::from_fn(|channel| {
        let sum = own.iter().map(|light| units(*light, channel as u32)).sum::<u128>();
        cases.meet(if sum >> 32 == 0 { "one word" } else { "two words" });
        sum as f64 / (count * 2f64.powi(24) * scale)
    });
    let samples = before.samples.min(MOST_SAMPLES);
    let light = before.light.lerp(DVec3::from_array(mean), count / (samples + count));
    Cell { key, samples: samples + count, age: 0, light }
}

fn compare(history_rows: Option<u32>, seed: u64) {
    let mut random = Random::new(seed);
    let constants = Constants { history_rows, exposure: 1.3, ..Constants::new(8, 8) };
    let scale = f64::from(constants.storage_scale());
    // Three cells share each slot.
    let key = |random: &mut Random, slot: u32| slot + SLOTS * random.pick(&[1, 2, 0x2aa_aaaa]);
    let last: Vec<Cell> = (0..SLOTS)
        .map(|slot| {
            let cell = Cell {
                key: key(&mut random, slot),
                samples: random.pick(&[1.0, 3.0, 255.0, 256.0, 900.0]),
                age: random.pick(&[0, 1, MOST_AGE - 1, MOST_AGE, MOST_AGE + 1]),
                light: random.color(3.0),
            };
            if random.chance(0.3) { Cell::default() } else { cell }
        })
        .collect();
    let records: Vec<[u32; 2]> = (0..RECORDS)
        .map(|_| {
            let slot = random.bits() % (SLOTS - 4);
            let exponent = random.pick(&[0, 10, 15, 23, 31]);
            let light = (random.bits() & 0x7ff_ffff) | (exponent << 27);
            if random.chance(0.2) { [0, light] } else { [key(&mut random, slot), light] }
        })
        .collect();
    let packed: Vec<_> = last.iter().map(|cell| cell.pack()).collect();
    let sum = |step: u32, sums: &[[u32; 8]]| {
        let buffers = [
            ("last_cache", Buffer::whole(&packed)),
            ("cache_sums", Buffer::whole(sums)),
            ("records", Buffer::whole(&records)),
        ];
        let outputs = Kernel::new("cache_sums", &[]).run_once(&constants.frame(), [step, RECORDS, 0], [1, 1], &buffers);
        outputs.get::<[u32; 8]>("cache_sums")
    };
    let sums = sum(ADD, &sum(CLAIM, &[[0; 8]; SLOTS as usize]));
    let buffers = [
        ("last_cache", Buffer::whole(&packed)),
        ("cache_sums", Buffer::whole(&sums)),
        ("cache", Buffer::whole(&[[[u32::MAX; 4]; 2]; SLOTS as usize])),
    ];
    let outputs = Kernel::new("radiance_cache", &[]).run_once(&constants.frame(), [0; 3], [SLOTS / 64, 1], &buffers);
    let mut cases = Cases::default();
    for (slot, found) in outputs.get::<[[u32; 4]; 2]>("cache").into_iter().map(Cell::unpack).enumerate() {
        let own: Vec<_> = records.iter().copied().filter(|r| r[0] != 0 && (r[0] % SLOTS) as usize == slot).collect();
        let tenant = if history_rows.is_some() { last[slot] } else { Cell::default() };
        let expected = renewed(tenant, &own, scale, &mut cases);
        let named = |cell: Cell| (cell.key, cell.samples, cell.age);
        assert_eq!(named(found), named(expected), "slot {slot}");
        let off = (found.light - expected.light).abs();
        assert!(off.cmple(1e-6 * expected.light + 1e-12).all(), "slot {slot}: {found:?} and not {expected:?}");
    }
    cases.assert_met(&[
        "an empty slot",
        "a record without a slot",
        "all records have the slot",
        "no record",
        "two words",
    ]);
    if history_rows.is_some() {
        cases.assert_met(&["a cell that stays"]);
    }
}

#[test]
fn records_are_summed_in_integers_and_cells_are_renewed() {
    compare(Some(0), 51);
    compare(None, 52);
}
