//! Adds records of reflected light to the cells of the radiance cache.

use glam::DVec3;

use super::camera::Constants;
use super::harness::{Buffer, Kernel};
use super::inputs::{Cases, Random};

const SLOTS: u32 = 64;
const RECORDS: u32 = 3000;

/// Number of reflections of a frame's paths, which is that of [`Constants::frame`].
const REFLECTIONS: u32 = 0;

/// First kernel arguments of `cache_sums`.
const CLAIM: u32 = 0;
const ADD: u32 = 1;

/// Samples that a mean remembers, and frames without samples after which a cell loses its slot. A cell of paths with
/// another number of reflections may lose it sooner, to another cell.
const MOST_SAMPLES: f64 = 256.0;
const MOST_AGE: u32 = 64;
const MOST_AGE_OF_OTHERS: u32 = 4;

#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    key: u32,
    samples: f64,
    age: u32,
    reflections: u32,
    /// Sum of light over sum of albedo, and that sum of albedo.
    light: DVec3,
    albedo: DVec3,
}

impl Cell {
    fn pack(self) -> [[u32; 4]; 3] {
        let row = |color: DVec3| color.extend(0.0).as_vec4().to_array().map(f32::to_bits);
        let first = [self.key, (self.samples as f32).to_bits(), self.age, self.reflections];
        [first, row(self.light), row(self.albedo)]
    }

    fn unpack([[key, samples, age, reflections], light, albedo]: [[u32; 4]; 3]) -> Self {
        let color = |[r, g, b, _]: [u32; 4]| DVec3::from_array([r, g, b].map(|bits| f64::from(f32::from_bits(bits))));
        let samples = f32::from_bits(samples).into();
        Self { key, samples, age, reflections, light: color(light), albedo: color(albedo) }
    }
}

/// A record of light and albedo, both packed, for the cell with a key.
type Record = [u32; 3];

/// A channel of packed light or albedo, in units of 2^-24.
fn units(packed: u32, channel: u32) -> u128 {
    u128::from((packed >> (9 * channel)) & 511) << (packed >> 27)
}

/// Returns the cell that holds a slot after the records of a frame.
fn renewed(tenant: Cell, records: &[Record], reflections: u32, cases: &mut Cases) -> Cell {
    let is_live = tenant.key != 0 && tenant.age < MOST_AGE;
    let newest = records.iter().map(|[key, ..]| *key).max().unwrap_or(0);
    let yields = tenant.reflections != reflections && tenant.age >= MOST_AGE_OF_OTHERS;
    let before = match (is_live, yields, newest) {
        (true, false, _) => tenant,
        (true, true, 0) => {
            cases.meet("a cell of other paths that stays");
            tenant
        }
        (true, true, key) => {
            cases.meet("a cell of other paths that goes");
            Cell { key, reflections, ..Cell::default() }
        }
        (false, _, 0) => Cell::default(),
        (false, _, key) => Cell { key, reflections, ..Cell::default() },
    };
    cases.meet(if is_live { "a cell that stays" } else { "an empty slot" });
    let key = before.key;
    let own: Vec<&Record> = records.iter().filter(|[of, ..]| *of == key).collect();
    cases.meet(if own.len() < records.len() { "a record without a slot" } else { "all records have the slot" });
    if own.is_empty() {
        cases.meet("no record");
        return Cell { age: before.age + 1, ..before };
    }
    let mut sum = |word: usize| {
        DVec3::from_array(std::array::from_fn(|channel| {
            let sum = own.iter().map(|record| units(record[word], channel as u32)).sum::<u128>();
            cases.meet(if sum >> 32 == 0 { "one word" } else { "two words" });
            sum as f64 / 2f64.powi(24)
        }))
    };
    let (light, reflected) = (sum(1), sum(2));
    let kept = before.samples.min(MOST_SAMPLES);
    let old = before.albedo * (kept / before.samples.max(1.0));
    let albedo = old + reflected;
    let all = before.light * old + light;
    let light = DVec3::from_array(std::array::from_fn(|c| if albedo[c] > 1e-6 { all[c] / albedo[c] } else { 0.0 }));
    if albedo.min_element() <= 1e-6 {
        cases.meet("a black cell");
    }
    Cell { samples: kept + own.len() as f64, age: 0, light, albedo, ..before }
}

fn compare(history_rows: Option<u32>, seed: u64) {
    let mut random = Random::new(seed);
    let constants = Constants { history_rows, ..Constants::new(8, 8) };
    // Three cells share each slot.
    let key = |random: &mut Random, slot: u32| slot + SLOTS * random.pick(&[1, 2, 0x2aa_aaaa]);
    let last: Vec<Cell> = (0..SLOTS)
        .map(|slot| {
            let cell = Cell {
                key: key(&mut random, slot),
                samples: random.pick(&[1.0, 3.0, 255.0, 256.0, 900.0]),
                age: random.pick(&[0, 1, MOST_AGE_OF_OTHERS, MOST_AGE - 1, MOST_AGE, MOST_AGE + 1]),
                reflections: random.pick(&[REFLECTIONS, REFLECTIONS, 3]),
                light: random.color(3.0),
                albedo: random.color(90.0),
            };
            if random.chance(0.3) { Cell::default() } else { cell }
        })
        .collect();
    let records: Vec<Record> = (0..RECORDS)
        .map(|_| {
            let slot = random.bits() % (SLOTS - 16);
            let exponent = random.pick(&[0, 10, 15, 23, 31]);
            let light = (random.bits() & 0x7ff_ffff) | (exponent << 27);
            // Some cells are red alone.
            let albedo = if slot.is_multiple_of(4) { 0x7800_01ff } else { random.bits() & 0x7fff_ffff };
            if random.chance(0.2) { [0, light, albedo] } else { [key(&mut random, slot), light, albedo] }
        })
        .collect();
    let packed: Vec<_> = last.iter().map(|cell| cell.pack()).collect();
    let sum = |step: u32, sums: &[[u32; 16]]| {
        let buffers = [
            ("last_cache", Buffer::whole(&packed)),
            ("cache_sums", Buffer::whole(sums)),
            ("records", Buffer::whole(&records)),
        ];
        let outputs = Kernel::new("cache_sums", &[]).run_once(&constants.frame(), [step, RECORDS, 0], [1, 1], &buffers);
        outputs.get::<[u32; 16]>("cache_sums")
    };
    let sums = sum(ADD, &sum(CLAIM, &[[0; 16]; SLOTS as usize]));
    let buffers = [
        ("last_cache", Buffer::whole(&packed)),
        ("cache_sums", Buffer::whole(&sums)),
        ("cache", Buffer::whole(&[[[u32::MAX; 4]; 3]; SLOTS as usize])),
    ];
    let outputs = Kernel::new("radiance_cache", &[]).run_once(&constants.frame(), [0; 3], [SLOTS / 64, 1], &buffers);
    let mut cases = Cases::default();
    for (slot, found) in outputs.get::<[[u32; 4]; 3]>("cache").into_iter().map(Cell::unpack).enumerate() {
        let own: Vec<_> = records.iter().copied().filter(|r| r[0] != 0 && (r[0] % SLOTS) as usize == slot).collect();
        let tenant = if history_rows.is_some() { last[slot] } else { Cell::default() };
        let expected = renewed(tenant, &own, REFLECTIONS, &mut cases);
        let named = |cell: Cell| (cell.key, cell.samples, cell.age, cell.reflections);
        assert_eq!(named(found), named(expected), "slot {slot}");
        let is_near = |a: DVec3, b: DVec3| (a - b).abs().cmple(2e-6 * b + 1e-12).all();
        let agrees = is_near(found.light, expected.light) && is_near(found.albedo, expected.albedo);
        assert!(agrees, "slot {slot}: {found:?} and not {expected:?}");
    }
    let met = ["an empty slot", "a record without a slot", "all records have the slot", "no record", "two words"];
    cases.assert_met(&met);
    cases.assert_met(&["a black cell"]);
    if history_rows.is_some() {
        cases.assert_met(&["a cell that stays", "a cell of other paths that stays", "a cell of other paths that goes"]);
    }
}

#[test]
fn cache_sums_records_in_integers_and_renews_cells() {
    compare(Some(0), 51);
    compare(None, 52);
}
